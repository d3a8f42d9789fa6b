//! Hard cases for reflections, by every implementation: nothing that is not finite, nothing brighter than what there is to reflect, and by rays
//! the light of the reference.
use anyhow::{Context, Result, ensure};
use glam::{Affine3A, DAffine3, DVec3, Quat, Vec2, Vec3, Vec4};
use magpie::gpu::Gpu;
use magpie::scene::{Camera, ColourSpace, Material, Sampler, Scene, Texture, TextureUse};
use magpie_passes::reference::{Only, ReferenceOptions};
use magpie_passes::{FrameRequest, RenderOptions, Renderer, Slots};
use magpie_tests::against::{RAW_REFLECTIONS, Shown, bias, mean_with, truth_of};
use magpie_tests::fixtures::{add, block, camera, environment, material, placed, plane, scene, sphere};
use magpie_tests::harness::{config, gpu, save_picture};
use std::env;
use std::f32::consts::FRAC_PI_2;

/// Every implementation, traced reflections also with a ray for four pixels.
const IMPLEMENTATIONS: [(&str, &[&str]); 6] = [
    ("sky", &["stages.reflections=sky"]),
    ("probe", &["stages.reflections=probe"]),
    ("screen-space", &["stages.reflections=screen-space"]),
    ("ray-traced", &["stages.reflections=ray-traced"]),
    ("hybrid", &["stages.reflections=hybrid"]),
    (
        "quarter rays",
        &["stages.reflections=ray-traced", "reflections.pixels_per_ray=4", "reflections.denoiser=pica-pica"],
    ),
];
/// What all of them share.
const COMMON: [&str; 2] = ["post.anti_aliasing=taa", "stages.gi=off"];
const SIZE: [u32; 2] = [48, 32];
/// The brightest that these scenes have to reflect: a texel of the environment.
const BRIGHTEST: f32 = 30.0;
/// Greatest number of 16-bit floats.
const MOST: f32 = 65504.0;

/// Twelve tiles of metal from roughness 1e-4 to 1, and what they reflect.
fn strip(eye: [f64; 3]) -> Scene {
    let mut s = scene("strip", camera(eye, [0.0, 0.0, -0.4]));
    s.cameras[0].near = 1e-3;
    for k in 0..12_u8 {
        let roughness = 1e-4_f32.powf(1.0 - f32::from(k) / 11.0);
        let place = Affine3A::from_scale_rotation_translation(
            Vec3::new(1.0, 1.0, 6.0),
            Quat::IDENTITY,
            Vec3::new(0.3 * (f32::from(k) - 5.5), 0.0, 0.0),
        );
        add(&mut s, plane(0.15), material([0.9; 3], 1.0, roughness), place);
    }
    things(&mut s);
    s
}

/// A matte block, a glossy ball and an environment.
fn things(s: &mut Scene) {
    let long = Vec3::new(1.6, 0.15, 0.1);
    add(s, block(long), material([0.8, 0.3, 0.1], 0.0, 1.0), Affine3A::from_translation(Vec3::new(0.0, 0.15, -0.7)));
    let ball = Affine3A::from_scale_rotation_translation(Vec3::splat(0.2), Quat::IDENTITY, Vec3::new(0.4, 0.2, -0.2));
    add(s, sphere(16), material([0.2, 0.5, 0.8], 0.0, 0.3), ball);
    s.environment = Some(environment());
}

/// An upright mirror and a lamp of this radiance, which the mirror shows: one that lights the scene, or one that only shows its colour.
fn lamp(radiance: f32, lights: bool) -> Scene {
    let mut s = scene("lamp", camera([0.0, 0.3, 2.0], [0.0, 0.2, 0.0]));
    let upright = Affine3A::from_rotation_translation(Quat::from_rotation_x(FRAC_PI_2), Vec3::new(0.0, 0.0, -0.9));
    add(&mut s, plane(1.5), material([0.9; 3], 1.0, 0.0), upright);
    let ball = Affine3A::from_scale_rotation_translation(Vec3::splat(0.12), Quat::IDENTITY, Vec3::new(-0.5, 0.6, 0.2));
    let of = if lights {
        Material { emission: Vec3::splat(radiance), ..material([0.5; 3], 0.0, 1.0) }
    } else {
        Material {
            unlit: true,
            base_colour: Vec4::new(radiance, radiance, radiance, 1.0),
            ..material([0.0; 3], 0.0, 1.0)
        }
    };
    add(&mut s, sphere(16), of, ball);
    add(&mut s, plane(2.0), material([0.5; 3], 0.0, 0.6), Affine3A::IDENTITY);
    s.environment = Some(environment());
    s
}

