//! Bound on the rounding errors of 32-bit arithmetic on a surface, from which ray offsets are chosen (`docs/ray-origins.md`).
use crate::ray::Bounds;
use glam::{Affine3A, DMat3, DVec3, Vec3A};

/// Unit roundoff of `f32`.
const U: f64 = 1.0 / 16_777_216.0;

/// `n u / (1 - n u)`: bound on the relative error of `n` operations (Higham 2002, "Accuracy and Stability of Numerical
/// Algorithms", lemma 3.1).
fn gamma(n: f64) -> f64 {
    n * U / (1.0 - n * U)
}

/// Roundings in a point of a triangle: weights from a difference (2), products and sums (3), the sum of the weights (1).
const POINT: f64 = 6.0;
/// Roundings in object to world and the offset: a dot product of four terms (4), a product and a sum (1).
const PLACE: f64 = 5.0;
/// Roundings in world to object during traversal (4), with an inverse computed by the driver (4).
const ENTER: f64 = 8.0;
/// Roundings in the triangle test, on differences of the corners to the ray: difference (1), shear (4), edges (3). Triangles are
/// assumed to be well-shaped. A sphere test needs no more.
const MEET: f64 = 8.0;

/// Extent of a mesh in object space.
#[derive(Clone, Copy, Debug)]
pub(super) struct Shape {
    /// Bounding box.
    pub bounds: Bounds,
    /// Deviation of the traced surface from the rasterised one; 0 unless `ray_detail` simplifies it.
    pub deviation: f32,
}

/// Bound, in metres, on the distance between a point of an instance and the same point as a ray that starts there sees it, from the
/// rounding errors of shaders and traversal with the transforms as stored on the device. Adds the deviation of a simplified mesh.
///
/// Error analysis as in pbrt (Pharr, Jakob and Humphreys 2023, "Physically Based Rendering", 4th edition, section 6.8): every
/// step is bounded by gamma times the sum of the magnitudes of its terms, at the corner of the box where that is largest.
pub(super) fn rounding(world_from_object: &Affine3A, object_from_world: &Affine3A, shape: &Shape) -> f32 {
    let (world, object) = (parts(world_from_object), parts(object_from_world));
    let size = |m: &DMat3| DMat3::from_cols(m.x_axis.abs(), m.y_axis.abs(), m.z_axis.abs());
    let (to_world, to_object) = (size(&world.0), size(&object.0));

    let Shape { bounds, deviation } = shape;
    let corner = bounds.min.abs().max(bounds.max.abs()).as_dvec3();
    let placed = to_world * corner + world.1.abs();
    let entered = to_object * placed + object.1.abs();
    // A corner is up to twice as far from the ray's origin as from the object's.
    let in_object = gamma(POINT) * corner + gamma(ENTER) * entered + gamma(MEET) * 2.0 * corner;
    // Error of the two stored transforms applied one after the other, since both are rounded.
    let product = world.0 * object.0;
    let off = [0, 1, 2].map(|c| (product.col(c) - DMat3::IDENTITY.col(c)).abs());
    let undone = DMat3::from_cols(off[0], off[1], off[2]) * placed + (world.0 * object.1 + world.1).abs();

    let total = to_world * in_object + gamma(PLACE) * placed + undone;
    // The Frobenius norm bounds the factor by which a vector can get longer.
    let stretch = [0, 1, 2].map(|c| world.0.col(c).length_squared()).into_iter().sum::<f64>().sqrt();
    ((total.length() + f64::from(*deviation) * stretch) as f32).max(f32::MIN_POSITIVE)
}

fn parts(m: &Affine3A) -> (DMat3, DVec3) {
    let a = m.matrix3;
    let column = |c: Vec3A| c.as_dvec3();
    (DMat3::from_cols(column(a.x_axis), column(a.y_axis), column(a.z_axis)), m.translation.as_dvec3())
}

#[cfg(test)]
mod tests {
    use super::*;
    use crate::ray::object_from_world;
    use glam::{Quat, Vec3};

    fn of(world: Affine3A, reach: f32) -> f32 {
        let bounds = Bounds { min: Vec3::splat(-reach), max: Vec3::splat(reach) };
        rounding(&world, &object_from_world(&world).unwrap(), &Shape { bounds, deviation: 0.0 })
    }

    #[test]
    fn it_grows_with_the_mesh_and_with_the_distance_and_with_nothing_else() {
        let turned = |scale: f32, at: Vec3| {
            Affine3A::from_scale_rotation_translation(Vec3::splat(scale), Quat::from_rotation_y(0.7), at)
        };
        let near = |a: f32, b: f32| assert!((a / b - 1.0).abs() < 0.1, "{a:e}, wanted {b:e}");
        // 35 unit roundoffs of a corner.
        near(of(Affine3A::IDENTITY, 1.0), 35.0 * U as f32 * 3.0_f32.sqrt());
        for scale in [1e-3, 1.0, 1e4] {
            near(of(turned(scale, Vec3::ZERO), 2.0 / scale), of(turned(1.0, Vec3::ZERO), 2.0));
            near(of(turned(scale, Vec3::ZERO), 2.0), scale * of(turned(1.0, Vec3::ZERO), 2.0));
        }
        let far = |x: f32| of(turned(1.0, Vec3::X * x), 1.0);
        near(far(2e6), 2.0 * far(1e6));
        assert!((1e6 * 10.0 * U as f32..1e6 * 60.0 * U as f32).contains(&far(1e6)), "{:e}", far(1e6));
    }

    #[test]
    fn it_covers_what_the_transforms_do_to_points() {
        let mut worst = 0.0_f64;
        let mut state = 1_u32;
        let mut random = || {
            state = state.wrapping_mul(747_796_405).wrapping_add(2_891_336_453);
            (state >> 8) as f32 / 8_388_608.0 - 1.0
        };
        for _ in 0..2000 {
            let mut vector = || Vec3::new(random(), random(), random());
            let (scale, axis, at, p) = (vector().abs() + 0.01, vector(), vector() * 50.0, vector() * 3.0);
            let turn = Quat::from_scaled_axis(axis * 3.0);
            let world = Affine3A::from_scale_rotation_translation(scale, turn, at);
            let object = object_from_world(&world).unwrap();
            let bounds = Bounds { min: Vec3::splat(-3.0), max: Vec3::splat(3.0) };
            let bound = rounding(&world, &object, &Shape { bounds, deviation: 0.0 });
            // To world and back in `f32`, compared in world space.
            let (m, t) = parts(&world);
            let back = object.transform_point3(world.transform_point3(p));
            let moved = (m * (back.as_dvec3() - p.as_dvec3())).length();
            assert!(t.is_finite() && moved <= f64::from(bound), "{moved:e} over {bound:e}: {world:?}");
            worst = worst.max(moved / f64::from(bound));
        }
        assert!(worst > 0.01, "the bound is {worst} times what it is for");
    }
}
