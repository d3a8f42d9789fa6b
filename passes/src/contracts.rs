//! The contract of every slot: what goes in and what comes out. Effects know of each other only through these.
//!
//! Every image that comes out is as large as the frame, that of `post` as large as the picture. Where one has another format or size than its
//! contract says, the frame is refused with both, and with the names of slot and implementation.
mod gbuffer;

use crate::outputs::{DIRECTION, DISTANCE, Gives, ONE, RADIANCE, SHARES};
pub use gbuffer::{Channel, GBuffer, GBufferToken, GEOMETRY, RAY_START};
use magpie::frame::View;
use magpie::graph::execute::Imports;
use magpie::graph::{Extent, Format, FrameGraph, Handle, Image, WriteHandle};
pub use magpie::scene::SceneHandles;
use magpie::scene::{Camera, ResidentError, SceneSketch, SharedScene};
use magpie_shaders::view::MOST_CASTERS;
use std::cell::RefCell;
use std::rc::Rc;

/// Slot `acceleration`.
#[derive(Clone)]
pub enum AccelerationIn {
    /// The scene on the device, gone to the moment that the frame shows.
    Resident {
        /// The scene.
        scene: SharedScene,
        /// Objects of the frame at hand.
        imports: Rc<RefCell<Imports>>,
        /// From where the frame is seen.
        camera: Camera,
    },
    /// A frame that is only planned, without a device.
    Sketch(Rc<SceneSketch>),
}

/// The scene as rays see it, up to date.
pub type AccelerationOut = Result<SceneHandles, ResidentError>;

impl Gives for AccelerationOut {
    const SHOWN: bool = false;

    fn images(&self) -> Vec<(&'static str, Handle<Image>, &'static [Format])> {
        Vec::new()
    }
}

/// The surfaces that are seen, and where they were one frame ago, as denoisers read them.
#[derive(Clone, Copy, Debug)]
pub struct Reprojected {
    /// View depth, geometric normal and instance in two words.
    pub guide: Handle<Image>,
    /// Which four pixels showed the surface, and their shares, in one word; 0 where none did.
    pub taps: Handle<Image>,
    /// The guide of the previous frame, in that frame's pixels; all 0 if there is none.
    pub previous_guide: Handle<Image>,
}

/// Slot `gbuffer`.
#[derive(Clone, Copy, Debug)]
pub struct GBufferIn {
    /// What to draw.
    pub scene: SceneHandles,
}

/// Slot `rays`.
#[derive(Clone, Copy, Debug)]
pub struct RaysIn {
    /// What rays see.
    pub scene: SceneHandles,
}

/// How much work rays are; `None` when nobody wants to know.
#[derive(Clone, Copy, Debug)]
pub struct RaysOut {
    /// In false colours, RGBA8.
    pub colours: Option<Handle<Image>>,
}

impl Gives for RaysOut {
    const SHOWN: bool = false;

    fn images(&self) -> Vec<(&'static str, Handle<Image>, &'static [Format])> {
        self.colours.map(|image| ("colours", image, &[Format::Rgba8Unorm][..])).into_iter().collect()
    }
}

/// Slot `shadows`.
#[derive(Clone, Copy, Debug)]
pub struct ShadowIn {
    /// What casts.
    pub scene: SceneHandles,
    /// What receives.
    pub gbuffer: GBuffer,
    /// Where it was one frame ago.
    pub reprojected: Reprojected,
}

/// Most images of visibility: every light that casts a shadow may have its own.
pub const SHADOW_GROUPS: usize = MOST_CASTERS as usize;

/// How much of some lights each pixel sees.
#[derive(Clone, Copy, Debug)]
pub struct ShadowGroup {
    /// A light in each channel: the share of it that is seen, 0 to 1. Red alone, red and green, or four channels, of 8 bits,
    /// 16F or 32F.
    pub visibility: Handle<Image>,
    /// Which lights, by their index in the scene, of those that can cast shadows; `NO_LIGHT` in channels that hold none.
    pub lights: [u32; 4],
    /// The first three channels belong to the first light, one for each of its colours.
    pub coloured: bool,
    /// Single rays of the pixel, unfiltered: their mean over frames is the share, and each of them may be far beside it.
    pub raw: bool,
}

