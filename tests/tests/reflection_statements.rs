//! What reflections of all implementations promise: what they show and what not, how deep mirrors nest, and what they cost.
use anyhow::{Context, Result, ensure};
use glam::{Affine3A, DAffine3, DQuat, DVec3, Quat, Vec3};
use magpie::gpu::Gpu;
use magpie::scene::{
    AlphaMode, Animation, Camera, Channel, Environment, Interpolation, Local, Material, Node, Property, Scene,
};
use magpie_passes::reference::{Only, ReferenceOptions};
use magpie_passes::{FrameRequest, FrameResult, RenderOptions, Renderer, Slots};
use magpie_tests::against::{Shown, bias, mean_of, mean_with, truth_of};
use magpie_tests::fixtures::{add, block, camera, environment, material, plane, scene, sphere, sun};
use magpie_tests::harness::{config, gpu};
use std::f32::consts::FRAC_PI_2;

const IMPLEMENTATIONS: [&str; 4] = [
    "stages.reflections=sky",
    "stages.reflections=probe",
    "stages.reflections=screen-space",
    "stages.reflections=ray-traced",
];
const RAYS: &str = IMPLEMENTATIONS[3];
/// Rays as they are.
const RAW: [&str; 6] = [
    RAYS,
    "reflections.denoiser=none",
    "reflections.reuse=false",
    "reflections.precision=32",
    "gbuffer.precision=full",
    "stages.gi=off",
];

/// Stands a plane up at `z`, its front towards +z or -z.
fn upright(z: f32, towards: f32) -> Affine3A {
    Affine3A::from_rotation_translation(Quat::from_rotation_x(towards * FRAC_PI_2), Vec3::new(0.0, 0.0, z))
}

fn at(place: Vec3, size: f32) -> Affine3A {
    Affine3A::from_scale_rotation_translation(Vec3::splat(size), Quat::IDENTITY, place)
}

fn unlit(colour: [f32; 3]) -> Material {
    Material { unlit: true, double_sided: true, ..material(colour, 0.0, 1.0) }
}

fn mirror() -> Material {
    material([0.98; 3], 1.0, 0.0)
}

/// An environment that is the same in all directions.
fn even(radiance: f32) -> Environment {
    let radiance = vec![Vec3::splat(radiance); 32];
    Environment { name: "even".to_owned(), width: 8, height: 4, radiance: radiance.into(), scale: 1.0, turn: 0.0 }
}

/// Frames at these times: of each the image of the slot, and what the frame was.
fn frames(gpu: &Gpu, scene: &Scene, changes: &[&str], size: [u32; 2], times: &[f64]) -> Result<Vec<Frame>> {
    let options = RenderOptions { width: size[0], height: size[1], check: true, ..RenderOptions::default() };
    let mut renderer = Renderer::new(gpu, scene, &Slots::default(), &config(changes)?, options)?;
    renderer.read_slots(&["reflections"])?;
    times.iter().map(|time| Frame::next(&mut renderer, &scene.cameras[0], *time)).collect()
}

struct Frame {
    image: Vec<DVec3>,
    result: FrameResult,
}

impl Frame {
    fn next(renderer: &mut Renderer, camera: &Camera, time: f64) -> Result<Self> {
        let result = renderer.frame(FrameRequest { camera, time, view: None, read_back: true })?.context("no frame")?;
        ensure!(result.findings.is_empty(), "{}", result.findings[0]);
        let image = result.slots[0].1.as_ref();
        let colour = |v: [f32; 4]| Vec3::from_slice(&v[..3]).as_dvec3();
        let image = image.map_or_else(Vec::new, |i| i.values().into_iter().map(colour).collect());
        Ok(Self { image, result })
    }

    /// Closest-hit and any-hit rays of the slot.
    fn rays(&self) -> [u64; 2] {
        let own = || self.result.sample.passes.iter().filter(|p| p.name.starts_with("reflections."));
        [own().map(|p| p.rays_closest).sum(), own().map(|p| p.rays_any).sum()]
    }

    /// Names of the slot's passes.
    fn passes(&self) -> Vec<&str> {
        let names = self.result.sample.passes.iter().map(|p| p.name.as_str());
        names.filter(|name| name.starts_with("reflections.")).collect()
    }
}

