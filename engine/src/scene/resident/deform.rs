//! Skinned and morphing meshes on the device. Every deforming instance has vertices of its own, recomputed each frame.
use super::block::Block;
use super::{Geometry, ResidentError};
use crate::gpu::{Buffer, BufferMemory, BufferUse, Gpu, GpuError, Kernel, Staging};
use crate::graph::execute::{Executor, Imports};
use crate::graph::{Access, Buffer as GraphBuffer, BufferDesc, FrameGraph, Handle, Queue, Record};
use crate::scene::{Animator, Mesh, Pose, Scene, single};
use magpie_shaders::acceleration::{
    DEFORM_GROUP, DeformJob, DeformParams, Deformer, Influence, JointMatrix, MorphDelta,
};
use magpie_shaders::scene::VertexAttributes;
use magpie_shaders::{ACCELERATION_DEFORM_COMP, Address};
use std::sync::Arc;

/// Workgroups per dimension that every Vulkan device supports (`maxComputeWorkGroupCount`).
const MAX_GROUPS: u32 = 65535;

/// All deforming instances.
pub(super) struct Deformation {
    kernel: Kernel,
    /// Deformed vertices of the current pose.
    memory: Arc<Buffer>,
    /// Inputs of the deformation: influences, morph deltas, and the tables of instances and workgroups.
    sources: Arc<Buffer>,
    deformers: Address,
    jobs: Address,
    job_count: u32,
    staging: Staging,
    pub meshes: Vec<Deforming>,
    /// Whether the device has the vertices of any pose.
    made: bool,
}

/// A deforming instance, with its own vertex tables.
pub(super) struct Deforming {
    pub instance: usize,
    /// Index of the mesh that it deforms.
    pub mesh: usize,
    pub positions: Address,
    pub previous_positions: Address,
    pub attributes: Address,
}

impl Deformation {
    /// Uploads the inputs of the deformation; `None` if nothing deforms.
    pub fn new(
        gpu: &Gpu,
        executor: &mut Executor,
        animator: &Animator,
        geometry: &Geometry<'_>,
    ) -> Result<Option<Self>, ResidentError> {
        let scene = geometry.scene;
        let instances: Vec<usize> = (0..scene.instances.len()).filter(|i| animator.deforms(*i)).collect();
        if instances.is_empty() {
            return Ok(None);
        }
        // Allocate the deformed vertices.
        let (mut bytes, mut places) = (0_u64, Vec::new());
        for &instance in &instances {
            let count = scene.meshes[scene.instances[instance].mesh as usize].positions.len() as u64;
            let mut take = |size: usize| {
                let at = bytes;
                bytes = (bytes + count * size as u64).next_multiple_of(16);
                at
            };
            places.push([take(12), take(12), take(size_of::<VertexAttributes>())]);
        }
        let memory = Arc::new(Buffer::new(gpu, "deforming vertices", bytes, BufferMemory::Device, BufferUse::Storage)?);
        let meshes: Vec<Deforming> = instances
            .iter()
            .zip(&places)
            .map(|(&instance, place)| {
                let [positions, previous_positions, attributes] = place.map(|o| memory.address().offset(o));
                let mesh = scene.instances[instance].mesh as usize;
                Deforming { instance, mesh, positions, previous_positions, attributes }
            })
            .collect();

        // Collect the inputs; instances of one mesh share them. Their addresses are known once the buffer is allocated.
        let mut block = Block::default();
        let mut shared: Vec<Option<[u64; 2]>> = vec![None; scene.meshes.len()];
        for deforming in &meshes {
            let mesh = &scene.meshes[deforming.mesh];
            let of = &mut shared[deforming.mesh];
            if of.is_none() {
                *of = Some([block.add(&influences(mesh)), block.add(&deltas(mesh))]);
            }
        }
        let deformer_table = block.add(&vec![Deformer::default(); meshes.len()]);
        let jobs = jobs(scene, &meshes);
        let job_table = block.add(&jobs);
        let sources = block.buffer(gpu, "deformation", BufferUse::Storage)?;
        let base = sources.address();
        let (mut first_joint, mut first_weight) = (0, 0);
        let pose = animator.pose(0.0);
        let deformers: Vec<Deformer> = meshes
            .iter()
            .map(|d| {
                let mesh = &scene.meshes[d.mesh];
                let [influences, targets] = shared[d.mesh].unwrap_or_default().map(|o| base.offset(o));
                let joints = pose.joints[d.instance].len() as u32;
                let weights = pose.weights[d.instance].len() as u32;
                let made = Deformer {
                    source_positions: geometry.meshes[d.mesh].positions,
                    source_attributes: geometry.meshes[d.mesh].attributes,
                    influences,
                    targets,
                    positions: d.positions,
                    previous_positions: d.previous_positions,
                    attributes: d.attributes,
                    vertex_count: mesh.positions.len() as u32,
                    influence_count: if joints == 0 { 0 } else { mesh.influences_per_vertex() as u32 },
                    target_count: weights,
                    first_joint,
                    first_weight,
                };
                first_joint += joints;
                first_weight += weights;
                made
            })
            .collect();
        block.put(deformer_table, &deformers);
        block.copy_to(gpu, executor, &sources)?;
        Ok(Some(Self {
            kernel: gpu.kernel(&ACCELERATION_DEFORM_COMP)?,
            memory,
            deformers: base.offset(deformer_table),
            jobs: base.offset(job_table),
            job_count: jobs.len() as u32,
            sources,
            staging: Staging::new(gpu, "pose"),
            meshes,
            made: false,
        }))
    }

