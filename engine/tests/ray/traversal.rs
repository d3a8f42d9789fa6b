//! The shader's walk through the trees, ported to Rust, against every triangle one after the other.
use crate::oracle::{self, Soup};
use crate::shapes::{self, Random, random_soup, sphere};
use crate::twin::{self, NO_HIT, Ray, Shapes, Tables, Work};
use glam::{Affine3A, EulerRot, Quat, Vec3};
use magpie::ray::{MeshBvh, SceneBvh, placements};

struct World {
    soups: Vec<Soup>,
    meshes: Vec<MeshBvh>,
    instances: Vec<(Affine3A, u32)>,
    scene: SceneBvh,
}

impl World {
    fn new(soups: Vec<Soup>, instances: Vec<(Affine3A, u32)>) -> Self {
        let meshes: Vec<_> = soups.iter().map(|s| MeshBvh::build(&s.positions, &s.indices).unwrap()).collect();
        let scene = SceneBvh::build(&placements(&instances, &meshes).unwrap()).unwrap();
        Self { soups, meshes, instances, scene }
    }

    fn trace(&self, ray: &Ray, any_hit: bool, work: &mut Work) -> twin::Hit {
        let shapes: Vec<_> = self.soups.iter().map(|s| Shapes::Triangles(&s.positions)).collect();
        let tables = Tables { scene: &self.scene, meshes: &self.meshes, shapes: &shapes, instances: &self.instances };
        tables.trace(ray, any_hit, work)
    }

    fn closest(&self, origin: Vec3, direction: Vec3) -> twin::Hit {
        let ray = Ray { origin, t_min: 0.0, direction, t_max: f32::INFINITY };
        self.trace(&ray, false, &mut Work::default())
    }

    /// Traces rays both ways. A difference is right only where a ray runs along an edge, within `tolerance` of it.
    fn compare(&self, rays: &[Ray], tolerance: f64) {
        let facets = oracle::facets(&self.soups, &self.instances);
        let (mut hits, mut contested) = (0, 0);
        let mut work = Work::default();
        for ray in rays {
            let hit = self.trace(ray, false, &mut work);
            let any = self.trace(ray, true, &mut work);
            assert_eq!(any.instance != NO_HIT, hit.instance != NO_HIT, "{ray:?}");
            let found = oracle::nearest(&facets, ray.origin, ray.direction, ray.t_min, ray.t_max);
            match found {
                None if hit.instance == NO_HIT => {}
                Some(f) if (hit.instance, hit.primitive) == (f.instance, f.triangle) => {
                    hits += 1;
                    let span = (f64::from(ray.origin.length()) + f.t * f64::from(ray.direction.length()))
                        / f64::from(ray.direction.length());
                    assert!((f64::from(hit.t) - f.t).abs() <= tolerance * span, "{ray:?} {hit:?} {f:?}");
                    for (ours, theirs) in hit.barycentric.iter().zip(&f.weights[1..]) {
                        assert!((f64::from(*ours) - theirs).abs() < 100.0 * tolerance, "{ray:?} {hit:?} {f:?}");
                    }
                    assert_eq!(hit.front, f.front, "{ray:?} {hit:?} {f:?}");
                }
                _ => {
                    // One of the two took a triangle that the other just missed at its edge, or at the end of the ray.
                    contested += 1;
                    let near = facets.iter().any(|facet| {
                        let d = ray.direction.as_dvec3();
                        shapes::grazes(facet, ray.origin.as_dvec3(), d, 100.0 * tolerance)
                    });
                    assert!(near, "{ray:?} {hit:?} {found:?}");
                }
            }
        }
        assert!(work.stack <= self.scene.stack, "used {} of {} stack entries", work.stack, self.scene.stack);
        assert!(hits * 10 > rays.len(), "{hits} hits of {} rays", rays.len());
        assert!(contested * 1000 <= rays.len(), "{contested} contested of {} rays", rays.len());
    }
}

fn rays_through(random: &mut Random, centre: Vec3, radius: f32, count: usize) -> Vec<Ray> {
    (0..count)
        .map(|at| {
            let origin = centre + 2.0 * radius * random.vector();
            let target = centre + radius * random.vector();
            // Any length: t is in lengths of the direction.
            let direction = (target - origin) * random.range(0.01, 10.0);
            let t_max = if at % 3 == 0 { random.range(0.5, 2.0) / direction.length() * radius } else { f32::INFINITY };
            Ray { origin, t_min: 0.0, direction, t_max }
        })
        .collect()
}