/// A board behind the camera is in the mirror before it by rays and probes. The sky knows no boards, and the screen none that it does not show.
#[test]
fn who_sees_what_the_camera_does_not() -> Result<()> {
    let Some(gpu) = gpu()? else { return Ok(()) };
    let mut s = scene("behind", camera([0.0, 0.0, 2.0], [0.0, 0.0, 0.0]));
    add(&mut s, plane(3.0), mirror(), upright(0.0, 1.0));
    add(&mut s, plane(3.0), unlit([0.8, 0.05, 0.05]), upright(4.0, -1.0));
    s.environment = Some(even(0.3));
    for (implementation, sees) in IMPLEMENTATIONS.into_iter().zip([false, true, false, true]) {
        let image = &frames(&gpu, &s, &[implementation, "stages.gi=off"], [16, 16], &[0.0; 4])?[3].image;
        let middle = image[8 * 16 + 8];
        println!("{implementation}: {middle:.3}");
        ensure!((middle.x > 4.0 * middle.y) == sees && middle.x > 0.2, "{implementation}: {middle}");
    }
    Ok(())
}

/// A red ball between two mirrors, seen past it into the one on the right.
fn corridor() -> Scene {
    let mut eye = camera([-0.3, 0.0, 4.0], [3.7, 0.0, 0.0]);
    eye.vertical_fov = 8_f32.to_radians();
    let mut s = scene("corridor", eye);
    for side in [-0.6, 0.6] {
        let place = Affine3A::from_translation(Vec3::new(side, 0.0, 0.0));
        add(&mut s, block(Vec3::new(0.05, 3.0, 20.0)), mirror(), place);
    }
    add(&mut s, sphere(24), material([0.9, 0.05, 0.05], 0.0, 1.0), at(Vec3::ZERO, 0.15));
    s.lights.push(sun(Vec3::new(0.0, 1.0, 0.5)));
    s.light_nodes.resize(1, None);
    s
}

/// Each bounce that is allowed shows one more image of the ball, from one bounce to eight, and paths end there: one ray more than bounces, for
/// lights and sky, and a shadow ray for each bounce.
#[test]
fn mirrors_nest_as_often_as_bounces_say() -> Result<()> {
    let Some(gpu) = gpu()? else { return Ok(()) };
    let size = [400, 24];
    for bounces in 1..=8_u32 {
        let limit = format!("reflections.bounces={bounces}");
        let changes = [&RAW[..], &["reflections.rays=8", limit.as_str()]].concat();
        let frame = &frames(&gpu, &corridor(), &changes, size, &[0.0])?[0];
        // Columns in which something red is seen.
        let red = |x: u32| (0..size[1]).any(|y| frame.image[(y * size[0] + x) as usize].x > 0.15);
        let images = (1..size[0]).filter(|x| red(*x) && !red(x - 1)).count();
        let paths = u64::from(8 * size[0] * size[1]);
        let [closest, any] = frame.rays();
        println!("{bounces} bounces: {images} images, {closest} and {any} rays for {paths} paths");
        ensure!(images == bounces as usize, "{bounces} bounces show {images} images");
        let most = u64::from(bounces) * paths;
        ensure!(closest <= most + paths && any <= most, "{bounces} bounces: {closest} and {any} rays");
    }
    Ok(())
}

