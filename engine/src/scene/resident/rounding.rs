//! How far 32-bit arithmetic may move a surface.
use crate::ray::Bounds;
use glam::{Affine3A, DMat3, DVec3, Vec3A};

/// Unit roundoff of `f32`.
const U: f64 = 1.0 / 16_777_216.0;

/// `n u / (1 - n u)`: bound of the relative error of `n` operations (Higham 2002, "Accuracy and Stability of Numerical Algorithms",
/// lemma 3.1).
fn gamma(n: f64) -> f64 {
    n * U / (1.0 - n * U)
}

/// A point between three corners: weights from a difference (2), products and sums (3), the weights' own sum (1).
const POINT: f64 = 6.0;
/// Object to world, and the step off the surface: a dot product of four (4), a product and a sum (1).
const PLACE: f64 = 5.0;
/// World to object in the walk (4), with an inverse that the driver has made for itself (4).
const ENTER: f64 = 8.0;
/// The test of a triangle of ordinary shape, on differences of its corners to the ray: difference (1), shear (4), edges (3). Of a
/// sphere no more.
const MEET: f64 = 8.0;

/// Greatest distance, metres, by which the arithmetic of shaders and of a walk moves a point of an instance against a ray that starts
/// there: `bounds` around the mesh in object space, the transforms as the device has them.
///
/// In the manner of pbrt (Pharr, Jakob and Humphreys 2023, "Physically Based Rendering", 4th edition, section 6.8): every step is
/// bounded by gamma times the sum of the sizes of its terms, here at the corner of the box where that is greatest.
pub(super) fn rounding(world_from_object: &Affine3A, object_from_world: &Affine3A, bounds: &Bounds) -> f32 {
    let (world, object) = (parts(world_from_object), parts(object_from_world));
    let size = |m: &DMat3| DMat3::from_cols(m.x_axis.abs(), m.y_axis.abs(), m.z_axis.abs());
    let (to_world, to_object) = (size(&world.0), size(&object.0));

    let corner = bounds.min.abs().max(bounds.max.abs()).as_dvec3();
    let placed = to_world * corner + world.1.abs();
    let entered = to_object * placed + object.1.abs();
    // Corners are up to twice as far from the ray as from the origin.
    let in_object = gamma(POINT) * corner + gamma(ENTER) * entered + gamma(MEET) * 2.0 * corner;
    // What the two transforms as they are stored, rounded, do to each other.
    let product = world.0 * object.0;
    let off = [0, 1, 2].map(|c| (product.col(c) - DMat3::IDENTITY.col(c)).abs());
    let undone = DMat3::from_cols(off[0], off[1], off[2]) * placed + (world.0 * object.1 + world.1).abs();

    let total = to_world * in_object + gamma(PLACE) * placed + undone;
    (total.length() as f32).max(f32::MIN_POSITIVE)
}

fn parts(m: &Affine3A) -> (DMat3, DVec3) {
    let a = m.matrix3;
    let column = |c: Vec3A| c.as_dvec3();
    (DMat3::from_cols(column(a.x_axis), column(a.y_axis), column(a.z_axis)), m.translation.as_dvec3())
}
