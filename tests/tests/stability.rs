//! Extreme scenes: no NaN, no infinity, no validation message, and a plausible picture. Also self-shadowing, at every scale and distance.
use anyhow::{Result, ensure};
use glam::{Affine3A, DAffine3, DVec3, Quat, Vec3};
use magpie::graph::Extent;
use magpie::scene::{
    Camera, FloatingOrigin, Light, Material, Mesh, Moment, ResidentOptions, ResidentScene, Scene, supply_missing,
};
use magpie_tests::bench::{Bench, Ran, Shot};
use magpie_tests::fixtures::{add, camera, material, plane, scene, sphere, sun};
use magpie_tests::harness::{builtin, config, gpu};
use magpie_tests::oracle::gbuffer::{Eye, octahedral};

const EXTENT: Extent = Extent { width: 160, height: 90 };
const LIT: &str = "direct.shade:radiance";
const DISPLAY: &str = "post.tone_map:display";
const DEPTH: &str = "gbuffer.draw:depth";
const NORMAL: &str = "gbuffer.draw:normal";
const GEOMETRIC_NORMAL: &str = "gbuffer.draw:geometric_normal";
const VISIBILITY: &str = "shadows.trace:visibility";

fn run(scene: &Scene, wanted: &[&str]) -> Result<Option<Ran>> {
    run_with(scene, &[], wanted)
}

fn run_with(scene: &Scene, changes: &[&str], wanted: &[&str]) -> Result<Option<Ran>> {
    let Some(gpu) = gpu()? else { return Ok(None) };
    let resident = ResidentScene::new(&gpu, scene, ResidentOptions::default())?.shared();
    let origin = FloatingOrigin::default().follow(&scene.cameras[0]);
    resident.borrow_mut().set_moment(&Moment { origin, cut: true, ..Moment::default() });
    let shot = Shot { scene: &resident, camera: &scene.cameras[0], extent: EXTENT };
    Bench::new(&gpu)?.frame(shot, &config(changes)?, wanted)?.clean().map(Some)
}

/// Share of pixels that show a surface, and of those that are neither black nor clipped in every channel.
struct Picture {
    surface: f64,
    toned: f64,
    radiance: Vec<[f32; 4]>,
}

/// Renders with every check. Radiance must be at least 0 and below `most`.
fn picture(scene: &Scene, most: f32) -> Result<Option<Picture>> {
    let Some(ran) = run(scene, &[LIT, DISPLAY, DEPTH])? else { return Ok(None) };
    let radiance = ran.values(LIT)?;
    for (i, v) in radiance.iter().enumerate() {
        let (x, y) = (i as u32 % EXTENT.width, i as u32 / EXTENT.width);
        ensure!(v[..3].iter().all(|c| (0.0..=most).contains(c)), "{}: ({x}, {y}) shines {v:?}", scene.name);
    }
    let share = |n: usize| n as f64 / radiance.len() as f64;
    let surface = share(ran.values(DEPTH)?.iter().filter(|d| d[0] > 0.0).count());
    let toned = ran.values(DISPLAY)?;
    let toned =
        share(toned.iter().filter(|v| v[..3].iter().any(|c| *c > 0.02) && v[..3].iter().any(|c| *c < 0.99)).count());
    println!("{}: {:.1} % surface, {:.1} % neither black nor clipped", scene.name, 100.0 * surface, 100.0 * toned);
    Ok(Some(Picture { surface, toned, radiance }))
}

fn grey(roughness: f32) -> Material {
    material([0.5; 3], 0.0, roughness)
}

/// A ball of radius 1 on a floor, transformed as a whole.
fn ball_on_floor(name: &str, light: Light, by: DAffine3, distance: f32) -> Scene {
    let (eye, target) = (Vec3::new(0.3, 0.55, 0.78).normalize() * distance + Vec3::Y, Vec3::Y);
    let mut camera = camera(eye, target);
    // The ball covers the same part of the picture at every distance.
    camera.vertical_fov = 2.0 * (2.0 / distance).atan();
    camera.world_from_camera.translation = by.transform_point3(eye.into());
    camera.near *= by.matrix3.x_axis.length() as f32;
    let mut s = scene(name, camera);
    add(&mut s, plane(6.0), grey(0.8), Affine3A::IDENTITY);
    add(&mut s, sphere(48), material([0.7, 0.5, 0.3], 0.0, 0.4), Affine3A::IDENTITY);
    s.instances[0].world_from_object = by;
    s.instances[1].world_from_object = by * DAffine3::from_translation(DVec3::Y);
    s.lights.push(light);
    s
}

