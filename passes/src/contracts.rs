//! The contract of every slot: its inputs and outputs. Effects depend on each other only through these types.
//!
//! Output images have the size of the frame; those of `post` have the size of the output picture. If an image has another format or size
//! than its contract allows, the frame is refused with an error that names the slot, the implementation and both formats or sizes.
mod gbuffer;

use crate::outputs::{DIRECTION, DISPLAY, DISTANCE, Gives, RADIANCE, SCALAR, VISIBILITY};
pub use gbuffer::{Channel, GBuffer, GBufferToken, GEOMETRY, RAY_START};
use magpie::frame::View;
use magpie::graph::execute::Imports;
use magpie::graph::{Buffer, BufferToken, Extent, Format, FrameGraph, Handle, Image, PassBuilder, Record, WriteHandle};
use magpie::scene::{Camera, ResidentError, SceneSketch, SharedScene};
pub use magpie::scene::{SceneHandles, SceneToken};
use magpie_shaders::Address;
use magpie_shaders::view::MAX_SHADOW_LIGHTS;
use std::cell::RefCell;
use std::rc::Rc;

/// Input of the slot `acceleration`.
#[derive(Clone)]
pub enum AccelerationIn {
    /// The scene on the device, animated to the time of the frame.
    Resident {
        /// The scene.
        scene: SharedScene,
        /// Buffers and images that this frame imports into the graph.
        imports: Rc<RefCell<Imports>>,
        /// The camera of the frame.
        camera: Camera,
    },
    /// A frame that is only planned, without a device.
    Sketch(Rc<SceneSketch>),
}

/// The scene's tables and acceleration structures, brought up to date for this frame.
pub type AccelerationOut = Result<SceneHandles, ResidentError>;

impl Gives for AccelerationOut {
    const SHOWN: bool = false;

    fn images(&self) -> Vec<(&'static str, Handle<Image>, &'static [Format])> {
        Vec::new()
    }
}

/// The visible surfaces and their reprojection into the previous frame, as denoisers read them.
#[derive(Clone, Copy, Debug)]
pub struct Reprojected {
    /// The guide, RG32 uint: view depth, geometric normal and instance, packed as in `lib/guide.glsl`.
    pub guide: Handle<Image>,
    /// The four pixels of the previous frame that showed the surface and their weights, R32 uint, packed as in `lib/taps.glsl`; 0 if none did.
    pub taps: Handle<Image>,
    /// The guide of the previous frame, in that frame's pixels; all 0 if there is none.
    pub previous_guide: Handle<Image>,
}

/// Input of the slot `gbuffer`.
#[derive(Clone, Copy, Debug)]
pub struct GBufferIn {
    /// The scene to draw.
    pub scene: SceneHandles,
}

/// Input of the slot `rays`.
#[derive(Clone, Copy, Debug)]
pub struct RaysIn {
    /// The scene to trace.
    pub scene: SceneHandles,
}

/// Output of the slot `rays`: the cost of traversal per pixel.
#[derive(Clone, Copy, Debug)]
pub struct RaysOut {
    /// Steps of one primary ray per pixel in false colours, RGBA8; `None` if the slot is off.
    pub colours: Option<Handle<Image>>,
}

impl Gives for RaysOut {
    const SHOWN: bool = false;

    fn images(&self) -> Vec<(&'static str, Handle<Image>, &'static [Format])> {
        self.colours.map(|image| ("colours", image, &[Format::Rgba8Unorm][..])).into_iter().collect()
    }
}

/// Input of the slot `shadows`.
#[derive(Clone, Copy, Debug)]
pub struct ShadowIn {
    /// The scene, which contains lights and occluders.
    pub scene: SceneHandles,
    /// The surfaces that receive shadows.
    pub gbuffer: GBuffer,
    /// Reprojection of these surfaces into the previous frame.
    pub reprojected: Reprojected,
}

/// Greatest number of visibility images: every shadow-casting light may have its own.
pub const SHADOW_GROUPS: usize = MAX_SHADOW_LIGHTS as usize;

/// Visibility of up to four lights, in one image.
#[derive(Clone, Copy, Debug)]
pub struct ShadowGroup {
    /// The visible share of one light in each channel, 0 to 1. One, two or four channels: R, RG or RGBA of 8-bit unorm, 16-bit unorm, 16F or
    /// 32F.
    pub visibility: Handle<Image>,
    /// Scene index of the light in each channel; `NO_LIGHT` for unused channels. They must be among the shadow-casting lights of the view.
    pub lights: [u32; 4],
    /// The first three channels hold the red, green and blue visibility of the first light.
    pub coloured: bool,
    /// The values are single unfiltered rays of the pixel. Their mean over frames is the visibility, but one frame may be far from it.
    pub raw: bool,
}

/// Visibility of the shadow-casting lights; all other lights are unshadowed.
#[derive(Clone, Copy, Debug, Default)]
pub struct ShadowOut {
    /// Visibility images. Used entries come first.
    pub groups: [Option<ShadowGroup>; SHADOW_GROUPS],
}

