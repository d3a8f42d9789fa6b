//! `direct = clustered` against `all-lights`, which evaluates each lamp at every pixel: light, error, and what it adds.
use anyhow::{Result, ensure};
use glam::{DAffine3, DVec3, Vec3};
use magpie::gpu::Gpu;
use magpie::scene::{Light, Scene};
use magpie_tests::against::{Shown, mean_of};
use magpie_tests::fixtures::placed;
use magpie_tests::harness::{builtin, config_without_bounces, gpu, linear, render};
use magpie_tests::lit::error;
use magpie_tests::rooms;

/// What is equal in all renders.
const RAW: [&str; 6] = [
    "direct.emitter_rays=0",
    "direct.precision=32",
    "gbuffer.precision=full",
    "stages.gi=off",
    "stages.reflections=off",
    "stages.ao=off",
];
/// Lamps that have a shadow are evaluated at every pixel.
const UNSHADOWED: [&str; 1] = ["stages.shadows=off"];

/// Light over that of all lamps at every pixel, and the mean error of luminance.
fn against_all(gpu: &Gpu, scene: &Scene, both: &[&str], changes: &[&str], shown: Shown) -> Result<[f64; 2]> {
    let of = |way: &[&str]| mean_of("direct", gpu, scene, &[&RAW, both, way].concat(), shown, 1);
    let wanted = of(&["stages.direct=all-lights"])?.0;
    let found = of(&[&["stages.direct=clustered"], changes].concat())?.0;
    let light = |image: &[DVec3]| image.iter().map(|v| v.element_sum()).sum::<f64>();
    Ok([light(&found) / light(&wanted), error(&found, &wanted)])
}

/// Checks both: by how much light may be off, and the error.
fn is_like_all(what: &str, [light, error]: [f64; 2], most: [f64; 2]) -> Result<()> {
    println!("{what}: light {light:.4}, error {error:.4}");
    ensure!((light - 1.0).abs() < most[0] && error < most[1], "{what}: {light:.4} of the light, error {error:.4}");
    Ok(())
}

const SHOWN: Shown = Shown { size: [96, 54], time: 0.0 };

fn of_metal(mut scene: Scene, roughness: f32) -> Scene {
    for m in &mut scene.materials {
        (m.roughness, m.metalness) = (roughness, 1.0);
    }
    scene
}

#[test]
fn light_is_that_of_all_lamps() -> Result<()> {
    let Some(gpu) = gpu()? else { return Ok(()) };
    for lamps in [100, 1000] {
        let hall = rooms::lamps(lamps);
        is_like_all(&format!("hall, {lamps} lamps"), against_all(&gpu, &hall, &UNSHADOWED, &[], SHOWN)?, [0.03, 0.04])?;
        for roughness in [0.02, 0.15, 0.4, 0.7] {
            let glossy = of_metal(hall.clone(), roughness);
            let what = format!("hall of metal, {lamps} lamps, roughness {roughness}");
            is_like_all(&what, against_all(&gpu, &glossy, &UNSHADOWED, &["direct.lobe=1"], SHOWN)?, [0.06, 0.12])?;
        }
    }
    let market = builtin("night-market?lights=1000")?;
    let [blurred, sharp] = [&["direct.lobe=0"], &["direct.lobe=1"]];
    let blurred = against_all(&gpu, &market, &UNSHADOWED, blurred, SHOWN)?;
    let sharp = against_all(&gpu, &market, &UNSHADOWED, sharp, SHOWN)?;
    let found = against_all(&gpu, &market, &UNSHADOWED, &[], SHOWN)?;
    println!("night market, 1,000 lamps: light and error with lobe = 0 {blurred:.3?}, with 1 {sharp:.3?}");
    is_like_all("by default", found, [0.03, 0.1])?;
    ensure!(sharp[1] < found[1] && found[1] < 0.5 * blurred[1], "lobes make the market no more exact");
    Ok(())
}

