//! The light tree where light is computed: `direct = light-tree`, the reference, and the hits of rays.
use anyhow::{Context, Result, ensure};
use glam::{Affine3A, DVec3, Vec3};
use magpie::prelude::{Extent, Rays};
use magpie::scene::{Light, Material, Scene};
use magpie_passes::reference::{Only, ReferenceOptions};
use magpie_passes::{Slots, plan_frame};
use magpie_tests::against::{Shown, bias, mean_of, truth_of};
use magpie_tests::fixtures::{add, material, plane};
use magpie_tests::harness::{config, config_without_bounces, gpu, linear, render};
use magpie_tests::lit::{agrees, compared, error, every_kind, fence, shown_lamp, truths};
use magpie_tests::rooms;

/// What leaves the light of samples as it is.
const RAW: [&str; 8] = [
    "stages.direct=light-tree",
    "direct.denoiser=none",
    "direct.precision=32",
    "gbuffer.precision=full",
    "stages.gi=off",
    "stages.reflections=off",
    "stages.ao=off",
    "stages.shadows=off",
];
const SHOWN: Shown = Shown { size: [40, 22], time: 0.0 };

fn is_full() -> bool {
    std::env::var_os("MAGPIE_FULL").is_some()
}

/// A large lamp above a pane of thin red glass, which the camera does not see.
fn behind_glass() -> Scene {
    let mut s = every_kind(0.3);
    let pane = Material { transmission: 0.9, double_sided: true, ..material([0.9, 0.3, 0.3], 0.0, 0.0) };
    add(&mut s, plane(1.5), pane, Affine3A::from_translation(Vec3::new(0.0, 2.6, 1.0)));
    s.lights.push(Light::Disc {
        centre: [0.0, 2.9, 1.0].into(),
        normal: Vec3::NEG_Y,
        radius: 0.6,
        radiance: Vec3::new(6.0, 5.0, 4.0),
    });
    s
}

/// Lamps of every kind and an emissive panel, seen by points of them, along lobes, and both; one light, and of each of several clusters.
#[test]
fn the_mean_is_that_of_the_reference() -> Result<()> {
    let Some(gpu) = gpu()? else { return Ok(()) };
    let counts = if is_full() { [8, 128] } else { [4, 12] };
    let scenes =
        [("fence", fence()), ("small", every_kind(0.3)), ("large", every_kind(1.5)), ("behind glass", behind_glass())];
    for (what, scene) in scenes {
        let wanted = truths(&gpu, &scene, SHOWN, counts)?;
        for changes in [&["direct.split_lights=1"][..], &["direct.split_lights=16", "direct.lobe=1"]] {
            agrees(
                &format!("{what}, {changes:?}"),
                &compared(&gpu, &scene, [&RAW, changes], SHOWN, &wanted, counts)?,
                0.03,
            )?;
        }
    }
    let wanted = truths(&gpu, &shown_lamp(), SHOWN, counts)?;
    agrees("shown lamp", &compared(&gpu, &shown_lamp(), [&RAW, &["direct.lobe=1"]], SHOWN, &wanted, counts)?, 0.03)
}

/// More lights of a frame leave less noise than one, and four by the tree at most half of what four by power leave.
#[test]
fn noise_falls_with_the_number_of_lights() -> Result<()> {
    let Some(gpu) = gpu()? else { return Ok(()) };
    let (scene, shown) = (rooms::lamps(200), Shown { size: [64, 36], time: 0.0 });
    let truth =
        truth_of(ReferenceOptions { only: Only::Direct, ..ReferenceOptions::default() }, &gpu, &scene, shown, 256)?;
    let of = |changes: &[&str]| -> Result<f64> {
        let changes = [&RAW, changes].concat();
        Ok(error(&mean_of("direct", &gpu, &scene, &changes, shown, 1)?.0, &truth.mean))
    };
    let one = of(&["direct.split_lights=1"])?;
    let four = of(&["direct.split_lights=4"])?;
    let sixteen = of(&["direct.split_lights=16"])?;
    let by_power = of(&["stages.direct=ris", "direct.source=power", "direct.candidates=1"])?;
    println!("mean error of luminance: 1 light {one:.3}, 4 {four:.3}, 16 {sixteen:.3}; one by power {by_power:.3}");
    ensure!(one < 0.6 * by_power && four < 0.8 * one && sixteen < 0.8 * four);
    // Four rays leave half the noise of one.
    ensure!(four < 0.5 * (0.5 * by_power), "{four:.3} by the tree, {:.3} by power", 0.5 * by_power);
    Ok(())
}

/// Nothing runs that a scene does not call for: without lamps and emissive surfaces neither rays nor a tree.
#[test]
fn without_local_lights_there_is_no_pass() -> Result<()> {
    let Some(gpu) = gpu()? else { return Ok(()) };
    let passes = |scene: &Scene| -> Result<Vec<String>> {
        let frame = render(&gpu, scene, &config_without_bounces(&["stages.direct=light-tree"])?, [16, 9], 1, None)?;
        let is_ours = |name: &String| name.starts_with("direct.") || name.starts_with("light_tree.");
        Ok(frame.sample.passes.iter().map(|p| p.name.clone()).filter(is_ours).collect())
    };
    let lit = passes(&fence())?;
    ensure!(lit.contains(&"direct.tree".to_owned()) && lit.contains(&"light_tree.lamps".to_owned()), "{lit:?}");
    let mut dark = fence();
    dark.lights.clear();
    ensure!(passes(&dark)? == ["direct.shade"], "{:?}", passes(&dark)?);
    Ok(())
}

