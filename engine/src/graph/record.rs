//! What a pass sees while it records: ids for its tokens, and the commands it may use.

use std::sync::Arc;

use bytemuck::Pod;
use magpie_shaders::{Address, SampledImage, StorageImage};

use super::{
    desc::Extent,
    token::{
        BufferToken, ColorToken, CopySource, CopyTarget, DepthToken, IndexToken, IndirectToken, SampleToken,
        StorageToken, TraceToken,
    },
};
use crate::gpu::{self, CommandEncoder, Cull, DrawRange, ImageRegion, Kernel, RasterKernel};

/// The object behind a resource of the declaration.
#[derive(Clone)]
pub(super) enum Physical {
    /// No kept pass uses it.
    Unused,
    /// An image.
    Image(Arc<gpu::Image>),
    /// A buffer, or an acceleration structure in buffers.
    Buffer(Arc<gpu::Buffer>),
}

/// What a pass recorded, for the figures.
#[derive(Clone, Copy, Debug, Default)]
pub(super) struct Recorded {
    pub draws: u32,
    pub dispatches: u32,
}

/// One indexed draw of one instance.
#[derive(Clone, Copy, Debug, PartialEq, Eq)]
pub struct Draw {
    /// First index in the index buffer.
    pub first_index: u32,
    /// How many indices.
    pub index_count: u32,
    /// `gl_InstanceIndex` in the vertex shader.
    pub instance: u32,
    /// Which faces are left out.
    pub cull: Cull,
    /// Its material is alpha-tested.
    pub alpha_test: bool,
}

/// One mip of an image in a buffer, rows without gaps.
#[derive(Clone, Copy, Debug, PartialEq, Eq)]
pub struct MipCopy {
    /// Where it begins in the buffer, bytes.
    pub offset: u64,
    /// Which mip.
    pub mip: u32,
}

/// Commands of one pass. Ids exist only for what the pass declared.
pub struct Record<'a> {
    pub(super) encoder: &'a mut CommandEncoder,
    pub(super) physical: &'a [Physical],
    pub(super) pass: u32,
    pub(super) name: &'a str,
    pub(super) rays: Address,
    pub(super) recorded: Recorded,
}

/// A token that stands for an id in shader parameters.
pub trait Token: Copy {
    /// The id.
    type Id;
    /// Looks it up.
    #[doc(hidden)]
    fn resolve(self, record: &Record<'_>) -> Self::Id;
}

impl Token for SampleToken {
    type Id = SampledImage;
    fn resolve(self, record: &Record<'_>) -> SampledImage {
        let id = record.image(self.resource, self.pass).sampled();
        id.unwrap_or_else(|| record.misuse("samples an image that was not made for it"))
    }
}

impl Token for StorageToken {
    type Id = StorageImage;
    fn resolve(self, record: &Record<'_>) -> StorageImage {
        let id = record.image(self.resource, self.pass).storage();
        id.unwrap_or_else(|| record.misuse("stores to an image that was not made for it"))
    }
}

impl Token for BufferToken {
    type Id = Address;
    fn resolve(self, record: &Record<'_>) -> Address {
        record.buffer(self.resource, self.pass).address()
    }
}

impl Record<'_> {
    /// The id of a token, as shader parameters hold it.
    ///
    /// # Panics
    /// When the token belongs to another pass.
    pub fn id<T: Token>(&self, token: T) -> T::Id {
        token.resolve(self)
    }

    /// Where shaders of this pass count the rays that they trace: closest-hit, then any-hit.
    pub fn rays(&self) -> Address {
        self.rays
    }

    /// One thread per pixel of `extent`, in the kernel's own workgroups.
    ///
    /// # Panics
    /// When `params` takes more than 128 bytes.
    pub fn dispatch<P: Pod>(&mut self, kernel: Kernel, params: &P, extent: Extent) {
        let [x, y, z] = kernel.local_size;
        self.dispatch_groups(kernel, params, [extent.width.div_ceil(x), extent.height.div_ceil(y), 1_u32.div_ceil(z)]);
    }

    /// So many workgroups.
    ///
    /// # Panics
    /// As [`Record::dispatch`].
    pub fn dispatch_groups<P: Pod>(&mut self, kernel: Kernel, params: &P, groups: [u32; 3]) {
        self.encoder.dispatch(kernel, bytemuck::bytes_of(params), groups);
        self.recorded.dispatches += 1;
    }

    /// One thread per pixel of `extent`, each free to trace rays through the acceleration structure of `tlas`.
    ///
    /// # Panics
    /// As [`Record::dispatch`], and when the token belongs to another pass.
    pub fn trace<P: Pod>(&mut self, kernel: Kernel, tlas: TraceToken, params: &P, extent: Extent) {
        self.own(tlas.pass);
        self.dispatch(kernel, params, extent);
    }