impl Gives for ShadowOut {
    fn images(&self) -> Vec<(&'static str, Handle<Image>, &'static [Format])> {
        self.groups.iter().flatten().map(|group| ("visibility", group.visibility, VISIBILITY)).collect()
    }
}

/// Default distance up to which geometry counts as an occluder for ambient occlusion, metres. The effects and the reference share it.
pub const AO_RANGE: f32 = 1.0;

/// Input of the slot `ao`.
#[derive(Clone, Copy, Debug)]
pub struct AoIn {
    /// The scene, which contains the occluders.
    pub scene: SceneHandles,
    /// The surfaces for which openness is computed.
    pub gbuffer: GBuffer,
    /// Reprojection of these surfaces into the previous frame.
    pub reprojected: Reprojected,
}

/// Ambient occlusion. It applies to indirect light only.
#[derive(Clone, Copy, Debug)]
pub struct AoOut {
    /// Openness, the cosine-weighted share of the hemisphere without an occluder in range: 0 is closed, 1 is open. R8 unorm, R16 unorm, R16F or
    /// R32F; `None` means 1 everywhere.
    pub openness: Option<Handle<Image>>,
    /// Bent normal, the mean unoccluded direction, in world space: octahedral in RG16F or RG32F. If `None`, the shading normal is used.
    pub bent_normal: Option<Handle<Image>>,
}

impl Gives for AoOut {
    fn images(&self) -> Vec<(&'static str, Handle<Image>, &'static [Format])> {
        let openness = self.openness.map(|image| ("openness", image, SCALAR));
        openness.into_iter().chain(self.bent_normal.map(|image| ("bent_normal", image, DIRECTION))).collect()
    }

    fn shown(&self) -> Option<Handle<Image>> {
        self.openness
    }
}

/// Input of the slot `direct`.
#[derive(Clone, Copy, Debug)]
pub struct DirectIn {
    /// The scene, which contains lights and materials.
    pub scene: SceneHandles,
    /// The surfaces to light.
    pub gbuffer: GBuffer,
    /// Reprojection of these surfaces into the previous frame.
    pub reprojected: Reprojected,
    /// Visibility of the lights.
    pub shadows: ShadowOut,
}

/// Reflected radiance of the lights towards the camera, plus emission.
#[derive(Debug)]
pub struct DirectOut {
    /// Radiance, RGBA32F or RGBA16F.
    pub radiance: WriteHandle<Image>,
}

impl Gives for DirectOut {
    fn images(&self) -> Vec<(&'static str, Handle<Image>, &'static [Format])> {
        self.radiance.images()
    }
}

/// Input of the slots `gi` and `reflections`, and of other effects that light the visible surfaces.
#[derive(Clone, Copy, Debug)]
#[non_exhaustive]
pub struct LightingIn {
    /// The scene: lights, materials and acceleration structures.
    pub scene: SceneHandles,
    /// The surfaces to light.
    pub gbuffer: GBuffer,
    /// Reprojection of these surfaces into the previous frame.
    pub reprojected: Reprojected,
    /// Ambient occlusion, for indirect light.
    pub ao: AoOut,
    /// Output of the slot `direct` in this frame: direct light plus emission.
    pub direct: Handle<Image>,
    /// Radiance of the complete previous frame, sky included, before anti-aliasing and tone mapping. It is in the pixels of that frame, not
    /// reprojected. RGBA16F with 1 in alpha; 0 in all channels where it is unknown, as in the first frame. `None` unless an effect asks for it with
    /// [`Needs::previous_radiance`](magpie::slot::Needs::previous_radiance).
    pub previous_radiance: Option<Handle<Image>>,
    /// Indirect light in the world, for the hits of rays, from the slot `gi`. `None` for that slot itself, and where it keeps none.
    pub cache: Option<LightCache>,
}

/// Diffuse indirect light that the slot `gi` keeps in the world, as surfels, for the hits of rays of other effects. How a shader asks it:
/// `cached_light_at` of `lib/hit_shading.glsl`.
#[derive(Clone, Copy, Debug)]
pub struct LightCache {
    /// A [`SurfelGrid`](magpie_shaders::surfels::SurfelGrid), which has the addresses of the other buffers.
    pub grid: Handle<Buffer>,
    /// [`PlacedSurfel`](magpie_shaders::surfels::PlacedSurfel) table.
    pub placed: Handle<Buffer>,
    /// Cells of the grid.
    pub cells: Handle<Buffer>,
    /// References of the cells.
    pub references: Handle<Buffer>,
}

/// What a pass declared with [`LightCache::read`].
#[derive(Clone, Copy, Debug)]
pub struct LightCacheToken(BufferToken);

