//! Decides whether emissive surfaces light a scene well enough that no sun needs to be supplied.
use super::light_sampling::{emits, mean_emission};
use super::supply::{PosedInstance, posed_instances};
use super::{AlphaMode, Instance, Scene};
use crate::ray::{Occluder, Occluders};
use glam::DVec3;
use rayon::prelude::*;
use std::f64::consts::PI;

/// Irradiance above which a surface counts as lit: a hundredth of what the supplied sun and sky give a surface facing the sun. A
/// white surface then has a radiance of 0.01, which is displayed at a tenth of the display's range.
pub(super) const MIN_IRRADIANCE: f64 = 0.01 * PI;
/// Fraction of the surfaces, by area, that must be lit.
pub(super) const MIN_LIT_FRACTION: f64 = 0.25;
/// Number of sample points on emissive surfaces, and on surfaces that may be lit.
const EMITTER_SAMPLES: usize = 256;
const SURFACE_SAMPLES: usize = 1024;
/// With more triangles and spheres than this, occlusion is ignored, because building a BVH over them would take seconds.
const MAX_OCCLUDERS: usize = 1 << 22;

/// A triangle or a sphere of the scene.
struct Primitive {
    shape: Occluder,
    /// Area, square metres.
    area: f64,
    /// Luminance of the emitted radiance.
    emission: f64,
    double_sided: bool,
    /// Whether it blocks light.
    opaque: bool,
}

/// A point on a surface.
struct Point {
    place: DVec3,
    /// Unit normal.
    normal: DVec3,
    double_sided: bool,
}

impl Primitive {
    /// Emitted flux of both sides.
    fn flux(&self) -> f64 {
        PI * self.area * self.emission * if self.double_sided { 2.0 } else { 1.0 }
    }

    /// Maps two numbers from 0 to 1 to a point, uniformly over the area of a triangle or of an unscaled sphere.
    fn point(&self, [x, y]: [f64; 2]) -> Point {
        let double_sided = self.double_sided;
        match self.shape {
            Occluder::Triangle([a, b, c]) => {
                let root = x.sqrt();
                let place = a * (1.0 - root) + b * (root * (1.0 - y)) + c * (root * y);
                Point { place, normal: (b - a).cross(c - a).normalize_or_zero(), double_sided }
            }
            Occluder::Ball(centre, shape) => {
                let (z, around) = (1.0 - 2.0 * x, 2.0 * PI * y);
                let flat = (1.0 - z * z).max(0.0).sqrt();
                let out = DVec3::new(flat * around.cos(), flat * around.sin(), z);
                let normal = (shape.inverse().transpose() * out).normalize_or_zero();
                Point { place: centre + shape * out, normal, double_sided }
            }
        }
    }
}

/// Fraction of a scene's surfaces, by area, that are lit by emission alone, 0 to 1: with an irradiance of at least [`MIN_IRRADIANCE`]
/// directly from emissive triangles and spheres (factor times texture). A deterministic estimate; below [`MIN_LIT_FRACTION`] it is an upper
/// bound, since it ignores occlusion.
pub(super) fn lit_fraction(scene: &Scene) -> f64 {
    if !scene.instances.iter().any(|i| emits(&scene.materials[i.material as usize])) {
        return 0.0;
    }
    let posed_instances = posed_instances(scene);
    let all = || {
        posed_instances.iter().zip(&scene.instances).flat_map(|(posed, instance)| primitives(scene, posed, instance))
    };
    // Scenes can be too large to store all pieces, so sums are computed first and points in a second pass.
    let [area, flux] = all().fold([0.0; 2], |[area, flux], p| [area + p.area, flux + p.flux()]);
    let (mut at, mut from) = (PointSampler::new(area, SURFACE_SAMPLES), PointSampler::new(flux, EMITTER_SAMPLES));
    for primitive in all() {
        at.add(&primitive, primitive.area);
        from.add(&primitive, primitive.flux());
    }
    let each = flux / EMITTER_SAMPLES as f64;
    let share = |hidden: &(dyn Fn(DVec3, DVec3) -> bool + Sync)| {
        at.points.par_iter().filter(|p| is_lit(p, &from.points, each, hidden)).count() as f64 / SURFACE_SAMPLES as f64
    };
    // Without occlusion first. If that is not enough, occlusion need not be computed.
    let most = share(&|_, _| false);
    let opaque = || all().filter(|p| p.opaque).map(|p| p.shape);
    if most < MIN_LIT_FRACTION || opaque().count() > MAX_OCCLUDERS {
        return most;
    }
    let occluders = Occluders::new(opaque());
    share(&|a, b| occluders.between(a, b))
}