/// A lamp that shines between mirrors, and the light of the frame before in every frame: after a thousand frames it is what it was after 100, and
/// nothing is brighter than the lamp.
#[test]
fn mirrors_stay_bounded_for_a_thousand_frames() -> Result<()> {
    let Some(gpu) = gpu()? else { return Ok(()) };
    let mut s = corridor();
    s.cameras = vec![camera([0.0, 0.0, 2.0], [0.0, 0.0, 0.0])];
    s.materials[2] = unlit([1.0, 0.7, 0.2]);
    s.instances[2].world_from_object = DAffine3::from_scale(DVec3::splat(0.35));
    // Glossy, so that light of the previous frame is used by rays too.
    s.materials[1] = material([0.98; 3], 1.0, 0.55);
    for implementation in &IMPLEMENTATIONS[1..] {
        let changes = [implementation, "stages.gi=off", "post.anti_aliasing=taa"];
        let options = RenderOptions { width: 32, height: 24, ..RenderOptions::default() };
        let mut renderer = Renderer::new(&gpu, &s, &Slots::default(), &config(&changes)?, options)?;
        renderer.read_slots(&["reflections"])?;
        let (mut light, mut most) = (Vec::new(), 0.0_f64);
        for frame in 0..1000 {
            let read_back = frame % 5 == 4;
            let request = FrameRequest { camera: &s.cameras[0], time: 0.0, view: None, read_back };
            let result = renderer.frame(request)?.context("no frame")?;
            let not_finite: u64 = result.sample.passes.iter().map(|p| p.not_finite).sum();
            ensure!(not_finite == 0, "{implementation}, frame {frame}: {not_finite} values are not finite");
            if !read_back {
                continue;
            }
            let image = result.slots[0].1.as_ref().context("no reflections")?.values();
            ensure!(image.iter().flatten().all(|v| v.is_finite()), "{implementation}, frame {frame}");
            let of = |v: &[f32; 4]| f64::from(v[0] + v[1] + v[2]);
            light.push(image.iter().map(of).sum::<f64>());
            most = image.iter().map(|v| f64::from(v[0])).fold(most, f64::max);
        }
        let mean = |from: usize, to: usize| light[from..to].iter().sum::<f64>() / (to - from) as f64;
        let (early, late) = (mean(20, 60), mean(160, 200));
        println!(
            "{implementation}: light of frames 100 to 300 {early:.3}, of 800 to 1000 {late:.3}, at most {most:.3}"
        );
        ensure!(early > 1.0 && (late / early - 1.0).abs() < 0.03, "{implementation}: {early}, then {late}");
        // A single ray counts more than the mean of its lobe, by a third at most here.
        ensure!(most < 1.5, "{implementation}: {most} of a lamp of 1");
    }
    Ok(())
}

/// `hit_distance` is that of what the mirror shows: a wall at a known distance, and the greatest number for the sky beside it.
#[test]
fn hit_distances_are_distances() -> Result<()> {
    let Some(gpu) = gpu()? else { return Ok(()) };
    const EYE: [f64; 3] = [0.0, 0.8, 2.0];
    let mut s = scene("distance", camera(EYE, [0.0, 0.3, -1.0]));
    add(&mut s, plane(6.0), mirror(), Affine3A::IDENTITY);
    add(&mut s, plane(2.0), unlit([0.5; 3]), upright(-2.0, 1.0));
    s.environment = Some(even(0.1));
    let size = [48, 32];
    for (implementation, pass) in [(RAYS, "reflections.trace"), (IMPLEMENTATIONS[2], "reflections.march")] {
        let options = RenderOptions { width: size[0], height: size[1], check: true, ..RenderOptions::default() };
        let changes = [implementation, "stages.gi=off", "reflections.denoiser=none", "gbuffer.precision=full"];
        let mut renderer = Renderer::new(&gpu, &s, &Slots::default(), &config(&changes)?, options)?;
        let view = Some((pass, "hit_distance"));
        let request = FrameRequest { camera: &s.cameras[0], time: 0.0, view, read_back: true };
        renderer.frame(request)?;
        let image = renderer.frame(request)?.and_then(|f| f.images).context("no image")?.linear.values();
        let (mut met, mut off) = (0, 0);
        for (k, value) in (0..).zip(&image) {
            let eye = &s.cameras[0];
            let half = f64::from(eye.vertical_fov / 2.0).tan();
            let [x, y] = [k % size[0], k / size[0]].map(|v| f64::from(v) + 0.5);
            let [w, h] = size.map(f64::from);
            let seen = DVec3::new((2.0 * x / w - 1.0) * half * w / h, (1.0 - 2.0 * y / h) * half, -1.0);
            let d = eye.world_from_camera.transform_vector3(seen).normalize();
            if d.y >= -0.01 {
                continue;
            }
            // Where the floor is met, and what is above it in the mirror direction.
            let floor = DVec3::from(EYE) + d * (EYE[1] / -d.y);
            let t = (floor.z + 2.0) / -d.z;
            let place = floor + DVec3::new(d.x, -d.y, d.z) * t;
            let inside = floor.z > -1.9 && place.x.abs() < 1.9 && place.y < 1.9;
            let found = f64::from(value[0]);
            // Found on the screen, what is not in the picture is the sky.
            if inside && (pass == "reflections.trace" || found < 60000.0) {
                met += 1;
                off += usize::from((found / t - 1.0).abs() > 0.02);
            }
        }
        // The lobe of the smoothest surface has a width: a few rays in a thousand go elsewhere.
        println!("{pass}: {met} pixels, {off} of them more than 2 % off");
        ensure!(met > 150 && off * 50 < met, "{pass}: {met} pixels, {off} off");
    }
    Ok(())
}

