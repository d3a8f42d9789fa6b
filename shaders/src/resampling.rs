//! Reservoirs of light samples, and the surfaces that they light.
use super::direct::LobeImages;
use super::gbuffer::GBufferImages;
use super::types::{Address, SampledImage, StorageImage};
use bytemuck::{Pod, Zeroable};

/// [`Reservoir::light`] of a reservoir without a sample.
pub const NO_SAMPLE: u32 = 4294967295;
/// Bit of [`Reservoir::light`]: the index is one of directional lights.
pub const DIRECTIONAL_SAMPLE: u32 = 2147483648;

/// Greatest number of neighbours of a round of spatial reuse.
pub const MAX_NEIGHBOURS: u32 = 8;

/// How a sample counts that several pixels could have drawn: confidences alone, 1/M. Biased: darker where neighbours cannot see a light.
pub const WEIGHTS_BIASED: u32 = 0;
/// How a sample counts that several pixels could have drawn: confidences of those that could have drawn the sample, 1/Z.
pub const WEIGHTS_COUNTED: u32 = 1;
/// How a sample counts that several pixels could have drawn: pairwise, with the balance heuristic between the pixel and each neighbour.
pub const WEIGHTS_PAIRWISE: u32 = 2;

/// [`CandidateParams::source`]: lights by power.
pub const SOURCE_POWER: u32 = 0;
/// [`CandidateParams::source`]: all lights alike.
pub const SOURCE_UNIFORM: u32 = 1;
/// [`CandidateParams::source`]: local lights and emissive surfaces by the light tree, directional lights by power.
pub const SOURCE_TREE: u32 = 2;

/// One sample of the lights, chosen from many. Samples are numbers from which a point of a light follows, so they mean something at every
/// surface: [`Reservoir::weight`] is per unit of the square that [`Reservoir::point`] is drawn from.
#[repr(C)]
#[derive(Clone, Copy, Debug, Default, PartialEq, Pod, Zeroable)]
pub struct Reservoir {
    /// Index in [`LightTables::near`](super::light_sampling::LightTables::near), or with [`DIRECTIONAL_SAMPLE`] in
    /// [`LightTables::far`](super::light_sampling::LightTables::far); or [`NO_SAMPLE`].
    pub light: u32,
    /// Two numbers of 16 bits, the point or direction of the light.
    pub point: u32,
    /// Unbiased contribution weight: light reflected from the sample times this estimates the light of all.
    pub weight: f32,
    /// Confidence in the lower 16 bits, in candidates of one frame; age of the sample in frames above it.
    pub confidence: u32,
}

/// A surface that light is sampled for, of this or of the previous frame.
#[repr(C)]
#[derive(Clone, Copy, Debug, Default, Pod, Zeroable)]
pub struct LitSurface {
    /// From the eye of its frame to the origin of its rays, metres.
    pub from_eye: [f32; 3],
    /// Bound of the origin's distance from the surface, metres; 0 where there is no surface.
    pub rounding: f32,
    /// Octahedral geometric normal, two snorm of 16 bits.
    pub geometric_normal: u32,
    /// Octahedral shading normal, two snorm of 16 bits.
    pub normal: u32,
    /// Roots of the base colour's channels, and metalness: four unorm of 8 bits.
    pub colour: u32,
    /// Roughness, strength of the clear coat and its roughness, and the distance of what a ray along the specular lobe met (`pack_distance` of
    /// `lib/resampling.glsl`; 0 if there was no such ray): four unorm of 8 bits.
    pub gloss: u32,
    /// Reflection of the dielectric part, as in the G-buffer: two snorm of 16 bits.
    pub dielectric: u32,
}

/// Parameters of `candidates.ray`.
#[repr(C)]
#[derive(Clone, Copy, Debug, Default, Pod, Zeroable)]
pub struct CandidateParams {
    /// The [`View`](super::view::View).
    pub view: Address,
    /// Root of the scene, [`Scene`](super::scene::Scene).
    pub scene: Address,
    /// Two counters, closest-hit and any-hit rays (`uint`).
    pub rays: Address,
    /// Counter of values that are not finite.
    pub not_finite: Address,
    /// The [`LightTables`](super::light_sampling::LightTables).
    pub lights: Address,
    /// The [`LightTree`](super::light_tree::LightTree), for [`SOURCE_TREE`].
    pub tree: Address,
    /// The G-buffer.
    pub gbuffer: GBufferImages,
    /// [`LitSurface`] of each pixel, to be written.
    pub surfaces: Address,
    /// [`Reservoir`] of each pixel, to be written.
    pub reservoirs: Address,
    /// Candidates per pixel among local lights and emissive surfaces.
    pub near_candidates: u32,
    /// The same among directional lights.
    pub far_candidates: u32,
    /// `SOURCE_*`.
    pub source: u32,
    /// Greatest alpha of lobes along which one more candidate is drawn; 0 for none.
    pub widest_alpha: f32,
}

