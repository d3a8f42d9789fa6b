//! What a pass sees while it records: ids for its tokens, and the commands it may use.

use std::sync::Arc;

use bytemuck::Pod;
use magpie_shaders::{Address, SampledImage, StorageImage};

use super::{
    desc::Extent,
    token::{
        BufferToken, BuildInputToken, BuildToken, ColorToken, CopySource, CopyTarget, DepthToken, IndexToken,
        IndirectToken, SampleToken, ScratchToken, StorageToken, TraceToken,
    },
};
use crate::gpu::{
    self, AccelDesc, CommandEncoder, CompactedSizes, Cull, DrawRange, GpuError, ImageRegion, Kernel, PUSH_BYTES,
    RAY_PUSH_BYTES, RasterKernel, RayKernel,
};

/// The object behind a resource of the declaration.
#[derive(Clone)]
pub(super) enum Physical {
    /// No kept pass uses it.
    Unused,
    /// An image.
    Image(Arc<gpu::Image>),
    /// A buffer.
    Buffer(BufferRange),
    /// An acceleration structure.
    Accel(AccelObject),
}

/// An acceleration structure: the driver's, or plain memory that shaders write.
#[derive(Clone)]
pub(super) struct AccelObject {
    pub memory: BufferRange,
    pub driver: Option<Arc<gpu::Accel>>,
    /// The scene's tables, which shaders know a top level by; of a bottom level none.
    pub root: Address,
}

/// Some bytes of a buffer.
#[derive(Clone)]
pub(super) struct BufferRange {
    pub buffer: Arc<gpu::Buffer>,
    pub offset: u64,
    pub bytes: u64,
}

impl BufferRange {
    pub fn whole(buffer: Arc<gpu::Buffer>) -> Self {
        let bytes = buffer.bytes();
        Self { buffer, offset: 0, bytes }
    }

    fn address(&self) -> Address {
        self.buffer.address().offset(self.offset)
    }
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
    /// It is spheres: eight corners of a box for each.
    pub spheres: bool,
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
    pub(super) counters: Address,
    pub(super) recorded: Recorded,
    /// The first mistake that the pass made while it recorded. What was wrong is not recorded, and the frame does not run.
    pub(super) fault: Option<GpuError>,
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
        let id = record.image(self.resource, self.pass).sampled_part(self.part);
        id.unwrap_or_else(|| record.misuse("samples an image that was not made for it"))
    }
}

impl Token for StorageToken {
    type Id = StorageImage;
    fn resolve(self, record: &Record<'_>) -> StorageImage {
        let id = record.image(self.resource, self.pass).storage_part(self.part);
        id.unwrap_or_else(|| record.misuse("stores to an image that was not made for it"))
    }
}

/// The root of the scene's tables.
impl Token for TraceToken {
    type Id = Address;
    fn resolve(self, record: &Record<'_>) -> Address {
        record.accel_in(record.physical, self.resource, self.pass).root
    }
}

/// The address that a build reads from: of a buffer, or of a bottom level as instances name it.
impl Token for BuildInputToken {
    type Id = Address;
    fn resolve(self, record: &Record<'_>) -> Address {
        record.own(self.pass);
        match &record.physical[self.resource as usize] {
            Physical::Accel(AccelObject { driver: Some(accel), .. }) => accel.address(),
            _ => record.buffer(self.resource, self.pass).address(),
        }
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
        self.counters
    }

    /// Where shaders of this pass count the values that they left out because they are not finite, one `uint`: `is_taken` of
    /// `lib/not_finite.glsl`.
    pub fn not_finite(&self) -> Address {
        self.counters.offset(8)
    }

    /// One thread per pixel of `extent`, in the kernel's own workgroups.
    ///
    /// `params` are its push constants. They must have the size of the block that the shader declares, which its SPIR-V says: for any
    /// other, nothing is recorded and the frame ends with [`GpuError::PushConstants`], which names the pass, the kernel and both sizes.
    /// A shader without such a block may be given anything of at most 128 bytes.
    pub fn dispatch<P: Pod>(&mut self, kernel: Kernel, params: &P, extent: Extent) {
        let [x, y, z] = kernel.local_size;
        self.dispatch_groups(kernel, params, [extent.width.div_ceil(x), extent.height.div_ceil(y), 1_u32.div_ceil(z)]);
    }

    /// So many workgroups. `params` are as with [`Record::dispatch`].
    pub fn dispatch_groups<P: Pod>(&mut self, kernel: Kernel, params: &P, groups: [u32; 3]) {
        if self.fits::<P>(kernel.push(), PUSH_BYTES) {
            self.encoder.dispatch(kernel, bytemuck::bytes_of(params), groups);
            self.recorded.dispatches += 1;
        }
    }