/// A room that shines evenly, under a sky of the same radiance: wherever a reflection comes from, it is that radiance times the albedo of the
/// lobe, once.
#[test]
fn the_albedo_counts_once() -> Result<()> {
    let Some(gpu) = gpu()? else { return Ok(()) };
    let room = |roughness: f32| {
        let mut s = scene("room", camera([0.0, 1.2, 2.4], [0.0, 0.3, 0.0]));
        add(&mut s, plane(1.5), material([0.9, 0.6, 0.3], 1.0, roughness), Affine3A::IDENTITY);
        let walls = Affine3A::from_translation(Vec3::new(0.0, 2.0, 0.0));
        add(&mut s, block(Vec3::new(3.0, 2.5, 3.0)), unlit([1.0; 3]), walls);
        s.environment = Some(even(1.0));
        s
    };
    let shown = Shown { size: [32, 24], time: 0.0 };
    for roughness in [0.0, 0.4] {
        let s = room(roughness);
        let options = ReferenceOptions { only: Only::Reflections, ..ReferenceOptions::default() };
        let truth = truth_of(options, &gpu, &s, shown, 256)?.mean;
        let of = |image: &[DVec3]| image.iter().sum::<DVec3>() / image.len() as f64;
        for implementation in IMPLEMENTATIONS {
            let exact = ["reflections.precision=32", "gbuffer.precision=full"];
            let changes = [&[implementation, "stages.gi=off", "stages.ao=off"], &exact[..]].concat();
            let (found, _) = mean_of("reflections", &gpu, &s, &changes, shown, 24)?;
            let share = of(&found) / of(&truth);
            println!("roughness {roughness}, {implementation}: {share:.4} of the truth");
            // Probes blur what they captured of the floor itself into its lobes. Counted twice it would be 0.9, 0.6 and 0.3 of the truth.
            let most = if roughness > 0.0 { 0.03 } else { 0.01 };
            ensure!((share - DVec3::ONE).abs().max_element() < most, "{roughness}, {implementation}: {share}");
        }
    }
    Ok(())
}

/// What unlit surfaces show in a mirror is a reflection, in the frame and in the reference, and no direct light in either.
#[test]
fn unlit_things_are_reflections() -> Result<()> {
    let Some(gpu) = gpu()? else { return Ok(()) };
    let mut s = scene("unlit", camera([0.0, 0.6, 2.0], [0.0, 0.3, 0.0]));
    add(&mut s, plane(3.0), material([0.5; 3], 0.0, 0.3), Affine3A::IDENTITY);
    add(&mut s, plane(1.0), unlit([0.2, 0.9, 0.4]), upright(-1.0, 1.0));
    let shown = Shown { size: [32, 24], time: 0.0 };
    // The lower quarter of the picture is floor.
    let floor = |image: &[DVec3]| image[image.len() / 4 * 3..].iter().sum::<DVec3>() / (image.len() / 4) as f64;
    let truth = |only| -> Result<DVec3> {
        let options = ReferenceOptions { only, ..ReferenceOptions::default() };
        Ok(floor(&truth_of(options, &gpu, &s, shown, 512)?.mean))
    };
    let found = floor(&mean_of("reflections", &gpu, &s, &RAW, shown, 256)?.0);
    let (wanted, direct) = (truth(Only::Reflections)?, truth(Only::Direct)?);
    println!("reflected {found:.5}, in the reference {wanted:.5}, direct {direct:.5}");
    ensure!(direct == DVec3::ZERO && wanted.y > 0.005, "direct {direct}, reflected {wanted}");
    ensure!((found / wanted - DVec3::ONE).abs().max_element() < 0.03, "{found} instead of {wanted}");
    Ok(())
}

