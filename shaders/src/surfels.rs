//! Surfels: discs on surfaces that gather diffuse indirect light.
use super::gbuffer::GBufferImages;
use super::hit_shading::HitShadingParams;
use super::types::{Address, SampledImage, StorageImage};
use bytemuck::{Pod, Zeroable};

/// Sectors around a surfel's normal in which its distance to what stands on the surface is known.
pub const SECTORS: u32 = 8;
/// Surfels in a row of the image of keys.
pub const KEYS_WIDTH: u32 = 512;
/// Surfels of a workgroup.
pub const SURFEL_GROUP: u32 = 256;
/// Pixels on a side of the tiles in which surfels are spawned, of those that are looked at in a frame.
pub const SPAWN_TILE: u32 = 16;
/// Greatest number of surfels that a tile spawns in one frame.
pub const TILE_SPAWNS: u32 = 64;
/// Greatest number of surfels of a cell that are looked at.
pub const CELL_LIMIT: u32 = 128;
/// Room for references from cells, for each surfel: eight cells of each of two levels.
pub const CELLS_OF_SURFEL: u32 = 16;
/// Cells on a side of the square from which a surfel draws directions, each with a chance of its own.
pub const GUIDE_SIDE: u32 = 4;
/// Cells on a side of the blocks over which changes of light are found, beside cells.
pub const CHANGE_BLOCK: u32 = 4;
/// Tests by which changes of light are found: of luminance and of colour by the newest samples, of luminance over a longer window.
pub const CHANGE_TESTS: u32 = 3;
/// Numbers in [`SurfelShowParams::counters`].
pub const SURFEL_COUNTERS: u32 = 8;
/// How samples are averaged: the published multi-scale mean.
pub const MULTI_SCALE: u32 = 0;
/// How samples are averaged: a mean over all samples, or over recent ones where the light has changed.
pub const RUNNING_MEAN: u32 = 1;

/// [`SurfelBinding::side`]: on the back of the triangle.
pub const SURFEL_BACK: u32 = 1;
/// [`SurfelBinding::side`]: of the triangles that rays see, which may be coarser than those of the picture.
pub const SURFEL_OF_RAYS: u32 = 2;

/// A point of a triangle or sphere.
#[repr(C)]
#[derive(Clone, Copy, Debug, Default, Pod, Zeroable)]
pub struct SurfelBinding {
    /// Index of the instance, plus 1; 0 for none.
    pub instance: u32,
    /// Triangle or sphere of the mesh.
    pub primitive: u32,
    /// Weights of the triangle's second and third corner; of a sphere, the direction from its centre in object space, octahedral.
    pub weights: [f32; 2],
    /// `SURFEL_BACK` and `SURFEL_OF_RAYS`.
    pub side: u32,
}

/// What is kept of a surfel from frame to frame: where it is bound, and what it has gathered.
#[repr(C)]
#[derive(Clone, Copy, Debug, Default, Pod, Zeroable)]
pub struct Surfel {
    /// What it is bound to; to nothing if this place in the pool is free.
    pub bound: SurfelBinding,
    /// The last frame in which the picture showed it, or a path found it.
    pub last_used: u32,
    /// Frame in which it was spawned.
    pub born: u32,
    /// Paths that it has traced.
    pub paths: u32,
    /// What it has gathered.
    pub light: Estimator,
    /// What it and those around it have gathered: what lights the picture.
    pub light_shared: SharedLight,
    /// Mean of the ambient occlusion that the picture showed at its centre, as openness; below 0 if it never did.
    pub openness: f32,
    /// Samples of surfels around it behind what it shares, weighted; [`WELL_KNOWN`](../lib/surfels.glsl) of those that ask no farther.
    pub samples_around: f32,
    /// Mean and standard deviation of the inverse of the distance along the surface to what stands on it, per metre, of each sector: the upper
    /// halves of two floats. 0 where nothing is near.
    pub nearness: [u32; 8],
    /// Mean square of the luminance found in each of [`GUIDE_SIDE`]² cells of the square from which directions are drawn: the upper halves of
    /// two floats.
    pub guide: [u32; 8],
    /// Its part of the light that few surfels have found by chance, irradiance over pi.
    pub excess: [f32; 3],
    /// [`SharedLight::excess`] for the next frame.
    pub excess_passed: [f32; 3],
    /// Chances of these cells in the present block of paths: bytes, in proportion; all 0 if they are even.
    pub chances: [u32; 4],
}

