//! The trees that Magpie's own walk reads, built on the host.
use super::block::Block;
use super::{AccelerationReport, ResidentError};
use crate::gpu::{Buffer, BufferUse, Gpu};
use crate::graph::execute::Executor;
use crate::ray::{MeshBvh, SceneBvh, placements};
use crate::scene::Scene;
use magpie_shaders::Address;
use rayon::prelude::*;
use std::sync::Arc;
use std::time::Instant;

/// Both levels in one buffer.
pub(super) struct Software {
    pub memory: Arc<Buffer>,
    /// Nodes and primitives of each mesh.
    pub meshes: Vec<(Address, Address)>,
    /// Nodes of the top level, and its instances.
    pub top: (Address, Address),
}

impl Software {
    /// Builds on every core.
    pub fn new(
        gpu: &Gpu,
        executor: &mut Executor,
        scene: &Scene,
        report: &mut AccelerationReport,
    ) -> Result<Self, ResidentError> {
        let start = Instant::now();
        let trees: Vec<MeshBvh> = scene
            .meshes
            .par_iter()
            .map(|m| MeshBvh::build(&m.positions, &m.indices).map_err(|e| e.in_mesh(&m.name)))
            .collect::<Result<_, _>>()?;
        report.bottom_ms = start.elapsed().as_secs_f64() * 1e3;
        let start = Instant::now();
        let placed: Vec<_> = scene.instances.iter().map(|i| (i.world_from_object, i.mesh)).collect();
        let top = SceneBvh::build(&placements(&placed, &trees)?)?;
        report.top_ms = start.elapsed().as_secs_f64() * 1e3;

        let mut block = Block::default();
        let top_offsets = (block.add(&top.nodes), block.add(&top.instances));
        report.top_bytes = block.0.len() as u64;
        let offsets: Vec<_> = trees.iter().map(|t| (block.add(&t.nodes), block.add(&t.primitives))).collect();
        report.bottom_bytes = block.0.len() as u64 - report.top_bytes;
        report.uncompacted_bytes = report.bottom_bytes;
        let memory = block.upload(gpu, executor, "scene acceleration", BufferUse::Storage)?;
        let at = |(a, b): (u64, u64)| (memory.address().offset(a), memory.address().offset(b));
        Ok(Self { meshes: offsets.into_iter().map(at).collect(), top: at(top_offsets), memory })
    }
}
