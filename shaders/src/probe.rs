//! Reflection probes: their table, and the parameters of `shaders/reflections/probe_*`.
use super::gbuffer::GBufferImages;
use super::types::{Address, SampledImage, SamplerId, StorageImage};
use bytemuck::{Pod, Zeroable};

/// Faces of a cube.
pub const PROBE_FACES: u32 = 6;
/// Greatest number of mips of a probe beside the first.
pub const PROBE_MIPS: u32 = 6;
/// [`ProbeTable::correction`]: radiance counts as infinitely far.
pub const PROBE_CORRECTION_OFF: u32 = 0;
/// [`ProbeTable::correction`]: radiance lies on the probe's box.
pub const PROBE_CORRECTION_BOX: u32 = 1;
/// [`ProbeTable::correction`]: radiance lies where the captured distances say.
pub const PROBE_CORRECTION_DISTANCE: u32 = 2;
/// [`ProbeTable::narrowing`]: roughness is that of the surface.
pub const PROBE_NARROWING_OFF: u32 = 0;
/// [`ProbeTable::narrowing`]: roughness times the ratio of distances.
pub const PROBE_NARROWING_ROUGHNESS: u32 = 1;
/// [`ProbeTable::narrowing`]: alpha, the square of roughness, times the ratio of distances.
pub const PROBE_NARROWING_ALPHA: u32 = 2;
/// [`ProbeShadeParams::direction`]: the mirror direction.
pub const PROBE_DIRECTION_MIRROR: u32 = 0;
/// [`ProbeShadeParams::direction`]: mirror direction and normal blended by the cube of roughness.
pub const PROBE_DIRECTION_CUBIC: u32 = 1;
/// [`ProbeShadeParams::direction`]: the fit of Lagarde and de Rousiers.
pub const PROBE_DIRECTION_FIT: u32 = 2;

/// What all probes have in common.
#[repr(C)]
#[derive(Clone, Copy, Debug, Default, Pod, Zeroable)]
pub struct ProbeTable {
    /// Number of probes that are looked up: those with a box, then those of the camera.
    pub count: u32,
    /// Texels of an edge of a face.
    pub side: u32,
    /// Mips beside the first; mip m holds the lobe of roughness m / `mips`.
    pub mips: u32,
    /// `PROBE_CORRECTION_*`.
    pub correction: u32,
    /// `PROBE_NARROWING_*`.
    pub narrowing: u32,
    /// Steps along a ray, at least 1.
    pub steps: u32,
    /// Distance from the camera's probe from which on it does not count, metres.
    pub reach: f32,
}

/// One probe.
#[repr(C)]
#[derive(Clone, Copy, Debug, Default, Pod, Zeroable)]
pub struct Probe {
    /// Box from world: a rotation and a translation; without scale. Unused without a box.
    pub box_from_world: [[f32; 4]; 3],
    /// Half the edges of the box, metres; 0 if it has none. The box of a camera's probe only corrects parallax.
    pub half_size: [f32; 3],
    /// Distance inside of the border over which it fades in, metres; below 0 for probes of the camera.
    pub fade: f32,
    /// Where it captures before its offset, world, metres.
    pub centre: [f32; 3],
    /// First layer of its faces.
    pub layer: u32,
    /// Index of its offset.
    pub offset: u32,
    /// Weight of a probe of the camera, which fade into each other; 0 to 1.
    pub weight: f32,
}

/// What `lib/probe.glsl` reads, as a block for the parameters of a pass.
#[repr(C)]
#[derive(Clone, Copy, Debug, Default, Pod, Zeroable)]
pub struct ProbeImages {
    /// The [`ProbeTable`].
    pub table: Address,
    /// The [`Probe`]s.
    pub probes: Address,
    /// How far each probe was moved out of walls, world, metres: three floats each.
    pub offsets: Address,
    /// Radiance, and in alpha the reciprocal of the distance along the axis of the face; RGBA16F. Six layers per probe.
    pub chain: SampledImage,
    /// Its sampler, which clamps.
    pub sampler_id: SamplerId,
}