/// A ball of mirror as wide as a pixel, and half of one.
fn small_mirrors() -> Scene {
    let mut s = strip([0.0, 0.9, 1.7]);
    for (x, radius) in [(-0.6, 0.03), (-0.3, 0.015), (0.0, 0.06)] {
        let place =
            Affine3A::from_scale_rotation_translation(Vec3::splat(radius), Quat::IDENTITY, Vec3::new(x, 0.4, 0.3));
        add(&mut s, sphere(16), material([0.95; 3], 1.0, 0.0), place);
    }
    s
}

/// A floor and a ball whose normal maps turn the normal by nearly 90 degrees, each texel another way.
fn bumps() -> Scene {
    let mut s = strip([0.0, 0.9, 1.7]);
    let rgba = [[255, 128, 130, 255], [0, 128, 130, 255], [128, 255, 128, 255], [128, 0, 255, 255]].concat();
    s.textures.push(Texture::new("bumps".to_owned(), [2, 2], ColourSpace::Linear, rgba));
    s.samplers.push(Sampler::default());
    let map = Some(TextureUse { texture: 0, sampler: 0, uv_set: 0, rows: [Vec3::X * 8.0, Vec3::Y * 8.0] });
    for material in &mut s.materials {
        material.normal_texture = map;
    }
    for mesh in &mut s.meshes {
        mesh.uv0 = mesh.positions.iter().map(|p| Vec2::new(p.x, p.z + p.y)).collect();
    }
    s
}

/// Triangles that are points and lines among the good ones.
fn degenerate() -> Scene {
    let mut s = strip([0.0, 0.9, 1.7]);
    for mesh in &mut s.meshes {
        let last = mesh.positions.len() as u32 - 1;
        mesh.indices.extend([0, 0, 0, 0, last, last, last, 0, last, 1, 1, 0]);
    }
    s
}

/// A hard case, the same without what makes it hard, if that is known to look alike, and the brightest reflection that it may have.
struct Case {
    name: &'static str,
    scene: Scene,
    alike: Option<Scene>,
    most: f32,
}

fn cases() -> Vec<Case> {
    let plain = || strip([0.0, 0.9, 1.7]);
    let case = |name, scene, alike, most| Case { name, scene, alike, most };
    let scaled = |by: f64| placed(plain(), DAffine3::from_scale(DVec3::splat(by)));
    let far = placed(plain(), DAffine3::from_translation(DVec3::new(1e4, 0.0, -7e3)));
    vec![
        case("roughness 1e-4 to 1", plain(), None, BRIGHTEST),
        case("grazing", strip([0.0, 0.01, 1.7]), None, BRIGHTEST),
        case("lamp of 1e5", lamp(1e5, true), None, 1e5),
        case("unlit lamp of 1e5", lamp(1e5, false), None, 1e5),
        case("mirrors of a pixel", small_mirrors(), None, BRIGHTEST),
        case("normals turned by 90 degrees", bumps(), None, BRIGHTEST),
        case("degenerate triangles", degenerate(), Some(plain()), BRIGHTEST),
        case("10 km away", far, Some(plain()), BRIGHTEST),
        // The strip is 3.6 m wide.
        case("1 mm wide", scaled(1e-3 / 3.6), Some(plain()), BRIGHTEST),
        case("10 km wide", scaled(1e4 / 3.6), Some(plain()), BRIGHTEST),
    ]
}

/// Frames of an implementation with every check on: the slot's image of the last one.
fn frames(gpu: &Gpu, scene: &Scene, changes: &[&str], size: [u32; 2], count: u32) -> Result<Vec<DVec3>> {
    let options = RenderOptions { width: size[0], height: size[1], check: true, ..RenderOptions::default() };
    let all = [changes, &COMMON].concat();
    let mut renderer = Renderer::new(gpu, scene, &Slots::default(), &config(&all)?, options)?;
    renderer.read_slots(&["reflections"])?;
    let mut last = Vec::new();
    for frame in 0..count {
        last = reflected(&mut renderer, &scene.cameras[0]).with_context(|| format!("frame {frame}"))?;
    }
    Ok(last)
}