/// State of the temporal estimator. Irradiance is that on the surfel's plane over pi: the radiance of a white surface.
#[repr(C)]
#[derive(Clone, Copy, Debug, Default, Pod, Zeroable)]
pub struct Estimator {
    /// Mean irradiance over pi.
    pub mean: [f32; 3],
    /// Samples that the mean stands for.
    pub samples: f32,
    /// Mean over a short window.
    pub short_mean: [f32; 3],
    /// Mean over the last two or three samples, from which paths take light.
    pub newest: [f32; 3],
    /// Variance of samples.
    pub variance: [f32; 3],
    /// Luminance of the brightest sample of late; older ones fade.
    pub brightest: f32,
    /// Multi-scale mean: blend that the variance asks for.
    pub variance_blend: f32,
    /// Multi-scale mean: how long both means have differed.
    pub inconsistency: f32,
    /// Mean of direction times irradiance over pi, without its part along the normal: one vector for each of red, green and blue.
    pub tilt: [[f32; 3]; 3],
}

/// Means over the samples of a surfel and of those around it.
#[repr(C)]
#[derive(Clone, Copy, Debug, Default, Pod, Zeroable)]
pub struct SharedLight {
    /// Of [`Estimator::mean`].
    pub mean: [f32; 3],
    /// Of [`Estimator::tilt`].
    pub tilt: [[f32; 3]; 3],
    /// Of [`Surfel::openness`]; below 0 where none is known.
    pub openness: f32,
    /// 1 if there is any light, 0 before a surfel has shared for the first time.
    pub is_known: u32,
    /// What it passes on of light that few surfels have found by chance, irradiance over pi. It is not in `mean`.
    pub excess: [f32; 3],
}

/// A surfel in this frame, as it is looked up.
#[repr(C)]
#[derive(Clone, Copy, Debug, Default, Pod, Zeroable)]
pub struct PlacedSurfel {
    /// World, metres.
    pub position: [f32; 3],
    /// Metres; 0 if this place in the pool is free.
    pub radius: f32,
    /// Geometric normal, unit, to its side.
    pub normal: [f32; 3],
    /// [`Estimator::samples`].
    pub samples: f32,
    /// [`Estimator::newest`] for paths, then [`SharedLight::mean`] for the picture.
    pub mean: [f32; 3],
    /// [`Estimator::tilt`] for paths, then [`SharedLight::tilt`].
    pub tilt: [[f32; 3]; 3],
    /// [`SharedLight::openness`].
    pub openness: f32,
    /// [`Surfel::excess`] for the picture, 0 for paths.
    pub excess: [f32; 3],
    /// [`Surfel::nearness`].
    pub nearness: [u32; 8],
}

/// Counters of a frame.
#[repr(C)]
#[derive(Clone, Copy, Debug, Default, PartialEq, Eq, Pod, Zeroable)]
pub struct SurfelCounts {
    /// Workgroups over all places of the pool that hold surfels. New ones take the first places that are free.
    pub groups: u32,
    /// Surfels.
    pub live: u32,
    /// Surfels that tiles and paths asked for.
    pub wanted: u32,
    /// Surfels that were spawned.
    pub spawned: u32,
    /// Surfels that were recycled.
    pub recycled: u32,
    /// References in cells, beyond [`CELL_LIMIT`] of a cell.
    pub dropped: u32,
    /// Pixels that no surfel covers, of those that were looked at.
    pub uncovered: u32,
    /// Pixels that a surfel should cover, of those that were looked at.
    pub visible: u32,
    /// Rays that surfels have traced.
    pub rays: u32,
    /// Surfels whose light has clearly changed: in this frame; and in that of the last frames in which most have, a 32nd less for each frame since.
    pub changed: [u32; 2],
}

