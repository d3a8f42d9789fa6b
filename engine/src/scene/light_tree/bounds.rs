//! Bounds of lights in space, direction and strength, as `shaders/lib/light_tree_fit.glsl` computes them on the device.
use glam::{Mat3, Vec3, Vec4};
use magpie_shaders::light_tree::{
    GREATEST_INTENSITY, LEAST_INTENSITY, LIGHT_NODE_HAS_SURFACES, LIGHT_NODE_TWO_SIDED, LightNode, UNLIMITED_REACH,
};
use magpie_shaders::scene as shared;
use std::f32::consts::PI;

/// What rounding may take from a cosine.
const COSINE_ROUNDING: f32 = 1e-6;

/// A cone around normals, and how far from them lights shine.
#[derive(Clone, Copy, Debug, PartialEq)]
pub(super) struct Cone {
    /// Unit.
    pub axis: Vec3,
    /// Cosine of the half angle; -1 for all directions.
    pub cos_normals: f32,
    /// Cosine of the greatest angle to its normal at which a light still shines.
    pub cos_emission: f32,
    pub two_sided: bool,
}

impl Cone {
    pub fn of(node: &LightNode) -> Self {
        Self {
            axis: Vec3::from(node.axis),
            cos_normals: node.cos_normals,
            cos_emission: node.cos_emission,
            two_sided: node.child & LIGHT_NODE_TWO_SIDED != 0,
        }
    }

    /// The cone around two (Conty Estevez and Kulla 2018, algorithm 1, without angles). A cone of lights with two sides is as good with its axis
    /// turned round.
    pub fn union(self, other: Self) -> Self {
        let (mut a, mut b) = if self.cos_normals > other.cos_normals { (other, self) } else { (self, other) };
        let whole = Self {
            cos_normals: -1.0,
            cos_emission: a.cos_emission.min(b.cos_emission),
            two_sided: a.two_sided || b.two_sided,
            ..a
        };
        if a.cos_normals <= COSINE_ROUNDING - 1.0 {
            return whole;
        }
        let cosine = a.axis.dot(b.axis);
        // Most lights of a mesh lie in the cone of those before them.
        if b.cos_normals == 1.0 && cosine >= a.cos_normals {
            return Self { cos_normals: a.cos_normals, ..whole };
        }
        if cosine < 0.0 {
            if b.two_sided {
                b.axis = -b.axis;
            } else if a.two_sided {
                a.axis = -a.axis;
            }
        }
        let (half_a, half_b) = (half_angle(a.cos_normals), half_angle(b.cos_normals));
        let half_between = [0.5 * (a.axis + b.axis).length(), 0.5 * (a.axis - b.axis).length()];
        let farthest = angle_sum(half_between, half_b);
        // By how much the axis turns; not at all where the wider cone holds the other.
        let turn = angle_difference(farthest, half_a);
        if turn[1] <= 0.0 {
            return Self { axis: a.axis, cos_normals: a.cos_normals, ..whole };
        }
        let opening = angle_sum(farthest, half_a);
        if opening[1] <= 0.0 {
            return whole;
        }
        let across = b.axis - a.axis.dot(b.axis) * a.axis;
        let across = if across.length_squared() > 1e-12 { across.normalize() } else { a.axis.any_orthonormal_vector() };
        // Once more, since what rounding left of the axis grows where the two are nearly opposite.
        let across = (across - a.axis.dot(across) * a.axis).normalize();
        Self {
            axis: (turn[0] * a.axis + turn[1] * across).normalize(),
            cos_normals: (opening[0] - COSINE_ROUNDING).max(-1.0),
            ..whole
        }
    }

    /// The measure of directions into which the lights shine, weighted by their cosine (Conty Estevez and Kulla 2018, equation 1): pi for one that
    /// is flat, 4 pi for a sphere.
    pub fn measure(&self) -> f32 {
        let cos = self.cos_normals.clamp(-1.0, 1.0);
        let sin = (1.0 - cos * cos).sqrt();
        let normals = 2.0 * PI * (1.0 - cos);
        if self.cos_emission == 0.0 {
            // A right angle, without arc cosines for most.
            return normals + if cos >= 0.0 { 0.5 * PI * (PI * sin + 2.0 * cos) } else { PI * (PI - cos.acos()) * sin };
        }
        let (normal, emission) = (cos.acos(), self.cos_emission.clamp(-1.0, 1.0).acos());
        let whole = (normal + emission).min(PI);
        normals + 0.5 * PI * (2.0 * whole * sin - (normal - 2.0 * whole).cos() - 2.0 * normal * sin + cos)
    }
}