/// The slot's image of the next frame. Errors if anything in the frame is not finite.
fn reflected(renderer: &mut Renderer, camera: &Camera) -> Result<Vec<DVec3>> {
    let request = FrameRequest { camera, time: 0.0, view: None, read_back: true };
    let result = renderer.frame(request)?.context("no frame")?;
    ensure!(result.findings.is_empty(), "{}", result.findings[0]);
    let not_finite: u64 = result.sample.passes.iter().map(|p| p.not_finite).sum();
    ensure!(not_finite == 0, "{not_finite} values were left out because they were not finite");
    let display = result.images.context("no picture")?.linear;
    ensure!(display.values().iter().flatten().all(|v| v.is_finite()), "the picture is not finite");
    let image = result.slots[0].1.as_ref().context("no reflections")?;
    Ok(image.values().iter().map(|v| Vec3::new(v[0], v[1], v[2]).as_dvec3()).collect())
}

fn brightest(image: &[DVec3]) -> f32 {
    image.iter().map(|v| v.max_element()).fold(0.0, f64::max) as f32
}

/// By every implementation, with anti-aliasing and histories.
#[test]
fn every_implementation_stays_finite_and_bounded() -> Result<()> {
    let Some(gpu) = gpu()? else { return Ok(()) };
    for case in cases() {
        for (name, changes) in IMPLEMENTATIONS {
            let image =
                frames(&gpu, &case.scene, changes, SIZE, 4).with_context(|| format!("{}, {name}", case.name))?;
            let most = brightest(&image);
            println!("{}, {name}: at most {most:.2}", case.name);
            ensure!(image.iter().all(|v| v.is_finite() && v.min_element() >= 0.0), "{}, {name}", case.name);
            // Nothing reflects more than it gets; 16-bit floats round by a thousandth, and end.
            ensure!(most <= 1.001 * case.most.min(MOST), "{}, {name}: {most}", case.name);
            ensure!(most > 0.0, "{}, {name} reflects nothing", case.name);
        }
    }
    Ok(())
}

/// Rays have the light of the reference to 2 %, no more of it in any pixel than the reference has anywhere, and look the same where the scene
/// is the same but for its place, its size, or triangles without area.
#[test]
fn rays_have_the_light_of_the_reference() -> Result<()> {
    let Some(gpu) = gpu()? else { return Ok(()) };
    let shown = Shown { size: SIZE, time: 0.0 };
    let changes = [&RAW_REFLECTIONS[..], &["reflections.bounces=3"]].concat();
    for case in cases() {
        let (mut found, mut truth) = (Vec::new(), Vec::new());
        for seed in 1..=2 {
            let options = RenderOptions { seed, ..RenderOptions::default() };
            // What the lamp lights by way of the mirror is found by chance.
            let rays = if case.name == "lamp of 1e5" { 1024 } else { 256 };
            found.push(mean_with(options, "reflections", &gpu, &case.scene, &changes, shown, rays / 8)?.0);
            let options = ReferenceOptions { only: Only::Reflections, depth: 4, seed, ..ReferenceOptions::default() };
            truth.push(truth_of(options, &gpu, case.alike.as_ref().unwrap_or(&case.scene), shown, rays)?.mean);
        }
        let b = bias(&found, &truth);
        let [most, wanted] = [&found, &truth].map(|all| all.iter().map(|i| brightest(i)).fold(0.0, f32::max));
        println!("{}: {b:.5?}, at most {most:.2}, the reference {wanted:.2}", case.name);
        ensure!(b.light.is_finite() && (b.light - 1.0).abs() < 0.02, "{}: {b:?}", case.name);
        ensure!(b.light_error < 0.02, "{}: too much noise to tell: {b:?}", case.name);
        ensure!(most <= 1.5 * wanted, "{}: {most}, where the reference has at most {wanted}", case.name);
    }
    Ok(())
}

