//! What a pass says about itself.

use super::{
    access::Access,
    declaration::{Clear, Origin, PassDecl, Shape, Use},
    desc::{BufferDesc, Extent, ImageDesc},
    error::GraphError,
    handle::{Buffer, Copyable, Handle, Image, Kind, Tlas, WriteHandle},
    pass::FrameGraph,
    token::{
        BufferToken, ColorToken, CopySource, CopyTarget, DepthToken, IndexToken, IndirectToken, SampleToken,
        StorageToken, TraceToken,
    },
};

/// Declares the uses of one pass. What is declared here, and only that, can be used while recording.
pub struct PassBuilder<'g> {
    pub(super) graph: &'g mut FrameGraph,
    pub(super) pass: u32,
}

impl PassBuilder<'_> {
    // New images and buffers.

    /// Makes an image that the pass writes as a storage image.
    pub fn create(&mut self, name: &str, desc: ImageDesc) -> (WriteHandle<Image>, StorageToken) {
        let handle = self.make_image(name, desc, Access::StorageWrite, None);
        let token = StorageToken { resource: handle.at.id, pass: self.pass };
        (handle, token)
    }

    /// Makes an image that is a colour attachment, cleared to `clear`. For unsigned formats these are whole numbers.
    pub fn color(&mut self, name: &str, desc: ImageDesc, clear: [f32; 4]) -> (WriteHandle<Image>, ColorToken) {
        let handle = self.make_image(name, desc, Access::Color, Some(Clear::Color(clear)));
        let token = ColorToken { resource: handle.at.id, pass: self.pass };
        (handle, token)
    }

    /// Makes an image that is the depth attachment, cleared to `clear`: 0 is infinitely far.
    pub fn depth(&mut self, name: &str, desc: ImageDesc, clear: f32) -> (WriteHandle<Image>, DepthToken) {
        let handle = self.make_image(name, desc, Access::Depth, Some(Clear::Depth(clear)));
        let token = DepthToken { resource: handle.at.id, pass: self.pass };
        (handle, token)
    }

    /// Makes a buffer that the pass writes in a shader.
    pub fn create_buffer(&mut self, name: &str, desc: BufferDesc) -> (WriteHandle<Buffer>, BufferToken) {
        let shape = self.graph.buffer_shape(name, desc);
        let handle = self.make(name, shape, Access::BufferWrite, None);
        let token = BufferToken { resource: handle.at.id, pass: self.pass };
        (handle, token)
    }

    // Further versions.

    /// Draws over a colour attachment.
    pub fn color_load(&mut self, image: WriteHandle<Image>) -> (WriteHandle<Image>, ColorToken) {
        let token = ColorToken { resource: image.at.id, pass: self.pass };
        (self.change(image, Access::ColorLoad), token)
    }

    /// Draws over a depth attachment.
    pub fn depth_load(&mut self, image: WriteHandle<Image>) -> (WriteHandle<Image>, DepthToken) {
        let token = DepthToken { resource: image.at.id, pass: self.pass };
        (self.change(image, Access::DepthLoad), token)
    }

    /// Reads and writes a storage image. One that was imported without contents must be written everywhere.
    pub fn write(&mut self, image: WriteHandle<Image>) -> (WriteHandle<Image>, StorageToken) {
        let token = StorageToken { resource: image.at.id, pass: self.pass };
        (self.change(image, Access::StorageReadWrite), token)
    }

    /// Reads and writes a buffer in a shader.
    pub fn write_buffer(&mut self, buffer: WriteHandle<Buffer>) -> (WriteHandle<Buffer>, BufferToken) {
        let token = BufferToken { resource: buffer.at.id, pass: self.pass };
        (self.change(buffer, Access::BufferReadWrite), token)
    }

    /// Copies to an image or a buffer; what the copy leaves out is kept.
    pub fn copy_to<K: Copyable>(&mut self, target: WriteHandle<K>) -> (WriteHandle<K>, CopyTarget) {
        let token = CopyTarget { resource: target.at.id, pass: self.pass };
        (self.change(target, Access::CopyWrite), token)
    }

    // Reads.

    /// Samples an image, or fetches its texels.
    pub fn sample(&mut self, image: Handle<Image>) -> SampleToken {
        SampleToken { resource: self.see(image, Access::Sample), pass: self.pass }
    }

    /// Reads a storage image.
    pub fn storage(&mut self, image: Handle<Image>) -> StorageToken {
        StorageToken { resource: self.see(image, Access::StorageRead), pass: self.pass }
    }

    /// Reads a buffer in a shader.
    pub fn read(&mut self, buffer: Handle<Buffer>) -> BufferToken {
        BufferToken { resource: self.see(buffer, Access::BufferRead), pass: self.pass }
    }

    /// Takes the indices of a draw from a buffer.
    pub fn index(&mut self, buffer: Handle<Buffer>) -> IndexToken {
        IndexToken { resource: self.see(buffer, Access::Index), pass: self.pass }
    }

    /// Takes the arguments of an indirect draw or dispatch from a buffer.
    pub fn indirect(&mut self, buffer: Handle<Buffer>) -> IndirectToken {
        IndirectToken { resource: self.see(buffer, Access::Indirect), pass: self.pass }
    }

    /// Traces rays through an acceleration structure.
    pub fn trace(&mut self, tlas: Handle<Tlas>) -> TraceToken {
        TraceToken { resource: self.see(tlas, Access::Trace), pass: self.pass }
    }

    /// Copies from an image or a buffer.
    pub fn copy_from<K: Copyable>(&mut self, source: Handle<K>) -> CopySource {
        CopySource { resource: self.see(source, Access::CopyRead), pass: self.pass }
    }

    // Questions.

    /// What an image is like; its size is given as that of the image itself.
    pub fn desc(&self, image: Handle<Image>) -> ImageDesc {
        self.graph.desc(image)
    }

    /// Size of an image, pixels.
    pub fn extent(&self, image: Handle<Image>) -> Extent {
        self.graph.extent(image)
    }

    /// Size that an image of this description has or would have, pixels.
    pub fn extent_of(&self, desc: ImageDesc) -> Extent {
        self.graph.extent_of(desc)
    }

    // How it is noted.

    fn make_image(&mut self, name: &str, desc: ImageDesc, access: Access, clear: Option<Clear>) -> WriteHandle<Image> {
        let shape = self.graph.image_shape(name, desc);
        self.make(name, shape, access, clear)
    }

    fn make<K: Kind>(&mut self, name: &str, shape: Shape, access: Access, clear: Option<Clear>) -> WriteHandle<K> {
        let full_name = format!("{}:{name}", self.decl().name);
        let resource = self.graph.add_resource(full_name, shape, Origin::Transient, Some(self.pass));
        self.check_format(resource, access);
        self.graph.name_output(self.pass, name, resource, 0);
        self.decl_mut().uses.push(Use { resource, access, reads: None, writes: Some(0), clear });
        WriteHandle::new(self.graph.handle(resource, 0))
    }

    fn change<K: Kind>(&mut self, handle: WriteHandle<K>, access: Access) -> WriteHandle<K> {
        let (resource, version) = (handle.at.id, handle.at.version);
        self.graph.assert_own(handle.at);
        self.check_format(resource, access);
        if access.is_attachment() {
            // A storage write or a copy may replace everything; an attachment that is not cleared shows what was there.
            self.check_contents(resource, version, access);
        }
        if self.check_together(resource, access) {
            let name = self.name_of(resource);
            self.graph.name_output(self.pass, &name, resource, version + 1);
        }
        self.graph.declaration.resources[resource as usize].writers.push(Some(self.pass));
        let new = Use { resource, access, reads: Some(version), writes: Some(version + 1), clear: None };
        self.decl_mut().uses.push(new);
        WriteHandle::new(self.graph.handle(resource, version + 1))
    }

    /// Notes a read and gives the index of what is read.
    fn see<K: Kind>(&mut self, handle: Handle<K>, access: Access) -> u32 {
        let (resource, version) = (handle.id, handle.version);
        self.graph.assert_own(handle);
        let new = Use { resource, access, reads: Some(version), writes: None, clear: None };
        if self.decl().uses.contains(&new) {
            return resource; // Declared twice, which is no more than once.
        }
        self.check_format(resource, access);
        if self.check_together(resource, access) {
            self.check_fresh(resource, version, access);
            self.check_contents(resource, version, access);
        }
        self.decl_mut().uses.push(new);
        resource
    }

    fn decl(&self) -> &PassDecl {
        &self.graph.declaration.passes[self.pass as usize]
    }

    fn decl_mut(&mut self) -> &mut PassDecl {
        &mut self.graph.declaration.passes[self.pass as usize]
    }

    fn name_of(&self, resource: u32) -> String {
        self.graph.declaration.resources[resource as usize].name.clone()
    }

    fn check_format(&mut self, resource: u32, access: Access) {
        let Shape::Image { format, .. } = self.graph.declaration.resources[resource as usize].shape else { return };
        let suits = match access {
            Access::Color | Access::ColorLoad => !format.is_depth(),
            Access::Depth | Access::DepthLoad => format.is_depth(),
            Access::StorageRead | Access::StorageWrite | Access::StorageReadWrite => format.is_storable(),
            _ => true,
        };
        if !suits {
            let (pass, resource) = (self.decl().name.clone(), self.name_of(resource));
            self.graph.errors.push(GraphError::Format { pass, resource, access, format });
        }
    }

    /// Whether this use goes with those of the same resource that the pass has declared already: buffers may be read in
    /// several ways at once, images have one layout at a time, and nothing is both read and written.
    fn check_together(&mut self, resource: u32, access: Access) -> bool {
        let goes = |other: Access| {
            let only_read = !access.writes() && !other.writes();
            only_read && access.layout() == other.layout()
        };
        let clash = self.decl().uses.iter().find(|u| u.resource == resource && !goes(u.access)).map(|u| u.access);
        if let Some(first) = clash {
            let (pass, resource) = (self.decl().name.clone(), self.name_of(resource));
            self.graph.errors.push(GraphError::Conflict { pass, resource, first, second: access });
        }
        clash.is_none()
    }

    fn check_fresh(&mut self, resource: u32, version: u32, access: Access) {
        let declaration = &self.graph.declaration;
        let writers = &declaration.resources[resource as usize].writers;
        let newest = writers.len() as u32 - 1;
        if version == newest {
            return;
        }
        let later = writers[newest as usize].map(|w| &declaration.passes[w as usize]);
        let written = later.and_then(|p| p.uses.iter().find(|u| u.resource == resource && u.writes == Some(newest)));
        if let (Some(later), Some(written)) = (later, written) {
            let (pass, resource) = (self.decl().name.clone(), self.name_of(resource));
            let (writer, written) = (later.name.clone(), written.access);
            self.graph.errors.push(GraphError::StaleRead { pass, resource, access, version, newest, writer, written });
        }
    }

    fn check_contents(&mut self, resource: u32, version: u32, access: Access) {
        let decl = &self.graph.declaration.resources[resource as usize];
        if version == 0 && decl.is_undefined() {
            let (pass, resource) = (self.decl().name.clone(), self.name_of(resource));
            self.graph.errors.push(GraphError::Unwritten { pass, resource, access });
        }
    }
}