/// Cosine and sine of half the angle with this cosine.
fn half_angle(cosine: f32) -> [f32; 2] {
    [cosine, -cosine].map(|c| (0.5 + 0.5 * c).max(0.0).sqrt())
}

fn angle_sum(a: [f32; 2], b: [f32; 2]) -> [f32; 2] {
    [a[0] * b[0] - a[1] * b[1], a[1] * b[0] + a[0] * b[1]]
}

fn angle_difference(a: [f32; 2], b: [f32; 2]) -> [f32; 2] {
    [a[0] * b[0] + a[1] * b[1], a[1] * b[0] - a[0] * b[1]]
}

/// The node above two others. What does not shine counts for nothing.
pub(super) fn node_above(a: &LightNode, b: &LightNode, first_child: u32) -> LightNode {
    let child = first_child | (a.child | b.child) & (LIGHT_NODE_TWO_SIDED | LIGHT_NODE_HAS_SURFACES);
    if a.intensity <= 0.0 || b.intensity <= 0.0 {
        return LightNode { child, ..if a.intensity > 0.0 { *a } else { *b } };
    }
    let cone = Cone::of(a).union(Cone::of(b));
    let intensity = a.intensity + b.intensity;
    let count = a.count + b.count;
    // Mean of the squares over the square of the mean, less 1.
    let squares = |node: &LightNode| (node.intensity / intensity).powi(2) * (1.0 + node.spread) / node.count as f32;
    LightNode {
        min: Vec3::from(a.min).min(Vec3::from(b.min)).to_array(),
        max: Vec3::from(a.max).max(Vec3::from(b.max)).to_array(),
        intensity,
        reach: a.reach.max(b.reach),
        axis: cone.axis.to_array(),
        cos_normals: cone.cos_normals,
        cos_emission: cone.cos_emission,
        spread: (count as f32 * (squares(a) + squares(b)) - 1.0).max(0.0),
        count,
        child,
    }
}

/// Within what the tree can sum up and divide by.
fn tree_intensity(strength: f32) -> f32 {
    if strength > 0.0 { strength.clamp(LEAST_INTENSITY, GREATEST_INTENSITY) } else { 0.0 }
}

fn luminance(c: [f32; 3]) -> f32 {
    Vec3::from(c).dot(Vec3::new(0.2126, 0.7152, 0.0722))
}

/// A leaf that does not shine.
fn dark_leaf(child: u32) -> LightNode {
    LightNode { axis: [0.0, 0.0, 1.0], cos_normals: 1.0, child, ..LightNode::default() }
}

/// A leaf that shines with this intensity, if at all.
fn shining(leaf: LightNode, intensity: f32, count: u32) -> LightNode {
    let intensity = tree_intensity(intensity);
    LightNode { intensity, count: if intensity > 0.0 { count } else { 0 }, ..leaf }
}

pub(super) fn lamp_leaf(light: &shared::Light, child: u32) -> LightNode {
    let (direction, position) = (Vec3::from(light.direction), Vec3::from(light.position));
    let disc = PI * light.radius * light.radius;
    let (half_u, half_v) = (Vec3::from(light.half_u), Vec3::from(light.half_v));
    let (extent, area) = match light.kind {
        shared::LIGHT_RECTANGLE => (half_u.abs() + half_v.abs(), 4.0 * half_u.cross(half_v).length()),
        shared::LIGHT_DISC => (light.radius * (1.0 - direction * direction).max(Vec3::ZERO).map(f32::sqrt), disc),
        shared::LIGHT_SPHERE => (Vec3::splat(light.radius), disc),
        _ => (Vec3::ZERO, 1.0),
    };
    let mut leaf = LightNode {
        min: (position - extent).to_array(),
        max: (position + extent).to_array(),
        reach: if light.range > 0.0 { light.range } else { UNLIMITED_REACH },
        cos_normals: -1.0,
        ..dark_leaf(child)
    };
    if matches!(light.kind, shared::LIGHT_RECTANGLE | shared::LIGHT_DISC | shared::LIGHT_SPOT) {
        (leaf.axis, leaf.cos_normals) = (light.direction, 1.0);
    }
    if light.kind == shared::LIGHT_SPOT {
        leaf.cos_emission = -light.cone_offset / light.cone_scale;
    }
    shining(leaf, area * luminance(light.intensity), 1)
}

pub(super) fn triangle_leaf([a, b, c]: [Vec3; 3], emission: f32, child: u32) -> LightNode {
    // In double precision, in which the smallest areas do not vanish.
    let across = (b - a).as_dvec3().cross((c - a).as_dvec3());
    let leaf = LightNode {
        min: a.min(b).min(c).to_array(),
        max: a.max(b).max(c).to_array(),
        reach: UNLIMITED_REACH,
        axis: across.try_normalize().map_or([0.0, 0.0, 1.0], |axis| axis.as_vec3().to_array()),
        ..dark_leaf(child)
    };
    shining(leaf, (0.5 * across.length() * f64::from(emission)) as f32, 1)
}

