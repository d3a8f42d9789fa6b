//! Scenes with closed-form solutions: tests the whole CPU path tracer.
use super::{CpuPathTracer, CpuPathTracerOptions};
use crate::fixtures::{add, camera, plane, scene};
use glam::{Affine3A, DVec3, Quat, Vec3};
use magpie::scene::{AlphaMode, Camera, Environment, Light, Material, Mesh, Scene, Sphere};
use magpie_passes::reference::{Only, PixelSampling};
use std::env;
use std::f64::consts::PI;

/// A purely Lambertian material, with the index of refraction of air.
fn lambertian(albedo: f32) -> Material {
    Material { base_colour: Vec3::splat(albedo).extend(1.0), metalness: 0.0, ior: 1.0, ..Material::default() }
}

fn ball(radius: f32) -> Mesh {
    Mesh { name: "ball".into(), spheres: vec![Sphere { centre: Vec3::ZERO, radius }], ..Mesh::default() }
}

/// A camera with such a narrow view that it sees almost one point.
fn spy(eye: [f64; 3], target: [f64; 3]) -> Camera {
    Camera { vertical_fov: 1e-4, ..camera(eye, target) }
}

fn uniform(radiance: Vec3) -> Environment {
    Environment {
        name: "uniform".into(),
        width: 2,
        height: 1,
        radiance: vec![radiance; 2].into(),
        scale: 1.0,
        turn: 0.0,
    }
}

/// Mean over a few pixels of the same value, and its standard error.
fn measure(scene: &Scene, camera: &Camera, options: CpuPathTracerOptions) -> (DVec3, DVec3) {
    let n = 64.0;
    let samples = if env::var_os("MAGPIE_FULL").is_some() { options.samples * 16 } else { options.samples };
    let pixels = CpuPathTracer::new(scene, 0.0).radiance(camera, 8, 8, CpuPathTracerOptions { samples, ..options });
    let mean = pixels.iter().map(|p| p.0).sum::<DVec3>() / n;
    let error = pixels.iter().map(|p| p.1 * p.1).sum::<DVec3>().map(f64::sqrt) / n;
    (mean, error)
}

/// Asserts a relative error below 0.2 % in every channel, with a standard error that is small enough to tell.
fn assert_is(what: &str, got: (DVec3, DVec3), want: DVec3) {
    println!("{what}: {} ± {}, want {want}", got.0, got.1);
    for c in 0..3 {
        assert!(got.1[c] <= 0.0007 * want[c], "{what}: standard error {} of {want}", got.1);
        assert!((got.0[c] - want[c]).abs() <= 0.002 * want[c], "{what}: {} ± {}, want {want}", got.0, got.1);
    }
}

fn options(samples: u32) -> CpuPathTracerOptions {
    CpuPathTracerOptions { samples, ..CpuPathTracerOptions::default() }
}

#[test]
fn light_in_a_closed_sphere_is_emission_over_one_minus_albedo() {
    let mut room = scene("sphere", camera([0.2, 0.1, 0.0], [0.3, 0.3, -1.0]));
    let emission = Vec3::new(1.0, 2.0, 0.5);
    let colour = Vec3::new(0.6, 0.4, 0.2);
    let material = Material { emission, double_sided: true, base_colour: colour.extend(1.0), ..lambertian(0.0) };
    add(&mut room, ball(1.0), material, Affine3A::from_translation(Vec3::new(0.1, 0.0, 0.2)));
    let albedo = colour.as_dvec3();
    let want = emission.as_dvec3() / (DVec3::ONE - albedo);
    assert_is("closed sphere", measure(&room, &room.cameras[0].clone(), options(4096)), want);
    for depth in [1, 2, 7] {
        // A truncated geometric series.
        let want = emission.as_dvec3() * (DVec3::ONE - albedo.powf(f64::from(depth) + 1.0)) / (DVec3::ONE - albedo);
        let got = measure(&room, &room.cameras[0].clone(), CpuPathTracerOptions { depth, ..options(2048) });
        assert_is(&format!("closed sphere, {depth} scatterings"), got, want);
    }
    // Stretched, the room has no closed form except for the same limit, as all points are alike.
    room.instances[0].world_from_object.matrix3 *= glam::DMat3::from_diagonal(DVec3::new(1.0, 0.7, 1.4));
    assert_is("closed ellipsoid", measure(&room, &room.cameras[0].clone(), options(4096)), want);
}