/// A lamp that lights the scene has one highlight by rays too: it is in direct light, and what is left in reflections is what the lamp itself
/// reflects.
#[test]
fn a_lamp_has_one_highlight_by_rays() -> Result<()> {
    let Some(gpu) = gpu()? else { return Ok(()) };
    let mut s = scene("lamp", camera([0.0, 1.0, 3.0], [0.0, 0.3, 0.0]));
    add(&mut s, plane(3.0), material([0.9; 3], 1.0, 0.15), Affine3A::IDENTITY);
    let lamp = Material { emission: Vec3::splat(40.0), ..material([0.5; 3], 0.0, 1.0) };
    add(&mut s, sphere(16), lamp, at(Vec3::new(0.0, 0.7, 0.0), 0.3));
    let shown = Shown { size: [32, 24], time: 0.0 };
    let light = |image: &[DVec3]| image.iter().map(|v| v.element_sum()).sum::<f64>();
    let changes = [&RAW[..], &["direct.denoiser=none", "direct.emitter_rays=4", "reflections.bounces=3"]].concat();
    // Of direct light without the lamp itself.
    let floor = |image: Vec<DVec3>| -> Vec<DVec3> {
        image.into_iter().map(|v| if v.x > 35.0 { DVec3::ZERO } else { v }).collect()
    };
    let direct = light(&floor(mean_of("direct", &gpu, &s, &changes, shown, 32)?.0));
    let changes = [&changes[..], &["reflections.rays=8"]].concat();
    let (mut found, mut truth) = (Vec::new(), Vec::new());
    for seed in 1..=3 {
        let options = RenderOptions { seed, ..RenderOptions::default() };
        found.push(mean_with(options, "reflections", &gpu, &s, &changes, shown, 32)?.0);
        let options = ReferenceOptions { only: Only::Reflections, depth: 4, seed, ..ReferenceOptions::default() };
        truth.push(truth_of(options, &gpu, &s, shown, 256)?.mean);
    }
    let (reflected, bias) = (light(&found[0]), bias(&found, &truth));
    println!("direct {direct:.1}, reflected {reflected:.3}, {bias:?}");
    ensure!(direct > 500.0 && reflected < 0.05 * direct, "direct {direct}, reflected {reflected}");
    ensure!((bias.light - 1.0).abs() < 0.05, "reflected {bias:?}");
    Ok(())
}

/// Blended surfaces that cover less than half are not in the G-buffer. A veil before a mirror changes nothing of what is found on the screen, in
/// any frame while it moves; rays and the reference see it in the mirror alike.
#[test]
fn veils_do_not_disturb_histories() -> Result<()> {
    let Some(gpu) = gpu()? else { return Ok(()) };
    let base = || {
        let mut s = scene("veil", camera([0.0, 0.8, 2.4], [0.0, 0.3, 0.0]));
        add(&mut s, plane(3.0), material([0.9; 3], 1.0, 0.1), Affine3A::IDENTITY);
        add(&mut s, plane(1.5), material([0.8, 0.4, 0.1], 0.0, 1.0), upright(-1.0, 1.0));
        s.lights.push(sun(Vec3::new(0.2, 1.0, 0.8)));
        s.light_nodes.resize(1, None);
        s.environment = Some(environment());
        s
    };
    let mut veiled = base();
    let mut veil = unlit([0.1, 0.9, 0.2]);
    (veil.base_colour.w, veil.alpha) = (0.3, AlphaMode::Blend);
    add(&mut veiled, plane(0.8), veil, upright(0.0, 1.0));
    moves(&mut veiled, 2, [Vec3::new(-0.8, 0.5, 0.0), Vec3::new(0.8, 0.5, 0.0)], Interpolation::Linear);
    let times: Vec<f64> = (0..8).map(|k| f64::from(k) * 0.1).collect();
    let screen = [IMPLEMENTATIONS[2], "stages.gi=off", "stages.shadows=off"];
    let (plain, found) =
        (frames(&gpu, &base(), &screen, [48, 32], &times)?, frames(&gpu, &veiled, &screen, [48, 32], &times)?);
    let apart = plain.iter().zip(&found).position(|(a, b)| a.image != b.image);
    ensure!(apart.is_none(), "frame {apart:?} differs");
    ensure!(plain[0].image != plain[1].image, "nothing is found on the screen");

    let shown = Shown { size: [32, 24], time: 0.5 };
    // Two bounces, as rays have by default.
    let options = ReferenceOptions { only: Only::Reflections, depth: 3, ..ReferenceOptions::default() };
    let sum = |image: Vec<DVec3>| image.into_iter().sum::<DVec3>();
    // The sun on the wall by way of the floor is nearly all noise.
    let dim = |scene: Scene| Scene { lights: vec![], light_nodes: vec![], ..scene };
    let wanted = sum(truth_of(options, &gpu, &dim(veiled.clone()), shown, 512)?.mean);
    let traced = sum(mean_of("reflections", &gpu, &dim(veiled), &RAW, shown, 192)?.0);
    let without = sum(mean_of("reflections", &gpu, &dim(base()), &RAW, shown, 192)?.0);
    println!("reflected {traced:.2}, in the reference {wanted:.2}, without the veil {without:.2}");
    ensure!((traced / wanted - DVec3::ONE).abs().max_element() < 0.02, "{traced} instead of {wanted}");
    ensure!(traced.y > 1.02 * without.y, "the veil is not seen: {traced}, {without} without it");
    Ok(())
}

