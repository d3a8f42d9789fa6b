//! Nodes, skins and animations, and how animations are sampled (glTF 2.0, Appendix C).
use glam::{DAffine3, DQuat, DVec3, DVec4};

/// A node of the scene's hierarchy.
#[derive(Clone, Debug, Default)]
pub struct Node {
    /// Name, for messages.
    pub name: String,
    /// Index into [`Scene::nodes`](super::Scene::nodes) of the parent, less than the node's own; `None` for a root node.
    pub parent: Option<u32>,
    /// Transform from node to parent space, in the rest pose.
    pub local: Local,
    /// Morph weights for the meshes that the node shows; empty to use the weights of the mesh.
    pub weights: Vec<f32>,
}

/// Transform of a node, from node to parent space.
#[derive(Clone, Copy, Debug, PartialEq)]
pub enum Local {
    /// Any affine transform. Animation channels do not change it.
    Matrix(DAffine3),
    /// Scale, then rotation, then translation.
    Trs {
        /// Metres.
        translation: DVec3,
        /// Unit quaternion.
        rotation: DQuat,
        /// Factor along each axis.
        scale: DVec3,
    },
}

impl Local {
    /// The identity transform.
    pub const IDENTITY: Self = Self::Trs { translation: DVec3::ZERO, rotation: DQuat::IDENTITY, scale: DVec3::ONE };

    /// The transform as a matrix.
    pub fn affine(&self) -> DAffine3 {
        match *self {
            Self::Matrix(m) => m,
            Self::Trs { translation, rotation, scale } => {
                DAffine3::from_scale_rotation_translation(scale, rotation, translation)
            }
        }
    }
}

impl Default for Local {
    fn default() -> Self {
        Self::IDENTITY
    }
}

/// World-from-node transform of every node in the rest pose.
pub(super) fn rest_worlds(nodes: &[Node]) -> Vec<DAffine3> {
    let mut worlds: Vec<DAffine3> = Vec::with_capacity(nodes.len());
    for node in nodes {
        let local = node.local.affine();
        worlds.push(node.parent.map_or(local, |p| worlds[p as usize] * local));
    }
    worlds
}

/// The joints that deform a mesh.
#[derive(Clone, Debug, Default)]
pub struct Skin {
    /// Name, for messages.
    pub name: String,
    /// Indices into [`Scene::nodes`](super::Scene::nodes).
    pub joints: Vec<u32>,
    /// Joint from mesh at bind time, one per joint.
    pub inverse_bind: Vec<DAffine3>,
}

/// An animation of nodes and morph weights. It loops.
#[derive(Clone, Debug, Default)]
pub struct Animation {
    /// Name, for `Animator::with_animation` and messages.
    pub name: String,
    /// Time of the last key of all channels, seconds, at least 0; the loop has this length.
    pub duration: f64,
    /// At most one channel for each node and property.
    pub channels: Vec<Channel>,
}

/// One property of one node over time.
#[derive(Clone, Debug)]
pub struct Channel {
    /// Index into [`Scene::nodes`](super::Scene::nodes).
    pub node: u32,
    /// The property that it animates.
    pub property: Property,
    /// Interpolation between keys.
    pub interpolation: Interpolation,
    /// Times of the keys, seconds from the start: at least one, non-decreasing.
    pub times: Vec<f32>,
    /// Values of the keys, one key after another: 3 numbers for a translation (metres) or a scale, 4 for a rotation (x, y, z, w), one per
    /// morph target for weights. With [`Interpolation::CubicSpline`] each key has three sets: in-tangent (per second), value, out-tangent.
    pub values: Vec<f32>,
}

/// The property that a channel animates.
#[derive(Clone, Copy, Debug, PartialEq, Eq)]
pub enum Property {
    /// Translation of [`Local::Trs`].
    Translation,
    /// Rotation of [`Local::Trs`].
    Rotation,
    /// Scale of [`Local::Trs`].
    Scale,
    /// Morph weights of the meshes that the node shows.
    Weights,
}

/// Interpolation between two keys.
#[derive(Clone, Copy, Debug, Default, PartialEq, Eq)]
pub enum Interpolation {
    /// The value of the previous key.
    Step,
    /// Linear; spherical linear (slerp) for rotations, along the shorter arc.
    #[default]
    Linear,
    /// A cubic Hermite spline.
    CubicSpline,
}

/// The two keys around a time. `along` is the fraction between them, 0 if there is nothing to interpolate.
struct Segment {
    key: usize,
    along: f64,
    seconds: f64,
}

