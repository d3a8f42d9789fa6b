//! The view of a frame: the camera, and what an effect may ask about the scene without looking at the GPU.
use crate::gpu::{GpuError, Staging};
use crate::graph::execute::Imports;
use crate::graph::{Access, Buffer, BufferDesc, Draw, DrawClass, DrawLists, Extent, FrameGraph, Handle, ImportKey};
use crate::scene::{Camera, Placed, ResidentScene, SceneFacts, SceneSketch, ShadowLight};
use glam::{DVec3, Mat4, Vec3A};
use magpie_shaders::SampledImage;
use magpie_shaders::scene::LIGHT_DIRECTIONAL;
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
    pub draws: DrawLists,
    /// Size of the picture that is made in the end, pixels. The frame itself may be smaller.
    pub output: Extent,
    /// The lights that can cast shadows, the one that matters most first.
    pub shadow_lights: Arc<[ShadowLight]>,
    /// Where the instances of the scene are.
    pub placed: Arc<[Placed]>,
    /// The scene's own number.
    pub scene: u64,
    /// From where the frame is seen.
    pub camera: Camera,
    /// The world point from which the frame's coordinates are counted, metres.
    pub origin: DVec3,
    /// What the scene is made of.
    pub facts: Arc<SceneFacts>,
}

impl View {
    /// The blended draws, the farthest first: by the distance from the eye to the nearest point of each instance's box, which is 0 inside of
    /// it. Where two are equally far, the instance with the lower index comes first.
    #[must_use]
    pub fn blended_back_to_front(&self) -> Vec<Draw> {
        let eye = self.camera.eye() - self.origin;
        let far = |i: u32| self.placed.get(i as usize).map_or(f64::INFINITY, |p| p.bounds.distance_to(eye));
        self.draws.back_to_front(DrawClass::Blended, far)
    }
}

/// From where a frame is seen, and which frame it is.
#[derive(Clone, Copy, Debug)]
pub struct ViewDesc<'a> {
    /// The camera.
    pub camera: &'a Camera,
    /// Pixels that are rendered.
    pub extent: Extent,
    /// Pixels of the picture that is made in the end. Its shape is what the camera's is taken from.
    pub output: Extent,
    /// Where the rendered pixels are sampled: pixels from their centres, right and down, each -0.5 to 0.5.
    pub jitter: [f32; 2],
    /// Frame number, from 0.
    pub frame: u32,
    /// Seed of everything random.
    pub seed: u32,
    /// The frame before; `None` for the first, in which nothing moves.
    pub previous: Option<PreviousView<'a>>,
    /// Only directional lights are among [`View::shadow_lights`]: an effect [samples](crate::slot::Needs::samples_lamps) all others.
    pub samples_lamps: bool,
}

/// From where the frame before was seen.
#[derive(Clone, Copy, Debug)]
pub struct PreviousView<'a> {
    /// The camera.
    pub camera: &'a Camera,
    /// Pixels that were rendered.
    pub extent: Extent,
    /// Pixels of the picture.
    pub output: Extent,
    /// Where its pixels were sampled, as [`ViewDesc::jitter`].
    pub jitter: [f32; 2],
}

impl<'a> ViewDesc<'a> {
    /// The first frame with seed 0, as large as the picture and sampled at the centres of pixels.
    #[must_use]
    pub fn new(camera: &'a Camera, extent: Extent) -> Self {
        Self {
            camera,
            extent,
            output: extent,
            jitter: [0.0; 2],
            frame: 0,
            seed: 0,
            previous: None,
            samples_lamps: false,
        }
    }

    fn shadow_lights(&self, all: &[ShadowLight]) -> Arc<[ShadowLight]> {
        let casts = |light: &&ShadowLight| !self.samples_lamps || light.placed.kind == LIGHT_DIRECTIONAL;
        all.iter().filter(casts).copied().collect()
    }
}

impl<'a> PreviousView<'a> {
    /// A frame as large as its picture, sampled at the centres of pixels.
    #[must_use]
    pub fn new(camera: &'a Camera, extent: Extent) -> Self {
        Self { camera, extent, output: extent, jitter: [0.0; 2] }
    }
}

const BLOCK_BYTES: u64 = size_of::<shared::View>() as u64;