fn turned(scale: Vec3, angles: Vec3, translation: Vec3) -> Affine3A {
    let rotation = Quat::from_euler(EulerRot::XYZ, angles.x, angles.y, angles.z);
    Affine3A::from_scale_rotation_translation(scale, rotation, translation)
}

#[test]
fn a_soup_agrees_with_the_oracle() {
    let mut random = Random(1);
    let world = World::new(vec![random_soup(&mut random, 400)], vec![(Affine3A::IDENTITY, 0)]);
    world.compare(&rays_through(&mut random, Vec3::ZERO, 1.0, 10_000), 1e-5);
}

#[test]
fn placed_soups_agree_with_the_oracle() {
    let mut random = Random(2);
    let soups = vec![random_soup(&mut random, 60), random_soup(&mut random, 1), sphere(6)];
    let instances = (0..24)
        .map(|at| {
            let mut scale = Vec3::splat(random.range(0.1, 0.5)) + 0.3 * random.vector().abs();
            if at % 2 == 0 {
                scale[at / 2 % 3] *= -1.0;
            }
            (turned(scale, 3.0 * random.vector(), random.vector()), at as u32 % 3)
        })
        .collect();
    let world = World::new(soups, instances);
    world.compare(&rays_through(&mut random, Vec3::ZERO, 1.0, 10_000), 1e-5);
}

#[test]
fn far_from_the_origin_it_still_agrees() {
    let mut random = Random(3);
    let far = Vec3::new(1e6, -1e6, 1e6);
    // One mesh lies far out itself, another is put there.
    let mut shifted = random_soup(&mut random, 100);
    shifted.positions.iter_mut().for_each(|p| *p = 1e4 * *p + far);
    let instances = vec![(Affine3A::IDENTITY, 0), (turned(Vec3::splat(1e4), Vec3::ONE, far), 1)];
    let world = World::new(vec![shifted, random_soup(&mut random, 100)], instances);
    world.compare(&rays_through(&mut random, far, 1e4, 10_000), 1e-5);
}

#[test]
fn a_closed_surface_has_no_cracks() {
    for (translation, scale) in [(Vec3::ZERO, 1.0), (Vec3::new(1e6, 2e6, -1e6), 1e3), (Vec3::new(0.1, 0.0, -7.0), 1e-3)]
    {
        let ball = sphere(12);
        let (corners, indices) = (ball.positions.clone(), ball.indices.clone());
        let place = turned(Vec3::splat(scale), Vec3::new(0.3, 1.0, 2.0), translation);
        let world = World::new(vec![ball], vec![(place, 0)]);
        for triangle in indices.as_chunks::<3>().0 {
            let [a, b, c] = triangle.map(|i| corners[i as usize]);
            for target in [a, 0.5 * (a + b), b.lerp(c, 0.3), c.lerp(a, 1e-3)] {
                let direction = place.transform_vector3(target);
                assert_ne!(world.closest(translation, direction).instance, NO_HIT, "towards {target}");
            }
        }
    }
}

#[test]
fn axis_parallel_rays_meet_corners_edges_and_faces() {
    let world = World::new(vec![shapes::cube()], vec![(Affine3A::IDENTITY, 0)]);
    let steps = [-1.0, -0.5, 0.0, 0.25, 1.0];
    for axis in 0..3 {
        for sign in [-1.0, 1.0] {
            for (zero, u, v) in
                steps.iter().flat_map(|&u| steps.map(|v| (0.0_f32, u, v))).flat_map(|(z, u, v)| [(z, u, v), (-z, u, v)])
            {
                let mut origin = Vec3::ZERO;
                (origin[axis], origin[(axis + 1) % 3], origin[(axis + 2) % 3]) = (-3.0 * sign, u, v);
                let mut direction = Vec3::splat(zero);
                direction[axis] = sign;
                let hit = world.closest(origin, direction);
                // Rays inside the faces of a cube of half edge 1 run along its other faces where |u| or |v| is 1.
                assert!(hit.instance == 0 && (hit.t - 2.0).abs() < 1e-6, "{origin} {direction} {hit:?}");
                assert!(hit.front);
                origin[(axis + 1) % 3] = u + 2.5 * if u < 0.0 { -1.0 } else { 1.0 };
                assert_eq!(world.closest(origin, direction).instance, NO_HIT, "{origin} {direction}");
            }
        }
    }
}

