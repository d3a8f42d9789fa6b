//! A scene on the device: one buffer of tables, one of indices, one of acceleration structures, and the textures.
use super::{AlphaMode, ColourSpace, Daylight, Light, Material, Mesh, Scene, TextureUse, single};
use crate::gpu::{Buffer, BufferMemory, BufferUse, Cull, Gpu, GpuError, Image, ImageUse};
use crate::graph::execute::{ExecuteError, Executor, Imports};
use crate::graph::{
    self as graph, Access, BufferDesc, Domain, Draw, Extent, Format, FrameGraph, Handle, ImageDesc, ImageState,
    MipCopy, Queue, Record, Tlas,
};
use crate::ray::{MeshBvh, RayError, SceneBvh, object_from_world};
use bytemuck::Pod;
use glam::{Affine3A, Vec3};
use magpie_shaders::scene as shared;
use magpie_shaders::view::Sky;
use magpie_shaders::{Address, SampledImage, SamplerId};
use rayon::prelude::*;
use std::sync::Arc;

/// Why a scene could not be brought to the device.
#[derive(Debug, thiserror::Error)]
pub enum ResidentError {
    /// An acceleration structure could not be built.
    #[error(transparent)]
    Ray(#[from] RayError),
    /// The device refused.
    #[error(transparent)]
    Gpu(#[from] GpuError),
    /// The upload failed.
    #[error(transparent)]
    Upload(#[from] ExecuteError),
}

/// A scene on the device.
pub struct ResidentScene {
    tables: Arc<Buffer>,
    indices: Arc<Buffer>,
    bvh: Arc<Buffer>,
    textures: Vec<Arc<Image>>,
    root: Address,
    draws: Arc<[Draw]>,
    key_light: Option<u32>,
    sky: Option<Sky>,
}

/// The scene's resources as one frame's graph knows them.
#[derive(Clone, Copy, Debug)]
pub struct SceneImports {
    /// Instances, meshes, vertices, materials and lights.
    pub tables: Handle<graph::Buffer>,
    /// Indices of every mesh, one after another.
    pub indices: Handle<graph::Buffer>,
    /// The acceleration structure.
    pub tlas: Handle<Tlas>,
}

impl ResidentScene {
    /// Builds the acceleration structures on every core and uploads everything.
    ///
    /// # Errors
    /// Geometry that no tree can hold (with the mesh's name), exhausted memory, a lost device.
    pub fn new(gpu: &Gpu, scene: &Scene) -> Result<Self, ResidentError> {
        let mut executor = Executor::new(gpu)?;
        let textures = upload_textures(gpu, &mut executor, scene)?;

        // Acceleration structures.
        let trees: Vec<MeshBvh> = scene
            .meshes
            .par_iter()
            .map(|m| MeshBvh::build(&m.positions, &m.indices).map_err(|e| e.in_mesh(&m.name)))
            .collect::<Result<_, _>>()?;
        let placed: Vec<_> = scene.instances.iter().map(|i| (single(&i.world_from_object), i.mesh)).collect();
        let top = SceneBvh::build(&placed, &trees)?;
        let mut bvh = Block::default();
        let top_nodes = bvh.add(&top.nodes);
        let top_instances = bvh.add(&top.instances);
        let tree_offsets: Vec<_> = trees.iter().map(|t| (bvh.add(&t.nodes), bvh.add(&t.triangles))).collect();
        let bvh = bvh.upload(gpu, &mut executor, "scene acceleration", BufferUse::Storage)?;

        // Indices and vertices.
        let mut indices = Block::default();
        let index_offsets: Vec<_> = scene.meshes.iter().map(|m| indices.add(&m.indices)).collect();
        let indices = indices.upload(gpu, &mut executor, "scene indices", BufferUse::Index)?;
        let mut tables = Block::default();
        let vertex_offsets: Vec<_> =
            scene.meshes.iter().map(|m| (tables.add(&m.positions), tables.add(&attributes(m)))).collect();

        // Tables; their addresses follow from the base, so places are taken first and filled once the base is known.
        let materials = materials(gpu, scene, &textures)?;
        let material_table = tables.add(&materials);
        let lights: Vec<_> = scene.lights.iter().map(light).collect();
        let light_table = tables.add(&lights);
        let instances: Vec<_> = scene.instances.iter().map(|i| instance(scene, i)).collect();
        let instance_table = tables.add(&instances);
        let mesh_table = tables.add(&vec![shared::Mesh::default(); scene.meshes.len()]);
        let root_table = tables.add(&[shared::Scene::default()]);
        let buffer = tables.buffer(gpu, "scene tables", BufferUse::Storage)?;
        let base = buffer.address();
        let meshes: Vec<_> = (0..scene.meshes.len())
            .map(|i| shared::Mesh {
                positions: base.offset(vertex_offsets[i].0),
                previous_positions: base.offset(vertex_offsets[i].0),
                attributes: base.offset(vertex_offsets[i].1),
                indices: indices.address().offset(index_offsets[i]),
                nodes: bvh.address().offset(tree_offsets[i].0),
                triangles: bvh.address().offset(tree_offsets[i].1),
                primitive_count: (scene.meshes[i].indices.len() / 3) as u32,
            })
            .collect();
        tables.put(mesh_table, &meshes);
        let root = shared::Scene {
            instances: base.offset(instance_table),
            meshes: base.offset(mesh_table),
            materials: base.offset(material_table),
            lights: base.offset(light_table),
            tlas: Address::default(),
            tlas_nodes: bvh.address().offset(top_nodes),
            tlas_instances: bvh.address().offset(top_instances),
            instance_count: instances.len() as u32,
            light_count: lights.len() as u32,
        };
        tables.put(root_table, &[root]);
        tables.copy_to(gpu, &mut executor, &buffer)?;

        Ok(Self {
            tables: buffer,
            indices,
            bvh,
            textures,
            root: base.offset(root_table),
            draws: draws(scene, &index_offsets),
            key_light: key_light(&scene.lights),
            sky: scene.daylight.as_ref().map(Daylight::to_gpu),
        })
    }

    /// Brings the scene's buffers into a frame.
    pub fn import(&self, g: &mut FrameGraph, imports: &mut Imports) -> SceneImports {
        let mut buffer = |name, buffer: &Arc<Buffer>, g: &mut FrameGraph| {
            g.import_buffer(name, BufferDesc::new(buffer.bytes()), Access::CopyWrite, imports.buffer(buffer)).read()
        };
        let tables = buffer("scene.tables", &self.tables, g);
        let indices = buffer("scene.indices", &self.indices, g);
        let tlas = g.import_tlas("scene.tlas", Access::CopyWrite, imports.buffer(&self.bvh));
        SceneImports { tables, indices, tlas }
    }

    /// Address of the [`magpie_shaders::scene::Scene`].
    pub fn root(&self) -> Address {
        self.root
    }

    /// One draw per instance: opaque ones first, then by what culls them.
    pub fn draws(&self) -> &Arc<[Draw]> {
        &self.draws
    }

    /// The light that the shadow stage traces: the first directional one, else the strongest lamp.
    pub fn key_light(&self) -> Option<u32> {
        self.key_light
    }

    /// The sky, if the scene has one.
    pub fn sky(&self) -> Option<Sky> {
        self.sky
    }

    /// Bytes of geometry, tables and textures.
    pub fn scene_bytes(&self) -> u64 {
        let textures: u64 = self.textures.iter().map(|t| t.bytes()).sum();
        self.tables.bytes() + self.indices.bytes() + textures
    }

    /// Bytes of acceleration structures.
    pub fn acceleration_bytes(&self) -> u64 {
        self.bvh.bytes()
    }
}

/// Tables that will lie one after another in one buffer, each aligned to 16 bytes.
#[derive(Default)]
struct Block(Vec<u8>);

impl Block {
    fn add<T: Pod>(&mut self, items: &[T]) -> u64 {
        self.0.resize(self.0.len().next_multiple_of(16), 0);
        let offset = self.0.len() as u64;
        self.0.extend_from_slice(bytemuck::cast_slice(items));
        offset
    }

    fn put<T: Pod>(&mut self, offset: u64, items: &[T]) {
        let bytes = bytemuck::cast_slice(items);
        self.0[offset as usize..offset as usize + bytes.len()].copy_from_slice(bytes);
    }

    fn buffer(&self, gpu: &Gpu, name: &str, usage: BufferUse) -> Result<Arc<Buffer>, GpuError> {
        Ok(Arc::new(Buffer::new(gpu, name, self.0.len() as u64, BufferMemory::Device, usage)?))
    }

    fn upload(
        &self,
        gpu: &Gpu,
        executor: &mut Executor,
        name: &str,
        usage: BufferUse,
    ) -> Result<Arc<Buffer>, ResidentError> {
        let buffer = self.buffer(gpu, name, usage)?;
        self.copy_to(gpu, executor, &buffer)?;
        Ok(buffer)
    }

    fn copy_to(&self, gpu: &Gpu, executor: &mut Executor, target: &Arc<Buffer>) -> Result<(), ResidentError> {
        let bytes = self.0.len() as u64;
        if bytes == 0 {
            return Ok(());
        }
        let mut staging = Buffer::new(gpu, "staging", bytes, BufferMemory::Upload, BufferUse::Storage)?;
        staging.write(0, &self.0)?;
        let (mut g, mut imports) = (executor.begin(Extent::new(1, 1)), Imports::default());
        let source =
            g.import_buffer("staging", BufferDesc::new(bytes), Access::CopyRead, imports.buffer(&Arc::new(staging)));
        let desc = BufferDesc::new(target.bytes());
        let to = g.import_buffer(target.name(), desc, Access::CopyWrite, imports.buffer(target));
        let to = g.pass("upload.buffer", Queue::Transfer, |p| {
            let from = p.copy_from(source.read());
            let (to, into) = p.copy_to(to);
            (to, move |c: &mut Record<'_>| c.copy_buffer(from, 0, into, 0, bytes))
        });
        g.output(to.read());
        executor.run(g, &imports)?;
        Ok(())
    }
}

fn upload_textures(gpu: &Gpu, executor: &mut Executor, scene: &Scene) -> Result<Vec<Arc<Image>>, ResidentError> {
    let usage = ImageUse { sampled: true, ..Default::default() };
    let mut images = Vec::with_capacity(scene.textures.len());
    for texture in &scene.textures {
        let format = match texture.colour_space {
            ColourSpace::Srgb => Format::Rgba8Srgb,
            ColourSpace::Linear => Format::Rgba8Unorm,
        };
        let extent = Extent::new(texture.size[0], texture.size[1]);
        let image = Arc::new(Image::new(gpu, &texture.name, format, extent, texture.mips.len() as u32, usage)?);
        let mut block = Block::default();
        let mips: Vec<_> =
            texture.mips.iter().zip(0..).map(|(data, mip)| MipCopy { offset: block.add(data), mip }).collect();
        let bytes = block.0.len() as u64;
        let mut staging = Buffer::new(gpu, "staging", bytes, BufferMemory::Upload, BufferUse::Storage)?;
        staging.write(0, &block.0)?;

        let (mut g, mut imports) = (executor.begin(extent), Imports::default());
        let source =
            g.import_buffer("staging", BufferDesc::new(bytes), Access::CopyRead, imports.buffer(&Arc::new(staging)));
        let desc = ImageDesc { mips: image.mips(), ..ImageDesc::fixed(format, extent) };
        let to = g.import_image("texture", desc, ImageState::UNDEFINED, imports.image(&image));
        let to = g.pass("upload.texture", Queue::Transfer, |p| {
            let from = p.copy_from(source.read());
            let (to, into) = p.copy_to(to);
            (to, move |c: &mut Record<'_>| c.copy_to_image(from, into, &mips))
        });
        g.leave(to.read(), Access::Sample, Domain::Raster);
        executor.run(g, &imports)?;
        images.push(image);
    }
    Ok(images)
}

fn attributes(mesh: &Mesh) -> Vec<shared::VertexAttributes> {
    (0..mesh.positions.len())
        .map(|i| shared::VertexAttributes {
            normal: mesh.normals[i].to_array(),
            tangent: mesh.tangents[i].to_array(),
            uv0: mesh.uv0[i].to_array(),
            uv1: mesh.uv1[i].to_array(),
            colour: mesh.colours[i].to_array(),
        })
        .collect()
}

fn rows(m: &Affine3A) -> [[f32; 4]; 3] {
    let (a, t) = (m.matrix3, m.translation);
    [0, 1, 2].map(|r| [a.x_axis[r], a.y_axis[r], a.z_axis[r], t[r]])
}

fn instance(scene: &Scene, instance: &super::Instance) -> shared::Instance {
    let material = &scene.materials[instance.material as usize];
    let alpha_test = if material.alpha == AlphaMode::Opaque { 0 } else { shared::INSTANCE_ALPHA_TEST };
    let double_sided = if material.double_sided { shared::INSTANCE_DOUBLE_SIDED } else { 0 };
    // The importer keeps no singular instance; a built-in or a user's one that is singular has no inside to trace.
    let world_from_object = single(&instance.world_from_object);
    let inverse = object_from_world(&world_from_object).unwrap_or(Affine3A::ZERO);
    shared::Instance {
        world_from_object: rows(&world_from_object),
        object_from_world: rows(&inverse),
        previous_world_from_object: rows(&world_from_object),
        mesh: instance.mesh,
        material: instance.material,
        mask: shared::INSTANCE_MASK_ALL,
        flags: alpha_test | double_sided,
        rounding: 0.0,
    }
}

fn materials(gpu: &Gpu, scene: &Scene, textures: &[Arc<Image>]) -> Result<Vec<shared::Material>, GpuError> {
    let slot = |used: Option<TextureUse>| -> Result<shared::TextureSlot, GpuError> {
        let Some(used) = used else {
            return Ok(shared::TextureSlot { image: SampledImage(shared::NO_TEXTURE), ..Default::default() });
        };
        let image = textures.get(used.texture as usize).and_then(|t| t.sampled());
        let sampler = scene.samplers.get(used.sampler as usize).copied().unwrap_or_default();
        let sampler_id: SamplerId = gpu.sampler(sampler)?;
        Ok(shared::TextureSlot {
            image: image.unwrap_or(SampledImage(shared::NO_TEXTURE)),
            sampler_id,
            uv_set: used.uv_set,
            row_u: used.rows[0].to_array(),
            row_v: used.rows[1].to_array(),
        })
    };
    let one = |m: &Material| -> Result<shared::Material, GpuError> {
        let mut flags = 0;
        let (tested, alpha_cutoff) = match m.alpha {
            AlphaMode::Opaque => (false, 0.0),
            AlphaMode::Mask(cutoff) => (true, cutoff),
            AlphaMode::Blend => (true, 0.5),
        };
        for (set, bit) in [
            (tested, shared::MATERIAL_ALPHA_TEST),
            (m.double_sided, shared::MATERIAL_DOUBLE_SIDED),
            (m.unlit, shared::MATERIAL_UNLIT),
        ] {
            flags |= if set { bit } else { 0 };
        }
        Ok(shared::Material {
            base_colour: m.base_colour.to_array(),
            emission: m.emission.to_array(),
            metalness: m.metalness,
            roughness: m.roughness,
            normal_scale: m.normal_scale,
            occlusion_strength: m.occlusion_strength,
            alpha_cutoff,
            flags,
            base_colour_texture: slot(m.base_colour_texture)?,
            metallic_roughness_texture: slot(m.metallic_roughness_texture)?,
            normal_texture: slot(m.normal_texture)?,
            occlusion_texture: slot(m.occlusion_texture)?,
            emission_texture: slot(m.emission_texture)?,
        })
    };
    scene.materials.iter().map(one).collect()
}

fn light(light: &Light) -> shared::Light {
    match light {
        Light::Directional { direction, illuminance } => shared::Light {
            kind: shared::LIGHT_DIRECTIONAL,
            direction: direction.to_array(),
            intensity: illuminance.to_array(),
            ..Default::default()
        },
        Light::Point { position, intensity, range } => shared::Light {
            kind: shared::LIGHT_POINT,
            position: position.to_array(),
            intensity: intensity.to_array(),
            range: range.unwrap_or(0.0),
            ..Default::default()
        },
        Light::Spot { position, direction, intensity, range, inner, outer } => {
            // KHR_lights_punctual: both folded into one multiply-add; equal angles give a hard edge.
            let cone_scale = 1.0 / (inner.cos() - outer.cos()).max(1e-3);
            shared::Light {
                kind: shared::LIGHT_SPOT,
                position: position.to_array(),
                direction: direction.to_array(),
                intensity: intensity.to_array(),
                range: range.unwrap_or(0.0),
                cone_scale,
                cone_offset: -outer.cos() * cone_scale,
                ..Default::default()
            }
        }
        Light::Rectangle { centre, half_u, half_v, radiance } => shared::Light {
            kind: shared::LIGHT_RECTANGLE,
            position: centre.to_array(),
            direction: half_u.cross(*half_v).normalize_or_zero().to_array(),
            intensity: radiance.to_array(),
            half_u: half_u.to_array(),
            half_v: half_v.to_array(),
            ..Default::default()
        },
    }
}

fn key_light(lights: &[Light]) -> Option<u32> {
    let sun = lights.iter().position(|l| matches!(l, Light::Directional { .. }));
    let luminance = |c: Vec3| c.dot(Vec3::new(0.2126, 0.7152, 0.0722));
    let power = |l: &Light| match l {
        Light::Directional { illuminance, .. } => luminance(*illuminance),
        Light::Point { intensity, .. } | Light::Spot { intensity, .. } => luminance(*intensity),
        Light::Rectangle { half_u, half_v, radiance, .. } => {
            luminance(*radiance) * half_u.cross(*half_v).length() * 4.0
        }
    };
    let strongest = || (0..lights.len()).max_by(|a, b| power(&lights[*a]).total_cmp(&power(&lights[*b])));
    sun.or_else(strongest).map(|i| i as u32)
}

fn draws(scene: &Scene, index_offsets: &[u64]) -> Arc<[Draw]> {
    let mut draws: Vec<Draw> = scene
        .instances
        .iter()
        .zip(0..)
        // Spheres have no triangles to draw.
        .filter(|(i, _)| !scene.meshes[i.mesh as usize].indices.is_empty())
        .map(|(i, instance)| {
            let (mesh, material) = (i.mesh as usize, i.material as usize);
            let mirrored = i.world_from_object.matrix3.determinant() < 0.0;
            let cull = match (scene.materials[material].double_sided, mirrored) {
                (true, _) => Cull::None,
                (false, false) => Cull::Back,
                (false, true) => Cull::BackMirrored,
            };
            Draw {
                first_index: (index_offsets[mesh] / 4) as u32,
                index_count: scene.meshes[mesh].indices.len() as u32,
                instance,
                cull,
                alpha_test: scene.materials[material].alpha != AlphaMode::Opaque,
            }
        })
        .collect();
    draws.sort_by_key(|d| (d.alpha_test, d.cull as u32, d.instance));
    draws.into()
}