/// How far what surfels have found of late is from their means, added up over those of a cell, or of a block of cells. Integers, so that the order
/// does not count.
#[repr(C)]
#[derive(Clone, Copy, Debug, Default, Pod, Zeroable)]
pub struct SurfelChange {
    /// Sum of differences, in 256ths of the standard deviation of samples.
    pub sum: i32,
    /// Sum of their squares, in 64ths.
    pub squares: u32,
    /// Surfels.
    pub count: u32,
    /// Greatest [`Estimator::brightest`] of the surfels in the frame before, as the bits of a float.
    pub brightest: u32,
}

/// Where surfels are found: cells of a hashed grid around the camera, whose size grows with the distance.
#[repr(C)]
#[derive(Clone, Copy, Debug, Default, Pod, Zeroable)]
pub struct SurfelGrid {
    /// [`PlacedSurfel`] table.
    pub placed: Address,
    /// First reference and number of references of each cell.
    pub cells: Address,
    /// Indices of surfels.
    pub references: Address,
    /// Radius over the distance to the eye.
    pub size: f32,
    /// Number of cells less 1; the number is a power of 2.
    pub cell_mask: u32,
}

/// Push constants of the kernels that keep the pool and build the grid.
#[repr(C)]
#[derive(Clone, Copy, Debug, Default, Pod, Zeroable)]
pub struct SurfelPoolParams {
    /// The [`View`](super::view::View).
    pub view: Address,
    /// Root of the scene, [`Scene`](super::scene::Scene).
    pub scene: Address,
    /// [`Surfel`] table.
    pub pool: Address,
    /// Where surfels are found.
    pub grid: SurfelGrid,
    /// [`SurfelCounts`].
    pub counts: Address,
    /// Three words, the workgroups of an indirect dispatch over the pool.
    pub groups: Address,
    /// Number of free places in each workgroup of the pool, which `surfel_sum.comp` turns into how many there are before it, and room for their
    /// sum; then their indices.
    pub free: Address,
    /// For each cell the surfel whose path asks for one there, plus 1, or 0; then a [`SurfelBinding`] for each surfel.
    pub wishes: Address,
    /// Places in the pool.
    pub capacity: u32,
    /// Frames after which a surfel that nothing uses is recycled while the pool is not nearly full.
    pub life: u32,
    /// Output: which surfels trace, R8 unorm, as keys of a pixel list.
    pub keys: StorageImage,
    /// 1 if the frame begins: its counters are set to 0.
    pub begins: u32,
    /// Counter of surfels whose place is not finite.
    pub not_finite: Address,
    /// Output, where the frame begins: a copy of `grid`.
    pub cache: Address,
    /// [`SurfelChange`] of each cell, then of blocks of [`CHANGE_BLOCK`]³ cells, hashed in the same way; both for each of [`CHANGE_TESTS`] tests.
    pub changes: Address,
}

/// Push constants of `surfel_spawn.comp` and `surfel_wishes.comp`.
#[repr(C)]
#[derive(Clone, Copy, Debug, Default, Pod, Zeroable)]
pub struct SurfelSpawnParams {
    /// The [`View`](super::view::View).
    pub view: Address,
    /// [`Surfel`] table.
    pub pool: Address,
    /// Where surfels are found.
    pub grid: SurfelGrid,
    /// [`SurfelCounts`].
    pub counts: Address,
    /// The G-buffer.
    pub gbuffer: GBufferImages,
    /// Output: number of surfels that each tile asks for, room for those of workgroups of cells and the sum of all; then the tiles' pixels,
    /// [`TILE_SPAWNS`] for each, x in the lower 16 bits.
    pub asked: Address,
    /// As in [`SurfelPoolParams`].
    pub wishes: Address,
    /// Coverage below which a pixel asks for a surfel.
    pub coverage: f32,
    /// Number of tiles, for `surfel_wishes.comp`.
    pub tiles: u32,
    /// Of so many pixels in a row, and so many in a column, one is looked at in a frame. A power of 2.
    pub stride: u32,
}