/// A camera as the matrices of one frame have it; the world is counted from an origin.
struct Matrices {
    /// Clip from world without jitter: reversed infinite depth, y down.
    steady: Mat4,
    /// The same with jitter.
    jittered: Mat4,
    /// The inverse of that.
    inverse: Mat4,
    eye: Vec3A,
}

impl Matrices {
    fn new(view: &PreviousView<'_>, origin: DVec3) -> Self {
        let PreviousView { camera, extent, output, jitter } = *view;
        let (placed, view_from_world) = (camera.placed(origin), camera.view_from_world(origin));
        let steady = camera.clip_from_view(output.width as f32 / output.height as f32);
        // Where a pixel is sampled right of its centre, everything is drawn as far left. The inverse of both is taken apart by hand,
        // so that it is exactly that of the camera where there is no jitter.
        let shift = [2.0 * jitter[0] / extent.width as f32, 2.0 * jitter[1] / extent.height as f32];
        let (mut jittered, mut view_from_clip) = (steady, steady.inverse());
        jittered.z_axis.x += shift[0];
        jittered.z_axis.y += shift[1];
        view_from_clip.w_axis += view_from_clip.x_axis * shift[0] + view_from_clip.y_axis * shift[1];
        Self {
            steady: steady * view_from_world,
            jittered: jittered * view_from_world,
            // The product of the two inverses: the inverse of the product loses digits far from the origin.
            inverse: Mat4::from(placed) * view_from_clip,
            eye: placed.translation,
        }
    }
}

impl ViewDesc<'_> {
    /// Brings camera and frame into a frame that is only planned.
    pub fn sketch(&self, scene: &SceneSketch, g: &mut FrameGraph) -> View {
        let block = g.import_buffer("view", BufferDesc::new(BLOCK_BYTES), Access::BufferRead, ImportKey::Caller(0));
        View {
            block: block.read(),
            frame: self.frame,
            draws: scene.draws.clone(),
            output: self.output,
            shadow_lights: self.shadow_lights(&scene.shadow_lights),
            placed: scene.placed.clone(),
            scene: u64::MAX,
            camera: self.camera.clone(),
            origin: scene.origin,
            facts: scene.facts.clone(),
        }
    }

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
        let (origin, shadow_lights) = (scene.origin(), self.shadow_lights(&scene.shadow_lights()));
        let Self { camera, extent, output, jitter, .. } = *self;
        let this = PreviousView { camera, extent, output, jitter };
        let (now, before) = (Matrices::new(&this, origin), Matrices::new(&self.previous.unwrap_or(this), origin));
        let contents = shared::View {
            clip_from_world: now.jittered.to_cols_array_2d(),
            world_from_clip: now.inverse.to_cols_array_2d(),
            steady_clip_from_world: now.steady.to_cols_array_2d(),
            previous_clip_from_world: before.steady.to_cols_array_2d(),
            previous_world_from_clip: before.inverse.to_cols_array_2d(),
            eye: now.eye.to_array(),
            previous_eye: before.eye.to_array(),
            jitter,
            previous_jitter: self.previous.map_or(jitter, |previous| previous.jitter),
            output_size: [output.width, output.height],
            mip_bias: (extent.height as f32 / output.height as f32).log2().min(0.0),
            frame: self.frame,
            size: [extent.width, extent.height],
            seed: self.seed,
            shadow_light_count: shadow_lights.len() as u32,
            shadow_lights: std::array::from_fn(|k| shadow_lights.get(k).map_or(NO_LIGHT, |l| l.light)),
            lobe_albedo: scene.lobe_albedo_address(),
            has_sky: u32::from(scene.sky().is_some()),
            sky: scene.sky().unwrap_or(Sky { environment: SampledImage::NONE, ..Sky::default() }),
        };
        let key = imports.buffer(block.write(bytemuck::bytes_of(&contents))?);
        Ok(View {
            block: g.import_buffer("view", BufferDesc::new(BLOCK_BYTES), Access::BufferRead, key).read(),
            frame: self.frame,
            draws: scene.draws().clone(),
            output,
            shadow_lights,
            placed: scene.placed().clone(),
            scene: scene.number(),
            camera: camera.clone(),
            origin,
            facts: scene.facts().clone(),
        })
    }
}