/// Lets an instance go from one place to another within the first second.
fn moves(scene: &mut Scene, instance: usize, places: [Vec3; 2], interpolation: Interpolation) {
    let node = scene.nodes.len() as u32;
    let (_, rotation, _) = scene.instances[instance].world_from_object.to_scale_rotation_translation();
    let local = Local::Trs { translation: places[0].as_dvec3(), rotation, scale: DVec3::ONE };
    scene.nodes.push(Node { name: "moves".to_owned(), local, ..Node::default() });
    scene.instances[instance].node = Some(node);
    scene.animations.push(Animation {
        name: "moves".to_owned(),
        duration: 9.0,
        channels: vec![Channel {
            node,
            property: Property::Translation,
            interpolation,
            times: vec![0.0, 1.0, 9.0],
            values: [places[0], places[1], places[1]].iter().flat_map(|p| p.to_array()).collect(),
        }],
    });
}

/// A mirror that comes into the scene while frames go on shows from its first frame on what it shows where it always was: nothing is baked.
#[test]
fn a_mirror_that_appears_reflects_at_once() -> Result<()> {
    let Some(gpu) = gpu()? else { return Ok(()) };
    let mut s = scene("appears", camera([0.0, 0.8, 2.4], [0.0, 0.3, 0.0]));
    add(&mut s, plane(1.2), mirror(), Affine3A::IDENTITY);
    add(&mut s, plane(1.5), unlit([0.8, 0.4, 0.1]), upright(-1.3, 1.0));
    add(&mut s, block(Vec3::splat(0.3)), unlit([0.1, 0.4, 0.8]), Affine3A::from_translation(Vec3::new(0.4, 0.3, -0.5)));
    s.environment = Some(environment());
    // Below the picture until it appears.
    moves(&mut s, 0, [Vec3::new(0.0, -40.0, 0.0), Vec3::ZERO], Interpolation::Step);
    let mut there = s.clone();
    there.animations.clear();
    there.nodes.last_mut().context("a node")?.local =
        Local::Trs { translation: DVec3::ZERO, rotation: DQuat::IDENTITY, scale: DVec3::ONE };
    let error = |a: &[DVec3], b: &[DVec3]| {
        let apart: f64 = a.iter().zip(b).map(|(a, b)| a.distance_squared(*b)).sum();
        (apart / b.iter().map(|v| v.length_squared()).sum::<f64>()).sqrt()
    };
    for implementation in IMPLEMENTATIONS {
        let changes = [implementation, "stages.gi=off", "stages.ao=off", "reflections.denoiser=none"];
        let has_denoiser = implementation == RAYS || implementation.ends_with("space");
        let changes = &changes[..if has_denoiser { 4 } else { 3 }];
        let times: Vec<f64> = [0.5; 6].into_iter().chain([2.0; 4]).collect();
        let appeared = frames(&gpu, &s, changes, [48, 32], &times)?;
        let settled = frames(&gpu, &there, changes, [48, 32], &[2.0; 10])?;
        let errors: Vec<f64> =
            appeared[6..].iter().zip(&settled[6..]).map(|(a, b)| error(&a.image, &b.image)).collect();
        let before = error(&appeared[5].image, &settled[5].image);
        println!("{implementation}: error before {before:.3}, in the first frames {errors:.4?}");
        ensure!(before > 0.5, "{implementation}: the mirror is seen before it is there");
        ensure!(errors.iter().all(|e| *e < 0.01), "{implementation}: {errors:?}");
    }
    Ok(())
}

