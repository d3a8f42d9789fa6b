//! The view of a frame: the camera, and what an effect may ask about the scene without looking at the GPU.
use crate::gpu::{GpuError, Staging};
use crate::graph::execute::Imports;
use crate::graph::{Access, Buffer, BufferDesc, Draw, Extent, FrameGraph, Handle};
use crate::scene::{Camera, Caster, Placed, ResidentScene};
use glam::{DVec3, Mat4};
use magpie_shaders::SampledImage;
use magpie_shaders::scene::NO_TEXTURE;
use magpie_shaders::view::{self as shared, NO_LIGHT, Sky};
use std::sync::Arc;

/// What every effect is given beside its inputs.
#[derive(Clone, Debug)]
pub struct View {
    /// [`magpie_shaders::view::View`], the camera's and the frame's block for shaders.
    pub block: Handle<Buffer>,
    /// Frame number, from 0.
    pub frame: u32,
    /// What the raster passes draw.
    pub draws: Arc<[Draw]>,
    /// The lights that can cast shadows, the one that matters most first.
    pub casters: Arc<[Caster]>,
    /// Where the instances of the scene are.
    pub placed: Arc<[Placed]>,
    /// The scene's own number.
    pub scene: u64,
    /// From where the frame is seen.
    pub camera: Camera,
    /// The world point from which the frame's coordinates are counted, metres.
    pub origin: DVec3,
    /// The scene has a sky.
    pub has_sky: bool,
}

/// From where a frame is seen, and which frame it is.
#[derive(Clone, Copy, Debug)]
pub struct ViewDesc<'a> {
    /// The camera.
    pub camera: &'a Camera,
    /// Pixels.
    pub extent: Extent,
    /// Frame number, from 0.
    pub frame: u32,
    /// Seed of everything random.
    pub seed: u32,
    /// Camera and size of the frame before; `None` for the first, in which nothing moves.
    pub previous: Option<(&'a Camera, Extent)>,
}

const BLOCK_BYTES: u64 = size_of::<shared::View>() as u64;

fn clip_from_view(camera: &Camera, extent: Extent) -> Mat4 {
    camera.clip_from_view(extent.width as f32 / extent.height as f32)
}

/// Clip space from the world, which is counted from `origin`: reversed infinite depth, y down.
fn clip_from_world(camera: &Camera, extent: Extent, origin: DVec3) -> Mat4 {
    clip_from_view(camera, extent) * camera.view_from_world(origin)
}

impl ViewDesc<'_> {
    /// Brings camera, frame and sky into a frame of the graph, in the memory of `block`. The world is counted from the origin that
    /// the scene has gone to, that of the frame before too.
    ///
    /// # Errors
    /// [`GpuError::OutOfMemory`], where an earlier frame's imports still hold that memory.
    pub fn declare(
        &self,
        block: &mut Staging,
        scene: &ResidentScene,
        g: &mut FrameGraph,
        imports: &mut Imports,
    ) -> Result<View, GpuError> {
        let (camera, extent, origin) = (self.camera, self.extent, scene.origin());
        let now = clip_from_world(camera, extent, origin);
        let before = self.previous.map_or(now, |(camera, extent)| clip_from_world(camera, extent, origin));
        let placed = camera.placed(origin);
        let casters = scene.casters();
        // The product of the two inverses: the inverse of the product loses digits far from the origin.
        let world_from_clip = Mat4::from(placed) * clip_from_view(camera, extent).inverse();
        let contents = shared::View {
            clip_from_world: now.to_cols_array_2d(),
            world_from_clip: world_from_clip.to_cols_array_2d(),
            previous_clip_from_world: before.to_cols_array_2d(),
            eye: placed.translation.to_array(),
            frame: self.frame,
            size: [self.extent.width, self.extent.height],
            seed: self.seed,
            caster_count: casters.len() as u32,
            casters: std::array::from_fn(|k| casters.get(k).map_or(NO_LIGHT, |c| c.light)),
            scene: scene.root(),
            has_sky: u32::from(scene.sky().is_some()),
            sky: scene.sky().unwrap_or(Sky { environment: SampledImage(NO_TEXTURE), ..Sky::default() }),
        };
        let key = imports.buffer(block.write(bytemuck::bytes_of(&contents))?);
        Ok(View {
            block: g.import_buffer("view", BufferDesc::new(BLOCK_BYTES), Access::BufferRead, key).read(),
            frame: self.frame,
            draws: scene.draws().clone(),
            casters: casters.into(),
            placed: scene.placed().clone(),
            scene: scene.number(),
            camera: camera.clone(),
            origin,
            has_sky: scene.sky().is_some(),
        })
    }
}