impl Channel {
    /// Numbers per key, without tangents.
    pub fn width(&self) -> usize {
        let parts = if self.interpolation == Interpolation::CubicSpline { 3 } else { 1 };
        self.values.len() / (self.times.len() * parts).max(1)
    }

    /// Translation or scale at a time in seconds; constant before the first and after the last key.
    pub fn vector(&self, time: f64) -> DVec3 {
        let s = self.segment(time);
        DVec3::from_array([0, 1, 2].map(|c| self.component(&s, c)))
    }

    /// Rotation at a time in seconds, as a unit quaternion.
    pub fn rotation(&self, time: f64) -> DQuat {
        let s = self.segment(time);
        if self.interpolation == Interpolation::Linear && s.along > 0.0 {
            let key = |k: usize| {
                let q = &self.values[4 * k..4 * k + 4];
                unit(DVec4::new(q[0].into(), q[1].into(), q[2].into(), q[3].into()))
            };
            return slerp(key(s.key), key(s.key + 1), s.along);
        }
        unit(DVec4::from_array([0, 1, 2, 3].map(|c| self.component(&s, c))))
    }

    /// Writes the morph weights at a time in seconds to `out`.
    pub fn weights(&self, time: f64, out: &mut [f32]) {
        let s = self.segment(time);
        for (c, out) in out.iter_mut().enumerate().take(self.width()) {
            *out = self.component(&s, c) as f32;
        }
    }

    fn segment(&self, time: f64) -> Segment {
        let after = self.times.partition_point(|t| f64::from(*t) <= time);
        if after == 0 || after == self.times.len() {
            return Segment { key: after.saturating_sub(1), along: 0.0, seconds: 0.0 };
        }
        let (a, b) = (f64::from(self.times[after - 1]), f64::from(self.times[after]));
        Segment { key: after - 1, along: (time - a) / (b - a), seconds: b - a }
    }

    /// One component at a segment, interpolated on its own.
    fn component(&self, s: &Segment, c: usize) -> f64 {
        let width = self.width();
        let cubic = self.interpolation == Interpolation::CubicSpline;
        // Sets of numbers in a key of a spline: 0 in-tangent, 1 value, 2 out-tangent.
        let at = |key: usize, part: usize| {
            let row = if cubic { 3 * key + part } else { key };
            f64::from(self.values[row * width + c])
        };
        let (t, from) = (s.along, at(s.key, 1));
        if t == 0.0 {
            return from;
        }
        match self.interpolation {
            Interpolation::Step => from,
            Interpolation::Linear => (1.0 - t) * from + t * at(s.key + 1, 1),
            Interpolation::CubicSpline => {
                let (t2, t3) = (t * t, t * t * t);
                (2.0 * t3 - 3.0 * t2 + 1.0) * from
                    + s.seconds * (t3 - 2.0 * t2 + t) * at(s.key, 2)
                    + (3.0 * t2 - 2.0 * t3) * at(s.key + 1, 1)
                    + s.seconds * (t3 - t2) * at(s.key + 1, 0)
            }
        }
    }
}

/// The normalised quaternion; the identity if it is zero, as a spline may be.
fn unit(q: DVec4) -> DQuat {
    q.try_normalize().map_or(DQuat::IDENTITY, DQuat::from_vec4)
}

/// Spherical linear interpolation of unit quaternions along the shorter arc (Shoemake 1985).
fn slerp(a: DQuat, b: DQuat, t: f64) -> DQuat {
    let b = if a.dot(b) < 0.0 { -b } else { b };
    // Half the angle from the lengths of sum and difference, which is accurate where the arc cosine is not.
    let angle = 2.0 * (b - a).length().atan2((b + a).length());
    let (wa, wb) = if angle < 1e-9 {
        (1.0 - t, t)
    } else {
        (((1.0 - t) * angle).sin() / angle.sin(), (t * angle).sin() / angle.sin())
    };
    unit(DVec4::from(a * wa + b * wb))
}

#[cfg(test)]
mod tests {
    use super::*;
    use std::f64::consts::FRAC_1_SQRT_2;

    fn channel(interpolation: Interpolation, property: Property, times: &[f32], values: &[f32]) -> Channel {
        Channel { node: 0, property, interpolation, times: times.to_vec(), values: values.to_vec() }
    }