/// Whether a point is lit by sample points that emit `flux` each.
fn is_lit(at: &Point, from: &[Point], flux: f64, hidden: impl Fn(DVec3, DVec3) -> bool) -> bool {
    let one = |emitter_point: &Point| {
        let towards = emitter_point.place - at.place;
        let square = towards.length_squared();
        let sided = |cosine: f64, both: bool| if both { cosine.abs() } else { cosine.max(0.0) };
        let cosines = sided(at.normal.dot(towards), at.double_sided)
            * sided(-emitter_point.normal.dot(towards), emitter_point.double_sided);
        let sides = if emitter_point.double_sided { 2.0 } else { 1.0 };
        // A Lambertian emitter of flux P has the intensity P cos / pi. The cosines are multiplied by the distance.
        if square > 0.0 { flux / (PI * sides) * cosines / (square * square) } else { 0.0 }
    };
    let mut sum = 0.0;
    from.iter().any(|emitter_point| {
        let more = one(emitter_point);
        if more > 0.0 && more.is_finite() && !hidden(at.place, emitter_point.place) {
            sum += more;
        }
        sum >= MIN_IRRADIANCE
    })
}

/// Chooses `count` points, distributed over pieces in proportion to their weights.
struct PointSampler {
    points: Vec<Point>,
    before: f64,
    step: f64,
    count: usize,
}

impl PointSampler {
    /// `whole` is the sum of all weights. If it is zero, no points are chosen.
    fn new(whole: f64, count: usize) -> Self {
        Self { points: Vec::new(), before: 0.0, step: whole / count as f64, count }
    }

    fn add(&mut self, primitive: &Primitive, weight: f64) {
        self.before += weight;
        while self.points.len() < self.count && (self.points.len() as f64 + 0.5) * self.step < self.before {
            // The R2 sequence (Roberts 2018, "The Unreasonable Effectiveness of Quasirandom Sequences").
            let i = self.points.len() as f64 + 1.0;
            let u = [0.754_877_666_246_693, 0.569_840_290_998_053].map(|step| (i * step).fract());
            self.points.push(primitive.point(u));
        }
    }
}

/// The triangles and spheres of an instance whose area is above zero.
fn primitives<'a>(
    scene: &'a Scene,
    posed: &'a PosedInstance<'a>,
    instance: &Instance,
) -> impl Iterator<Item = Primitive> + 'a {
    let (mesh, material) = (&scene.meshes[instance.mesh as usize], &scene.materials[instance.material as usize]);
    let (emissive, double_sided) = (emits(material), material.double_sided);
    let opaque = material.alpha == AlphaMode::Opaque && material.transmission == 0.0;
    let triangles = posed.indices.chunks_exact(3).map(move |corners| {
        let [a, b, c] =
            [0, 1, 2].map(|k| posed.world.transform_point3(posed.positions[corners[k] as usize].as_dvec3()));
        let area = 0.5 * (b - a).cross(c - a).length();
        let emission = if emissive { mean_emission(scene, material, mesh, corners) } else { 0.0 };
        Primitive { shape: Occluder::Triangle([a, b, c]), area, emission, double_sided, opaque }
    });
    let spheres = posed.spheres.iter().map(move |(centre, shape)| {
        let area = 4.0 * PI * shape.determinant().abs().powf(2.0 / 3.0);
        let emission = if emissive { super::light_sampling::luminance(material.emission) } else { 0.0 };
        Primitive { shape: Occluder::Ball(*centre, *shape), area, emission, double_sided, opaque }
    });
    triangles.chain(spheres).filter(|p| p.area > 0.0 && p.area.is_finite())
}

#[cfg(test)]
mod tests {
    use super::*;
    use crate::scene::{Material, Mesh, Sphere, Supply, builtin, supply};
    use glam::{Affine3A, Vec3};

    /// The Cornell box, with a lamp that itself emits this radiance.
    fn room(radiance: f32) -> Scene {
        let mut scene = builtin("cornell").unwrap();
        scene.lights.clear();
        for material in scene.materials.iter_mut().filter(|m| m.emission != Vec3::ZERO) {
            (material.shows_light, material.emission) = (false, Vec3::splat(radiance));
        }
        scene
    }