    /// One thread per pixel of `extent`, each free to trace rays through the acceleration structure of `tlas`. `params` are as with
    /// [`Record::dispatch`], and at most 120 bytes.
    ///
    /// # Panics
    /// When the token belongs to another pass.
    pub fn trace<P: Pod>(&mut self, kernel: RayKernel, tlas: TraceToken, params: &P, extent: Extent) {
        self.own(tlas.pass);
        match kernel {
            RayKernel::Compute(kernel) => self.dispatch(kernel, params, extent),
            RayKernel::Pipeline(pipeline) if self.fits::<P>(pipeline.push(), RAY_PUSH_BYTES) => {
                let root = self.id(tlas);
                let size = [extent.width, extent.height, 1];
                self.encoder.trace_rays(pipeline, bytemuck::bytes_of(params), root, size);
                self.recorded.dispatches += 1;
            }
            RayKernel::Pipeline(_) => {}
        }
    }

    /// As [`Record::trace`], with the number of threads from six words of a buffer, from `offset` bytes on: the workgroups that
    /// cover them, in the kernel's own size, then the threads themselves; x, y and z each. Write both: which of them is read depends
    /// on how rays are traced.
    ///
    /// # Panics
    /// As [`Record::trace`], and past the end of the buffer.
    pub fn trace_indirect<P: Pod>(
        &mut self,
        kernel: RayKernel,
        tlas: TraceToken,
        params: &P,
        (threads, offset): (IndirectToken, u64),
    ) {
        match kernel {
            RayKernel::Compute(kernel) => self.dispatch_indirect(kernel, params, threads, offset),
            RayKernel::Pipeline(pipeline) if self.fits::<P>(pipeline.push(), RAY_PUSH_BYTES) => {
                let (physical, root) = (self.physical, self.id(tlas));
                let range = self.buffer_in(physical, threads.resource, threads.pass);
                self.inside(range, offset, 24);
                let size = range.address().offset(offset + 12);
                self.encoder.trace_rays_indirect(pipeline, bytemuck::bytes_of(params), root, size);
                self.recorded.dispatches += 1;
            }
            RayKernel::Pipeline(_) => {}
        }
    }

    /// Builds an acceleration structure of the driver's. `scratch` has the room that [`gpu::Gpu::accel_sizes`] says.
    ///
    /// # Panics
    /// When a token belongs to another pass, or the structure is plain memory.
    pub fn build_accel(&mut self, target: BuildToken, scratch: ScratchToken, desc: &AccelDesc) {
        self.make_accel(target, scratch, desc, false);
    }

    /// Refits one to what its geometry is now: its tree stays.
    ///
    /// # Panics
    /// As [`Record::build_accel`].
    pub fn refit_accel(&mut self, target: BuildToken, scratch: ScratchToken, desc: &AccelDesc) {
        self.make_accel(target, scratch, desc, true);
    }

    fn make_accel(&mut self, target: BuildToken, scratch: ScratchToken, desc: &AccelDesc, refit: bool) {
        let physical = self.physical;
        let target = self.driver_in(physical, target.resource, target.pass);
        let scratch = self.buffer_in(physical, scratch.resource, scratch.pass).address();
        self.encoder.build_accel(desc, refit, target, scratch);
    }

    /// Writes how small structures can become that were built to be compacted: eight bytes each.
    ///
    /// # Panics
    /// As [`Record::build_accel`], and past the end of the buffer.
    pub fn compacted_sizes(&mut self, sources: &[BuildInputToken], sizes: &CompactedSizes, to: CopyTarget) {
        let physical = self.physical;
        let accels: Vec<_> = sources.iter().map(|s| self.driver_in(physical, s.resource, s.pass)).collect();
        let target = self.buffer_in(physical, to.resource, to.pass);
        self.inside(target, 0, 8 * accels.len() as u64);
        self.encoder.compacted_sizes(&accels, sizes, (&target.buffer, target.offset));
    }

    /// Copies a structure into a smaller one.
    ///
    /// # Panics
    /// As [`Record::build_accel`].
    pub fn compact_accel(&mut self, source: BuildInputToken, target: BuildToken) {
        let physical = self.physical;
        let source = self.driver_in(physical, source.resource, source.pass);
        let target = self.driver_in(physical, target.resource, target.pass);
        self.encoder.compact_accel(source, target);
    }

