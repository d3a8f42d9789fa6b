//! Sampled lights where numbers are extreme: lamps without power, of 10^8 beside 1, all in one point, within things, triangles without area.
use anyhow::{Context, Result, ensure};
use glam::{Affine3A, DVec3, Vec3};
use magpie::gpu::Gpu;
use magpie::scene::{Light, Material, Mesh, Scene};
use magpie_passes::{FrameRequest, RenderOptions, Renderer, Slots};
use magpie_tests::fixtures::{add, block, camera, material, mesh, plane, scene};
use magpie_tests::harness::{config, gpu};

/// What is equal in all renders.
const RAW: [&str; 6] = [
    "direct.denoiser=none",
    "direct.precision=32",
    "gbuffer.precision=full",
    "stages.gi=off",
    "stages.reflections=off",
    "stages.ao=off",
];
const SIZE: [u32; 2] = [80, 45];

fn floor() -> Scene {
    let mut s = scene("floor", camera([0.0, 3.0, 4.5], [0.0, 0.0, 0.0]));
    add(&mut s, plane(6.0), material([0.8; 3], 0.0, 0.9), Affine3A::IDENTITY);
    s
}

/// Lamps in rows over the floor.
fn lamps(count: u32, intensity: impl Fn(u32) -> f32) -> Vec<Light> {
    let across = f64::from(count).sqrt().ceil() as u32;
    let at = |n: u32| 8.0 * (f64::from(n) + 0.5) / f64::from(across) - 4.0;
    let lamp = |k: u32| Light::Point {
        position: [at(k % across), 1.5, at(k / across)].into(),
        intensity: Vec3::splat(intensity(k)),
        range: None,
    };
    (0..count).map(lamp).collect()
}

/// Mean light of a picture over frames; every frame is finite. Also the greatest mean of one frame.
fn light(gpu: &Gpu, scene: &Scene, changes: &[&str], frames: u32) -> Result<[f64; 2]> {
    let options = RenderOptions { width: SIZE[0], height: SIZE[1], check: true, ..RenderOptions::default() };
    let config = config(&[&RAW, changes].concat())?;
    let mut renderer = Renderer::new(gpu, scene, &Slots::default(), &config, options)?;
    renderer.read_slots(&["direct"])?;
    let (mut sum, mut most) = (0.0, 0.0_f64);
    for _ in 0..frames {
        let request = FrameRequest { camera: &scene.cameras[0], time: 0.0, view: None, read_back: true };
        let result = renderer.frame(request)?.context("no frame")?;
        ensure!(result.findings.is_empty(), "{:?}", result.findings);
        let values = result.slots[0].1.as_ref().context("no light")?.values().to_vec();
        let frame: DVec3 = values.iter().map(|v| Vec3::new(v[0], v[1], v[2]).as_dvec3()).sum();
        let mean = frame.element_sum() / values.len() as f64;
        sum += mean / f64::from(frames);
        most = most.max(mean);
    }
    Ok([sum, most])
}

/// All ways to sample give the light that there is, within 2 %, clusters within 4 %, and no frame is far off. `wanted`: a scene whose lights are evaluated one by one,
/// unshadowed.
fn energy_is_kept(gpu: &Gpu, what: &str, scene: &Scene, wanted: &Scene, frames: u32) -> Result<()> {
    energy_is_kept_by(&["ris", "restir", "light-tree", "clustered"], gpu, what, scene, wanted, frames)
}

fn energy_is_kept_by(ways: &[&str], gpu: &Gpu, what: &str, scene: &Scene, wanted: &Scene, frames: u32) -> Result<()> {
    let [wanted, _] = light(gpu, wanted, &["stages.direct=all-lights", "stages.shadows=off"], 1)?;
    ensure!(wanted > 0.0, "{what}: dark");
    for way in ways {
        let stage = format!("stages.direct={way}");
        let [mean, most] = light(gpu, scene, &[&stage], frames)?.map(|light| light / wanted);
        println!("{what}, {way}: {mean:.4} of the light, at most {most:.2} in a frame");
        let off = if *way == "clustered" { 0.04 } else { 0.02 };
        ensure!((mean - 1.0).abs() < off && most < 1.2, "{what}, {way}: {mean} of the light, {most} in a frame");
    }
    Ok(())
}