/// Visibility of the lights that cast shadows; all others shine through everything.
#[derive(Clone, Copy, Debug, Default)]
pub struct ShadowOut {
    /// Implementation from the front.
    pub groups: [Option<ShadowGroup>; SHADOW_GROUPS],
}

impl Gives for ShadowOut {
    fn images(&self) -> Vec<(&'static str, Handle<Image>, &'static [Format])> {
        self.groups.iter().flatten().map(|group| ("visibility", group.visibility, SHARES)).collect()
    }
}

/// How far away a thing still counts for ambient occlusion where nothing else is said, metres: of the effects and of the reference.
pub const AO_RANGE: f32 = 1.0;

/// Slot `ao`.
#[derive(Clone, Copy, Debug)]
pub struct AoIn {
    /// What hides.
    pub scene: SceneHandles,
    /// What is hidden from.
    pub gbuffer: GBuffer,
    /// Where it was one frame ago.
    pub reprojected: Reprojected,
}

/// What is left of the hemisphere above each pixel, weighed with the cosine; `None` for all of it. For indirect light only.
#[derive(Clone, Copy, Debug)]
pub struct AoOut {
    /// Openness, one channel: 1 where nothing near hides anything, 0 where all is hidden. R8, R16F or R32F.
    pub openness: Option<Handle<Image>>,
    /// Mean direction of what is not hidden, in the world, octahedral in RG16F or RG32F. `None`: the normal has to do.
    pub bent_normal: Option<Handle<Image>>,
}

impl Gives for AoOut {
    fn images(&self) -> Vec<(&'static str, Handle<Image>, &'static [Format])> {
        let openness = self.openness.map(|image| ("openness", image, ONE));
        openness.into_iter().chain(self.bent_normal.map(|image| ("bent_normal", image, DIRECTION))).collect()
    }

    fn shown(&self) -> Option<Handle<Image>> {
        self.openness
    }
}

/// Slot `direct`.
#[derive(Clone, Copy, Debug)]
pub struct DirectIn {
    /// Lights and materials.
    pub scene: SceneHandles,
    /// What is lit.
    pub gbuffer: GBuffer,
    /// Where it was one frame ago.
    pub reprojected: Reprojected,
    /// What is in shadow.
    pub shadows: ShadowOut,
}

/// Radiance towards the camera from the lights, emission included.
#[derive(Debug)]
pub struct DirectOut {
    /// The image, RGBA32F or RGBA16F.
    pub radiance: WriteHandle<Image>,
}

impl Gives for DirectOut {
    fn images(&self) -> Vec<(&'static str, Handle<Image>, &'static [Format])> {
        self.radiance.images()
    }
}

/// Slots `gi` and `reflections`, and others that light what the camera sees.
#[derive(Clone, Copy, Debug)]
#[non_exhaustive]
pub struct LightingIn {
    /// Lights, materials, and what rays see.
    pub scene: SceneHandles,
    /// What is lit.
    pub gbuffer: GBuffer,
    /// Where it was one frame ago.
    pub reprojected: Reprojected,
    /// What hides indirect light.
    pub ao: AoOut,
    /// Radiance from the lights and emission, of this frame.
    pub direct: Handle<Image>,
    /// Radiance of the previous frame with everything in it, in the previous frame's pixels, before anti-aliasing and tone mapping: RGBA16F
    /// with 1 in alpha, 0 in all channels where it is not known, as in the first frame. `None` unless an effect asks for it with
    /// [`Needs::previous_radiance`](magpie::slot::Needs::previous_radiance).
    pub previous_radiance: Option<Handle<Image>>,
}