    /// Discards the state of the device: the next frame recomputes all vertices.
    pub fn forget(&mut self) {
        self.made = false;
    }

    /// Size on the device, bytes.
    pub fn bytes(&self) -> u64 {
        self.memory.bytes() + self.sources.bytes()
    }

    /// Adds the pass that computes the vertices of a pose, if they may have changed. Returns whether it did.
    pub fn declare(
        &mut self,
        g: &mut FrameGraph,
        imports: &mut Imports,
        pose: &Pose,
        animated: bool,
        cut: bool,
        vertices: Handle<GraphBuffer>,
    ) -> Result<(Handle<GraphBuffer>, bool), GpuError> {
        let desc = BufferDesc::new(self.memory.bytes());
        let memory = g.import_buffer("scene.deforming", desc, Access::BufferRead, imports.buffer(&self.memory));
        if self.made && !animated {
            return Ok((memory.read(), false));
        }
        let first = cut || !std::mem::replace(&mut self.made, true);

        let mut block = Block::default();
        let of = |d: &Deforming| {
            pose.joints[d.instance].iter().map(|j| JointMatrix { rows: super::tables::rows(&single(j)) })
        };
        let joints: Vec<JointMatrix> = self.meshes.iter().flat_map(of).collect();
        let weights: Vec<f32> = self.meshes.iter().flat_map(|d| pose.weights[d.instance].iter().copied()).collect();
        let (joint_table, weight_table) = (block.add(&joints), block.add(&weights));
        let staged = self.staging.write(&block.0)?;
        let address = staged.address();
        let staged = imports.buffer(staged);
        let posed = g.import_buffer("scene.pose", BufferDesc::new(block.0.len() as u64), Access::CopyRead, staged);
        let sources = imports.buffer(&self.sources);
        let desc = BufferDesc::new(self.sources.bytes());
        let sources = g.import_buffer("scene.deformers", desc, Access::CopyWrite, sources);

        let params = DeformParams {
            deformers: self.deformers,
            jobs: self.jobs,
            joints: address.offset(joint_table),
            weights: address.offset(weight_table),
            job_count: self.job_count,
            first: first.into(),
        };
        let kernel = self.kernel;
        let across = self.job_count.min(MAX_GROUPS);
        let groups = [across, self.job_count.div_ceil(across), 1];
        let memory = g.pass("acceleration.deform", Queue::Graphics, |p| {
            p.read(posed.read());
            p.read(sources.read());
            p.read(vertices);
            let (memory, _) = p.write_buffer(memory);
            (memory, move |c: &mut Record<'_>| c.dispatch_groups(kernel, &params, groups))
        });
        Ok((memory.read(), true))
    }
}

fn influences(mesh: &Mesh) -> Vec<Influence> {
    mesh.influences.iter().map(|i| Influence { joint: i.joint, weight: i.weight }).collect()
}

/// Deltas of every vertex for the first target, then for the next; zero where a target does not change an attribute.
fn deltas(mesh: &Mesh) -> Vec<MorphDelta> {
    let count = mesh.positions.len();
    let of = |table: &[glam::Vec3], i: usize| table.get(i).copied().unwrap_or_default().to_array();
    let one = |target: &crate::scene::MorphTarget, i: usize| MorphDelta {
        position: of(&target.positions, i),
        normal: of(&target.normals, i),
        tangent: of(&target.tangents, i),
    };
    mesh.targets.iter().flat_map(|t| (0..count).map(move |i| one(t, i))).collect()
}

fn jobs(scene: &Scene, meshes: &[Deforming]) -> Vec<DeformJob> {
    let of = |(deformer, d): (u32, &Deforming)| {
        let count = scene.meshes[d.mesh].positions.len() as u32;
        (0..count.div_ceil(DEFORM_GROUP)).map(move |group| DeformJob { deformer, first: group * DEFORM_GROUP })
    };
    (0..).zip(meshes).flat_map(of).collect()
}