pub(super) fn sphere_leaf(centre: Vec3, radius: f32, emission: f32, child: u32) -> LightNode {
    let leaf = LightNode {
        min: (centre - radius).to_array(),
        max: (centre + radius).to_array(),
        reach: UNLIMITED_REACH,
        cos_normals: -1.0,
        ..dark_leaf(child)
    };
    shining(leaf, PI * radius * radius * emission, 1)
}

/// Square of the greatest factor over the least by which a transform stretches normals; `None` where it is too great to tell. `rows`: those of the
/// inverse.
fn stretch_of_normals(rows: [Vec3; 3]) -> Option<f32> {
    let size: f32 = rows.iter().map(|row| row.length_squared()).sum();
    if size.is_nan() || size <= 0.0 {
        return None;
    }
    // Eigenvalues of a symmetric matrix of trace 1 (Smith 1961, "Eigenvalues of a Symmetric 3 x 3 Matrix").
    let column = |i: usize| Vec3::from_array([0, 1, 2].map(|j| rows[i].dot(rows[j]) / size));
    let rest = Mat3::from_cols(column(0), column(1), column(2)) - Mat3::IDENTITY * (1.0 / 3.0);
    let deviation =
        ([rest.x_axis, rest.y_axis, rest.z_axis].iter().map(|c| c.length_squared()).sum::<f32>() / 6.0).sqrt();
    if deviation < 1e-5 {
        return Some(1.0);
    }
    let angle = (0.5 * (rest * (1.0 / deviation)).determinant()).clamp(-1.0, 1.0).acos() / 3.0;
    let eigenvalue = |angle: f32| 1.0 / 3.0 + 2.0 * deviation * angle.cos();
    // The least is known to the precision of the arc cosine.
    let least = eigenvalue(angle + 2.0 * PI / 3.0) - 1e-3 * deviation;
    (least > 1e-4).then(|| eigenvalue(angle) / least)
}

/// An instance of a mesh whose tree has this root.
pub(super) fn instance_leaf(root: &LightNode, instance: &shared::Instance, child: u32) -> LightNode {
    let linear = |rows: [[f32; 4]; 3]| rows.map(|row| Vec4::from(row).truncate());
    let (world, object) = (linear(instance.world_from_object), linear(instance.object_from_world));
    let inverse: f32 = object.iter().map(|row| row.length_squared()).sum();
    // A singular transform leaves nothing that shines.
    if inverse.is_nan() || inverse <= 0.0 || root.intensity <= 0.0 {
        return dark_leaf(child);
    }
    let mut leaf = LightNode { child, ..*root };
    let (min, max) = (Vec3::from(root.min), Vec3::from(root.max));
    let (centre, extent) = (0.5 * min + 0.5 * max, 0.5 * max - 0.5 * min);
    #[allow(clippy::needless_range_loop)]
    for axis in 0..3 {
        let offset = instance.world_from_object[axis][3];
        let middle = world[axis].dot(centre) + offset;
        let size = world[axis].abs().dot(centre.abs() + extent) + offset.abs();
        let reach = world[axis].abs().dot(extent) + 1e-6 * size;
        (leaf.min[axis], leaf.max[axis]) = (middle - reach, middle + reach);
    }
    let normal: Vec3 = object.iter().zip(root.axis).map(|(row, n)| *row * n).sum();
    leaf.axis = normal.as_dvec3().try_normalize().map_or(root.axis, |n| n.as_vec3().to_array());
    // The angle between two vectors grows by no more than tan(after / 2) = stretch tan(before / 2) (Wielandt's inequality).
    let stretch_square = stretch_of_normals(object);
    if root.cos_normals < 1.0 && stretch_square != Some(1.0) {
        let wide = 1.0 + root.cos_normals;
        leaf.cos_normals = match stretch_square {
            Some(stretch_square) if wide > 1e-6 => {
                let tangent_square = stretch_square * (1.0 - root.cos_normals) / wide;
                ((1.0 - tangent_square) / (1.0 + tangent_square) - COSINE_ROUNDING).max(-1.0)
            }
            _ => -1.0,
        };
    }
    // Areas across the axis grow by the cofactor matrix, those of other normals by its mean.
    let volume = world[0].cross(world[1]).dot(world[2]).abs();
    let along = root.cos_normals.max(0.0).powi(2);
    let growth = volume * (inverse / 3.0 * (1.0 - along) + normal.length_squared() * along).sqrt();
    shining(leaf, root.intensity * growth, root.count)
}
