//! Light from all around, from an image.
use glam::Vec3;
use std::sync::Arc;

/// An environment map: radiance in every direction, latitude over longitude.
///
/// The direction of texture coordinates (u, v), before `turn`, is `(sin p sin t, cos t, -cos p sin t)` with `p = 2 pi (u - 1/2)` and
/// `t = pi v`: the middle of the image is -z, where a camera without rotation looks, and its top edge is +y.
#[derive(Clone, Debug, PartialEq)]
pub struct Environment {
    /// Name for messages.
    pub name: String,
    /// Texels from left to right, at least 1.
    pub width: u32,
    /// Texels from top to bottom, at least 1.
    pub height: u32,
    /// Radiance of each texel, linear Rec.709, finite and at least 0; rows from the top.
    pub radiance: Arc<[Vec3]>,
    /// What the radiance is multiplied with, at least 0.
    pub scale: f32,
    /// Angle about +y by which the image is turned counter-clockwise as seen from above, radians.
    pub turn: f32,
}
