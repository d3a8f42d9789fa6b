//! Declaring what one pass uses.

use super::{
    access::Access,
    declaration::{Clear, Origin, Shape, Use},
    desc::{BufferDesc, Extent, ImageDesc, Part},
    error::GraphError,
    handle::{Accel, Blas, Buffer, BuildInput, Copyable, Handle, Image, Kind, Tlas, WriteHandle},
    pass::FrameGraph,
    token::{
        BufferToken, BuildInputToken, BuildToken, ColorToken, CopySource, CopyTarget, DepthToken, IndexToken,
        IndirectToken, SampleToken, ScratchToken, StorageToken, TraceToken,
    },
};

/// Declares the uses of one pass. The pass can use nothing else while it records.
pub struct PassBuilder<'g> {
    pub(super) graph: &'g mut FrameGraph,
    pub(super) pass: u32,
    /// Index of the pass's first use in the declaration.
    pub(super) first_use: usize,
}

impl PassBuilder<'_> {
    // New images and buffers.

    /// Makes an image that the pass writes as a storage image.
    pub fn create(&mut self, name: &str, desc: ImageDesc) -> (WriteHandle<Image>, StorageToken) {
        self.create_part(name, desc, Part::ALL)
    }

    /// Makes an image that is a colour attachment, cleared to `clear`. For unsigned formats the channels are truncated to integers.
    pub fn color(&mut self, name: &str, desc: ImageDesc, clear: [f32; 4]) -> (WriteHandle<Image>, ColorToken) {
        let handle = self.make_image(name, desc, Access::Color, Some(Clear::Color(clear)));
        let token = ColorToken { resource: handle.at.id, pass: self.pass };
        (handle, token)
    }

    /// Makes an image that is the depth attachment, cleared to `clear`; depth is reversed, so 0 is infinitely far.
    pub fn depth(&mut self, name: &str, desc: ImageDesc, clear: f32) -> (WriteHandle<Image>, DepthToken) {
        let handle = self.make_image(name, desc, Access::Depth, Some(Clear::Depth(clear)));
        let token = DepthToken { resource: handle.at.id, pass: self.pass };
        (handle, token)
    }

    /// Makes an image of which the pass writes one part as a storage image; later passes write the rest.
    pub fn create_part(&mut self, name: &str, desc: ImageDesc, part: Part) -> (WriteHandle<Image>, StorageToken) {
        let shape = self.graph.image_shape(name, desc);
        let handle = self.make(name, shape, Access::StorageWrite, part, None);
        let token = StorageToken { resource: handle.at.id, pass: self.pass, part: self.last_part() };
        (handle, token)
    }

    /// Makes a buffer that the pass writes in a shader.
    pub fn create_buffer(&mut self, name: &str, desc: BufferDesc) -> (WriteHandle<Buffer>, BufferToken) {
        let shape = self.graph.buffer_shape(name, desc);
        let handle = self.make(name, shape, Access::BufferWrite, Part::ALL, None);
        self.graph.note_content(handle.at.id, desc);
        let token = BufferToken { resource: handle.at.id, pass: self.pass };
        (handle, token)
    }

    /// Makes a buffer that the pass fills by copies: from the host, from images or from other buffers.
    pub fn fill_buffer(&mut self, name: &str, desc: BufferDesc) -> (WriteHandle<Buffer>, CopyTarget) {
        let shape = self.graph.buffer_shape(name, desc);
        let handle = self.make(name, shape, Access::CopyWrite, Part::ALL, None);
        self.graph.note_content(handle.at.id, desc);
        let token = CopyTarget { resource: handle.at.id, pass: self.pass };
        (handle, token)
    }

    /// Makes an acceleration structure of `bytes` bytes that the driver builds in this pass.
    pub fn build<K: Accel>(&mut self, name: &str, bytes: u64) -> (WriteHandle<K>, BuildToken) {
        let handle = self.make_accel(name, bytes, Access::Build);
        let token = BuildToken { resource: handle.at.id, pass: self.pass };
        (handle, token)
    }

    /// Makes an acceleration structure of `bytes` bytes whose nodes a shader writes.
    pub fn build_in_shader<K: Accel>(&mut self, name: &str, bytes: u64) -> (WriteHandle<K>, BufferToken) {
        let handle = self.make_accel(name, bytes, Access::BufferWrite);
        let token = BufferToken { resource: handle.at.id, pass: self.pass };
        (handle, token)
    }

    /// Builds an acceleration structure again in the same memory; its earlier contents are discarded.
    pub fn rebuild<K: Accel>(&mut self, accel: WriteHandle<K>) -> (WriteHandle<K>, BuildToken) {
        let token = BuildToken { resource: accel.at.id, pass: self.pass };
        (self.change(accel, Access::Build, Part::ALL), token)
    }

    /// Copies to an acceleration structure that is plain memory, not built by the driver.
    pub fn copy_to_accel<K: Accel>(&mut self, accel: WriteHandle<K>) -> (WriteHandle<K>, CopyTarget) {
        let token = CopyTarget { resource: accel.at.id, pass: self.pass };
        (self.change(accel, Access::CopyWrite, Part::ALL), token)
    }

    /// Writes the nodes of an acceleration structure in a shader; nodes that the shader does not write are kept.
    pub fn write_accel<K: Accel>(&mut self, accel: WriteHandle<K>) -> (WriteHandle<K>, BufferToken) {
        let token = BufferToken { resource: accel.at.id, pass: self.pass };
        (self.change(accel, Access::BufferReadWrite, Part::ALL), token)
    }

    /// Makes an acceleration structure of `bytes` bytes and compacts `source` into it.
    pub fn compact(
        &mut self,
        name: &str,
        source: Handle<Blas>,
        bytes: u64,
    ) -> (WriteHandle<Blas>, BuildInputToken, BuildToken) {
        let input = self.build_input(source);
        let (handle, token) = self.build(name, bytes);
        (handle, input, token)
    }

    /// Makes the scratch buffer of a build in this pass.
    pub fn scratch(&mut self, name: &str, desc: BufferDesc) -> ScratchToken {
        let shape = self.graph.buffer_shape(name, desc);
        let handle: WriteHandle<Buffer> = self.make(name, shape, Access::BuildScratch, Part::ALL, None);
        ScratchToken { resource: handle.at.id, pass: self.pass }
    }

    // New versions of existing resources.

    /// Draws to a colour attachment and keeps its contents.
    pub fn color_load(&mut self, image: WriteHandle<Image>) -> (WriteHandle<Image>, ColorToken) {
        let token = ColorToken { resource: image.at.id, pass: self.pass };
        (self.change(image, Access::ColorLoad, Part::ALL), token)
    }

    /// Draws to a colour attachment, cleared to `clear` first.
    pub fn color_over(&mut self, image: WriteHandle<Image>, clear: [f32; 4]) -> (WriteHandle<Image>, ColorToken) {
        let token = ColorToken { resource: image.at.id, pass: self.pass };
        self.graph.declaration.clears.push((self.graph.declaration.uses.len() as u32, Clear::Color(clear)));
        (self.change(image, Access::Color, Part::ALL), token)
    }

    /// Draws to a depth attachment and keeps its contents.
    pub fn depth_load(&mut self, image: WriteHandle<Image>) -> (WriteHandle<Image>, DepthToken) {
        let token = DepthToken { resource: image.at.id, pass: self.pass };
        (self.change(image, Access::DepthLoad, Part::ALL), token)
    }

    /// Draws into one layer of a depth image, cleared to `clear` first; the other layers keep their contents.
    pub fn depth_layer(
        &mut self,
        image: WriteHandle<Image>,
        layer: u32,
        clear: f32,
    ) -> (WriteHandle<Image>, DepthToken) {
        let token = DepthToken { resource: image.at.id, pass: self.pass };
        self.graph.declaration.clears.push((self.graph.declaration.uses.len() as u32, Clear::Depth(clear)));
        let part = Part { mip: 0, mips: 1, ..Part::layer(layer) };
        (self.change(image, Access::Depth, part), token)
    }

    /// Overwrites pixels of a storage image, which the pass does not read. The other pixels keep their contents. One that was imported
    /// without contents must be written in every pixel.
    pub fn overwrite(&mut self, image: WriteHandle<Image>) -> (WriteHandle<Image>, StorageToken) {
        let resource = image.at.id;
        let handle = self.change(image, Access::StorageWrite, Part::ALL);
        (handle, StorageToken { resource, pass: self.pass, part: self.last_part() })
    }

    /// Reads and writes a storage image. One that was imported without contents must be written in every pixel.
    pub fn write(&mut self, image: WriteHandle<Image>) -> (WriteHandle<Image>, StorageToken) {
        self.write_part(image, Part::ALL)
    }

    /// Reads and writes a part of a storage image. Reads of other parts must be declared before this.
    pub fn write_part(&mut self, image: WriteHandle<Image>, part: Part) -> (WriteHandle<Image>, StorageToken) {
        let resource = image.at.id;
        let handle = self.change(image, Access::StorageReadWrite, part);
        (handle, StorageToken { resource, pass: self.pass, part: self.last_part() })
    }

    /// Reads and writes a buffer in a shader.
    pub fn write_buffer(&mut self, buffer: WriteHandle<Buffer>) -> (WriteHandle<Buffer>, BufferToken) {
        let token = BufferToken { resource: buffer.at.id, pass: self.pass };
        (self.change(buffer, Access::BufferReadWrite, Part::ALL), token)
    }

    /// Copies to an image or a buffer; what the copy does not cover is kept.
    pub fn copy_to<K: Copyable>(&mut self, target: WriteHandle<K>) -> (WriteHandle<K>, CopyTarget) {
        let token = CopyTarget { resource: target.at.id, pass: self.pass };
        (self.change(target, Access::CopyWrite, Part::ALL), token)
    }

    /// Refits an acceleration structure to moved geometry; its topology is kept.
    pub fn refit<K: Accel>(&mut self, accel: WriteHandle<K>) -> (WriteHandle<K>, BuildToken) {
        let token = BuildToken { resource: accel.at.id, pass: self.pass };
        (self.change(accel, Access::Refit, Part::ALL), token)
    }

    // Reads.

    /// Samples an image, or fetches its texels.
    pub fn sample(&mut self, image: Handle<Image>) -> SampleToken {
        self.sample_part(image, Part::ALL)
    }

    /// Samples a part of an image. Mip 0 in the shader is the first mip of the part.
    pub fn sample_part(&mut self, image: Handle<Image>, part: Part) -> SampleToken {
        let (resource, part) = self.see(image, Access::Sample, part);
        SampleToken { resource, pass: self.pass, part }
    }

    /// Attaches a depth image for testing only: fragments behind it are dropped, and it keeps its contents and its version. The pass may
    /// [sample](Self::sample) the same version beside it. It may have no other depth attachment, nor write this one.
    pub fn depth_test(&mut self, image: Handle<Image>) -> DepthToken {
        DepthToken { resource: self.see(image, Access::DepthTest, Part::ALL).0, pass: self.pass }
    }

    /// Reads a storage image.
    pub fn storage(&mut self, image: Handle<Image>) -> StorageToken {
        self.storage_part(image, Part::ALL)
    }

    /// Reads a part of a storage image. The shader sees the first mip of the part.
    pub fn storage_part(&mut self, image: Handle<Image>, part: Part) -> StorageToken {
        let (resource, part) = self.see(image, Access::StorageRead, part);
        StorageToken { resource, pass: self.pass, part }
    }

    /// Reads a buffer in a shader.
    pub fn read(&mut self, buffer: Handle<Buffer>) -> BufferToken {
        BufferToken { resource: self.see(buffer, Access::BufferRead, Part::ALL).0, pass: self.pass }
    }

    /// Takes the indices of a draw from a buffer.
    pub fn index(&mut self, buffer: Handle<Buffer>) -> IndexToken {
        IndexToken { resource: self.see(buffer, Access::Index, Part::ALL).0, pass: self.pass }
    }

    /// Takes the arguments of an indirect draw or dispatch from a buffer.
    pub fn indirect(&mut self, buffer: Handle<Buffer>) -> IndirectToken {
        IndirectToken { resource: self.see(buffer, Access::Indirect, Part::ALL).0, pass: self.pass }
    }

    /// Traces rays through an acceleration structure.
    pub fn trace(&mut self, tlas: Handle<Tlas>) -> TraceToken {
        TraceToken { resource: self.see(tlas, Access::Trace, Part::ALL).0, pass: self.pass }
    }

    /// Declares an input of a build: a buffer of geometry, or a bottom level.
    pub fn build_input<K: BuildInput>(&mut self, input: Handle<K>) -> BuildInputToken {
        BuildInputToken { resource: self.see(input, Access::BuildInput, Part::ALL).0, pass: self.pass }
    }

    /// Copies from an image or a buffer.
    pub fn copy_from<K: Copyable>(&mut self, source: Handle<K>) -> CopySource {
        CopySource { resource: self.see(source, Access::CopyRead, Part::ALL).0, pass: self.pass }
    }

    // Queries.

    /// Description of an image, with its size given as that of the image itself ([`Size::Like`](super::Size::Like)).
    pub fn desc(&self, image: Handle<Image>) -> ImageDesc {
        self.graph.desc(image)
    }

    /// Size of mip 0 of an image, pixels.
    pub fn extent(&self, image: Handle<Image>) -> Extent {
        self.graph.extent(image)
    }

    /// Size of mip 0 that an image of this description has or would have, pixels.
    pub fn extent_of(&self, desc: ImageDesc) -> Extent {
        self.graph.extent_of(desc)
    }

    // Recording the uses in the declaration.

    fn make_image(&mut self, name: &str, desc: ImageDesc, access: Access, clear: Option<Clear>) -> WriteHandle<Image> {
        let shape = self.graph.image_shape(name, desc);
        self.make(name, shape, access, Part::ALL, clear)
    }

    fn make_accel<K: Accel>(&mut self, name: &str, bytes: u64, access: Access) -> WriteHandle<K> {
        let Shape::Buffer { bytes } = self.graph.buffer_shape(name, BufferDesc::new(bytes)) else {
            unreachable!("a buffer's shape is that of a buffer")
        };
        self.make(name, Shape::Accel { bytes, top: K::TOP }, access, Part::ALL, None)
    }

    fn make<K: Kind>(
        &mut self,
        name: &str,
        shape: Shape,
        access: Access,
        part: Part,
        clear: Option<Clear>,
    ) -> WriteHandle<K> {
        let name = self.graph.declaration.add_name(name);
        let resource = self.graph.add_resource(name, shape, Origin::Transient, Some(self.pass));
        self.check_format(resource, access);
        let part = self.resolve(resource, part);
        if let Some(clear) = clear {
            self.graph.declaration.clears.push((self.graph.declaration.uses.len() as u32, clear));
        }
        self.graph.declaration.uses.push(Use { resource, access, part, reads: None, writes: Some(0) });
        WriteHandle::new(self.graph.handle(resource, 0))
    }

    fn change<K: Kind>(&mut self, handle: WriteHandle<K>, access: Access, part: Part) -> WriteHandle<K> {
        let (resource, version) = (handle.at.id, handle.at.version);
        self.graph.assert_own(handle.at);
        self.check_format(resource, access);
        let part = self.resolve(resource, part);
        if access.is_attachment() && access.reads() {
            // A storage write or a copy may overwrite everything, but an attachment that is not cleared shows its earlier contents.
            self.check_contents(resource, version, access);
        }
        self.check_together(resource, access, part);
        self.graph.declaration.resources[resource as usize].versions += 1;
        let new = Use { resource, access, part, reads: Some(version), writes: Some(version + 1) };
        self.graph.declaration.uses.push(new);
        WriteHandle::new(self.graph.handle(resource, version + 1))
    }

    /// Declares a read. Returns the index of the resource and the resolved part.
    fn see<K: Kind>(&mut self, handle: Handle<K>, access: Access, part: Part) -> (u32, Part) {
        let (resource, version) = (handle.id, handle.version);
        self.graph.assert_own(handle);
        let part = self.resolve(resource, part);
        let new = Use { resource, access, part, reads: Some(version), writes: None };
        if self.uses().contains(&new) {
            return (resource, part); // Declaring the same read twice counts once.
        }
        self.check_format(resource, access);
        if self.check_together(resource, access, part) {
            self.check_fresh(resource, version, access);
            self.check_contents(resource, version, access);
        }
        self.graph.declaration.uses.push(new);
        (resource, part)
    }

    /// The part with [`Part::REST`] replaced by actual counts. A part outside the image is an error and yields the whole image.
    fn resolve(&mut self, resource: u32, part: Part) -> Part {
        let (mips, layers) = self.graph.declaration.resources[resource as usize].shape.parts();
        if part.is_all() {
            return Part { mip: 0, mips: mips as u16, layer: 0, layers: layers as u16 };
        }
        if !part.fits(mips, layers) {
            let (pass, resource) = (self.name(), self.name_of(resource));
            self.graph.errors.push(GraphError::Part { pass, resource, part, mips, layers });
            return Part { mip: 0, mips: mips as u16, layer: 0, layers: layers as u16 };
        }
        part.of(mips, layers)
    }

    fn uses(&self) -> &[Use] {
        &self.graph.declaration.uses[self.first_use..]
    }

    fn last_part(&self) -> Part {
        self.uses().last().map_or(Part::ALL, |u| u.part)
    }

    fn name(&self) -> String {
        self.graph.declaration.pass_name(self.pass).to_owned()
    }

    fn name_of(&self, resource: u32) -> String {
        self.graph.declaration.resource_name(resource)
    }

    fn check_format(&mut self, resource: u32, access: Access) {
        let Shape::Image { format, .. } = self.graph.declaration.resources[resource as usize].shape else { return };
        let suits = match access {
            Access::Color | Access::ColorLoad => !format.is_depth(),
            Access::Depth | Access::DepthLoad | Access::DepthTest => format.is_depth(),
            Access::StorageRead | Access::StorageWrite | Access::StorageReadWrite => format.is_storable(),
            _ => true,
        };
        if !suits {
            let (pass, resource) = (self.name(), self.name_of(resource));
            self.graph.errors.push(GraphError::Format { pass, resource, access, format });
        }
    }

    /// Whether this use is compatible with the pass's other uses of overlapping parts: buffers may be read in several ways at
    /// once, images have one layout at a time, and nothing is both read and written.
    fn check_together(&mut self, resource: u32, access: Access, part: Part) -> bool {
        let goes = |other: &Use| {
            let only_read = !access.writes() && !other.access.writes();
            !other.part.overlaps(part) || (only_read && access.layout() == other.access.layout())
        };
        let clash = self.uses().iter().find(|u| u.resource == resource && !goes(u)).map(|u| u.access);
        if let Some(first) = clash {
            let (pass, resource) = (self.name(), self.name_of(resource));
            self.graph.errors.push(GraphError::Conflict { pass, resource, first, second: access });
        }
        clash.is_none()
    }

    fn check_fresh(&mut self, resource: u32, version: u32, access: Access) {
        let newest = self.graph.declaration.resources[resource as usize].versions - 1;
        if version == newest {
            return;
        }
        let declaration = &self.graph.declaration;
        let written = |pass: u32| {
            let of_pass = declaration.uses_of(pass).iter();
            of_pass.clone().find(|u| u.resource == resource && u.writes == Some(newest)).map(|u| (pass, u.access))
        };
        if let Some((writer, written)) = (0..self.pass).rev().find_map(written) {
            let writer = declaration.pass_name(writer).to_owned();
            let (pass, resource) = (self.name(), self.name_of(resource));
            self.graph.errors.push(GraphError::StaleRead { pass, resource, access, version, newest, writer, written });
        }
    }

    fn check_contents(&mut self, resource: u32, version: u32, access: Access) {
        let decl = &self.graph.declaration.resources[resource as usize];
        if version == 0 && decl.is_undefined() {
            let (pass, resource) = (self.name(), self.name_of(resource));
            self.graph.errors.push(GraphError::Unwritten { pass, resource, access });
        }
    }
}