/// Irradiance at the origin of a horizontal plane from a polygon of radiance 1 (Lambert 1760).
fn by_polygon(corners: &[DVec3]) -> f64 {
    let n = corners.len();
    let edge = |i: usize| {
        let (a, b) = (corners[i].normalize(), corners[(i + 1) % n].normalize());
        a.cross(b).normalize().y * a.dot(b).acos()
    };
    (0.5 * (0..n).map(edge).sum::<f64>()).abs()
}

/// Checks radiance straight up from the origin of a white plane against the expected irradiance.
fn lit(what: &str, lights: Vec<Light>, shapes: Vec<(Mesh, Material, Affine3A)>, irradiance: f64, samples: u32) {
    let mut world = scene("plane", spy([0.0, 3.0, 3.0], [0.0; 3]));
    world.cameras[0].near = 1e-3;
    add(&mut world, plane(50.0), lambertian(0.6), Affine3A::IDENTITY);
    world.lights = lights;
    for (mesh, material, place) in shapes {
        add(&mut world, mesh, material, place);
    }
    let albedo = f64::from(0.6_f32);
    let want = DVec3::new(1.0, 0.5, 0.25) * albedo / PI * irradiance;
    let depth = 1;
    let got = measure(&world, &world.cameras[0].clone(), CpuPathTracerOptions { depth, ..options(samples) });
    assert_is(what, got, want);
    // All of it is direct light.
    let direct = CpuPathTracerOptions { only: Only::Direct, pixel: PixelSampling::Centre, ..options(samples) };
    assert_is(what, measure(&world, &world.cameras[0].clone(), direct), want);
}

const RADIANCE: Vec3 = Vec3::new(1.0, 0.5, 0.25);

#[test]
fn small_lights_light_a_plane_as_they_should() {
    let at = DVec3::new(0.6, 1.2, -0.3);
    let (d2, cosine) = (at.length_squared(), at.normalize().y);
    let point = Light::Point { position: at, intensity: RADIANCE, range: None };
    lit("point", vec![point], vec![], cosine / d2, 64);
    let faded = Light::Point { position: at, intensity: RADIANCE, range: Some(2.0) };
    lit("point with a range", vec![faded], vec![], cosine / d2 * (1.0 - (d2 / 4.0).powi(2)), 64);
    let spot = |inner, outer, direction| {
        vec![Light::Spot { position: DVec3::Y, direction, intensity: RADIANCE, range: None, inner, outer }]
    };
    lit("spot", spot(0.2, 0.4, Vec3::NEG_Y), vec![], 1.0, 64);
    let halfway = ((0.2_f64.cos() + 0.5_f64.cos()) / 2.0).acos() as f32;
    let aside = Quat::from_rotation_z(halfway) * Vec3::NEG_Y;
    lit("spot at its edge", spot(0.2, 0.5, aside), vec![], 0.25, 64);
    let sun = |angular_radius: f32| {
        vec![Light::Directional { direction: Vec3::NEG_Y, illuminance: RADIANCE, angular_radius }]
    };
    lit("sun", sun(0.0), vec![], 1.0, 64);
    // Uniform radiance E / (2 pi (1 - cos r)) over a cone has the irradiance E (1 + cos r) / 2.
    for radius in [0.005, 0.4] {
        lit("sun with a disc", sun(radius), vec![], 0.5 + 0.5 * f64::from(radius).cos(), 3000);
    }
}

