use super::*;
use crate::scene::light_sampling::luminance;
use crate::scene::{Animator, Light, SceneFacts};
use glam::DVec3;

/// Numbers of lamps on both sides of every step of the division.
const NUMBERS: [u32; 9] = [10, 11, 57, 99, 100, 101, 1_000, 4_321, 100_000];

/// Flux of a lamp, the mean of its channels.
fn flux(light: &Light) -> f64 {
    let pi = std::f64::consts::PI;
    let mean = |c: &Vec3| f64::from(c.element_sum()) / 3.0;
    match light {
        Light::Sphere { radius, radiance, .. } => 4.0 * (pi * f64::from(*radius)).powi(2) * mean(radiance),
        Light::Rectangle { half_u, half_v, radiance, .. } => {
            4.0 * pi * f64::from(half_u.cross(*half_v).length()) * mean(radiance)
        }
        Light::Spot { intensity, outer, .. } => 2.0 * pi * (1.0 - f64::from(*outer).cos()) * mean(intensity),
        other => panic!("another kind of lamp: {other:?}"),
    }
}

#[test]
fn there_are_as_many_lamps_as_were_asked_for_and_together_they_are_as_strong() {
    let sums = NUMBERS.map(|lights| {
        let scene = scene(lights);
        assert_eq!(scene.lights.len(), lights as usize);
        let kinds = |is: fn(&Light) -> bool| scene.lights.iter().filter(|light| is(light)).count();
        assert_eq!(kinds(|l| matches!(l, Light::Directional { .. })), 0, "{lights}: no sun");
        let others = kinds(|l| matches!(l, Light::Spot { .. })) * kinds(|l| matches!(l, Light::Rectangle { .. }));
        assert_eq!(others > 0, lights >= 100, "{lights}: spots and boards");
        let sum: f64 = scene.lights.iter().map(flux).sum();
        assert!((sum / f64::from(lamps::FLUX) - 1.0).abs() < 0.01, "{lights}: {sum}");
        SceneFacts::new(&scene).lights.iter().map(|light| light.power).sum::<f64>()
    });
    // Luminance depends on the mixture of colours as well.
    let [least, most] = [sums.iter().copied().fold(f64::MAX, f64::min), sums.iter().copied().fold(0.0, f64::max)];
    assert!(most / least < 1.8, "{sums:?}");
}

/// Centre, radius and emission of every ball that shows a lamp, in a moment.
fn balls(scene: &Scene, time: f64) -> Vec<(DVec3, f32, Vec3)> {
    let pose = Animator::new(scene).pose(time);
    let shown = |i: &crate::scene::Instance| scene.materials[i.material as usize].shows_light;
    let of = |(instance, world): (&crate::scene::Instance, &glam::DAffine3)| {
        let emission = scene.materials[instance.material as usize].emission;
        let spheres = &scene.meshes[instance.mesh as usize].spheres;
        spheres.iter().map(|s| (world.transform_point3(s.centre.as_dvec3()), s.radius, emission)).collect::<Vec<_>>()
    };
    scene.instances.iter().zip(&pose.instances).filter(|(i, _)| shown(i)).flat_map(of).collect()
}

#[test]
fn each_lamp_is_shown_where_it_shines() {
    let markets = [10, 1_500].map(scene);
    for (scene, time) in [(&markets[0], 0.0), (&markets[0], 3.7), (&markets[1], 0.0), (&markets[1], 11.3)] {
        let mut balls = balls(scene, time);
        balls.sort_by(|a, b| a.0.x.total_cmp(&b.0.x));
        for light in &Animator::new(scene).pose(time).lights {
            let Light::Sphere { centre, radius, radiance } = light else { continue };
            let first = balls.partition_point(|ball| ball.0.x < centre.x - 1e-4);
            let near = balls[first..].iter().take_while(|ball| ball.0.x < centre.x + 1e-4);
            let shows = |ball: &&(DVec3, f32, Vec3)| ball.0.abs_diff_eq(*centre, 1e-4) && ball.2 == *radiance;
            let ball = near.clone().find(shows).unwrap_or_else(|| panic!("{time} s: none at {centre}"));
            assert!(ball.1 < *radius && ball.1 > 0.95 * radius, "{} {radius}", ball.1);
        }
    }
}

#[test]
fn a_few_lamps_move_and_come_back() {
    for lights in [10, 100, 10_000] {
        let scene = scene(lights);
        let animator = Animator::new(&scene);
        let moving: Vec<usize> = (0..scene.lights.len()).filter(|i| animator.moves_light(*i)).collect();
        assert!(moving.len() >= 3 && moving.len() <= 64 + lights as usize / 20, "{lights}: {}", moving.len());
        // So that few of their places are written in each frame.
        assert_eq!(moving, (0..moving.len()).collect::<Vec<_>>(), "{lights}: those that move come first");
        let place = |time: f64, i: usize| match animator.pose(time).lights[i] {
            Light::Sphere { centre, .. } => centre,
            Light::Spot { position, .. } => position,
            _ => panic!("another kind"),
        };
        let length = animator.duration();
        assert!((length - f64::from(moving::LOOP)).abs() < 1e-6);
        for i in moving.into_iter().step_by(1 + lights as usize / 300) {
            let way =
                (0..16).map(|k| place(f64::from(k) * length / 16.0, i).distance(place(0.0, i))).fold(0.0, f64::max);
            assert!(way > 0.01, "{lights}: lamp {i} moves by {way} m");
            let last = place(length - 1e-4, i).distance(place(0.0, i));
            assert!(last < 2e-3, "{lights}: lamp {i} jumps by {last} m at the end of the loop");
        }
    }
}

#[test]
fn the_same_number_makes_the_same_market() {
    let [a, b] = [scene(700), scene(700)];
    assert_eq!(a.lights, b.lights);
    let places = |scene: &Scene| scene.meshes.iter().flat_map(|mesh| mesh.positions.clone()).collect::<Vec<_>>();
    assert!(places(&a) == places(&b));
}

/// Loose boxes would make rays and culling slow.
#[test]
fn lamps_are_gathered_by_place() {
    let scene = scene(10_000);
    assert!(scene.instances.len() < 2_000, "{} instances", scene.instances.len());
    for mesh in scene.meshes.iter().filter(|mesh| !mesh.spheres.is_empty()) {
        let [min, max] = mesh.bounds().unwrap();
        assert!((max - min).max_element() < 13.0, "{}: {}", mesh.name, max - min);
    }
}

#[test]
fn the_sky_gives_a_hint_of_light() {
    let scene = scene(10);
    let sky = scene.environment.as_ref().unwrap();
    sky.validate().unwrap();
    let brightest = sky.radiance.iter().map(|r| luminance(*r)).fold(0.0, f64::max);
    assert!(brightest > 0.001 && brightest < 0.05 && scene.daylight.is_none());
    let names: Vec<_> = scene.cameras.iter().map(|camera| camera.name.as_str()).collect();
    assert_eq!(names, ["default", "close", "above"]);
}