    fn ball(scene: &mut Scene, centre: Vec3, radius: f32, material: Material) {
        let (mesh, made) = (scene.meshes.len() as u32, scene.materials.len() as u32);
        scene.meshes.push(Mesh { spheres: vec![Sphere { centre, radius }], ..Mesh::default() });
        scene.materials.push(material);
        scene.instances.push(Instance::fixed("ball", mesh, made, Affine3A::IDENTITY));
    }

    /// A ball with a few bright spots, whose light mostly misses it.
    fn helmet() -> Scene {
        let mut scene = Scene::default();
        ball(&mut scene, Vec3::ZERO, 1.0, Material::default());
        for at in [Vec3::X, Vec3::Y, Vec3::new(0.6, 0.0, 0.8)] {
            ball(&mut scene, at, 0.04, Material { emission: Vec3::splat(8.0), ..Material::default() });
        }
        scene
    }

    fn is_given_a_sun(mut scene: Scene) -> bool {
        supply(&mut scene, Supply::All);
        assert!(!scene.supplied.is_empty(), "either way it is said");
        scene.daylight.is_some()
    }

    #[test]
    fn a_room_lit_by_a_panel_needs_no_sun() {
        let bright = room(10.0);
        assert!(lit_fraction(&bright) > 0.5, "{}", lit_fraction(&bright));
        assert!(!is_given_a_sun(bright));
        // A panel that emits very little.
        assert!(lit_fraction(&room(0.02)) < 0.05 && is_given_a_sun(room(0.02)));
        // A surface that only shows a light does not count as emissive.
        let mut shown = room(10.0);
        shown.materials.iter_mut().for_each(|m| m.shows_light = true);
        assert!(lit_fraction(&shown) == 0.0 && is_given_a_sun(shown));
    }

    /// A lamp in a closed box lights nothing outside it, whichever way the surrounding faces are oriented.
    #[test]
    fn light_that_is_shut_in_does_not_count() {
        let mut scene = Scene::default();
        let both_sides = || Material { double_sided: true, ..Material::default() };
        ball(&mut scene, Vec3::ZERO, 6.0, both_sides());
        ball(&mut scene, Vec3::ZERO, 0.2, Material { emission: Vec3::splat(100.0), ..Material::default() });
        let open = lit_fraction(&scene);
        ball(&mut scene, Vec3::ZERO, 1.0, both_sides());
        let shut = lit_fraction(&scene);
        // Through a glass shade its light does get out.
        scene.materials[2].transmission = 1.0;
        let shaded = lit_fraction(&scene);
        assert!(open > 0.9 && shut < 0.1 && shaded > 0.9, "{open} {shut} {shaded}");
    }

    #[test]
    fn a_few_glowing_spots_on_a_thing_leave_it_dark() {
        assert!(lit_fraction(&helmet()) < 0.1, "{}", lit_fraction(&helmet()));
        assert!(is_given_a_sun(helmet()));
    }

    /// A small sphere at the centre of a large one gives uniform irradiance: radiance times pi times the squared ratio of the radii.
    #[test]
    fn irradiance_in_a_ball_has_a_closed_form() {
        let lit = |radiance: f64| {
            let mut scene = Scene::default();
            ball(&mut scene, Vec3::ZERO, 4.0, Material { double_sided: true, ..Material::default() });
            ball(
                &mut scene,
                Vec3::ZERO,
                0.5,
                Material { emission: Vec3::splat(radiance as f32), ..Material::default() },
            );
            lit_fraction(&scene)
        };
        let just = MIN_IRRADIANCE / (PI * (0.5_f64 / 4.0).powi(2));
        assert!(lit(1.1 * just) > 0.95, "{}", lit(1.1 * just));
        assert!(lit(0.9 * just) < 0.05, "{}", lit(0.9 * just));
    }

    #[test]
    fn whatever_the_numbers_there_is_an_answer() {
        for (radius, radiance) in [(1e-20, 1.0), (1e12, 1.0), (1.0, 1e30), (1.0, f32::MAX)] {
            let mut scene = Scene::default();
            ball(&mut scene, Vec3::ZERO, radius, Material { emission: Vec3::splat(radiance), ..Material::default() });
            let share = lit_fraction(&scene);
            assert!((0.0..=1.0).contains(&share), "{radius} {radiance}: {share}");
        }
        assert_eq!(lit_fraction(&Scene::default()), 0.0);
    }
}