fn high_sun() -> Light {
    sun(Vec3::new(0.4, 1.0, 0.3))
}

#[test]
fn a_camera_that_grazes_a_plane() -> Result<()> {
    for height in [1e-2, 1e-4, 0.0] {
        let level = camera(Vec3::new(0.0, height, 3.0), Vec3::new(0.0, height, 0.0));
        let mut s = scene(&format!("plane grazed from {height} m"), Camera { near: 1e-5, ..level });
        add(&mut s, plane(100.0), grey(0.3), Affine3A::IDENTITY);
        s.lights.push(high_sun());
        let Some(seen) = picture(&s, 100.0)? else { return Ok(()) };
        ensure!(height == 0.0 || (0.4..0.55).contains(&seen.surface), "the lower half is floor: {}", seen.surface);
    }
    Ok(())
}

#[test]
fn a_perfect_mirror_that_faces_the_sun() -> Result<()> {
    let mut s = scene("mirror", camera(Vec3::new(0.0, 2.0, 2.0), Vec3::ZERO));
    add(&mut s, plane(3.0), material([1.0; 3], 1.0, 0.0), Affine3A::IDENTITY);
    // The sun's mirror image is in the middle of this pixel.
    let pixel = (EXTENT.height / 2 * EXTENT.width + EXTENT.width / 2) as usize;
    let to_viewer = -Eye::new(&s.cameras[0], EXTENT).pixel_ray(pixel).normalize();
    s.lights.push(sun(DVec3::new(-to_viewer.x, to_viewer.y, -to_viewer.z).as_vec3()));
    // Peak of the lobe: D = 1 / (pi alpha²) with alpha 0.002, V n·l = 1 / (4 n·v), F = 1, illuminance pi.
    let peak = 1.0 / (4e-6 * 4.0 * to_viewer.y);
    let exact = ["direct.precision=32", "gi.precision=32", "reflections.precision=32", "compose.precision=32"];
    let Some(ran) = run_with(&s, &exact, &[LIT])? else { return Ok(()) };
    let brightest = f64::from(ran.values(LIT)?[pixel][0]);
    println!("mirror: {brightest} where the lobe has its peak of {peak}");
    ensure!((brightest / peak - 1.0).abs() < 1e-3, "{brightest} instead of {peak}");
    // The default's 16 bits end below that.
    let Some(seen) = picture(&s, 65504.0)? else { return Ok(()) };
    ensure!(peak > 65504.0 && seen.radiance[pixel][0] == 65504.0, "{} in 16 bits", seen.radiance[pixel][0]);
    Ok(())
}

#[test]
fn triangles_without_area_among_good_ones() -> Result<()> {
    let good = ball_on_floor("good triangles", high_sun(), DAffine3::IDENTITY, 6.0);
    let mut bad = good.clone();
    bad.name = "zero-area triangles among good ones".to_owned();
    for mesh in &mut bad.meshes {
        spoil(mesh);
    }
    let (Some(a), Some(b)) = (picture(&good, 100.0)?, picture(&bad, 100.0)?) else { return Ok(()) };
    let differ = a.radiance.iter().zip(&b.radiance).filter(|(a, b)| a != b).count();
    println!("{differ} pixels change with triangles that have no area");
    ensure!(differ == 0, "{differ} pixels changed");
    Ok(())
}

/// Adds triangles that are degenerate to points and lines.
fn spoil(mesh: &mut Mesh) {
    let last = mesh.positions.len() as u32 - 1;
    mesh.indices.extend([0, 0, 0, 0, last, last, last, 0, last, 1, 1, 0]);
}