/// `auto` is `all-lights` where lamps are few and `light-tree` where they are many, to the last bit, and says why.
#[test]
fn auto_takes_what_fits_the_scene() -> Result<()> {
    let Some(gpu) = gpu()? else { return Ok(()) };
    let picture = |scene: &Scene, changes: &[&str]| {
        linear(render(&gpu, scene, &config_without_bounces(changes)?, [32, 18], 3, None)?)
    };
    for (scene, way, part) in [(fence(), "all-lights", "tree"), (rooms::lamps(20), "light-tree", "emitters")] {
        let auto = picture(&scene, &["stages.direct=auto"])?;
        ensure!(
            auto.values() == picture(&scene, &[&format!("stages.direct={way}")])?.values(),
            "{}: not as `{way}`",
            scene.name
        );
        let (slots, settings) = (Slots::default(), config(&["stages.direct=auto"])?);
        let plan = plan_frame(&scene, &scene.cameras[0], &slots, &settings, Rays::Software, Extent::new(32, 18))?;
        let direct = plan.slots.iter().find(|slot| slot.slot == "direct").context("no slot `direct`")?;
        let idle = direct.parts.iter().find(|p| p.part == part).and_then(|p| p.reason.as_ref());
        ensure!(idle.is_some_and(|why| why.contains("lamps")), "{}: {:?}", scene.name, direct.parts);
    }
    Ok(())
}

/// The reference finds the same light by the tree as by power, with less noise where lamps are many: light of lamps, of surfaces that emit, in
/// front of surfaces and behind thin glass, and along rays that meet lamps.
#[test]
fn the_reference_finds_the_same_light_by_tree() -> Result<()> {
    let Some(gpu) = gpu()? else { return Ok(()) };
    let glass = {
        let mut s = rooms::lamps(60);
        s.materials[1] = Material { transmission: 0.9, ..material([0.9, 0.8, 0.7], 0.0, 0.3) };
        s
    };
    let (runs, samples) = if is_full() { (8, 512) } else { (4, 48) };
    for (what, scene, less) in
        [("hall", rooms::lamps(200), 0.5), ("every kind", every_kind(1.5), 1.2), ("glass", glass, 0.9)]
    {
        let runs_of = |tree: bool| -> Result<(Vec<Vec<DVec3>>, f64)> {
            let mut noise = 0.0;
            let mut one = |seed: u32| {
                let options = ReferenceOptions {
                    depth: 3,
                    light_tree: Some(tree),
                    seed: seed + 50 * u32::from(tree),
                    ..ReferenceOptions::default()
                };
                let found = truth_of(options, &gpu, &scene, SHOWN, samples)?;
                noise += found.standard_error().iter().map(|e| e.length_squared()).sum::<f64>();
                anyhow::Ok(found.mean)
            };
            Ok(((0..runs).map(&mut one).collect::<Result<_>>()?, noise))
        };
        let (by_power, noise_by_power) = runs_of(false)?;
        let (by_tree, noise_by_tree) = runs_of(true)?;
        let ratio = (noise_by_tree / noise_by_power).sqrt();
        println!("{what}: noise by the tree over that by power {ratio:.3}");
        agrees(what, &bias(&by_tree, &by_power), 0.03)?;
        ensure!(ratio < less, "{what}: by the tree the noise is {ratio:.3} times as large");
    }
    Ok(())
}

/// Indirect light by one ray, whose hits are lit by lamps that the tree chooses, is that of the reference by power.
#[test]
fn hits_are_lit_by_tree() -> Result<()> {
    let Some(gpu) = gpu()? else { return Ok(()) };
    let scene = rooms::lamps(200);
    let raw = [
        "stages.gi=ray-traced",
        "gi.denoiser=none",
        "gi.reuse=false",
        "gi.precision=32",
        "gi.bounces=1",
        "stages.reflections=off",
        "stages.ao=off",
        "gbuffer.precision=full",
    ];
    let options = ReferenceOptions { only: Only::Gi, depth: 2, light_tree: Some(false), ..ReferenceOptions::default() };
    let truth = truth_of(options, &gpu, &scene, SHOWN, if is_full() { 4096 } else { 256 })?;
    let (found, _) = mean_of("gi", &gpu, &scene, &raw, SHOWN, if is_full() { 1024 } else { 64 })?;
    let light = |image: &[DVec3]| image.iter().sum::<DVec3>().dot(Vec3::ONE.as_dvec3());
    let share = light(&found) / light(&truth.mean);
    println!("indirect light over that of the reference: {share:.4}");
    ensure!((share - 1.0).abs() < if is_full() { 0.005 } else { 0.03 }, "{share:.4} of the light");
    Ok(())
}