/// What a mirror shows of a lamp of 10^5 is in `direct` if the lamp lights the scene, in `reflections` if it only shows its colour; with 32 bits
/// it has its radiance, with 16 that ends at their greatest number.
#[test]
fn a_mirror_shows_a_lamp_as_bright_as_it_is() -> Result<()> {
    let Some(gpu) = gpu()? else { return Ok(()) };
    let shown = Shown { size: SIZE, time: 0.0 };
    let dim: [(&str, &[&str]); 2] = [("32", &RAW_REFLECTIONS), ("16", &IMPLEMENTATIONS[3].1[..1])];
    for (bits, changes) in dim {
        let options = RenderOptions { check: true, ..RenderOptions::default() };
        let unlit = mean_with(options, "reflections", &gpu, &lamp(1e5, false), changes, shown, 1)?.0;
        let wanted = 0.9 * if bits == "32" { 1e5 } else { f64::from(MOST) };
        let most = f64::from(brightest(&unlit));
        println!("{bits} bits: a mirror of 0.9 shows a lamp of 1e5 with {most:.0}");
        ensure!((most / wanted - 1.0).abs() < 0.01, "{bits} bits: {most} instead of {wanted}");
    }
    let changes = ["direct.precision=32", "direct.emitter_rays=8", "direct.denoiser=none", "gbuffer.precision=full"];
    let changes: Vec<&str> = RAW_REFLECTIONS[..10].iter().copied().chain(changes).collect();
    let found = mean_with(RenderOptions::default(), "direct", &gpu, &lamp(1e5, true), &changes, shown, 32)?.0;
    let options = ReferenceOptions { only: Only::Direct, ..ReferenceOptions::default() };
    let truth = truth_of(options, &gpu, &lamp(1e5, true), shown, 512)?.mean;
    // The upper half of the picture: the mirror.
    let mirror = |image: &[DVec3]| image[..image.len() / 2].iter().map(|v| v.element_sum()).sum::<f64>();
    let share = mirror(&found) / mirror(&truth);
    println!("direct light in the mirror: {share:.4} of the reference's {:.0}", mirror(&truth));
    ensure!((share - 1.0).abs() < 0.02, "direct light in the mirror: {share} of the reference's");
    Ok(())
}

/// After a cut of the camera the reflection is, to the last bit, that of a renderer which has seen nothing else before: nothing is left in
/// histories, nor of the previous frame. Probes stay, since they belong to places; after a jump they are captured anew.
#[test]
fn a_cut_leaves_nothing_behind() -> Result<()> {
    let Some(gpu) = gpu()? else { return Ok(()) };
    let mut s = strip([0.0, 0.9, 1.7]);
    add(
        &mut s,
        plane(1.0),
        Material { unlit: true, ..material([1.0, 0.05, 0.05], 0.0, 1.0) },
        Affine3A::from_rotation_translation(Quat::from_rotation_x(FRAC_PI_2), Vec3::new(0.0, 1.0, -1.2)),
    );
    let there = camera([1.4, 0.5, -0.2], [-0.5, 0.1, 0.1]);
    for (name, changes) in IMPLEMENTATIONS {
        let options = RenderOptions { width: SIZE[0], height: SIZE[1], check: true, ..RenderOptions::default() };
        let config = config(&[changes, &COMMON].concat())?;
        let after = |before: &Camera, cuts: bool| -> Result<Vec<DVec3>> {
            let mut renderer = Renderer::new(&gpu, &s, &Slots::default(), &config, options)?;
            renderer.read_slots(&["reflections"])?;
            for _ in 0..6 {
                reflected(&mut renderer, before)?;
            }
            if cuts {
                renderer.cut();
            }
            reflected(&mut renderer, &there)
        };
        let (cut, wanted, kept) = (after(&s.cameras[0], true)?, after(&there, true)?, after(&there, false)?);
        let apart = |image: &[DVec3]| image.iter().zip(&wanted).map(|(a, b)| a.distance(*b)).fold(0.0, f64::max);
        println!("{name}: {} after a cut, {:.3} of the same without one", apart(&cut), apart(&kept));
        if name == "probe" {
            let light = |image: &[DVec3]| image.iter().map(|v| v.element_sum()).sum::<f64>();
            let share = light(&cut) / light(&wanted);
            ensure!((share - 1.0).abs() < 0.05, "{name}: {share} of the light");
        } else {
            ensure!(cut == wanted, "{name}: {} apart", apart(&cut));
        }
        ensure!(name == "sky" || name == "probe" || apart(&kept) > 0.01, "{name} has no history");
    }
    Ok(())
}

/// With `MAGPIE_FULL` pictures of all cases are written to `target/images`: the reference, then each implementation in its 16th frame.
#[test]
fn pictures() -> Result<()> {
    if env::var_os("MAGPIE_FULL").is_none() {
        return Ok(());
    }
    let Some(gpu) = gpu()? else { return Ok(()) };
    let size = [144, 96];
    for case in cases() {
        let options = ReferenceOptions { only: Only::Reflections, ..ReferenceOptions::default() };
        let mut images = vec![truth_of(options, &gpu, &case.scene, Shown { size, time: 0.0 }, 64)?.mean];
        for (_, changes) in IMPLEMENTATIONS {
            images.push(frames(&gpu, &case.scene, changes, size, 16)?);
        }
        save_picture(&format!("hard {}", case.name), size[0], 3, &images)?;
    }
    Ok(())
}
