//! Recording a pass: ids and addresses for its tokens, and the commands that it may use.

use std::sync::Arc;

use bytemuck::Pod;
use magpie_shaders::{Address, SampledImage, StorageImage};

use super::{
    desc::Extent,
    draw::Draw,
    token::{
        BufferToken, BuildInputToken, BuildToken, ColorToken, CopySource, CopyTarget, DepthToken, IndexToken,
        IndirectToken, SampleToken, ScratchToken, StorageToken, TraceToken,
    },
};
use crate::gpu::{
    self, AccelDesc, BufferAt, CommandEncoder, CompactedSizes, Cull, DrawRange, DrawsAt, GpuError, ImageRegion, Kernel,
    PUSH_BYTES, PushBlock, RAY_PUSH_BYTES, RasterKernel, RayKernel,
};

/// The device object behind a resource of the declaration.
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

/// An acceleration structure: one built by the driver, or plain memory that shaders write.
#[derive(Clone)]
pub(super) struct AccelObject {
    pub memory: BufferRange,
    pub driver: Option<Arc<gpu::Accel>>,
    /// Address of the scene's tables, which shaders need beside a top level; null for a bottom level.
    pub root: Address,
}

/// A range of a buffer.
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

/// Counts of what a pass recorded, for the statistics.
#[derive(Clone, Copy, Debug, Default)]
pub(super) struct Recorded {
    pub draws: u32,
    pub dispatches: u32,
    /// Names of what the pass counts itself.
    pub counts: &'static [&'static str],
}

/// Things that a pass can count itself.
pub const MOST_COUNTS: usize = 8;
/// Bytes of counters that every pass has, before those.
pub(super) const OWN_COUNTERS: u64 = 16;

/// One mip of an image in a buffer, rows tightly packed.
#[derive(Clone, Copy, Debug, PartialEq, Eq)]
pub struct MipCopy {
    /// Offset in the buffer, bytes.
    pub offset: u64,
    /// Mip level of the image.
    pub mip: u32,
}

/// Indirect draws, whose arguments are in a buffer. Each has five words: number of indices, number of instances, first index, offset
/// added to indices, first instance. A draw without instances draws nothing.
#[derive(Clone, Copy, Debug)]
pub struct IndirectDraws {
    /// The buffer.
    pub words: IndirectToken,
    /// Offset of the first draw in the buffer, bytes.
    pub offset: u64,
    /// How many draws there are.
    pub count: u32,
    /// Which faces they cull.
    pub cull: Cull,
}

/// Records the commands of one pass. Only resources that the pass declared have ids here.
pub struct Record<'a> {
    pub(super) encoder: &'a mut CommandEncoder,
    pub(super) physical: &'a [Physical],
    pub(super) pass: u32,
    pub(super) name: &'a str,
    pub(super) counters: Address,
    pub(super) recorded: Recorded,
    /// The first error while recording. The command that caused it is not recorded, and the frame does not run.
    pub(super) fault: Option<GpuError>,
}

/// A token that resolves to an id in shader parameters.
pub trait Token: Copy {
    /// Type of the id: an index into the bindless set, or an address.
    type Id;
    /// Looks the id up.
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

/// Resolves to the root address of the scene's tables.
impl Token for TraceToken {
    type Id = Address;
    fn resolve(self, record: &Record<'_>) -> Address {
        record.accel_in(record.physical, self.resource, self.pass).root
    }
}

/// Resolves to the address that a build reads: of a buffer, or of a bottom level as instances refer to it.
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
    /// The id of a token, for use in shader parameters.
    ///
    /// # Panics
    /// If the token belongs to another pass.
    pub fn id<T: Token>(&self, token: T) -> T::Id {
        token.resolve(self)
    }

    /// Address of the two counters in which shaders of this pass count their rays: closest-hit, then any-hit, one `uint` each.
    /// Behind them is the one of [`not_finite`](Self::not_finite).
    pub fn rays(&self) -> Address {
        self.counters
    }