/// One kind of light. The default is none.
#[derive(Clone, Copy, Debug, Default)]
#[non_exhaustive]
pub struct LightingOut {
    /// Radiance towards the camera, RGBA32F or RGBA16F; `None` if there is none.
    pub radiance: Option<Handle<Image>>,
    /// Distance from which most of it comes, metres, where that is known: R16F or R32F.
    pub hit_distance: Option<Handle<Image>>,
    /// How much the radiance can be trusted, 0 to 1, where that varies: R8, R16, R16F or R32F.
    pub confidence: Option<Handle<Image>>,
}

impl LightingOut {
    /// Radiance alone.
    pub fn radiance(radiance: Handle<Image>) -> Self {
        Self { radiance: Some(radiance), ..Self::default() }
    }

    /// With [`LightingOut::hit_distance`].
    #[must_use]
    pub fn with_hit_distance(self, hit_distance: Handle<Image>) -> Self {
        Self { hit_distance: Some(hit_distance), ..self }
    }

    /// With [`LightingOut::confidence`].
    #[must_use]
    pub fn with_confidence(self, confidence: Handle<Image>) -> Self {
        Self { confidence: Some(confidence), ..self }
    }
}

impl Gives for LightingOut {
    fn images(&self) -> Vec<(&'static str, Handle<Image>, &'static [Format])> {
        let all = [
            ("radiance", self.radiance, RADIANCE),
            ("hit_distance", self.hit_distance, DISTANCE),
            ("confidence", self.confidence, ONE),
        ];
        all.into_iter().filter_map(|(name, image, formats)| Some((name, image?, formats))).collect()
    }

    fn shown(&self) -> Option<Handle<Image>> {
        self.radiance
    }
}

/// Slot `compose`.
#[derive(Debug)]
pub struct ComposeIn {
    /// Lights and emission.
    pub direct: DirectOut,
    /// Diffuse indirect light.
    pub gi: LightingOut,
    /// Specular indirect light.
    pub reflections: LightingOut,
}

/// The sum of all light; RGBA32F or RGBA16F.
pub type ComposeOut = WriteHandle<Image>;

impl Gives for ComposeOut {
    fn images(&self) -> Vec<(&'static str, Handle<Image>, &'static [Format])> {
        vec![("radiance", self.read(), RADIANCE)]
    }
}

/// Slot `sky`.
#[derive(Debug)]
pub struct SkyIn {
    /// Where nothing was drawn.
    pub depth: Handle<Image>,
    /// The lit picture.
    pub lit: WriteHandle<Image>,
}

/// The picture with what lies behind everything, and the right to draw on; RGBA32F or RGBA16F.
pub type SkyOut = WriteHandle<Image>;

/// Slot `post`.
#[derive(Clone, Copy, Debug)]
pub struct PostIn {
    /// Linear radiance.
    pub colour: Handle<Image>,
    /// What the picture shows; `None` where it was not drawn in this frame, so that it has nothing to do with others.
    pub seen: Option<Seen>,
}

/// What a picture shows.
#[derive(Clone, Copy, Debug)]
pub struct Seen {
    /// What moves.
    pub scene: SceneHandles,
    /// What every pixel sees first.
    pub gbuffer: GBuffer,
}

/// The picture, in the size of the output.
#[derive(Clone, Copy, Debug)]
pub struct PostOut {
    /// Linear radiance of which the display's image is made, RGBA32F or RGBA16F.
    pub radiance: Handle<Image>,
    /// RGBA8, sRGB-encoded.
    pub display: Handle<Image>,
}

impl Gives for PostOut {
    fn images(&self) -> Vec<(&'static str, Handle<Image>, &'static [Format])> {
        vec![("radiance", self.radiance, RADIANCE), ("display", self.display, &[Format::Rgba8Unorm])]
    }

    fn shown(&self) -> Option<Handle<Image>> {
        Some(self.display)
    }

    fn extent(&self, _: &FrameGraph, view: &View) -> Extent {
        view.output
    }
}