/// Push constants of `surfel_sum.comp`.
#[repr(C)]
#[derive(Clone, Copy, Debug, Default, Pod, Zeroable)]
pub struct SurfelSumParams {
    /// Numbers, replaced by the sum of those before; the entry after the last becomes the sum of all.
    pub numbers: Address,
    /// A `uint`, how many there are; or 0 for `count`.
    pub count_at: Address,
    /// How many there are.
    pub count: u32,
}

/// Push constants of `surfel_commit.comp`.
#[repr(C)]
#[derive(Clone, Copy, Debug, Default, Pod, Zeroable)]
pub struct SurfelCommitParams {
    /// The [`View`](super::view::View).
    pub view: Address,
    /// Root of the scene, [`Scene`](super::scene::Scene).
    pub scene: Address,
    /// [`Surfel`] table.
    pub pool: Address,
    /// Where surfels are found.
    pub grid: SurfelGrid,
    /// [`SurfelCounts`].
    pub counts: Address,
    /// As in [`SurfelSpawnParams`], with sums of all before in place of the numbers.
    pub asked: Address,
    /// As in [`SurfelPoolParams`].
    pub wishes: Address,
    /// As in [`SurfelPoolParams`].
    pub free: Address,
    /// Workgroups that were searched for free places.
    pub groups: Address,
    /// List of the surfels that are spawned, as pixels of the image of keys.
    pub list: Address,
    /// Rays of a frame at most.
    pub budget: u32,
    /// Rays of a surfel in its first frame at most.
    pub rays_of_new: u32,
    /// Number of tiles.
    pub tiles: u32,
    /// Places in the pool.
    pub capacity: u32,
    /// Reversed depth of the G-buffer.
    pub depth: SampledImage,
    /// Instance + 1 and primitive of the G-buffer.
    pub ids: SampledImage,
}

/// Push constants of `surfel_trace.ray` and `surfel_tinted_trace.ray`.
#[repr(C)]
#[derive(Clone, Copy, Debug, Default, Pod, Zeroable)]
pub struct SurfelTraceParams {
    /// The [`View`](super::view::View).
    pub view: Address,
    /// Root of the scene, [`Scene`](super::scene::Scene).
    pub scene: Address,
    /// Three counters (`uint`): closest-hit rays, any-hit rays, and values that are not finite.
    pub rays: Address,
    /// What shading at hits reads.
    pub hits: HitShadingParams,
    /// [`Surfel`] table.
    pub pool: Address,
    /// Where surfels are found, a [`SurfelGrid`].
    pub grid: Address,
    /// As in [`SurfelPoolParams`].
    pub changes: Address,
    /// [`SurfelCounts`].
    pub counts: Address,
    /// List of surfels, as pixels of the image of keys.
    pub list: Address,
    /// Output: as in [`SurfelPoolParams`].
    pub wishes: Address,
    /// Greatest number of surfaces that a path meets and that are shaded, at least 1.
    pub bounces: u32,
    /// As in the `TraceParams` of reflections.
    pub regularization: f32,
    /// How samples are averaged: [`MULTI_SCALE`] or [`RUNNING_MEAN`].
    pub estimator: u32,
    /// 1 where paths go on to emissive surfaces from where they end, otherwise 0.
    pub emitters: u32,
}