/// More lamps that are near, and more cells, are more exact.
#[test]
fn settings_buy_accuracy() -> Result<()> {
    let Some(gpu) = gpu()? else { return Ok(()) };
    let scene = rooms::lamps(1000);
    let of = |changes: &[&str]| Ok::<_, anyhow::Error>(against_all(&gpu, &scene, &UNSHADOWED, changes, SHOWN)?[1]);
    let near = [of(&["direct.near=4"])?, of(&["direct.near=16"])?];
    let cells = [of(&["direct.cells=8"])?, near[1], of(&["direct.cells=32"])?];
    println!("near 4, 16: {near:.4?}; cells 8, 16, 32: {cells:.4?}");
    ensure!(near[1] < 0.8 * near[0] && cells[2] < 0.8 * cells[1] && cells[1] < 0.8 * cells[0]);
    Ok(())
}

/// Where no more lamps shine than are near anywhere, all are evaluated: the picture is the same to the last bit, and no pass is added.
#[test]
fn few_lamps_need_no_clusters() -> Result<()> {
    let Some(gpu) = gpu()? else { return Ok(()) };
    let frame = |scene: &Scene, way: &str| -> Result<_> {
        let config = config_without_bounces(&[&format!("stages.direct={way}")])?;
        render(&gpu, scene, &config, [32, 18], 2, None)
    };
    let few = rooms::lamps(16);
    let (clustered, all) = (frame(&few, "clustered")?, frame(&few, "all-lights")?);
    ensure!(!clustered.sample.passes.iter().any(|p| p.name == "direct.clusters"), "clusters of 16 lamps");
    ensure!(linear(clustered)?.values() == linear(all)?.values(), "16 lamps are not as by `all-lights`");
    let names: Vec<_> = frame(&rooms::lamps(17), "clustered")?.sample.passes.iter().map(|p| p.name.clone()).collect();
    for pass in ["direct.depths", "direct.reach", "direct.clusters", "direct.far_lamps"] {
        ensure!(names.iter().any(|name| name == pass), "17 lamps, no {pass}: {names:?}");
    }
    Ok(())
}

/// Nothing is remembered: what moves is where it is.
#[test]
fn moving_lamps_are_where_they_are() -> Result<()> {
    let Some(gpu) = gpu()? else { return Ok(()) };
    let market = builtin("night-market?lights=300")?;
    let shown = Shown { time: 2.5, ..SHOWN };
    is_like_all("night market, later", against_all(&gpu, &market, &UNSHADOWED, &[], shown)?, [0.02, 0.09])
}

/// A hall of 2 cm, of 2 km, and 10 km from the origin.
#[test]
fn size_and_place_do_not_count() -> Result<()> {
    let Some(gpu) = gpu()? else { return Ok(()) };
    for (what, by) in [
        ("a thousandth", DAffine3::from_scale(DVec3::splat(1e-3))),
        ("a hundred times", DAffine3::from_scale(DVec3::splat(1e2))),
        ("10 km away", DAffine3::from_translation(DVec3::new(1e4, 0.0, -1e4))),
    ] {
        let scene = placed(rooms::lamps(400), by);
        is_like_all(what, against_all(&gpu, &scene, &UNSHADOWED, &[], SHOWN)?, [0.02, 0.05])?;
    }
    Ok(())
}

/// More lamps within a cell than it lists.
#[test]
fn crowds_of_lamps_keep_their_light() -> Result<()> {
    let Some(gpu) = gpu()? else { return Ok(()) };
    let mut scene = rooms::lamps(100);
    for k in 0..2000_u32 {
        let place = |n: u32| 0.01 * (f64::from(n) - 22.0);
        let position = DVec3::new(-4.0 + place(k % 45), 1.6, -4.0 + place(k / 45));
        scene.lights.push(Light::Point { position, intensity: Vec3::splat(0.02), range: None });
        scene.light_nodes.push(None);
    }
    is_like_all("2,000 lamps within a metre", against_all(&gpu, &scene, &UNSHADOWED, &[], SHOWN)?, [0.03, 0.05])?;
    is_like_all("eight of them with shadows", against_all(&gpu, &scene, &[], &[], SHOWN)?, [0.03, 0.05])
}