#[test]
fn scales_and_places_far_from_one() -> Result<()> {
    let reference = ball_on_floor("scale 1", high_sun(), DAffine3::IDENTITY, 6.0);
    let Some(reference) = picture(&reference, 100.0)? else { return Ok(()) };
    let far = |x: f64| DAffine3::from_translation(DVec3::new(x, 0.0, -0.7 * x));
    let scaled = |s: f64| DAffine3::from_scale(DVec3::splat(s));
    for (name, by, most) in [
        ("scale 1e-3", scaled(1e-3), 0.002),
        ("scale 1e4", scaled(1e4), 0.002),
        ("1e3 m away", far(1e3), 0.002),
        ("1e6 m away", far(1e6), 0.002),
        ("1e9 m away", far(1e9), 0.002),
    ] {
        let Some(seen) = picture(&ball_on_floor(name, high_sun(), by, 6.0), 100.0)? else { return Ok(()) };
        let changed = |(a, b): &(&[f32; 4], &[f32; 4])| (0..3).any(|c| (a[c] - b[c]).abs() > 0.02 + 0.02 * a[c]);
        let differ = reference.radiance.iter().zip(&seen.radiance).filter(changed).count() as f64;
        let share = differ / reference.radiance.len() as f64;
        println!("{name}: {:.3} % of the pixels look otherwise than at scale 1", 100.0 * share);
        ensure!(share <= most, "{name}: {:.2} % of the pixels differ", 100.0 * share);
    }
    Ok(())
}

#[test]
fn lights_inside_and_on_surfaces() -> Result<()> {
    let lamp = |position: Vec3, intensity| Light::Point {
        position: position.into(),
        intensity: Vec3::splat(intensity),
        range: None,
    };
    for (name, light, most) in [
        ("light inside the ball", lamp(Vec3::Y, 10.0), 1e10),
        ("light on the floor", lamp(Vec3::new(1.5, 0.0, 1.0), 10.0), 1e10),
        ("light on the ball", lamp(Vec3::new(0.0, 2.0, 0.0), 10.0), 1e10),
        ("light a millimetre above the floor", lamp(Vec3::new(1.2, 1e-3, 1.2), 10.0), 1e10),
        ("intensity 1e8", lamp(Vec3::new(1.5, 3.0, 2.0), 1e8), 1e14),
    ] {
        let scene = ball_on_floor(name, light, DAffine3::IDENTITY, 6.0);
        let Some(seen) = picture(&scene, most)? else { return Ok(()) };
        let lit = seen.radiance.iter().filter(|v| v[0] > 0.0).count();
        match name {
            "light inside the ball" => ensure!(lit == 0, "{lit} pixels are lit through the ball"),
            "intensity 1e8" => ensure!(lit > EXTENT.width as usize * 30, "{lit} pixels are lit"),
            _ => println!("{name}: {lit} pixels are lit"),
        }
    }
    Ok(())
}

#[test]
fn a_camera_inside_an_object() -> Result<()> {
    let from = |eye: Vec3| Camera { near: 1e-3, ..camera(eye, eye + Vec3::new(0.3, -0.2, -1.0)) };
    // Single sided: its inside is invisible. Double sided: it is visible, and the sun does not get in.
    for double_sided in [false, true] {
        let mut s = scene(&format!("inside a ball, double sided: {double_sided}"), from(Vec3::new(0.1, 1.0, 0.0)));
        add(&mut s, sphere(32), Material { double_sided, ..grey(0.5) }, Affine3A::from_translation(Vec3::Y));
        s.lights.push(high_sun());
        let Some(seen) = picture(&s, 100.0)? else { return Ok(()) };
        ensure!(seen.surface == f64::from(u8::from(double_sided)), "{}", seen.surface);
        ensure!(seen.radiance.iter().all(|v| v[0] == 0.0), "the sun shines into the ball");
    }
    let mut s = builtin("courtyard")?;
    s.cameras = vec![from(Vec3::new(0.0, -0.001, 0.0))];
    picture(&s, 1e5)?;
    Ok(())
}

#[test]
fn an_empty_view_and_a_needle() -> Result<()> {
    let mut away = builtin("courtyard")?;
    away.name = "courtyard, looking at the sky".to_owned();
    away.cameras = vec![camera(Vec3::new(0.0, 30.0, 0.0), Vec3::new(0.1, 60.0, 0.2))];
    if let Some(seen) = picture(&away, 1.0)? {
        ensure!(seen.surface == 0.0 && seen.toned > 0.9, "{} surface, {} toned", seen.surface, seen.toned);
    }
    let mut needle = scene("needle", camera(Vec3::new(0.0, 0.4, 3.0), Vec3::ZERO));
    needle.cameras.clear();
    let turned =
        Affine3A::from_scale_rotation_translation(Vec3::new(1e-4, 5.0, 1.0), Quat::from_rotation_z(0.5), Vec3::ZERO);
    add(&mut needle, sphere(16), grey(0.4), turned);
    supply_missing(&mut needle);
    picture(&needle, 1e5)?;
    Ok(())
}

