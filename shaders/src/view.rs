//! What every pass knows of the camera, the frame and the sky.
use super::types::{Address, SampledImage, SamplerId};
use bytemuck::{Pod, Zeroable};

/// In a table of lights: none.
pub const NO_LIGHT: u32 = 4294967295;

/// Most lights that cast shadows in one frame.
pub const MOST_CASTERS: u32 = 8;

/// Camera, frame and sky. Matrices are column-major; clip space has reversed, infinite depth and y down.
#[repr(C)]
#[derive(Clone, Copy, Debug, Default, Pod, Zeroable)]
pub struct View {
    /// Clip from world, with this frame's [`View::jitter`].
    pub clip_from_world: [[f32; 4]; 4],
    /// World from clip, the inverse of that.
    pub world_from_clip: [[f32; 4]; 4],
    /// Clip from world without jitter.
    pub steady_clip_from_world: [[f32; 4]; 4],
    /// Clip from world one frame ago, without jitter.
    pub previous_clip_from_world: [[f32; 4]; 4],
    /// World from clip one frame ago, with that frame's jitter.
    pub previous_world_from_clip: [[f32; 4]; 4],
    /// Eye in the world, metres.
    pub eye: [f32; 3],
    /// Eye one frame ago.
    pub previous_eye: [f32; 3],
    /// Where pixels are sampled: pixels from their centres, right and down.
    pub jitter: [f32; 2],
    /// The same one frame ago.
    pub previous_jitter: [f32; 2],
    /// Width and height of the picture that is made in the end, pixels; [`View::size`] where that is not scaled.
    pub output_size: [u32; 2],
    /// Mip levels that textures are read finer by than the pixels of [`View::size`] ask for: log2 of those over the output's, 0 or less.
    pub mip_bias: f32,
    /// Frame number, from 0.
    pub frame: u32,
    /// Width and height, pixels.
    pub size: [u32; 2],
    /// Seed of the run.
    pub seed: u32,
    /// How many of [`View::casters`] there are.
    pub caster_count: u32,
    /// Indices of the lights that can cast shadows, the one that matters most first; [`NO_LIGHT`] behind the last.
    pub casters: [u32; 8],
    /// Root of the scene's tables.
    pub scene: Address,
    /// 1 when the scene has a sky.
    pub has_sky: u32,
    /// The sky, if any.
    pub sky: Sky,
}

/// Light from all around: an environment map, or analytic daylight (Preetham et al. 1999), scaled, over a Lambertian ground.
#[repr(C)]
#[derive(Clone, Copy, Debug, Default, Pod, Zeroable)]
pub struct Sky {
    /// Unit direction towards the sun.
    pub to_sun: [f32; 3],
    /// Perez coefficients A to E of luminance Y.
    pub perez_y_luminance: [f32; 5],
    /// Perez coefficients of chromaticity x.
    pub perez_x: [f32; 5],
    /// Perez coefficients of chromaticity y.
    pub perez_y: [f32; 5],
    /// Zenith (Y, x, y) over the Perez function at the zenith.
    pub zenith: [f32; 3],
    /// Radiance of the ground below the horizon.
    pub ground: [f32; 3],
    /// Radiance of the sun's disc.
    pub sun_radiance: [f32; 3],
    /// Cosine of the sun's angular radius; above 1 when there is no disc.
    pub sun_cos_radius: f32,
    /// An image that takes the place of sky, ground and disc, latitude over longitude, or
    /// [`NO_TEXTURE`](super::scene::NO_TEXTURE).
    pub environment: SampledImage,
    /// Its sampler: repeats from left to right.
    pub environment_sampler: SamplerId,
    /// What its texels are multiplied with.
    pub environment_scale: f32,
    /// Sine and cosine of the angle about +y by which it is turned.
    pub environment_turn: [f32; 2],
    /// Irradiance of the sky and the ground as order-2 spherical harmonics (Ramamoorthi and Hanrahan 2001), cosine-convolved.
    pub irradiance_sh: [[f32; 3]; 9],
}