    /// Draws into the attachments that the pass declared. `params` are as with [`Record::dispatch`]; where both shaders have a block, the
    /// longer one counts.
    ///
    /// # Panics
    /// When the token belongs to another pass.
    pub fn draw<P: Pod>(&mut self, kernel: RasterKernel, params: &P, indices: IndexToken, draws: &[Draw]) {
        if draws.is_empty() || !self.fits::<P>(kernel.push(), PUSH_BYTES) {
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
        let physical = self.physical;
        let indices = self.buffer_in(physical, indices.resource, indices.pass);
        self.encoder.draw(kernel, bytemuck::bytes_of(params), (&indices.buffer, indices.offset), &ranges);
        self.recorded.draws += ranges.len() as u32;
    }

    /// As many workgroups as three words of a buffer say, from `offset` bytes on: x, y and z. Where one of them is zero, nothing
    /// runs: a pass before it decides on the device whether and how much this one does. `params` are as with [`Record::dispatch`].
    ///
    /// # Panics
    /// Past the end of the buffer, and when the token belongs to another pass.
    pub fn dispatch_indirect<P: Pod>(&mut self, kernel: Kernel, params: &P, groups: IndirectToken, offset: u64) {
        if !self.fits::<P>(kernel.push(), PUSH_BYTES) {
            return;
        }
        let physical = self.physical;
        let range = self.buffer_in(physical, groups.resource, groups.pass);
        self.inside(range, offset, 12);
        self.encoder.dispatch_indirect(kernel, bytemuck::bytes_of(params), &range.buffer, range.offset + offset);
        self.recorded.dispatches += 1;
    }

    /// Draws `count` times what a buffer says, from `offset` bytes on. Each draw is five words: how many indices, how many
    /// instances, the first index, what is added to indices, the first instance. Where there are no instances, nothing is drawn.
    /// `params` are as with [`Record::draw`].
    ///
    /// # Panics
    /// Past the end of the buffer, and when a token belongs to another pass.
    pub fn draw_indirect<P: Pod>(
        &mut self,
        kernel: RasterKernel,
        params: &P,
        indices: IndexToken,
        draws: (IndirectToken, u64),
        (count, cull): (u32, Cull),
    ) {
        if !self.fits::<P>(kernel.push(), PUSH_BYTES) {
            return;
        }
        let (physical, (draws, offset)) = (self.physical, draws);
        let indices = self.buffer_in(physical, indices.resource, indices.pass);
        let range = self.buffer_in(physical, draws.resource, draws.pass);
        self.inside(range, offset, 20 * u64::from(count));
        self.encoder.draw_indirect(
            kernel,
            bytemuck::bytes_of(params),
            (&indices.buffer, indices.offset),
            (&range.buffer, range.offset + offset),
            (count, cull),
        );
        self.recorded.draws += count;
    }

    /// Fills a buffer from `offset` bytes on with `contents`, which travel with the commands: for tables of at most 64 KiB.
    ///
    /// # Panics
    /// Past the end of the buffer, with more than 65536 bytes or a count of bytes that is no multiple of four, or when the token
    /// belongs to another pass.
    pub fn fill_buffer<T: Pod>(&mut self, to: CopyTarget, offset: u64, contents: &[T]) {
        let bytes: &[u8] = bytemuck::cast_slice(contents);
        let physical = self.physical;
        let target = self.buffer_in(physical, to.resource, to.pass);
        self.inside(target, offset, bytes.len() as u64);
        let fits = bytes.len() <= 65536 && bytes.len().is_multiple_of(4);
        assert!(fits, "{}: {} bytes travel with the commands, at most 65536 in words do", self.name, bytes.len());
        self.encoder.fill_buffer(&target.buffer, target.offset + offset, bytes);
    }

    /// Copies `bytes` bytes from one buffer to another.
    ///
    /// # Panics
    /// Past the end of either, or when a token belongs to another pass.
    pub fn copy_buffer(&mut self, from: CopySource, from_offset: u64, to: CopyTarget, to_offset: u64, bytes: u64) {
        let physical = self.physical;
        let source = self.buffer_in(physical, from.resource, from.pass);
        let target = self.buffer_in(physical, to.resource, to.pass);
        self.inside(source, from_offset, bytes);
        self.inside(target, to_offset, bytes);
        let (from_offset, to_offset) = (source.offset + from_offset, target.offset + to_offset);
        self.encoder.copy_buffer(&source.buffer, from_offset, &target.buffer, to_offset, bytes);
    }

    /// Copies mips from a buffer to an image.
    ///
    /// # Panics
    /// Past the end of the buffer, or when a token belongs to another pass.
    pub fn copy_to_image(&mut self, from: CopySource, to: CopyTarget, mips: &[MipCopy]) {
        let physical = self.physical;
        let source = self.buffer_in(physical, from.resource, from.pass);
        let target = self.image_in(physical, to.resource, to.pass);
        let regions: Vec<_> = mips.iter().map(|m| self.region(*m, source, target)).collect();
        self.encoder.copy_buffer_to_image(&source.buffer, target, &regions);
    }

    /// Copies one mip of an image to a buffer.
    ///
    /// # Panics
    /// As [`Record::copy_to_image`].
    pub fn copy_from_image(&mut self, from: CopySource, to: CopyTarget, mip: MipCopy) {
        let physical = self.physical;
        let source = self.image_in(physical, from.resource, from.pass);
        let target = self.buffer_in(physical, to.resource, to.pass);
        let region = self.region(mip, target, source);
        self.encoder.copy_image_to_buffer(source, &target.buffer, region);
    }

    /// Copies a part of an image to a part of the same size of another.
    ///
    /// # Panics
    /// When the mips differ in size or format, or a token belongs to another pass.
    pub fn copy_image(&mut self, from: CopySource, from_mip: u32, to: CopyTarget, to_mip: u32) {
        let physical = self.physical;
        let source = self.image_in(physical, from.resource, from.pass);
        let target = self.image_in(physical, to.resource, to.pass);
        let (from_extent, to_extent) = (source.extent().mip(from_mip), target.extent().mip(to_mip));
        assert_eq!(from_extent, to_extent, "{}: mips {from_mip} and {to_mip} differ in size", self.name);
        assert_eq!(source.format(), target.format(), "{}: copied images differ in format", self.name);
        self.encoder.copy_image(source, from_mip, target, to_mip);
    }

    fn region(&self, copy: MipCopy, range: &BufferRange, image: &gpu::Image) -> ImageRegion {
        let extent = image.extent().mip(copy.mip);
        let bytes = u64::from(extent.width) * u64::from(extent.height) * u64::from(image.format().bytes_per_pixel());
        self.inside(range, copy.offset, bytes);
        ImageRegion { buffer_offset: range.offset + copy.offset, mip: copy.mip, extent }
    }

    /// Whether push constants of this type are what a pipeline reads; the frame fails where they are not.
    fn fits<P>(&mut self, (pipeline, block): (u32, Option<u32>), most: u32) -> bool {
        let given = size_of::<P>() as u32;
        let wanted = block.unwrap_or(given).min(most);
        if given != wanted {
            let (pass, kernel) = (self.name.to_owned(), self.encoder.pipeline_name(pipeline));
            self.fault.get_or_insert(GpuError::PushConstants { pass, kernel, wanted, given });
            return false;
        }
        match self.encoder.make_pipeline(pipeline) {
            Ok(()) => true,
            Err(error) => {
                self.fault.get_or_insert(error);
                false
            }
        }
    }

    fn inside(&self, range: &BufferRange, offset: u64, bytes: u64) {
        let end = offset.saturating_add(bytes);
        assert!(
            end <= range.bytes,
            "{}: {end} is past the end of {} bytes of {}",
            self.name,
            range.bytes,
            range.buffer.name()
        );
    }

    fn own(&self, pass: u32) {
        assert_eq!(pass, self.pass, "{}: a token of pass {pass} was used in pass {}", self.name, self.pass);
    }

    fn image(&self, resource: u32, pass: u32) -> &gpu::Image {
        self.image_in(self.physical, resource, pass)
    }

    fn image_in<'p>(&self, physical: &'p [Physical], resource: u32, pass: u32) -> &'p gpu::Image {
        self.own(pass);
        match &physical[resource as usize] {
            Physical::Image(image) => image,
            Physical::Buffer(_) | Physical::Accel(_) | Physical::Unused => {
                self.misuse(&format!("resource {resource} is no image"))
            }
        }
    }

    fn buffer(&self, resource: u32, pass: u32) -> &BufferRange {
        self.buffer_in(self.physical, resource, pass)
    }

    fn buffer_in<'p>(&self, physical: &'p [Physical], resource: u32, pass: u32) -> &'p BufferRange {
        self.own(pass);
        match &physical[resource as usize] {
            Physical::Buffer(range) => range,
            Physical::Accel(accel) => &accel.memory,
            Physical::Image(_) | Physical::Unused => self.misuse(&format!("resource {resource} is no buffer")),
        }
    }

    fn accel_in<'p>(&self, physical: &'p [Physical], resource: u32, pass: u32) -> &'p AccelObject {
        self.own(pass);
        match &physical[resource as usize] {
            Physical::Accel(accel) => accel,
            _ => self.misuse(&format!("resource {resource} is no acceleration structure")),
        }
    }

    fn driver_in<'p>(&self, physical: &'p [Physical], resource: u32, pass: u32) -> &'p gpu::Accel {
        match &self.accel_in(physical, resource, pass).driver {
            Some(accel) => accel,
            None => self.misuse(&format!("resource {resource} is no acceleration structure of the driver's")),
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