/// Number of pixels that the light must reach, those of them that are in shadow, pixels deep in the ball's shadow, and those of them that
/// are lit.
///
/// A floor without anything above it and a convex ball: whatever faces the light is lit, except the ball's shadow on the floor. Excluded
/// are pixels within 2 degrees of the terminator, where a facet of the ball may rightly occlude its neighbour, and within 2 % of the
/// shadow's edge (10 % on its inner side).
fn falsely_dark(scene: &Scene, by: DAffine3, to_sun: DVec3) -> Result<Option<[usize; 4]>> {
    let Some(ran) = run(scene, &[DEPTH, NORMAL, GEOMETRIC_NORMAL, VISIBILITY])? else { return Ok(None) };
    let (depth, visible) = (ran.values(DEPTH)?, ran.values(VISIBILITY)?);
    let (normal, geometric) = (ran.values(NORMAL)?, ran.values(GEOMETRIC_NORMAL)?);
    let eye = Eye::new(&scene.cameras[0], EXTENT);
    let back = by.inverse();
    let (mut wanted, mut dark, mut hidden, mut lit) = (0, 0, 0, 0);
    for i in (0..depth.len()).filter(|i| depth[*i][0] > 0.0) {
        let world = eye.world_position(i, depth[i][0]);
        let p = back.transform_point3(world);
        let normals = [octahedral(normal[i][0], normal[i][1]), octahedral(geometric[i][0], geometric[i][1])];
        if normals.iter().any(|n| n.dot(to_sun) < 0.035) {
            continue;
        }
        // Distance of the ball's centre from the line to the sun; the ball itself is convex.
        let aside = (DVec3::Y - p).cross(to_sun).length();
        if p.y < 0.02 && normals[1].y > 0.999 && aside < 1.02 && (DVec3::Y - p).dot(to_sun) > 0.0 {
            if aside < 0.9 {
                hidden += 1;
                lit += usize::from(visible[i][0] > 0.0);
            }
            continue;
        }
        wanted += 1;
        dark += usize::from(visible[i][0] == 0.0);
    }
    Ok(Some([wanted, dark, hidden, lit]))
}

/// Share of falsely dark pixels among those that should be lit, and of falsely lit ones among those in shadow.
fn false_shadows(name: &str, elevation: f32, distance: f32, by: DAffine3) -> Result<Option<[f64; 2]>> {
    let (up, along) = elevation.to_radians().sin_cos();
    let to_sun = Vec3::new(0.6 * along, up, 0.8 * along).normalize();
    let scene = ball_on_floor(name, sun(to_sun), by, distance);
    let Some([wanted, dark, hidden, lit]) = falsely_dark(&scene, by, to_sun.as_dvec3())? else { return Ok(None) };
    println!("{name}: {dark} of {wanted} pixels are falsely dark, {lit} of {hidden} falsely lit");
    ensure!(wanted > 3000, "{name}: only {wanted} pixels should be lit");
    Ok(Some([dark as f64 / wanted as f64, lit as f64 / hidden.max(1) as f64]))
}

#[test]
fn nothing_shadows_itself() -> Result<()> {
    for elevation in [3.0_f32, 15.0, 60.0, 89.0] {
        for distance in [6.0_f32, 1e3] {
            for scale in [1e-2, 1.0, 1e3] {
                let name = format!("sun at {elevation} degrees, {distance} radii away, scale {scale}");
                let by = DAffine3::from_scale(DVec3::splat(scale));
                let Some([dark, lit]) = false_shadows(&name, elevation, distance, by)? else { return Ok(()) };
                ensure!(dark == 0.0, "{name}: {dark:.2e} of the pixels shadow themselves");
                ensure!(lit == 0.0, "{name}: {lit:.2e} of the shadow is lit");
            }
        }
    }
    Ok(())
}

#[test]
fn nothing_shadows_itself_far_from_the_origin() -> Result<()> {
    for place in [1e2, 1e3, 1e4, 1e6, 1e9] {
        for elevation in [10.0_f32, 60.0] {
            let name = format!("sun at {elevation} degrees, {place} m from the origin");
            let by = DAffine3::from_translation(DVec3::new(1.0, 0.9, -0.7) * place);
            let Some([dark, lit]) = false_shadows(&name, elevation, 6.0, by)? else { return Ok(()) };
            ensure!(dark == 0.0, "{name}: {dark:.2e} of the pixels shadow themselves");
            ensure!(lit == 0.0, "{name}: {lit:.2e} of the shadow is lit");
        }
    }
    Ok(())
}