/// Push constants of `surfel_share.comp`.
#[repr(C)]
#[derive(Clone, Copy, Debug, Default, Pod, Zeroable)]
pub struct SurfelShareParams {
    /// The [`View`](super::view::View).
    pub view: Address,
    /// [`Surfel`] table.
    pub pool: Address,
    /// Where surfels are found.
    pub grid: SurfelGrid,
    /// [`SurfelCounts`].
    pub counts: Address,
    /// Places in the pool.
    pub capacity: u32,
    /// Older surfels that trace in a frame at most; above 0.
    pub paths: u32,
    /// Reversed depth of the G-buffer.
    pub depth: SampledImage,
    /// Openness, or [`NO_IMAGE`](super::denoise::NO_IMAGE).
    pub openness: u32,
    /// 1 where directions are drawn more often from where light came before, otherwise 0.
    pub guided: u32,
}

/// Push constants of `surfel_widen.comp`.
#[repr(C)]
#[derive(Clone, Copy, Debug, Default, Pod, Zeroable)]
pub struct SurfelWidenParams {
    /// The [`View`](super::view::View).
    pub view: Address,
    /// [`Surfel`] table.
    pub pool: Address,
    /// Where surfels are found.
    pub grid: SurfelGrid,
    /// Places in the pool.
    pub capacity: u32,
    /// 0, then 1.
    pub turn: u32,
}

/// Push constants of `surfel_keep.comp`.
#[repr(C)]
#[derive(Clone, Copy, Debug, Default, Pod, Zeroable)]
pub struct SurfelKeepParams {
    /// [`Surfel`] table.
    pub pool: Address,
    /// Where surfels are found.
    pub grid: SurfelGrid,
    /// [`SurfelCounts`].
    pub counts: Address,
    /// Output: from [`SurfelCounts::live`] on to [`SurfelCounts::visible`], for the statistics.
    pub counted: Address,
    /// Places in the pool.
    pub capacity: u32,
}

/// Push constants of `surfel_gather.comp`.
#[repr(C)]
#[derive(Clone, Copy, Debug, Default, Pod, Zeroable)]
pub struct SurfelGatherParams {
    /// The [`View`](super::view::View).
    pub view: Address,
    /// Where surfels are found.
    pub grid: SurfelGrid,
    /// The G-buffer.
    pub gbuffer: GBufferImages,
    /// Openness, or [`NO_IMAGE`](super::denoise::NO_IMAGE).
    pub openness: u32,
    /// Output, RGBA16F or RGBA32F: radiance; with a `step` of 2 irradiance over pi, for the upper left one of four pixels.
    pub radiance: StorageImage,
    /// Greatest number in the format of `radiance`.
    pub greatest: f32,
    /// Distance of the pixels that are lit: 1 or 2.
    pub step: u32,
}

/// Push constants of `surfel_show.comp`.
#[repr(C)]
#[derive(Clone, Copy, Debug, Default, Pod, Zeroable)]
pub struct SurfelShowParams {
    /// The [`View`](super::view::View).
    pub view: Address,
    /// [`Surfel`] table.
    pub pool: Address,
    /// Where surfels are found.
    pub grid: SurfelGrid,
    /// [`SurfelCounts`].
    pub counts: Address,
    /// The G-buffer.
    pub gbuffer: GBufferImages,
    /// Output, RGBA32F: colours of surfels, darker to the rim; in alpha the sum of all weights.
    pub discs: StorageImage,
    /// Output, RGBA32F: age in frames, samples, paths, standard deviation of samples over their mean.
    pub state: StorageImage,
    /// Output, RGBA32F: radius in metres, surfels in the cell, sum of all weights, and the share that counts behind what stands on the surface.
    pub place: StorageImage,
    /// Output, R32F, one row: surfels, surfels wanted, spawned, recycled, references dropped, pixels uncovered and visible, rays.
    pub counters: StorageImage,
    /// Output, RGBA32F, [`KEYS_WIDTH`] wide, or [`NO_IMAGE`](super::denoise::NO_IMAGE): of each surfel, in two rows, position and radius, both 0 for
    /// free places; and its instance plus 1, triangle or sphere, and [`SurfelBinding::weights`].
    pub table: u32,
    /// Places in the pool.
    pub capacity: u32,
}