#[test]
fn lights_with_a_size_light_a_plane_as_they_should() {
    let rectangle = |centre: DVec3, u: Vec3, v: Vec3| {
        let corner = |s: f64, t: f64| centre + u.as_dvec3() * s + v.as_dvec3() * t;
        let want = by_polygon(&[corner(-1.0, -1.0), corner(1.0, -1.0), corner(1.0, 1.0), corner(-1.0, 1.0)]);
        (Light::Rectangle { centre, half_u: u, half_v: v, radiance: RADIANCE }, want)
    };
    let (high, want) = rectangle(DVec3::new(0.3, 1.0, -0.2), 0.5 * Vec3::X, 0.8 * Vec3::Z);
    lit("rectangle", vec![high], vec![], want, 5000);
    let (skew, want) = rectangle(DVec3::new(-1.0, 0.8, 0.1), Vec3::new(0.1, 0.0, -0.7), Vec3::new(0.2, 0.5, 0.0));
    let Light::Rectangle { half_u, half_v, .. } = skew else { unreachable!() };
    let faces = half_u.cross(half_v).dot(Vec3::new(1.0, -0.8, -0.1)) > 0.0;
    assert!(faces, "a rectangle that faces away lights nothing");
    lit("skew rectangle", vec![skew], vec![], want, 5000);

    let (radius, height) = (0.7, 1.1);
    let disc = |normal| Light::Disc { centre: DVec3::Y * height, normal, radius: radius as f32, radiance: RADIANCE };
    let want = PI * radius * radius / (radius * radius + height * height);
    lit("disc", vec![disc(Vec3::NEG_Y)], vec![], want, 5000);

    let centre = DVec3::new(0.8, 1.5, 0.4);
    let sphere = |radius: f64| Light::Sphere { centre, radius: radius as f32, radiance: RADIANCE };
    let by_sphere = |radius: f64| PI * radius * radius / centre.length_squared() * centre.normalize().y;
    for radius in [0.01, 1.2] {
        lit("sphere", vec![sphere(radius)], vec![], by_sphere(radius), 5000);
    }
    let all = by_sphere(0.9) + want;
    lit("sphere and disc", vec![sphere(0.9), disc(Vec3::NEG_Y)], vec![], all, 5000);
}

#[test]
fn emissive_shapes_light_a_plane_as_they_should() {
    let emits = Material { emission: RADIANCE, base_colour: glam::Vec4::new(0.0, 0.0, 0.0, 1.0), ..lambertian(0.0) };
    // A square that faces down.
    let place = |at: Vec3| Affine3A::from_rotation_translation(Quat::from_rotation_x(std::f32::consts::PI), at);
    let corners = [[-0.5, -0.5], [0.5, -0.5], [0.5, 0.5], [-0.5, 0.5]].map(|[x, z]| DVec3::new(x + 0.4, 1.0, z));
    let want = by_polygon(&corners);
    lit("square", vec![], vec![(plane(0.5), emits.clone(), place(Vec3::new(0.4, 1.0, 0.0)))], want, 5000);
    // The same with an unlit material.
    let unlit = Material { unlit: true, base_colour: RADIANCE.extend(1.0), ..Material::default() };
    lit("unlit square", vec![], vec![(plane(0.5), unlit, place(Vec3::new(0.4, 1.0, 0.0)))], want, 5000);
    // Half of it by blending with an alpha of 0.5, three quarters of it behind a blended sheet with an alpha of 0.25.
    let blended =
        Material { alpha: AlphaMode::Blend, base_colour: glam::Vec4::new(0.0, 0.0, 0.0, 0.5), ..emits.clone() };
    lit("blended square", vec![], vec![(plane(0.5), blended, place(Vec3::new(0.4, 1.0, 0.0)))], 0.5 * want, 5000);
    let sheet =
        Material { alpha: AlphaMode::Blend, base_colour: glam::Vec4::new(0.0, 0.0, 0.0, 0.25), ..lambertian(0.0) };
    let lamp = (plane(0.5), emits.clone(), place(Vec3::new(0.4, 1.0, 0.0)));
    let below = Affine3A::from_translation(Vec3::new(0.2, 0.4, 0.0));
    lit("square behind a sheet", vec![], vec![lamp.clone(), (plane(0.35), sheet, below)], 0.75 * want, 5000);
    // An emissive surface that depicts a light illuminates nothing, and is opaque; the back of a light illuminates nothing.
    let shows = Material { shows_light: true, ..emits.clone() };
    let up = Affine3A::from_translation(Vec3::new(0.0, 1.5, 0.0));
    let dark = vec![(plane(0.2), shows, up), (plane(0.2), emits.clone(), up), lamp];
    lit("one of three squares", vec![], dark, want, 15000);
    let (centre, radius) = (Vec3::new(0.4, 1.3, -0.5), 0.4);
    let want = PI * f64::from(radius * radius) / centre.as_dvec3().length_squared() * centre.as_dvec3().normalize().y;
    lit("ball", vec![], vec![(ball(radius), emits, Affine3A::from_translation(centre))], want, 20_000);
}

