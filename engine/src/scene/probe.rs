//! Places from which reflections are captured, as a scene asks for them.
use glam::{DAffine3, Vec3};

/// Greatest number of probes in a scene.
pub const MAX_PROBES: usize = 32;

/// A box with a reflection probe. Surfaces in it reflect what the probe captures, with parallax corrected.
#[derive(Clone, Copy, Debug, PartialEq)]
pub struct ReflectionProbe {
    /// Rotation and centre of the box: no scale. Metres of the world, in the rest pose.
    pub world_from_box: DAffine3,
    /// Half the lengths of the edges, metres, above 0.
    pub half_size: Vec3,
    /// Where it captures, from the centre of the box along the box's axes, metres; inside of the box.
    pub centre: Vec3,
    /// Distance inside of the border over which the probe fades in, metres, at least 0.
    pub fade: f32,
}