    /// Address of the `uint` in which shaders of this pass count the non-finite values that they leave out; see `is_taken` in
    /// `lib/not_finite.glsl`.
    pub fn not_finite(&self) -> Address {
        self.counters.offset(8)
    }

    /// Address of a `uint` for each of these names, 0 at first, in which shaders of this pass count things of their own, or to which they write a count.
    /// They stand in the statistics of the pass under these names. At most [`MOST_COUNTS`]; further names are left out.
    pub fn counts(&mut self, names: &'static [&'static str]) -> Address {
        self.recorded.counts = &names[..names.len().min(MOST_COUNTS)];
        self.counters.offset(OWN_COUNTERS)
    }

    /// Dispatches one thread per pixel of `extent`, in the workgroup size of the kernel.
    ///
    /// `params` are the push constants, and must have the size of the block in the shader, which its SPIR-V declares. Otherwise
    /// nothing is recorded and the frame ends with [`GpuError::PushConstants`], which names the pass, the kernel and both sizes.
    /// A shader without push constants accepts anything of at most 128 bytes.
    pub fn dispatch<P: Pod>(&mut self, kernel: Kernel, params: &P, extent: Extent) {
        let [x, y, z] = kernel.local_size;
        self.dispatch_groups(kernel, params, [extent.width.div_ceil(x), extent.height.div_ceil(y), 1_u32.div_ceil(z)]);
    }

    /// Dispatches `groups` workgroups in x, y and z. `params` as for [`Record::dispatch`].
    pub fn dispatch_groups<P: Pod>(&mut self, kernel: Kernel, params: &P, groups: [u32; 3]) {
        if self.fits::<P>(kernel.push(), PUSH_BYTES) {
            self.encoder.dispatch(kernel, bytemuck::bytes_of(params), groups);
            self.recorded.dispatches += 1;
        }
    }

    /// Runs one thread per pixel of `extent`, each of which may trace rays through the acceleration structure of `tlas`. `params`
    /// as for [`Record::dispatch`], but at most 120 bytes.
    ///
    /// # Panics
    /// If the token belongs to another pass.
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

    /// As [`Record::trace`], with sizes read from six words of a buffer at byte `offset`: the number of workgroups in x, y and z,
    /// then the number of threads in x, y and z. Write both, since the ray backend decides which of them is read.
    ///
    /// # Panics
    /// As [`Record::trace`], and if the words are past the end of the buffer.
    pub fn trace_indirect<P: Pod>(
        &mut self,
        kernel: RayKernel,
        tlas: TraceToken,
        params: &P,
        threads: IndirectToken,
        offset: u64,
    ) {
        self.own(tlas.pass);
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

    /// Builds an acceleration structure by the driver. `scratch` must have the size that [`gpu::Gpu::accel_sizes`] returns.
    ///
    /// # Panics
    /// If a token belongs to another pass, or if the structure is plain memory.
    pub fn build_accel(&mut self, target: BuildToken, scratch: ScratchToken, desc: &AccelDesc) {
        self.make_accel(target, scratch, desc, false);
    }

    /// Refits an acceleration structure to its current geometry; its topology is kept.
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

    /// Writes the compacted sizes of structures that were built for compaction, as one 64-bit word each.
    ///
    /// # Panics
    /// As [`Record::build_accel`], and if the words are past the end of the buffer.
    pub fn compacted_sizes(&mut self, sources: &[BuildInputToken], sizes: &CompactedSizes, to: CopyTarget) {
        let physical = self.physical;
        let accels: Vec<_> = sources.iter().map(|s| self.driver_in(physical, s.resource, s.pass)).collect();
        let target = self.buffer_in(physical, to.resource, to.pass);
        self.inside(target, 0, 8 * accels.len() as u64);
        let target = BufferAt { buffer: &target.buffer, offset: target.offset };
        self.encoder.compacted_sizes(&accels, sizes, target);
    }

    /// Compacts a structure into one that has the compacted size.
    ///
    /// # Panics
    /// As [`Record::build_accel`].
    pub fn compact_accel(&mut self, source: BuildInputToken, target: BuildToken) {
        let physical = self.physical;
        let source = self.driver_in(physical, source.resource, source.pass);
        let target = self.driver_in(physical, target.resource, target.pass);
        self.encoder.compact_accel(source, target);
    }

    /// Draws into the attachments that the pass declared. `params` as for [`Record::dispatch`]; if both shaders have push
    /// constants, the larger block counts.
    ///
    /// # Panics
    /// If the token belongs to another pass.
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
        let indices = BufferAt { buffer: &indices.buffer, offset: indices.offset };
        self.encoder.draw(kernel, bytemuck::bytes_of(params), indices, &ranges);
        self.recorded.draws += ranges.len() as u32;
    }

    /// Dispatches the number of workgroups in x, y and z that three words of a buffer say, at byte `offset`. If one of them is zero,
    /// nothing runs, so an earlier pass can decide on the device how much work this one does. `params` as for [`Record::dispatch`].
    ///
    /// # Panics
    /// If the words are past the end of the buffer, or if the token belongs to another pass.
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

    /// Records indirect draws. `params` as for [`Record::draw`].
    ///
    /// # Panics
    /// If the words are past the end of the buffer, or if a token belongs to another pass.
    pub fn draw_indirect<P: Pod>(
        &mut self,
        kernel: RasterKernel,
        params: &P,
        indices: IndexToken,
        draws: IndirectDraws,
    ) {
        if !self.fits::<P>(kernel.push(), PUSH_BYTES) {
            return;
        }
        let (physical, IndirectDraws { words, offset, count, cull }) = (self.physical, draws);
        let indices = self.buffer_in(physical, indices.resource, indices.pass);
        let range = self.buffer_in(physical, words.resource, words.pass);
        self.inside(range, offset, 20 * u64::from(count));
        let indices = BufferAt { buffer: &indices.buffer, offset: indices.offset };
        let words = BufferAt { buffer: &range.buffer, offset: range.offset + offset };
        self.encoder.draw_indirect(kernel, bytemuck::bytes_of(params), indices, DrawsAt { words, count, cull });
        self.recorded.draws += count;
    }

    /// Writes `contents` to a buffer from byte `offset` on. The data is part of the command buffer, so this suits tables of at
    /// most 64 KiB.
    ///
    /// # Panics
    /// If it ends past the end of the buffer, if it is larger than 65536 bytes or not a multiple of four bytes, or if the token
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

    /// Copies a range of one buffer to another; offsets and size are in bytes.
    ///
    /// # Panics
    /// If it ends past the end of either buffer, or if a token belongs to another pass.
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
    /// If it ends past the end of the buffer, or if a token belongs to another pass.
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

    /// Copies a mip of an image to a mip of the same size of another image.
    ///
    /// # Panics
    /// If the mips differ in size or format, or if a token belongs to another pass.
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

    /// Whether push constants of this type have the size that a pipeline declares; if not, the frame fails.
    fn fits<P>(&mut self, PushBlock { pipeline, bytes }: PushBlock, limit: u32) -> bool {
        let given = size_of::<P>() as u32;
        let wanted = bytes.unwrap_or(given).min(limit);
        if given != wanted {
            let (pass, kernel) = (self.name.to_owned(), self.encoder.pipeline_name(pipeline));
            self.fault.get_or_insert(GpuError::PushConstants { pass, kernel, wanted, given });
            return false;
        }
        match self.encoder.gpu().make_pipeline(pipeline) {
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

    /// Panics with the name of the pass: a programming error that no input can cause.
    fn misuse<T>(&self, what: &str) -> T {
        unreachable!("{}: {what}", self.name)
    }
}

/// Attachments have no id, because a pass only declares them.
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
