//! Translates accesses of the graph to Vulkan pipeline stages, access masks and layouts.
use super::Gpu;
use crate::graph::{Access, Domain, Format, Layout, Uses};
use ash::vk;

/// The stages and accesses on one side of a barrier.
#[derive(Clone, Copy, Debug, Default, PartialEq, Eq)]
pub(crate) struct Scope {
    pub(super) stages: vk::PipelineStageFlags2,
    pub(super) access: vk::AccessFlags2,
}

impl Scope {
    /// All stages and all accesses.
    pub const EVERYTHING: Self = Self {
        stages: vk::PipelineStageFlags2::ALL_COMMANDS,
        access: vk::AccessFlags2::from_raw(
            vk::AccessFlags2::MEMORY_READ.as_raw() | vk::AccessFlags2::MEMORY_WRITE.as_raw(),
        ),
    };

    /// The scope of one access by a pass of this domain.
    pub fn of(access: Access, domain: Domain) -> Self {
        let shaders = match domain {
            Domain::Raster => vk::PipelineStageFlags2::VERTEX_SHADER | vk::PipelineStageFlags2::FRAGMENT_SHADER,
            Domain::Compute | Domain::Copy => vk::PipelineStageFlags2::COMPUTE_SHADER,
        };
        let tests = vk::PipelineStageFlags2::EARLY_FRAGMENT_TESTS | vk::PipelineStageFlags2::LATE_FRAGMENT_TESTS;
        let output = vk::PipelineStageFlags2::COLOR_ATTACHMENT_OUTPUT;
        let (storage_read, storage_write) =
            (vk::AccessFlags2::SHADER_STORAGE_READ, vk::AccessFlags2::SHADER_STORAGE_WRITE);
        let (stages, access) = match access {
            Access::Color => (output, vk::AccessFlags2::COLOR_ATTACHMENT_WRITE),
            Access::ColorLoad => {
                (output, vk::AccessFlags2::COLOR_ATTACHMENT_WRITE | vk::AccessFlags2::COLOR_ATTACHMENT_READ)
            }
            Access::Depth | Access::DepthLoad => (
                tests,
                vk::AccessFlags2::DEPTH_STENCIL_ATTACHMENT_WRITE | vk::AccessFlags2::DEPTH_STENCIL_ATTACHMENT_READ,
            ),
            Access::DepthTest => (tests, vk::AccessFlags2::DEPTH_STENCIL_ATTACHMENT_READ),
            Access::Sample => (shaders, vk::AccessFlags2::SHADER_SAMPLED_READ),
            Access::StorageRead | Access::BufferRead => (shaders, storage_read),
            // A BVH for tracing in software is plain memory; one of the driver's is not.
            Access::Trace => (shaders, storage_read | vk::AccessFlags2::ACCELERATION_STRUCTURE_READ_KHR),
            Access::StorageWrite | Access::BufferWrite => (shaders, storage_write),
            Access::StorageReadWrite | Access::BufferReadWrite => (shaders, storage_read | storage_write),
            Access::Index => (vk::PipelineStageFlags2::INDEX_INPUT, vk::AccessFlags2::INDEX_READ),
            Access::Indirect => (vk::PipelineStageFlags2::DRAW_INDIRECT, vk::AccessFlags2::INDIRECT_COMMAND_READ),
            Access::Build => (
                vk::PipelineStageFlags2::ACCELERATION_STRUCTURE_BUILD_KHR,
                vk::AccessFlags2::ACCELERATION_STRUCTURE_WRITE_KHR,
            ),
            Access::Refit | Access::BuildScratch => (
                vk::PipelineStageFlags2::ACCELERATION_STRUCTURE_BUILD_KHR,
                vk::AccessFlags2::ACCELERATION_STRUCTURE_WRITE_KHR | vk::AccessFlags2::ACCELERATION_STRUCTURE_READ_KHR,
            ),
            Access::BuildInput => (
                vk::PipelineStageFlags2::ACCELERATION_STRUCTURE_BUILD_KHR,
                vk::AccessFlags2::ACCELERATION_STRUCTURE_READ_KHR | vk::AccessFlags2::SHADER_READ,
            ),
            Access::CopyRead => (vk::PipelineStageFlags2::COPY, vk::AccessFlags2::TRANSFER_READ),
            Access::CopyWrite => (vk::PipelineStageFlags2::COPY, vk::AccessFlags2::TRANSFER_WRITE),
            Access::HostRead => (vk::PipelineStageFlags2::HOST, vk::AccessFlags2::HOST_READ),
        };
        Self { stages, access }
    }

    /// The first scope of a barrier. No uses wait for nothing; uses that the batch waited for are ordered before all stages.
    pub fn before(uses: Uses) -> Self {
        if uses.is_any() {
            return Self::EVERYTHING.available();
        }
        let waited = if uses.has_other_queues() {
            Self { stages: vk::PipelineStageFlags2::ALL_COMMANDS, access: vk::AccessFlags2::NONE }
        } else {
            Self::default()
        };
        uses.iter().map(|(access, domain)| Self::of(access, domain).available()).fold(waited, std::ops::BitOr::bitor)
    }