/// Rays that meet nothing find the sky: a mirror under an environment alone is what `sky` shows, which looks it up in the mirror direction.
#[test]
fn rays_that_meet_nothing_find_the_sky() -> Result<()> {
    let Some(gpu) = gpu()? else { return Ok(()) };
    let mut s = scene("sky", camera([0.0, 0.8, 2.4], [0.0, 0.0, 0.0]));
    add(&mut s, plane(3.0), mirror(), Affine3A::IDENTITY);
    s.environment = Some(even(0.7));
    let shown = Shown { size: [32, 24], time: 0.0 };
    let exact = ["stages.gi=off", "stages.ao=off", "reflections.precision=32", "gbuffer.precision=full"];
    let of = |changes: &[&str]| mean_of("reflections", &gpu, &s, &[changes, &exact].concat(), shown, 16);
    let (sky, _) = of(&IMPLEMENTATIONS[..1])?;
    let (rays, _) = of(&[RAYS, "reflections.denoiser=none"])?;
    let seen: Vec<_> = sky.iter().zip(&rays).filter(|(s, _)| s.x > 0.0).collect();
    // One ray in thousands goes below the surface.
    let off = seen.iter().filter(|(s, r)| (r.x / s.x - 1.0).abs() > 5e-3).count();
    println!("{off} of {} pixels are more than 0.5 % apart", seen.len());
    ensure!(off * 100 <= seen.len() && seen.len() > 300, "{off} of {}", seen.len());
    Ok(())
}

/// A floor of two halves, seen from above, with these roughnesses.
fn halves(left: Material, right: Material) -> Scene {
    let mut s = scene("halves", camera([0.0, 6.0, 0.01], [0.0, 0.0, 0.0]));
    for (x, material) in [(-20.0, left), (20.0, right)] {
        add(&mut s, plane(20.0), material, Affine3A::from_translation(Vec3::new(x, 0.0, 0.0)));
    }
    s.environment = Some(environment());
    s
}

/// Surfaces without a reflection, or rougher than the limit, have no ray; half a picture of them costs half, at every number of rays. Without any
/// others there is no ray pass at all, and what is left is the sky's.
#[test]
fn what_no_surface_calls_for_costs_nothing() -> Result<()> {
    let Some(gpu) = gpu()? else { return Ok(()) };
    let metal = |roughness| material([0.8; 3], 1.0, roughness);
    let dull = Material { specular: 0.0, ..material([0.8; 3], 0.0, 0.1) };
    let size = [48, 32];
    let limit = "reflections.roughness_limit=0.5";
    for cells in [1, 2, 4] {
        let sparse = format!("reflections.pixels_per_ray={cells}");
        let rays = |scene: &Scene, limit: &[&str]| -> Result<u64> {
            let changes = [&RAW[..], &["reflections.bounces=1", sparse.as_str()], limit].concat();
            Ok(frames(&gpu, scene, &changes, size, &[0.0])?[0].rays()[0])
        };
        let all = rays(&halves(metal(0.0), metal(0.0)), &[limit])?;
        let (matte, rough) =
            (rays(&halves(metal(0.0), dull.clone()), &[])?, rays(&halves(metal(0.0), metal(0.8)), &[limit])?);
        let unlimited = rays(&halves(metal(0.0), metal(0.8)), &[])?;
        println!(
            "{cells} pixels per ray: {all} rays, half of it matte {matte}, rough {rough}, without a limit {unlimited}"
        );
        ensure!(all == u64::from(size[0] * size[1] / cells), "{all} rays");
        ensure!(
            [matte, rough].iter().all(|half| half.abs_diff(all / 2) <= u64::from(size[1])),
            "{matte} and {rough} of {all}"
        );
        // A rough lobe may lie below the surface.
        ensure!(unlimited > 3 * all / 4, "without a limit {unlimited} of {all}");
    }

    let changes = [&RAW[..], &[limit]].concat();
    let of = |scene: &Scene, changes: &[&str]| -> Result<(Vec<String>, Vec<DVec3>, bool)> {
        let frame = frames(&gpu, scene, changes, size, &[0.0])?.swap_remove(0);
        let keeps = frame.result.sample.passes.iter().any(|p| p.name == "previous_radiance.keep");
        Ok((frame.passes().into_iter().map(str::to_owned).collect(), frame.image, keeps))
    };
    let mut rough = halves(metal(0.9), material([0.5; 3], 0.0, 0.7));
    let (passes, image, keeps) = of(
        &rough,
        &[&[RAYS, "reflections.precision=32", "stages.gi=off", "gbuffer.precision=full"], &[limit][..]].concat(),
    )?;
    let (_, sky, _) =
        of(&rough, &[IMPLEMENTATIONS[0], "reflections.precision=32", "stages.gi=off", "gbuffer.precision=full"])?;
    ensure!(passes == ["reflections.sky"] && !keeps, "{passes:?}, keeps the previous frame: {keeps}");
    ensure!(image == sky && sky.iter().any(|v| v.x > 0.1), "it is not the sky's");
    // A coat is smooth whatever is below.
    let coated = Material { clearcoat: 1.0, clearcoat_roughness: 0.1, ..metal(0.9) };
    let (passes, ..) = of(&halves(coated, metal(0.9)), &changes)?;
    ensure!(passes.contains(&"reflections.trace".to_owned()), "{passes:?}");
    rough.environment = None;
    ensure!(of(&rough, &changes)?.0.is_empty(), "rough, without a sky: {:?}", of(&rough, &changes)?.0);
    let (passes, ..) = of(&halves(dull.clone(), dull), &changes)?;
    ensure!(passes.is_empty(), "without a reflective surface: {passes:?}");
    Ok(())
}