impl LightCache {
    /// Declares that a pass asks it.
    pub fn read(self, p: &mut PassBuilder<'_>) -> LightCacheToken {
        for buffer in [self.placed, self.cells, self.references] {
            p.read(buffer);
        }
        LightCacheToken(p.read(self.grid))
    }
}

impl LightCacheToken {
    /// Where the grid is.
    pub fn address(self, c: &Record<'_>) -> Address {
        c.id(self.0)
    }
}

/// Light of one kind, such as diffuse or specular indirect light. The default is no light.
#[derive(Clone, Copy, Debug, Default)]
#[non_exhaustive]
pub struct LightingOut {
    /// Radiance towards the camera, RGBA32F or RGBA16F; `None` if there is no light.
    pub radiance: Option<Handle<Image>>,
    /// Distance from which most of the light comes, metres, R16F or R32F; `None` if it is unknown.
    pub hit_distance: Option<Handle<Image>>,
    /// Confidence in the radiance, 0 to 1, R8 unorm, R16 unorm, R16F or R32F; `None` if it is the same everywhere.
    pub confidence: Option<Handle<Image>>,
    /// Of the slot `gi`: light in the world, for the slots after it.
    pub cache: Option<LightCache>,
}

impl LightingOut {
    /// Radiance without hit distance and confidence.
    pub fn radiance(radiance: Handle<Image>) -> Self {
        Self { radiance: Some(radiance), ..Self::default() }
    }

    /// Sets [`LightingOut::hit_distance`].
    #[must_use]
    pub fn with_hit_distance(self, hit_distance: Handle<Image>) -> Self {
        Self { hit_distance: Some(hit_distance), ..self }
    }

    /// Sets [`LightingOut::confidence`].
    #[must_use]
    pub fn with_confidence(self, confidence: Handle<Image>) -> Self {
        Self { confidence: Some(confidence), ..self }
    }

    /// Sets [`LightingOut::cache`].
    #[must_use]
    pub fn with_cache(self, cache: LightCache) -> Self {
        Self { cache: Some(cache), ..self }
    }
}

impl Gives for LightingOut {
    fn images(&self) -> Vec<(&'static str, Handle<Image>, &'static [Format])> {
        let all = [
            ("radiance", self.radiance, RADIANCE),
            ("hit_distance", self.hit_distance, DISTANCE),
            ("confidence", self.confidence, SCALAR),
        ];
        all.into_iter().filter_map(|(name, image, formats)| Some((name, image?, formats))).collect()
    }

    fn shown(&self) -> Option<Handle<Image>> {
        self.radiance
    }
}

/// Input of the slot `compose`.
#[derive(Debug)]
pub struct ComposeIn {
    /// Direct light and emission.
    pub direct: DirectOut,
    /// Diffuse indirect light.
    pub gi: LightingOut,
    /// Specular indirect light.
    pub reflections: LightingOut,
}

/// The sum of all light, RGBA32F or RGBA16F. The slot `sky` writes the background into the same image.
pub type ComposeOut = WriteHandle<Image>;

impl Gives for ComposeOut {
    fn images(&self) -> Vec<(&'static str, Handle<Image>, &'static [Format])> {
        vec![("radiance", self.read(), RADIANCE)]
    }
}

/// Input of the slot `sky`.
#[derive(Debug)]
pub struct SkyIn {
    /// Reversed depth; 0 marks the background.
    pub depth: Handle<Image>,
    /// The lit picture, to draw the background into.
    pub lit: WriteHandle<Image>,
}

/// The lit picture with its background, RGBA32F or RGBA16F. It may still be written to.
pub type SkyOut = WriteHandle<Image>;

/// Input of the slot `post`.
#[derive(Clone, Copy, Debug)]
pub struct PostIn {
    /// Linear radiance, RGBA32F or RGBA16F.
    pub colour: Handle<Image>,
    /// The surfaces in the picture, for temporal effects; `None` if the picture was not rendered by this frame, which turns them off.
    pub seen: Option<Seen>,
}

/// The surfaces that a picture shows.
#[derive(Clone, Copy, Debug)]
pub struct Seen {
    /// The scene, which contains the transforms of this and the previous frame.
    pub scene: SceneHandles,
    /// The G-buffer of the picture.
    pub gbuffer: GBuffer,
}

/// The finished picture, in the size of the output.
#[derive(Clone, Copy, Debug)]
pub struct PostOut {
    /// Linear radiance before exposure and tone curve, RGBA32F or RGBA16F.
    pub radiance: Handle<Image>,
    /// Display values, RGBA8 or RGBA16, sRGB-encoded.
    pub display: Handle<Image>,
}

impl Gives for PostOut {
    fn images(&self) -> Vec<(&'static str, Handle<Image>, &'static [Format])> {
        vec![("radiance", self.radiance, RADIANCE), ("display", self.display, &DISPLAY)]
    }

    fn shown(&self) -> Option<Handle<Image>> {
        Some(self.display)
    }

    fn extent(&self, _: &FrameGraph, view: &View) -> Extent {
        view.output
    }
}
