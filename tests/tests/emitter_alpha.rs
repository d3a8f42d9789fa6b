//! Emissive surfaces with alpha test or blending: every strategy finds the same light, which is what coverage leaves.
use anyhow::{Context, Result, ensure};
use glam::{Affine3A, DVec3, Quat, Vec2, Vec3, Vec4};
use magpie::gpu::Gpu;
use magpie::scene::{
    AlphaMode, ColourSpace, Material, Mesh, Sampler, Scene, Sphere, Texture, TextureUse, Wrap,
    light_tables::{LightWeights, Tables},
};
use magpie_passes::reference::{Estimate, Reference, ReferenceOptions, Strategy};
use magpie_shaders::Address;
use magpie_shaders::light_sampling::{LightChoice, LightTables};
use magpie_tests::against::{Shown, mean, relmse, truth};
use magpie_tests::fixtures::{add, block, camera, material, plane, scene};
use magpie_tests::harness::{config, gpu, render};
use magpie_tests::oracle::path::{CpuPathTracer, CpuPathTracerOptions};
use std::f32::consts::PI;

const SIZE: [u32; 2] = [24, 16];
const STRATEGIES: [Strategy; 3] = [Strategy::Power, Strategy::LightsOnly, Strategy::SurfacesOnly];

fn at(x: f32, y: f32, z: f32) -> Affine3A {
    Affine3A::from_translation(Vec3::new(x, y, z))
}

/// A white material with values that are exact in 8 bits.
fn white(metalness: f32, roughness: f32) -> Material {
    material([1.0; 3], metalness, (roughness * 255.0).round() / 255.0)
}

/// A floor, matte in front and glossy behind, with a block on it.
fn stage(name: &str) -> Scene {
    let mut s = scene(name, camera([0.0, 2.6, 3.4], [0.0, 0.0, 0.2]));
    add(&mut s, plane(4.0), white(0.0, 0.9), at(0.0, 0.0, 4.0));
    add(&mut s, plane(4.0), white(1.0, 0.4), at(0.0, 0.0, -4.0));
    add(&mut s, block(Vec3::new(0.2, 0.3, 0.2)), white(0.0, 0.5), at(-0.5, 0.3, 0.1));
    s
}

fn glowing(alpha: AlphaMode, share: f32) -> Material {
    let base_colour = Vec4::new(0.0, 0.0, 0.0, share);
    Material { emission: Vec3::new(6.0, 5.0, 3.0), alpha, base_colour, ..white(0.0, 1.0) }
}

/// The floor under a textured panel that faces down.
fn under(name: &str, emits: Material, change: impl FnOnce(&mut Mesh)) -> Scene {
    let mut s = stage(name);
    // Alpha is a checkerboard in the left half, and one half in the right half.
    let rgba = (0..64_u8)
        .flat_map(|i| [90, 90, 90, [[0, 255], [128, 128]][usize::from(i % 8 >= 4)][usize::from((i + i / 8) % 2)]]);
    s.textures.push(Texture::new("holes".to_owned(), [8, 8], ColourSpace::Srgb, rgba.collect()));
    s.samplers.push(Sampler { wrap: [Wrap::Clamp; 2], ..Sampler::default() });
    let mut shape = plane(0.5);
    shape.uv0 = shape.positions.iter().map(|p| Vec2::new(p.x + 0.5, p.z + 0.5)).collect();
    change(&mut shape);
    let down = Quat::from_rotation_z(0.3) * Quat::from_rotation_x(PI);
    add(&mut s, shape, emits, Affine3A::from_rotation_translation(down, Vec3::new(0.3, 1.2, 0.1)));
    s
}

fn textured(alpha: AlphaMode) -> Material {
    let base_colour_texture = Some(TextureUse { texture: 0, sampler: 0, uv_set: 0, rows: [Vec3::X, Vec3::Y] });
    Material { base_colour_texture, ..glowing(alpha, 1.0) }
}

/// Vertex alpha from 0 at one side to 1 at the other.
fn fading(mesh: &mut Mesh) {
    mesh.colours = mesh.positions.iter().map(|p| Vec4::new(1.0, 1.0, 1.0, p.x + 0.5)).collect();
}

/// A blended sphere.
fn ball() -> Scene {
    let mut s = stage("blended ball");
    let spheres = vec![Sphere { centre: Vec3::new(0.4, 0.9, 0.3), radius: 0.3 }];
    let mesh = Mesh { name: "ball".to_owned(), spheres, ..Mesh::default() };
    add(&mut s, mesh, glowing(AlphaMode::Blend, 0.3), Affine3A::IDENTITY);
    s
}