/// Roughness that grows across the picture: where rays give way to the sky there is no step, with a ray for each pixel and for four, raw and
/// denoised, and beyond the limit it is the sky's reflection.
#[test]
fn the_limit_of_roughness_has_no_edge() -> Result<()> {
    let Some(gpu) = gpu()? else { return Ok(()) };
    let mut s = scene("ramp", camera([0.0, 2.0, 3.0], [0.0, 0.0, 0.0]));
    let tiles = 48_u8;
    for k in 0..tiles {
        let share = (f32::from(k) + 0.5) / f32::from(tiles);
        let place = Affine3A::from_scale_rotation_translation(
            Vec3::new(1.0, 1.0, 48.0),
            Quat::IDENTITY,
            Vec3::new(4.8 * (share - 0.5), 0.0, 0.0),
        );
        add(&mut s, plane(0.05), material([0.9; 3], 1.0, share), place);
    }
    // A red ceiling hides the sky.
    let ceiling = Affine3A::from_translation(Vec3::new(0.0, 6.0, 0.0));
    add(&mut s, plane(40.0), unlit([0.9, 0.2, 0.1]), ceiling);
    s.environment = Some(even(0.5));
    let size = [96, 48];
    let columns = |changes: &[&str]| -> Result<Vec<f64>> {
        let all = [changes, &["stages.gi=off", "stages.ao=off", "gbuffer.precision=full"]].concat();
        let shown = frames(&gpu, &s, &all, size, &[0.0; 24])?.split_off(16);
        let mean = |at: usize| shown.iter().map(|frame| frame.image[at].x).sum::<f64>() / 8.0;
        Ok((0..96).map(|x| (12..36).map(|y| mean(y * 96 + x)).sum::<f64>() / 24.0).collect())
    };
    let limit = "reflections.roughness_limit=0.6";
    let (sky, traced) = (columns(&IMPLEMENTATIONS[..1])?, columns(&[RAYS])?);
    for changes in [
        vec![RAYS, limit],
        vec![RAYS, limit, "reflections.denoiser=pica-pica", "reflections.pixels_per_ray=4"],
        vec![RAYS, limit, "reflections.denoiser=none", "reflections.rays=8"],
    ] {
        let found = columns(&changes)?;
        let steps = |row: &[f64]| row.windows(2).map(|w| (w[1] - w[0]).abs()).fold(0.0, f64::max);
        let range = (found[40] - found[60]).abs();
        println!("{changes:?}: from {:.3} to {:.3}, steps of {:.4}", found[8], found[88], steps(&found));
        ensure!((found[88] / sky[88] - 1.0).abs() < 0.02 && (found[8] / traced[8] - 1.0).abs() < 0.05, "{found:.3?}");
        // The fade is some 14 columns wide: a smooth step is steepest in its middle, half as much again as a line.
        ensure!(range > 0.2 && steps(&found) < 0.2 * range, "a step of {} in a range of {range}", steps(&found));
    }
    Ok(())
}
