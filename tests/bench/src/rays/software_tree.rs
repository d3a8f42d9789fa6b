//! Software BVHs of a [`World`](super::World), built on the CPU.
use super::trace::upload;
use super::{Change, Placed, RayBenchError, Shape, WorldReport};
use glam::Affine3A;
use magpie::gpu::{Buffer, Gpu};
use magpie::graph::execute::Executor;
use magpie::ray::{MeshBvh, SceneBvh, placements};
use magpie_shaders::Address;
use rayon::prelude::*;
use std::sync::Arc;
use std::time::Instant;

/// Bottom-level and top-level BVHs.
pub(super) struct SoftwareTree {
    trees: Vec<MeshBvh>,
    meshes: Vec<(Address, Address)>,
    bottom: Arc<Buffer>,
    top: SceneBvh,
    top_memory: Arc<Buffer>,
    top_instances: u64,
}

impl SoftwareTree {
    pub fn new(
        gpu: &Gpu,
        executor: &mut Executor,
        shapes: &[Shape],
        placed: &[Placed],
        report: &mut WorldReport,
    ) -> Result<Self, RayBenchError> {
        let begun = Instant::now();
        let trees: Vec<MeshBvh> =
            shapes.par_iter().map(|s| MeshBvh::build(&s.positions, &s.indices)).collect::<Result<_, _>>()?;
        report.bottom_ns = begun.elapsed().as_nanos() as u64;
        let begun = Instant::now();
        let top = SceneBvh::build(&placements(&instances(placed), &trees)?)?;
        report.top_ns = begun.elapsed().as_nanos() as u64;

        let mut bytes = Vec::new();
        let mut offsets = Vec::new();
        for tree in &trees {
            let nodes = bytes.len() as u64;
            bytes.extend_from_slice(bytemuck::cast_slice(&tree.nodes));
            offsets.push((nodes, bytes.len() as u64));
            bytes.extend_from_slice(bytemuck::cast_slice(&tree.primitives));
        }
        report.bottom_bytes = bytes.len() as u64;
        report.uncompacted_bytes = report.bottom_bytes;
        let bottom = upload(gpu, executor, "bench bottom levels", &bytes)?;
        let at = |offset| bottom.address().offset(offset);
        let meshes = offsets.into_iter().map(|(nodes, triangles)| (at(nodes), at(triangles))).collect();
        let (top_memory, top_instances) = upload_top(gpu, executor, &top)?;
        report.top_bytes = top_memory.bytes();
        Ok(Self { trees, meshes, bottom, top, top_memory, top_instances })
    }

    /// Addresses of the nodes and primitives of each mesh.
    pub fn meshes(&self) -> impl Iterator<Item = (Address, Address)> {
        self.meshes.iter().copied()
    }

    /// Addresses of the top level's nodes and of its instances.
    pub fn top(&self) -> (Address, Address) {
        let base = self.top_memory.address();
        (base, base.offset(self.top_instances))
    }

    pub fn bottom_memory(&self) -> &Arc<Buffer> {
        &self.bottom
    }

    pub fn top_memory(&self) -> &Arc<Buffer> {
        &self.top_memory
    }

    /// Updates the top level; returns nanoseconds on the CPU, the upload excluded.
    pub fn follow(
        &mut self,
        gpu: &Gpu,
        executor: &mut Executor,
        placed: &[Placed],
        change: Change,
    ) -> Result<u64, RayBenchError> {
        let placed = instances(placed);
        let begun = Instant::now();
        let placed = placements(&placed, &self.trees)?;
        match change {
            Change::Rebuild => self.top = SceneBvh::build(&placed)?,
            Change::Refit => self.top.refit(&placed)?,
        }
        let taken = begun.elapsed().as_nanos() as u64;
        (self.top_memory, self.top_instances) = upload_top(gpu, executor, &self.top)?;
        Ok(taken)
    }
}

fn instances(placed: &[Placed]) -> Vec<(Affine3A, u32)> {
    placed.iter().map(|p| (p.world_from_object, p.shape)).collect()
}

/// Uploads nodes followed by instances, whose offset is returned.
fn upload_top(gpu: &Gpu, executor: &mut Executor, top: &SceneBvh) -> Result<(Arc<Buffer>, u64), RayBenchError> {
    let mut bytes: Vec<u8> = bytemuck::cast_slice(&top.nodes).to_vec();
    let offset = bytes.len() as u64;
    bytes.extend_from_slice(bytemuck::cast_slice(&top.instances));
    Ok((upload(gpu, executor, "bench top level", &bytes)?, offset))
}