    /// Draws into the attachments that the pass declared.
    ///
    /// # Panics
    /// As [`Record::dispatch`], and when the token belongs to another pass.
    pub fn draw<P: Pod>(&mut self, kernel: RasterKernel, params: &P, indices: IndexToken, draws: &[Draw]) {
        if draws.is_empty() {
            return;
        }
        let ranges: Vec<_> = draws
            .iter()
            .map(|d| DrawRange {
                first_index: d.first_index,
                index_count: d.index_count,
                instance: d.instance,
                cull: d.cull,
            })
            .collect();
        let (physical, pass) = (self.physical, self.pass);
        self.own(indices.pass);
        let Physical::Buffer(buffer) = &physical[indices.resource as usize] else {
            self.misuse::<()>(&format!("draws with indices from something else than a buffer (pass {pass})"));
            return;
        };
        self.encoder.draw(kernel, bytemuck::bytes_of(params), buffer, &ranges);
        self.recorded.draws += ranges.len() as u32;
    }

    /// Copies `bytes` bytes from one buffer to another.
    ///
    /// # Panics
    /// Past the end of either, or when a token belongs to another pass.
    pub fn copy_buffer(&mut self, from: CopySource, from_offset: u64, to: CopyTarget, to_offset: u64, bytes: u64) {
        let (source, target) = (self.buffer(from.resource, from.pass), self.buffer(to.resource, to.pass));
        assert!(
            from_offset + bytes <= source.bytes(),
            "{}: {} holds {} bytes",
            self.name,
            source.name(),
            source.bytes()
        );
        assert!(to_offset + bytes <= target.bytes(), "{}: {} holds {} bytes", self.name, target.name(), target.bytes());
        let (source, target) = (source.clone(), target.clone());
        self.encoder.copy_buffer(&source, from_offset, &target, to_offset, bytes);
    }

    /// Copies mips from a buffer to an image.
    ///
    /// # Panics
    /// Past the end of the buffer, or when a token belongs to another pass.
    pub fn copy_to_image(&mut self, from: CopySource, to: CopyTarget, mips: &[MipCopy]) {
        let (source, target) =
            (self.buffer(from.resource, from.pass).clone(), self.image(to.resource, to.pass).clone());
        let regions: Vec<_> = mips.iter().map(|m| self.region(*m, &source, &target)).collect();
        self.encoder.copy_buffer_to_image(&source, &target, &regions);
    }

    /// Copies one mip of an image to a buffer.
    ///
    /// # Panics
    /// As [`Record::copy_to_image`].
    pub fn copy_from_image(&mut self, from: CopySource, to: CopyTarget, mip: MipCopy) {
        let (source, target) =
            (self.image(from.resource, from.pass).clone(), self.buffer(to.resource, to.pass).clone());
        let region = self.region(mip, &target, &source);
        self.encoder.copy_image_to_buffer(&source, &target, region);
    }

    fn region(&self, copy: MipCopy, buffer: &gpu::Buffer, image: &gpu::Image) -> ImageRegion {
        let extent = image.extent().mip(copy.mip);
        let bytes = u64::from(extent.width) * u64::from(extent.height) * u64::from(image.format().bytes_per_pixel());
        let end = copy.offset + bytes;
        assert!(
            end <= buffer.bytes(),
            "{}: mip {} ends at {end}, {} holds {}",
            self.name,
            copy.mip,
            buffer.name(),
            buffer.bytes()
        );
        ImageRegion { buffer_offset: copy.offset, mip: copy.mip, extent }
    }

    fn own(&self, pass: u32) {
        assert_eq!(pass, self.pass, "{}: a token of pass {pass} was used in pass {}", self.name, self.pass);
    }

    fn image(&self, resource: u32, pass: u32) -> &Arc<gpu::Image> {
        self.own(pass);
        match &self.physical[resource as usize] {
            Physical::Image(image) => image,
            Physical::Buffer(_) | Physical::Unused => self.misuse(&format!("resource {resource} is no image")),
        }
    }

    fn buffer(&self, resource: u32, pass: u32) -> &Arc<gpu::Buffer> {
        self.own(pass);
        match &self.physical[resource as usize] {
            Physical::Buffer(buffer) => buffer,
            Physical::Image(_) | Physical::Unused => self.misuse(&format!("resource {resource} is no buffer")),
        }
    }

    /// A programmer's mistake that no input can cause: it stops the program with the pass's name.
    fn misuse<T>(&self, what: &str) -> T {
        unreachable!("{}: {what}", self.name)
    }
}

/// Attachments have no id: declaring them is all that a pass does with them.
impl ColorToken {
    /// Index of the resource.
    pub fn resource(self) -> u32 {
        self.resource
    }
}

impl DepthToken {
    /// Index of the resource.
    pub fn resource(self) -> u32 {
        self.resource
    }
}

impl IndirectToken {
    /// Index of the resource.
    pub fn resource(self) -> u32 {
        self.resource
    }
}