/// Parameters of `visibility.ray`.
#[repr(C)]
#[derive(Clone, Copy, Debug, Default, Pod, Zeroable)]
pub struct VisibilityParams {
    /// The [`View`](super::view::View).
    pub view: Address,
    /// Root of the scene, [`Scene`](super::scene::Scene).
    pub scene: Address,
    /// Two counters, closest-hit and any-hit rays (`uint`).
    pub rays: Address,
    /// The [`LightTables`](super::light_sampling::LightTables).
    pub lights: Address,
    /// [`LitSurface`] of each pixel.
    pub surfaces: Address,
    /// [`Reservoir`] of each pixel; where its light is hidden the weight is set to 0.
    pub reservoirs: Address,
}

/// Parameters of `temporal.ray` and `spatial.ray`.
#[repr(C)]
#[derive(Clone, Copy, Debug, Default, Pod, Zeroable)]
pub struct ResampleParams {
    /// The [`View`](super::view::View).
    pub view: Address,
    /// Root of the scene, [`Scene`](super::scene::Scene).
    pub scene: Address,
    /// Two counters, closest-hit and any-hit rays (`uint`).
    pub rays: Address,
    /// Counter of values that are not finite.
    pub not_finite: Address,
    /// The [`LightTables`](super::light_sampling::LightTables).
    pub lights: Address,
    /// [`LitSurface`] of each pixel.
    pub surfaces: Address,
    /// [`LitSurface`] of each pixel one frame ago; of `spatial.ray` unused.
    pub previous_surfaces: Address,
    /// [`Reservoir`] of each pixel.
    pub reservoirs: Address,
    /// [`Reservoir`] of each pixel one frame ago; of `spatial.ray` unused.
    pub previous: Address,
    /// [`Reservoir`] of each pixel, to be written.
    pub resampled: Address,
    /// Motion vectors.
    pub motion: SampledImage,
    /// Which pixels of the previous frame showed the surface.
    pub taps: SampledImage,
    /// `WEIGHTS_*`.
    pub weights: u32,
    /// Greatest confidence of the previous frame's reservoirs.
    pub cap: u32,
    /// Neighbours that are asked, up to [`MAX_NEIGHBOURS`].
    pub neighbours: u32,
    /// Distance of neighbours, pixels.
    pub radius: f32,
    /// Number of the round of spatial reuse, from 0.
    pub round: u32,
    /// 1: a sample counts only if the pixel sees it, which takes a shadow ray for each; 0: only the chosen one is tested.
    pub tests_all: u32,
}

/// Parameters of `sampled.ray`: light of the reservoirs' samples.
#[repr(C)]
#[derive(Clone, Copy, Debug, Default, Pod, Zeroable)]
pub struct SampledLightParams {
    /// The [`View`](super::view::View).
    pub view: Address,
    /// Root of the scene, [`Scene`](super::scene::Scene).
    pub scene: Address,
    /// Two counters, closest-hit and any-hit rays (`uint`).
    pub rays: Address,
    /// The [`LightTables`](super::light_sampling::LightTables).
    pub lights: Address,
    /// The G-buffer.
    pub gbuffer: GBufferImages,
    /// [`LitSurface`] of each pixel.
    pub surfaces: Address,
    /// [`Reservoir`] of each pixel.
    pub reservoirs: Address,
    /// What is written.
    pub lobes: LobeImages,
}

/// Parameters of `reservoirs.comp`: what reservoirs hold, as images.
#[repr(C)]
#[derive(Clone, Copy, Debug, Default, Pod, Zeroable)]
pub struct ShowReservoirsParams {
    /// The [`View`](super::view::View).
    pub view: Address,
    /// [`Reservoir`] of each pixel.
    pub reservoirs: Address,
    /// A colour for each light; black without a sample.
    pub light: StorageImage,
    /// The weight.
    pub weight: StorageImage,
    /// Confidence.
    pub confidence: StorageImage,
    /// Age of the sample, frames.
    pub age: StorageImage,
}