#[test]
fn a_convex_thing_under_even_light_shows_its_albedo() {
    let sky = Vec3::new(1.0, 2.0, 0.3);
    let show = |material: Material, target: [f64; 3], samples| {
        let mut world = scene("furnace", spy([0.0, 0.0, 4.0], target));
        add(&mut world, ball(1.0), material, Affine3A::IDENTITY);
        world.environment = Some(uniform(sky));
        measure(&world, &world.cameras[0].clone(), options(samples))
    };
    let sky = sky.as_dvec3();
    assert_is("matte ball", show(lambertian(0.5), [0.0; 3], 8192), sky * 0.5);
    assert_is("matte ball, grazing", show(lambertian(0.5), [0.0, 0.95, 0.0], 8192), sky * 0.5);
    let metal = Material { roughness: 0.0, ..Material::default() };
    assert_is("metal ball", show(metal, [0.3, 0.4, 0.0], 2048), sky);
    // Glass without loss is invisible in a uniform environment.
    let glass = Material { roughness: 0.0, metalness: 0.0, transmission: 1.0, thickness: 1.0, ..Material::default() };
    assert_is("glass ball", show(glass.clone(), [0.3, 0.4, 0.0], 4096), sky);
    let sheet = Material { thickness: 0.0, ..glass.clone() };
    assert_is("bubble", show(sheet, [0.3, 0.4, 0.0], 4096), sky);
    // Straight through the middle: F + (1 - F)² x (1 + F x + ...), where x is the transmittance over the diameter.
    let colour = Vec3::new(0.9, 0.5, 0.2);
    let tinted = Material { attenuation_colour: colour, attenuation_distance: 3.0, ..glass };
    let x = colour.as_dvec3().powf(2.0 / 3.0);
    let want = sky * (DVec3::splat(0.04) + 0.96 * 0.96 * x / (DVec3::ONE - 0.04 * x));
    assert_is("tinted glass ball", show(tinted, [0.0; 3], 8192), want);
}