/// Emitters with partial coverage of every kind.
fn partly_there() -> Vec<Scene> {
    let double_sided = |m: Material| Material { double_sided: true, ..m };
    // A blended sheet hangs between the panel and the floor.
    let mut veiled = under("panel behind a veil", textured(AlphaMode::Mask(0.5)), |_| ());
    let veil = Material { base_colour: Vec4::new(0.5, 0.5, 0.5, 0.4), double_sided: true, ..white(0.0, 1.0) };
    add(&mut veiled, plane(0.4), Material { alpha: AlphaMode::Blend, ..veil }, at(0.3, 0.8, 0.1));
    vec![
        under("holes by a texture", textured(AlphaMode::Mask(0.4)), |_| ()),
        under("holes by vertices", double_sided(glowing(AlphaMode::Mask(0.7), 1.0)), fading),
        under("blended by a factor", glowing(AlphaMode::Blend, 0.25), |_| ()),
        under("blended by a texture", double_sided(textured(AlphaMode::Blend)), |_| ()),
        under("blended by vertices", glowing(AlphaMode::Blend, 0.8), fading),
        ball(),
        veiled,
    ]
}

/// Panels with a coverage of 0.
fn nowhere() -> Vec<Scene> {
    vec![
        under("cut out by a factor", glowing(AlphaMode::Mask(0.5), 0.2), |_| ()),
        under("cut out by vertices", glowing(AlphaMode::Mask(1.0), 1.0), |m| m.colours.fill(Vec4::splat(0.9))),
        under(
            "cut out by a texture",
            Material { base_colour: Vec4::splat(0.3), ..textured(AlphaMode::Mask(0.5)) },
            |_| (),
        ),
        under("blended by nothing", glowing(AlphaMode::Blend, 0.0), |_| ()),
    ]
}

/// Light with one scattering. The camera blends surfaces by alpha, as the CPU path tracer does.
fn options(strategy: Strategy) -> ReferenceOptions {
    let ([width, height], seed) = (SIZE, strategy as u32 + 1);
    ReferenceOptions { width, height, depth: 1, strategy, seed, ..ReferenceOptions::default() }
}

fn estimate(gpu: &Gpu, scene: &Scene, strategy: Strategy, samples: u32) -> Result<Estimate> {
    let mut reference = Reference::new(gpu, scene, &scene.cameras[0], options(strategy))?;
    reference.add(samples)?;
    Ok(reference.estimate().clone())
}

/// Green of the mean of a picture, and its standard error.
fn whole(pixels: impl Iterator<Item = (DVec3, DVec3)>) -> [f64; 2] {
    let n = f64::from(SIZE[0] * SIZE[1]);
    let [sum, square] =
        pixels.fold([0.0; 2], |[sum, square], (mean, error)| [sum + mean.y, square + error.y * error.y]);
    [sum / n, square.sqrt() / n]
}

fn of(estimate: &Estimate) -> [f64; 2] {
    whole(estimate.mean.iter().copied().zip(estimate.standard_error()))
}

#[test]
fn each_strategy_alone_finds_what_is_there() -> Result<()> {
    let Some(gpu) = gpu()? else { return Ok(()) };
    for scene in partly_there() {
        // The ball is small and itself visible, which takes more samples.
        let patience = if scene.name.contains("ball") { 4 } else { 1 };
        let wanted = CpuPathTracerOptions { samples: 512 * patience, depth: 1, ..CpuPathTracerOptions::default() };
        let cpu = CpuPathTracer::new(&scene, 0.0).radiance(&scene.cameras[0], SIZE[0], SIZE[1], wanted);
        let [truth, error] = whole(cpu.into_iter());
        ensure!(truth > 0.02 && error < 0.015 * truth, "{}: {truth} +- {error}", scene.name);
        for strategy in STRATEGIES {
            let samples = patience * if strategy == Strategy::SurfacesOnly { 2048 } else { 512 };
            let [found, own] = of(&estimate(&gpu, &scene, strategy, samples)?);
            let (off, error) = (found / truth - 1.0, own.hypot(error) / truth);
            println!("{:<22} {strategy:?}: {found:.5}, {:+.2} +- {:.2} % off", scene.name, 100.0 * off, 100.0 * error);
            ensure!(error < 0.02 && off.abs() < 4.5 * error, "{}, {strategy:?}: {off} +- {error}", scene.name);
        }
    }
    Ok(())
}