#[test]
fn front_is_the_counter_clockwise_side_in_object_space() {
    let triangle = Soup { positions: vec![Vec3::ZERO, Vec3::X, Vec3::Y], indices: vec![0, 1, 2] };
    let mirror = Affine3A::from_scale(Vec3::new(1.0, 1.0, -1.0));
    for (place, front_from_above) in [(Affine3A::IDENTITY, true), (mirror, false)] {
        let soup = Soup { positions: triangle.positions.clone(), indices: triangle.indices.clone() };
        let world = World::new(vec![soup], vec![(place, 0)]);
        let at = Vec3::new(0.25, 0.5, 0.0);
        let above = world.closest(at + Vec3::Z, Vec3::NEG_Z);
        assert_eq!((above.t, above.barycentric, above.front), (1.0, [0.25, 0.5], front_from_above));
        assert_eq!(world.closest(at - Vec3::Z, Vec3::Z).front, !front_from_above);
    }
}

#[test]
fn the_ends_of_a_ray_are_not_part_of_it() {
    let world = World::new(vec![shapes::cube()], vec![(Affine3A::IDENTITY, 0)]);
    let trace = |t_min, t_max| {
        let ray = Ray { origin: Vec3::new(0.2, 0.3, -3.0), t_min, direction: Vec3::Z, t_max };
        world.trace(&ray, false, &mut Work::default())
    };
    assert_eq!(trace(0.0, 2.0).instance, NO_HIT);
    assert_eq!(trace(0.0, 2.1).t, 2.0);
    assert_eq!((trace(2.0, 9.0).t, trace(2.0, 9.0).front), (4.0, false));
    assert_eq!((trace(4.0, 9.0).t, trace(4.0, 9.0).instance), (9.0, NO_HIT));
}

#[test]
fn triangles_without_area_are_never_hit() {
    let line =
        Soup { positions: vec![Vec3::ZERO, Vec3::X, 2.0 * Vec3::X, Vec3::Y], indices: vec![0, 1, 2, 0, 0, 3, 1, 1, 1] };
    let world = World::new(vec![line], vec![(Affine3A::IDENTITY, 0)]);
    assert!(world.meshes[0].primitives.is_empty() && world.scene.instances.is_empty());
    for direction in [Vec3::NEG_Z, Vec3::new(0.5, 0.0, -1.0), Vec3::new(0.0, 0.5, -1.0)] {
        assert_eq!(world.closest(Vec3::Z, direction).instance, NO_HIT);
    }
    // Seen edge on, a triangle with area is not hit either, and gives no NaN (the twin asserts it in the boxes).
    let flat = Soup { positions: vec![Vec3::ZERO, Vec3::X, Vec3::Z], indices: vec![0, 1, 2] };
    let world = World::new(vec![flat], vec![(Affine3A::IDENTITY, 0)]);
    assert_eq!(world.closest(Vec3::new(-1.0, 0.0, 0.2), Vec3::X).instance, NO_HIT);
    assert_eq!(world.closest(Vec3::new(0.2, 1.0, 0.2), Vec3::NEG_Y).primitive, 0);
}

#[test]
fn nothing_to_hit_is_a_miss() {
    let nothing = || Soup { positions: Vec::new(), indices: Vec::new() };
    for world in [
        World::new(Vec::new(), Vec::new()),
        World::new(vec![nothing()], vec![(Affine3A::IDENTITY, 0)]),
        World::new(vec![shapes::cube()], Vec::new()),
        World::new(vec![shapes::cube()], vec![(Affine3A::from_scale(Vec3::new(1.0, 0.0, 1.0)), 0)]),
    ] {
        assert_eq!(world.closest(Vec3::new(0.1, 0.2, -3.0), Vec3::Z).instance, NO_HIT);
        assert_eq!(world.scene.nodes.len(), 1);
    }
    let both = World::new(vec![nothing(), shapes::cube()], vec![(Affine3A::IDENTITY, 0), (Affine3A::IDENTITY, 1)]);
    assert_eq!(both.closest(Vec3::new(0.1, 0.2, -3.0), Vec3::Z).instance, 1);
}