    /// The second scope of a barrier. No uses stand for another queue, whose semaphore wait covers all stages.
    pub fn after(uses: Uses) -> Self {
        if uses.is_any() {
            return Self::EVERYTHING;
        }
        if uses.is_empty() {
            return Self { stages: vk::PipelineStageFlags2::ALL_COMMANDS, access: vk::AccessFlags2::NONE };
        }
        uses.iter().map(|(access, domain)| Self::of(access, domain)).fold(Self::default(), std::ops::BitOr::bitor)
    }

    /// As the first scope of a barrier, which needs only the write accesses.
    pub(super) fn available(self) -> Self {
        const WRITES: vk::AccessFlags2 = vk::AccessFlags2::from_raw(
            vk::AccessFlags2::SHADER_STORAGE_WRITE.as_raw()
                | vk::AccessFlags2::COLOR_ATTACHMENT_WRITE.as_raw()
                | vk::AccessFlags2::DEPTH_STENCIL_ATTACHMENT_WRITE.as_raw()
                | vk::AccessFlags2::TRANSFER_WRITE.as_raw()
                | vk::AccessFlags2::ACCELERATION_STRUCTURE_WRITE_KHR.as_raw()
                | vk::AccessFlags2::MEMORY_WRITE.as_raw(),
        );
        Self { stages: self.stages, access: self.access & WRITES }
    }
}

impl Gpu {
    /// A scope with only the stages and accesses that this device supports.
    ///
    /// Ray passes may be compute shaders or ray-tracing pipelines, so a barrier for one covers both. Compute shaders may be
    /// paired with reads of acceleration structures only if the device has ray queries.
    pub(super) fn fit(&self, mut scope: Scope) -> Scope {
        let support = &self.0.ray_support;
        if support.pipeline && scope.stages.contains(vk::PipelineStageFlags2::COMPUTE_SHADER) {
            scope.stages |= vk::PipelineStageFlags2::RAY_TRACING_SHADER_KHR;
        }
        let read = vk::AccessFlags2::ACCELERATION_STRUCTURE_READ_KHR;
        let builds = scope.stages.contains(vk::PipelineStageFlags2::ACCELERATION_STRUCTURE_BUILD_KHR);
        if scope.access.contains(read)
            && !support.query
            && (!builds || scope.stages.contains(vk::PipelineStageFlags2::COMPUTE_SHADER))
        {
            scope.access &= !read;
            scope.access |= if support.accel { vk::AccessFlags2::MEMORY_READ } else { vk::AccessFlags2::NONE };
        }
        scope
    }
}

impl std::ops::BitOr for Scope {
    type Output = Self;
    fn bitor(self, other: Self) -> Self {
        Self { stages: self.stages | other.stages, access: self.access | other.access }
    }
}

/// The layout of an image of this format. Depth images are read in the layout in which they can be sampled and tested against at once;
/// descriptors of sampled images have the same.
pub(super) fn layout(layout: Layout, format: Format) -> vk::ImageLayout {
    match layout {
        Layout::Undefined => vk::ImageLayout::UNDEFINED,
        Layout::General => vk::ImageLayout::GENERAL,
        Layout::ColorAttachment => vk::ImageLayout::COLOR_ATTACHMENT_OPTIMAL,
        Layout::DepthAttachment => vk::ImageLayout::DEPTH_STENCIL_ATTACHMENT_OPTIMAL,
        Layout::ReadOnly if format.is_depth() => vk::ImageLayout::DEPTH_STENCIL_READ_ONLY_OPTIMAL,
        Layout::ReadOnly => vk::ImageLayout::SHADER_READ_ONLY_OPTIMAL,
        Layout::TransferSource => vk::ImageLayout::TRANSFER_SRC_OPTIMAL,
        Layout::TransferTarget => vk::ImageLayout::TRANSFER_DST_OPTIMAL,
    }
}

#[cfg(test)]
mod tests {
    use super::*;

    #[test]
    fn depth_is_read_in_a_layout_that_allows_both_tests_and_samples() {
        let read = |format| layout(Layout::ReadOnly, format);
        assert_eq!(read(Format::D32Float), vk::ImageLayout::DEPTH_STENCIL_READ_ONLY_OPTIMAL);
        assert_eq!(read(Format::Rgba16Float), vk::ImageLayout::SHADER_READ_ONLY_OPTIMAL);
        assert_eq!(Access::DepthTest.layout(), Access::Sample.layout());
        let test = Scope::of(Access::DepthTest, Domain::Raster);
        assert_eq!(test.access, vk::AccessFlags2::DEPTH_STENCIL_ATTACHMENT_READ);
        assert_eq!(test.available().access, vk::AccessFlags2::NONE);
    }
}