/// Proportional to the coverage: up to rounding if coverage is uniform, as the samples are the same.
#[test]
fn a_blended_panel_gives_its_share_of_the_light() -> Result<()> {
    let Some(gpu) = gpu()? else { return Ok(()) };
    let panel = |alpha, share| under("panel", glowing(alpha, share), |_| ());
    let [opaque, _] = of(&estimate(&gpu, &panel(AlphaMode::Opaque, 1.0), Strategy::LightsOnly, 64)?);
    for share in [1.0, 0.75, 0.25, 0.01] {
        let [blended, _] = of(&estimate(&gpu, &panel(AlphaMode::Blend, share), Strategy::LightsOnly, 64)?);
        println!("alpha {share}: {:.5} of the light", blended / opaque);
        ensure!((blended / opaque - f64::from(share)).abs() < 1e-5, "alpha {share}: {blended} of {opaque}");
    }
    Ok(())
}

#[test]
fn what_is_cut_out_whole_lights_nothing() -> Result<()> {
    let Some(gpu) = gpu()? else { return Ok(()) };
    for scene in nowhere() {
        ensure!(LightWeights::of_animation(&scene).emitters().is_none(), "{} is in the table", scene.name);
        for strategy in STRATEGIES {
            let [found, _] = of(&estimate(&gpu, &scene, strategy, 16)?);
            ensure!(found == 0.0, "{}, {strategy:?}: {found}", scene.name);
        }
        let result = render(&gpu, &scene, &config(&[])?, SIZE, 1, Some(("direct.shade", "radiance")))?;
        let traced = result.sample.passes.iter().any(|p| p.name == "direct.emitters");
        let values = result.images.context("no image")?.linear.values();
        ensure!(!traced && values.iter().all(|v| v[..3] == [0.0; 3]), "{} lights the frame", scene.name);
    }
    Ok(())
}

/// The frame's rays, to points of the emitter and along lobes, against the reference.
#[test]
fn the_frame_finds_the_same() -> Result<()> {
    const RAW: [&str; 3] = ["direct.denoiser=none", "direct.emitter_rays=8", "stages.shadows=off"];
    let Some(gpu) = gpu()? else { return Ok(()) };
    const SCENES: [&str; 4] = ["holes by a texture", "blended by a texture", "blended ball", "panel behind a veil"];
    for scene in partly_there().into_iter().filter(|s| SCENES.contains(&s.name.as_str())) {
        let shown = Shown { size: SIZE, time: 0.0 };
        let truth = truth(&gpu, &scene, shown, 1024)?;
        let found = mean(&gpu, &scene, &RAW, shown, 32)?.0;
        let [error, noise] = relmse(&found, &truth);
        let ratio = found.iter().sum::<DVec3>() / truth.mean.iter().sum::<DVec3>();
        println!("{:<22} {:.4} of the light, relMSE {error:.1e}, noise of the truth {noise:.1e}", scene.name, ratio.y);
        ensure!(noise < 5e-3 && error - noise < 1e-2, "{}: {error}, noise {noise}", scene.name);
        ensure!((ratio - 1.0).abs().max_element() < 0.015, "{}: {ratio} of the light", scene.name);
    }
    Ok(())
}

/// Selection probabilities follow coverage. Others would be unbiased too, but noisier.
#[test]
fn probabilities_follow_alpha() {
    let both = |alpha: [f32; 2]| {
        let mut s = under("two panels", glowing(AlphaMode::Blend, alpha[0]), |_| ());
        add(&mut s, plane(0.5), glowing(AlphaMode::Blend, alpha[1]), at(-1.0, 1.0, 0.0));
        let near = |tables: &Tables| -> Vec<f32> {
            let bytes = tables.placed(Address::default());
            let root: LightTables = bytemuck::pod_read_unaligned(&bytes[..size_of::<LightTables>()]);
            let entries = &bytes[root.near.get() as usize..][..root.near_count as usize * size_of::<LightChoice>()];
            bytemuck::pod_collect_to_vec::<u8, LightChoice>(entries).iter().map(|c| c.probability).collect()
        };
        let probabilities = LightWeights::of_animation(&s).emitters().map(|tables| near(&tables));
        probabilities.unwrap_or_default()
    };
    assert_eq!(both([1.0, 1.0]).len(), 4);
    assert_eq!(both([1.0, 0.0]).len(), 2, "what is nowhere is not in the table");
    let uneven = both([1.0, 0.25]);
    // Five hundredths of the probability are uniform.
    assert!((uneven[2] / uneven[0] - (0.05 + 0.95 * 0.25)).abs() < 1e-4, "{uneven:?}");
}