/// Push constants of `probe_capture.ray` and `probe_tinted_capture.ray`: one probe.
#[repr(C)]
#[derive(Clone, Copy, Debug, Default, Pod, Zeroable)]
pub struct CaptureParams {
    /// The [`View`](super::view::View).
    pub view: Address,
    /// Root of the scene, [`Scene`](super::scene::Scene).
    pub scene: Address,
    /// Two counters, closest-hit and any-hit rays (`uint`).
    pub rays: Address,
    /// Counter of values that were left out.
    pub not_finite: Address,
    /// [`LightTables`](super::light_sampling::LightTables) of every light.
    pub lights: Address,
    /// As [`ProbeImages::offsets`], of this probe.
    pub offset: Address,
    /// Where it captures before its offset, world, metres.
    pub centre: [f32; 3],
    /// Texels of an edge of a face.
    pub side: u32,
    /// Mip 0 of its six faces.
    pub radiance: StorageImage,
    /// Captures that each texel is the mean of, and above eight bits a number of the surface in it; R32 uint, six layers.
    pub counts: StorageImage,
    /// The other mips of its six faces.
    pub filtered: SampledImage,
    /// Their sampler.
    pub sampler_id: SamplerId,
    /// Faces to capture, a bit each.
    pub faces: u32,
    /// Those among them without earlier captures.
    pub fresh: u32,
    /// Greatest number of captures in the mean, at most 255.
    pub most: u32,
    /// 1 if hits gather indirect light, 2 if `filtered` may be used for that.
    pub indirect: u32,
    /// Key of random numbers.
    pub key: u32,
}

/// Push constants of `probe_place.ray`: moves one probe of the camera out of walls.
#[repr(C)]
#[derive(Clone, Copy, Debug, Default, Pod, Zeroable)]
pub struct PlaceParams {
    /// Root of the scene, [`Scene`](super::scene::Scene).
    pub scene: Address,
    /// Two counters, closest-hit and any-hit rays (`uint`).
    pub rays: Address,
    /// As [`ProbeImages::offsets`], of this probe.
    pub offset: Address,
    /// Where it would be, world, metres.
    pub centre: [f32; 3],
    /// The camera, world, metres.
    pub eye: [f32; 3],
    /// Distance that it keeps from surfaces where there is room, metres.
    pub clearance: f32,
}

/// Push constants of `probe_means.comp`: means of 2x2, 4x4 and more texels of each face.
#[repr(C)]
#[derive(Clone, Copy, Debug, Default, Pod, Zeroable)]
pub struct MeansParams {
    /// Mip 0 of the six faces.
    pub radiance: SampledImage,
    /// Texels of an edge of a face, a power of two.
    pub side: u32,
    /// The mips to write, the first a copy.
    pub mips: [StorageImage; 7],
    /// How many there are, at least 1.
    pub count: u32,
}

/// Push constants of `probe_filter.comp`: lobes of one probe.
#[repr(C)]
#[derive(Clone, Copy, Debug, Default, Pod, Zeroable)]
pub struct ProbeFilterParams {
    /// Counter of values that were left out.
    pub not_finite: Address,
    /// Means of its six faces, with mips.
    pub means: SampledImage,
    /// Their sampler.
    pub sampler_id: SamplerId,
    /// Mips 1 and up of the faces.
    pub mips: [StorageImage; 6],
    /// How many there are.
    pub count: u32,
    /// Texels of an edge of a face in mip 0.
    pub side: u32,
    /// Mips of `means` beside the first.
    pub mean_mips: u32,
    /// Samples of each texel.
    pub samples: u32,
    /// 1 reads means over the solid angle of a sample, 0 single texels.
    pub filtered: u32,
    /// Faces to filter, a bit each.
    pub faces: u32,
    /// Threads of a row.
    pub width: u32,
}

/// Push constants of `probe_shade.comp`.
#[repr(C)]
#[derive(Clone, Copy, Debug, Default, Pod, Zeroable)]
pub struct ProbeShadeParams {
    /// The [`View`](super::view::View).
    pub view: Address,
    /// Counter of values that were left out.
    pub not_finite: Address,
    /// The G-buffer.
    pub gbuffer: GBufferImages,
    /// The probes.
    pub probes: ProbeImages,
    /// Openness of ambient occlusion, or `NO_IMAGE`.
    pub openness: SampledImage,
    /// `PROBE_DIRECTION_*`.
    pub direction: u32,
    /// 1 if occlusion dims what probes show as well.
    pub occlusion: u32,
    /// Output: radiance, RGBA16F or RGBA32F.
    pub radiance: StorageImage,
    /// Greatest number in the format of `radiance`.
    pub greatest: f32,
}