#[test]
fn a_ray_visits_few_nodes() {
    let world = World::new(vec![sphere(100)], vec![(Affine3A::IDENTITY, 0)]);
    let mut random = Random(5);
    let mut work = Work::default();
    for ray in rays_through(&mut random, Vec3::ZERO, 1.0, 1000) {
        world.trace(&ray, false, &mut work);
    }
    // 20 000 triangles: five levels of eight; two more for entering and leaving.
    let (nodes, triangles) = (f64::from(work.nodes) / 1000.0, f64::from(work.primitives) / 1000.0);
    assert!(nodes < 20.0 && triangles < 20.0, "{nodes} nodes and {triangles} triangles per ray");
}

/// The nearest root of the quadratic in `f64`: t, and whether it is where the ray comes in.
fn sphere_root((centre, radius): (Vec3, f32), ray: &Ray) -> Option<(f64, bool)> {
    let (f, d) = ((ray.origin - centre).as_dvec3(), ray.direction.as_dvec3());
    let (a, b, c) = (d.dot(d), f.dot(d), f.dot(f) - f64::from(radius).powi(2));
    let root = (b * b - a * c).sqrt();
    let inside = |t: &f64| *t > f64::from(ray.t_min) && *t < f64::from(ray.t_max);
    [((-b - root) / a, true), ((-b + root) / a, false)].into_iter().find(|(t, _)| inside(t))
}

#[test]
fn spheres_agree_with_the_quadratic() {
    let mut random = Random(6);
    let spheres: Vec<_> = (0..300).map(|_| (random.vector(), random.range(0.01, 0.15))).collect();
    let mesh = [MeshBvh::build_spheres(&spheres).unwrap()];
    let instances = [(Affine3A::IDENTITY, 0), (turned(Vec3::splat(0.5), Vec3::ONE, 3.0 * Vec3::X), 0)];
    let scene = SceneBvh::build(&placements(&instances, &mesh).unwrap()).unwrap();
    let shapes = [Shapes::Spheres(&spheres)];
    let tables = Tables { scene: &scene, meshes: &mesh, shapes: &shapes, instances: &instances };
    let (mut hits, mut inside, mut contested) = (0, 0, 0);
    for ray in rays_through(&mut random, Vec3::ZERO, 1.0, 10_000) {
        let ray = Ray { t_max: ray.t_max.min(1.5 / ray.direction.length()), ..ray };
        let hit = tables.trace(&ray, false, &mut Work::default());
        let found = (0..)
            .zip(&spheres)
            .filter_map(|(at, s)| sphere_root(*s, &ray).map(|(t, front)| (t, front, at)))
            .min_by(|a, b| a.0.total_cmp(&b.0));
        match found {
            Some((t, front, at)) if (hit.instance, hit.primitive, hit.front) == (0, at, front) => {
                let error = (f64::from(hit.t) - t).abs() * f64::from(ray.direction.length());
                // Near its edge a sphere turns an error across the ray into the root of one along it.
                assert!(error < 2e-3, "{ray:?} {hit:?} {t}");
                hits += 1;
                inside += u32::from(!front);
            }
            None if hit.instance != 0 => {}
            _ => contested += 1,
        }
    }
    assert!(hits > 3000 && inside > 50, "{hits} hits, {inside} from the inside");
    assert!(contested <= 5, "{contested} rays differ");
}

#[test]
fn the_boxes_of_instances_spare_what_the_grid_takes_in() {
    // Two thin plates above one another, a hundredth of the scene apart, and rays between them that leave it by the side.
    let plate = || shapes::cube();
    let at = |y: f32| turned(Vec3::new(1.0, 1e-4, 1.0), Vec3::ZERO, y * Vec3::Y);
    let far = turned(Vec3::splat(0.1), Vec3::ZERO, 40.0 * Vec3::Y);
    let world = World::new(vec![plate()], vec![(at(0.0), 0), (at(0.01), 0), (far, 0)]);
    let mut work = Work::default();
    for at in 0..20 {
        let origin = Vec3::new(-0.9, 0.004 + 1e-4 * at as f32, 0.03 * at as f32);
        let ray = Ray { origin, t_min: 0.0, direction: Vec3::X, t_max: f32::INFINITY };
        assert_eq!(world.trace(&ray, false, &mut work).instance, NO_HIT);
    }
    assert_eq!(work.instances, 0);
}