    #[test]
    fn steps_and_lines_by_hand() {
        let values = [0.0, 0.0, 0.0, 2.0, -4.0, 6.0, 10.0, 0.0, 1.0];
        let step = channel(Interpolation::Step, Property::Translation, &[1.0, 2.0, 4.0], &values);
        let line = Channel { interpolation: Interpolation::Linear, ..step.clone() };
        for (time, stepped, linear) in [
            (-5.0, [0.0; 3], [0.0; 3]),
            (1.0, [0.0; 3], [0.0; 3]),
            (1.25, [0.0; 3], [0.5, -1.0, 1.5]),
            (2.0, [2.0, -4.0, 6.0], [2.0, -4.0, 6.0]),
            (3.0, [2.0, -4.0, 6.0], [6.0, -2.0, 3.5]),
            (4.0, [10.0, 0.0, 1.0], [10.0, 0.0, 1.0]),
            (9.0, [10.0, 0.0, 1.0], [10.0, 0.0, 1.0]),
        ] {
            assert_eq!(step.vector(time).to_array(), stepped, "step at {time}");
            assert_eq!(line.vector(time).to_array(), linear, "line at {time}");
        }
        let one = channel(Interpolation::Linear, Property::Scale, &[3.0], &[1.0, 2.0, 3.0]);
        assert_eq!([0.0, 3.0, 7.0].map(|t| one.vector(t)), [DVec3::new(1.0, 2.0, 3.0); 3]);
    }

    #[test]
    fn rotations_take_the_short_way_at_an_even_speed() {
        // From the identity to 90 degrees about y, given as the quaternion of the longer arc.
        let s = FRAC_1_SQRT_2 as f32;
        let turn =
            channel(Interpolation::Linear, Property::Rotation, &[0.0, 3.0], &[0.0, 0.0, 0.0, 1.0, 0.0, -s, 0.0, -s]);
        for degrees in [0.0_f64, 30.0, 60.0, 80.0] {
            let got = turn.rotation(degrees / 30.0);
            let wanted = DQuat::from_rotation_y(degrees.to_radians());
            assert!(got.dot(wanted).abs() > 1.0 - 1e-12, "{degrees}: {got}");
            assert!((got.length() - 1.0).abs() < 1e-14);
        }
        // Two keys that are almost equal.
        let still = channel(Interpolation::Linear, Property::Rotation, &[0.0, 1.0], &[0.0, s, 0.0, s, 0.0, s, 0.0, s]);
        assert!(still.rotation(0.4).abs_diff_eq(DQuat::from_rotation_y(90_f64.to_radians()), 1e-7));
        let step = Channel { interpolation: Interpolation::Step, ..turn };
        assert_eq!(step.rotation(2.9), DQuat::IDENTITY);
    }

    #[test]
    fn splines_by_hand() {
        // One number from 0 to 1 over two seconds, with out-tangent 3 and in-tangent -1 per second.
        // At half way: 0.5 * 0 + 2 * 0.125 * 3 + 0.5 * 1 + 2 * -0.125 * -1 = 1.5; at a quarter: 0.28125 * 3 + 0.15625 + 0.09375.
        let spline =
            channel(Interpolation::CubicSpline, Property::Weights, &[1.0, 3.0], &[9.0, 0.0, 3.0, -1.0, 1.0, 7.0]);
        assert_eq!(spline.width(), 1);
        let at = |time: f64| {
            let mut out = [0.0];
            spline.weights(time, &mut out);
            out[0]
        };
        assert_eq!([at(0.0), at(1.0), at(1.5), at(2.0), at(3.0), at(4.0)], [0.0, 0.0, 1.09375, 1.5, 1.0, 1.0]);
        // Two targets: their tangents and values are interleaved per key.
        let two = channel(
            Interpolation::CubicSpline,
            Property::Weights,
            &[0.0, 1.0],
            &[0.0, 0.0, 1.0, 2.0, 0.0, 0.0, 0.0, 0.0, 3.0, 6.0, 0.0, 0.0],
        );
        let mut out = [0.0; 2];
        two.weights(0.5, &mut out);
        assert_eq!(out, [2.0, 4.0]);
        // The result is a unit quaternion even if the keys are not.
        let turn = channel(
            Interpolation::CubicSpline,
            Property::Rotation,
            &[0.0, 1.0],
            &[
                0.0, 0.0, 0.0, 0.0, 0.0, 0.0, 0.0, 1.0, 0.0, 0.0, 0.0, 0.0, 0.0, 0.0, 0.0, 0.0, 0.0, 1.0, 0.0, 0.0,
                0.0, 0.0, 0.0, 0.0,
            ],
        );
        assert!(turn.rotation(0.5).abs_diff_eq(DQuat::from_rotation_y(90_f64.to_radians()), 1e-12));
    }
}
