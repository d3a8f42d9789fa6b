//! Parameters of camera, frame and sky, for every pass.
use super::types::{Address, SampledImage, SamplerId};
use bytemuck::{Pod, Zeroable};

/// Entry of a table of lights that stands for none.
pub const NO_LIGHT: u32 = 4294967295;

/// Greatest number of shadow-casting lights in one frame.
pub const MAX_SHADOW_LIGHTS: u32 = 8;

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
    /// Position of the camera in the world, metres.
    pub eye: [f32; 3],
    /// The same one frame ago.
    pub previous_eye: [f32; 3],
    /// Offset of the sample positions from the pixel centres, pixels, right and down.
    pub jitter: [f32; 2],
    /// The same one frame ago.
    pub previous_jitter: [f32; 2],
    /// Width and height of the final picture, pixels; equal to [`View::size`] without upsampling.
    pub output_size: [u32; 2],
    /// Bias of the mip level of textures: log2 of the height of [`View::size`] over that of the output, 0 or less.
    pub mip_bias: f32,
    /// Frame number, from 0.
    pub frame: u32,
    /// Width and height of the frame, pixels.
    pub size: [u32; 2],
    /// Seed of the run.
    pub seed: u32,
    /// Valid entries of [`View::shadow_lights`].
    pub shadow_light_count: u32,
    /// Indices of the shadow-casting lights, most important first; then [`NO_LIGHT`].
    pub shadow_lights: [u32; 8],
    /// Table of the specular lobe's albedo, [`LobeAlbedo`](super::lobe_albedo::LobeAlbedo), for `split_sum` of `lib/brdf.glsl`.
    pub lobe_albedo: Address,
    /// 1 if the scene has a sky.
    pub has_sky: u32,
    /// The sky; ignored without `has_sky`.
    pub sky: Sky,
}

/// Distant light: an environment map, or analytic daylight (Preetham et al. 1999), scaled, over a Lambertian ground.
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
    /// Environment map in place of sky, ground and sun disc, latitude over longitude, or [`NO_TEXTURE`](super::scene::NO_TEXTURE).
    pub environment: SampledImage,
    /// Its sampler, which repeats in u.
    pub environment_sampler: SamplerId,
    /// Factor of the environment map's radiance.
    pub environment_scale: f32,
    /// Sine and cosine of the environment map's rotation about +y.
    pub environment_turn: [f32; 2],
    /// Irradiance of the sky and the ground as order-2 spherical harmonics (Ramamoorthi and Hanrahan 2001), cosine-convolved.
    pub irradiance_sh: [[f32; 3]; 9],
}