#[test]
fn lamps_without_power_take_nothing() -> Result<()> {
    let Some(gpu) = gpu()? else { return Ok(()) };
    let mut s = floor();
    s.lights = lamps(2000, |k| if k % 200 == 7 { 3.0 } else { 0.0 });
    energy_is_kept(&gpu, "10 of 2,000 shine", &s, &s, 16)?;
    // None at all.
    s.lights = lamps(100, |_| 0.0);
    for way in ["stages.direct=restir", "stages.direct=clustered"] {
        let [none, _] = light(&gpu, &s, &[way], 2)?;
        ensure!(none == 0.0, "{way}: {none} from lamps without power");
    }
    Ok(())
}

#[test]
fn one_of_a_hundred_million_beside_ten_thousand() -> Result<()> {
    let Some(gpu) = gpu()? else { return Ok(()) };
    let mut s = floor();
    s.lights = lamps(10_000, |k| if k == 5050 { 1e8 } else { 1.0 });
    energy_is_kept(&gpu, "10^8 beside 1", &s, &s, 8)?;
    // And the other way round: the bright one is off, the others are found nevertheless.
    let options = RenderOptions { width: SIZE[0], height: SIZE[1], check: true, ..RenderOptions::default() };
    let mut renderer =
        Renderer::new(&gpu, &s, &Slots::default(), &config(&[&RAW[..], &["stages.direct=restir"]].concat())?, options)?;
    renderer.scale_light(5050, 0.0);
    let request = FrameRequest { camera: &s.cameras[0], time: 0.0, view: None, read_back: true };
    let result = renderer.frame(request)?.context("no frame")?;
    ensure!(result.findings.is_empty(), "{:?}", result.findings);
    Ok(())
}

#[test]
fn all_lamps_in_one_point() -> Result<()> {
    let Some(gpu) = gpu()? else { return Ok(()) };
    let mut s = floor();
    s.lights = lamps(1000, |k| 0.01 * (1.0 + (k % 3) as f32));
    for light in &mut s.lights {
        if let Light::Point { position, .. } = light {
            *position = [0.3, 1.0, 0.2].into();
        }
    }
    energy_is_kept(&gpu, "1,000 in one point", &s, &s, 16)?;
    // Lamps in the floor itself, and a millimetre over it.
    for height in [0.0, 0.001] {
        for light in &mut s.lights {
            if let Light::Point { position, .. } = light {
                position.y = height;
            }
        }
        light(&gpu, &s, &["stages.direct=restir"], 4)?;
    }
    Ok(())
}

#[test]
fn lamps_within_things_light_nothing() -> Result<()> {
    let Some(gpu) = gpu()? else { return Ok(()) };
    let mut s = floor();
    s.lights = lamps(9, |_| 2.0);
    let wanted = s.clone();
    // 200 more, as strong all together, shut into boxes below the floor.
    for k in 0..4_u8 {
        let place = Vec3::new(f32::from(k) - 1.5, -1.0, 0.0);
        let shut = Material { double_sided: true, ..material([0.5; 3], 0.0, 0.8) };
        add(&mut s, block(Vec3::splat(0.3)), shut, Affine3A::from_translation(place));
        for i in 0..50_u8 {
            let position = place.as_dvec3() + DVec3::new(0.01 * f64::from(i % 7), 0.02 * f64::from(i % 5), 0.0);
            s.lights.push(Light::Point { position, intensity: Vec3::splat(0.09), range: None });
        }
    }
    // Clusters have no shadows but the strongest.
    energy_is_kept_by(&["ris", "restir", "light-tree"], &gpu, "200 within boxes", &s, &wanted, 24)
}

#[test]
fn triangles_without_area_emit_nothing() -> Result<()> {
    let Some(gpu) = gpu()? else { return Ok(()) };
    let triangles = if std::env::var_os("MAGPIE_FULL").is_some() { 1_000_000 } else { 50_000_u32 };
    let mut s = floor();
    s.lights = lamps(4, |_| 2.0);
    let wanted = s.clone();
    // Each is a line.
    let positions: Vec<Vec3> = (0..triangles)
        .flat_map(|k| [0.0, 0.1, 0.2].map(|x| Vec3::new(x + 1e-3 * (k % 997) as f32, 1.0, 0.0)))
        .collect();
    let normals = vec![Vec3::Y; positions.len()];
    let lines: Mesh = mesh("lines", positions, normals, (0..3 * triangles).collect());
    let emits = Material { emission: Vec3::splat(10.0), ..material([0.5; 3], 0.0, 0.8) };
    add(&mut s, lines, emits, Affine3A::IDENTITY);
    energy_is_kept(&gpu, "emissive lines", &s, &wanted, 8)
}