#[test]
fn openness_and_shadows_are_shares() {
    let mut world = scene("corner", spy([0.0, 3.0, 3.0], [0.0; 3]));
    world.cameras[0].near = 1e-3;
    add(&mut world, plane(50.0), lambertian(0.6), Affine3A::IDENTITY);
    let only =
        |only, samples| CpuPathTracerOptions { only, ao_range: 1e6, pixel: PixelSampling::Centre, ..options(samples) };
    let share = |world: &Scene, options| measure(world, &world.cameras[0].clone(), options);
    assert_is("open", share(&world, only(Only::AmbientOcclusion, 64)), DVec3::ONE);
    // A wall beside the point occludes half of its hemisphere; within half of the range it occludes nothing.
    let turn = Affine3A::from_rotation_translation(
        Quat::from_rotation_z(std::f32::consts::FRAC_PI_2),
        Vec3::new(1e-3, 0.0, 0.0),
    );
    add(&mut world, plane(50.0), lambertian(0.6), turn);
    assert_is("corner", share(&world, only(Only::AmbientOcclusion, 40_000)), DVec3::splat(0.5));
    let near = CpuPathTracerOptions { ao_range: 5e-4, ..only(Only::AmbientOcclusion, 64) };
    assert_is("corner within its range", share(&world, near), DVec3::ONE);
    // A wall occludes half of a light above its edge.
    world.lights =
        vec![Light::Disc { centre: DVec3::new(1e-3, 1.0, 0.0), normal: Vec3::NEG_Y, radius: 0.4, radiance: RADIANCE }];
    let seen = share(&world, only(Only::Shadows, 20_000));
    println!("seen {}", seen.0);
    assert!((seen.0.x - 0.5).abs() < 2e-3, "{}", seen.0);
    world.instances.pop();
    assert_is("without a wall", share(&world, only(Only::Shadows, 64)), DVec3::ONE);
    // For the background there is neither shadow nor occlusion.
    world.cameras[0] = spy([0.0, 3.0, 3.0], [0.0, 9.0, 0.0]);
    assert_is("background", share(&world, only(Only::AmbientOcclusion, 64)), DVec3::ONE);
    assert_eq!(share(&world, only(Only::Shadows, 64)).0, DVec3::ZERO);
}

#[test]
fn the_parts_sum_to_the_whole() {
    let mut world = super::super::scenes::rough_dielectric();
    let mut half = lambertian(0.7);
    (half.alpha, half.base_colour.w) = (AlphaMode::Blend, 0.6);
    (half.clearcoat, half.double_sided, half.emission) = (1.0, true, Vec3::splat(0.1));
    let upright = Quat::from_rotation_x(std::f32::consts::FRAC_PI_2);
    add(&mut world, plane(0.4), half, Affine3A::from_rotation_translation(upright, Vec3::new(0.0, 0.8, 1.0)));
    world.environment = Some(uniform(Vec3::new(0.2, 0.3, 0.5)));
    let cpu = CpuPathTracer::new(&world, 0.0);
    let mean = |only| {
        let options =
            CpuPathTracerOptions { only, pixel: PixelSampling::Centre, samples: 512, seed: only as u64, ..options(0) };
        let pixels = cpu.radiance(&world.cameras[0], 24, 16, options);
        let n = pixels.len() as f64;
        let error = pixels.iter().map(|p| p.1 * p.1).sum::<DVec3>().map(f64::sqrt) / n;
        (pixels.iter().map(|p| p.0).sum::<DVec3>() / n, error)
    };
    let parts = [Only::Direct, Only::Gi, Only::Reflections, Only::Transparency].map(mean);
    let whole = mean(Only::All);
    // The floor or the sheet in front of it fills the view: no pixel shows the sky.
    let sum: DVec3 = parts.iter().map(|p| p.0).sum();
    let error = (parts.iter().map(|p| p.1 * p.1).sum::<DVec3>() + whole.1 * whole.1).map(f64::sqrt);
    println!("{parts:?}\n{whole:?}");
    assert!(parts.iter().all(|p| p.0.min_element() > 0.02 * whole.0.min_element()), "a part is missing: {parts:?}");
    let off = (sum - whole.0).abs();
    assert!((error / whole.0).max_element() < 0.01, "{error}");
    assert!(off.cmple(4.0 * error).all(), "{sum} {} {error}", whole.0);
}

#[test]
fn the_same_seed_gives_the_same_picture() {
    let world = super::super::scenes::many_lights();
    let cpu = CpuPathTracer::new(&world, 0.0);
    let run = |seed| cpu.radiance(&world.cameras[0], 6, 4, CpuPathTracerOptions { seed, ..options(8) });
    assert_eq!(run(1), run(1));
    assert_ne!(run(1), run(2));
}
