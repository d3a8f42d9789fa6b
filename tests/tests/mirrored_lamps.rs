//! Lamps that smooth floors mirror, denoised, against the reference: specular light is apart from diffuse light there, and nowhere else.
use anyhow::{Context, Result, ensure};
use glam::{Affine3A, DVec3, Quat, Vec3, Vec4};
use magpie::gpu::Gpu;
use magpie::scene::{AlphaMode, Camera, Light, Material, Mesh, Scene, Sphere};
use magpie_passes::reference::Estimate;
use magpie_passes::{FrameRequest, RenderOptions, Renderer, Slots};
use magpie_tests::against::{Shown, relmse, truth};
use magpie_tests::fixtures::{add, block, camera, material, plane, scene};
use magpie_tests::harness::{config, gpu, linear};
use std::f32::consts::PI;

const SHOWN: Shown = Shown { size: [64, 36], time: 0.0 };
/// The rest of the frame costs time and shows nothing.
const ALONE: [&str; 5] =
    ["stages.gi=off", "stages.reflections=off", "stages.ao=off", "stages.shadows=off", "gbuffer.precision=full"];
const APART: &str = "direct.split=0.3";
const TOGETHER: &str = "direct.split=0";

/// The camera `along` metres to the right.
fn seen_from(along: f64) -> Camera {
    camera([along, 1.2, 4.0], [along, 0.2, -1.0])
}

/// A floor with lamps in rows behind it, half hidden by boards. As balls of an emissive mesh, or as lights.
fn floor(roughness: f32, are_lights: bool) -> Scene {
    let mut s = scene("floor", seen_from(0.0));
    add(&mut s, plane(8.0), material([0.25, 0.22, 0.2], 0.0, roughness), Affine3A::IDENTITY);
    for k in 0..4_u8 {
        let place = Vec3::new(1.2 * f32::from(k) - 2.0, 0.25, -0.6);
        add(
            &mut s,
            block(Vec3::new(0.06, 0.25, 0.03)),
            material([0.5; 3], 0.0, 0.9),
            Affine3A::from_translation(place),
        );
    }
    let mut balls = Vec::new();
    for k in 0..24_u8 {
        let (column, row) = (f32::from(k % 8), f32::from(k / 8));
        let centre = Vec3::new(0.9 * column - 3.1 + 0.2 * row, 0.5 + 0.45 * row, -2.0 - 0.5 * row);
        let hue = |phase: f32| 0.55 + 0.45 * (1.7 * f32::from(k) + phase).sin();
        if are_lights {
            let radiance = 40.0 * Vec3::new(hue(0.0), hue(2.1), hue(4.2));
            s.lights.push(Light::Sphere { centre: centre.as_dvec3(), radius: 0.1, radiance });
        } else {
            balls.push(Sphere { centre, radius: 0.1 });
        }
    }
    if !are_lights {
        let emits = Material { emission: Vec3::new(30.0, 22.0, 12.0), ..material([0.5; 3], 0.0, 1.0) };
        add(&mut s, Mesh { name: "balls".to_owned(), spheres: balls, ..Mesh::default() }, emits, Affine3A::IDENTITY);
    }
    s
}

/// The same behind a veil of a third.
fn behind_a_veil() -> Scene {
    let mut s = floor(0.02, true);
    let veil = Material {
        base_colour: Vec4::new(0.2, 0.5, 0.9, 0.33),
        alpha: AlphaMode::Blend,
        double_sided: true,
        ..material([0.0; 3], 0.0, 1.0)
    };
    let upright = Affine3A::from_rotation_translation(Quat::from_rotation_x(0.5 * PI), Vec3::new(-1.5, 1.0, -1.2));
    add(&mut s, plane(1.5), veil, upright);
    s
}

/// Light of the slot in one of the frames, its passes, and memory.
struct Ran {
    light: Vec<DVec3>,
    passes: Vec<String>,
    /// Read and written, of images of a frame, and kept for the next.
    bytes: [u64; 3],
}

/// The frames, counted from 1, of a camera that goes so many metres to the right from frame to frame, and ends where the scene's is.
fn run(gpu: &Gpu, scene: &Scene, changes: &[&str], speed: f64, frames: &[u32]) -> Result<Vec<Ran>> {
    let [width, height] = SHOWN.size;
    let options = RenderOptions { width, height, check: true, ..RenderOptions::default() };
    let config = config(&[&ALONE, changes].concat())?;
    let mut renderer = Renderer::new(gpu, scene, &Slots::default(), &config, options)?;
    renderer.read_slots(&["direct"])?;
    let last = frames.iter().copied().max().unwrap_or_default();
    let mut ran = Vec::new();
    for frame in 1..=last {
        let camera = seen_from(speed * (f64::from(frame) - f64::from(last)));
        let request = FrameRequest { camera: &camera, time: 0.0, view: None, read_back: frames.contains(&frame) };
        let result = renderer.frame(request)?.context("no frame")?;
        ensure!(result.findings.is_empty(), "frame {frame}: {}", result.findings[0]);
        if frames.contains(&frame) {
            let image = result.slots[0].1.as_ref().context("no light")?;
            let of_slot = |name: &str| name.strip_prefix("direct.").map(str::to_owned);
            let reports = result.what_runs();
            let report = reports.iter().find(|report| report.slot == "direct").context("no slot")?;
            ran.push(Ran {
                light: image.values().iter().map(|v| Vec3::new(v[0], v[1], v[2]).as_dvec3()).collect(),
                passes: result.sample.passes.iter().filter_map(|p| of_slot(&p.name)).collect(),
                bytes: [report.bytes, report.transient_bytes, report.history_bytes],
            });
        }
    }
    Ok(ran)
}

/// relMSE, and the root mean square error of tone-mapped values, in which a bright lamp counts no more than a lit surface.
fn errors(ran: &Ran, truth: &Estimate) -> [f64; 2] {
    let tone = |v: &DVec3| *v / (*v + DVec3::ONE);
    let square: f64 = ran.light.iter().zip(&truth.mean).map(|(f, t)| (tone(f) - tone(t)).length_squared()).sum();
    [relmse(&ran.light, truth)[0], (square / ran.light.len() as f64).sqrt()]
}

/// Scenes and ways to light them.
fn ways() -> [(&'static str, &'static [&'static str], bool); 4] {
    [
        ("ris", &["stages.direct=ris"], true),
        ("restir", &["stages.direct=restir"], true),
        ("emissive meshes", &["stages.direct=all-lights"], false),
        ("light-tree", &["stages.direct=light-tree"], true),
    ]
}

/// Errors while nothing moves, and while the camera does, with specular light apart and together with diffuse light.
#[test]
fn mirrored_lamps_stay_sharp() -> Result<()> {
    let Some(gpu) = gpu()? else { return Ok(()) };
    for roughness in [0.02, 0.15] {
        for (what, way, are_lights) in ways() {
            // Of glossy floors, the default alone where time is short.
            if roughness > 0.1 && what != "light-tree" && std::env::var_os("MAGPIE_FULL").is_none() {
                continue;
            }
            let scene = floor(roughness, are_lights);
            let wanted = truth(&gpu, &scene, SHOWN, 512)?;
            let noise = relmse(&wanted.mean, &wanted)[1];
            // A mirror needs its history for rays to emissive meshes, which follow its lobe in every second frame; while the camera moves it lags behind.
            // On glossy surfaces one such ray is so noisy that light apart is no better in the first frames.
            let [still, moving] = match (are_lights, roughness < 0.1) {
                (true, _) => [[0.5, 0.7], [0.5, 0.9]],
                (false, true) => [[0.75; 2], [0.95, 0.9]],
                (false, false) => [[1.8, 1.1]; 2],
            };
            for (speed, frames, most) in [(0.0, &[8, 32][..], still), (0.03, &[16], moving)] {
                let of = |split: &str| run(&gpu, &scene, &[way, &[split]].concat(), speed, frames);
                for ((apart, together), frame) in of(APART)?.iter().zip(&of(TOGETHER)?).zip(frames) {
                    ensure!(has_own(apart) && !has_own(together), "{:?}, {:?}", apart.passes, together.passes);
                    let ([apart, tone], [together, tone_together]) =
                        (errors(apart, &wanted), errors(together, &wanted));
                    println!(
                        "{what}, roughness {roughness}, {speed} m per frame, frame {frame}: relMSE {apart:.3}, together \
                         {together:.3}; tone-mapped {tone:.4}, together {tone_together:.4}; noise of the truth {noise:.1e}"
                    );
                    let shares = [apart / together, tone / tone_together];
                    ensure!(
                        shares.iter().zip(most).all(|(share, most)| *share < most),
                        "{what}, roughness {roughness}, frame {frame}: {shares:.3?} of the errors"
                    );
                }
            }
        }
    }
    Ok(())
}

/// Whether specular light has a denoiser of its own.
fn has_own(ran: &Ran) -> bool {
    ran.passes.iter().any(|pass| pass.ends_with("_specular"))
}

/// The light is that of the reference but for a little that the denoiser takes for outliers, behind a veil too.
#[test]
fn hardly_any_light_is_lost() -> Result<()> {
    let Some(gpu) = gpu()? else { return Ok(()) };
    for (what, scene) in [("clear", floor(0.02, true)), ("veil", behind_a_veil())] {
        let wanted = truth(&gpu, &scene, SHOWN, 512)?;
        for (way, changes, _) in &ways()[..2] {
            let frames: Vec<u32> = (9..=40).collect();
            let ran = run(&gpu, &scene, &[changes, &[APART][..]].concat(), 0.0, &frames)?;
            let light: DVec3 = ran.iter().flat_map(|ran| &ran.light).sum::<DVec3>() / ran.len() as f64;
            let share = light / wanted.mean.iter().sum::<DVec3>();
            let [error, tone] = errors(&ran[ran.len() - 1], &wanted);
            println!("{what}, {way}: {share:.4} of the light, relMSE {error:.3}, tone-mapped {tone:.4}");
            ensure!((share - 1.0).abs().max_element() < 0.05, "{what}, {way}: {share} of the light");
            ensure!(error < 0.3, "{what}, {way}: relMSE {error}");
        }
    }
    Ok(())
}

/// A rough floor with a mirror in it: what is rough is denoised as in a scene without mirrors, together.
#[test]
fn rough_surfaces_beside_a_mirror_are_not_split() -> Result<()> {
    let Some(gpu) = gpu()? else { return Ok(()) };
    let mut scene = floor(0.5, true);
    let place = Affine3A::from_translation(Vec3::new(-0.4, 0.01, 0.8));
    add(&mut scene, plane(1.2), material([0.25, 0.22, 0.2], 0.0, 0.02), place);
    // Ids count instances from 1.
    let mirror = scene.instances.len() as u32;
    let [width, height] = SHOWN.size;
    let options = RenderOptions { width, height, check: true, ..RenderOptions::default() };
    let mut renderer = Renderer::new(&gpu, &scene, &Slots::default(), &config(&ALONE)?, options)?;
    let view = Some(("gbuffer.draw", "ids"));
    let request = FrameRequest { camera: &scene.cameras[0], time: 0.0, view, read_back: true };
    let ids = linear(renderer.frame(request)?.context("no frame")?)?;
    let instances = ids.bytes.as_chunks::<8>().0.iter().map(|b| u32::from_le_bytes([b[0], b[1], b[2], b[3]]));
    let is_mirror: Vec<bool> = instances.map(|instance| instance == mirror).collect();
    let count = is_mirror.iter().filter(|is| **is).count();
    ensure!((50..is_mirror.len() / 3).contains(&count), "{count} pixels show the mirror");

    let wanted = truth(&gpu, &scene, SHOWN, 512)?;
    let tone = |v: DVec3| v / (v + DVec3::ONE);
    for way in ["stages.direct=light-tree", "stages.direct=ris"] {
        let error_of = |split: &str| -> Result<[f64; 2]> {
            let ran = run(&gpu, &scene, &[way, split], 0.0, &[32])?;
            ensure!(has_own(&ran[0]) == (split == APART), "{:?}", ran[0].passes);
            let mut sums = [0.0; 2];
            for ((light, truth), is_mirror) in ran[0].light.iter().zip(&wanted.mean).zip(&is_mirror) {
                sums[usize::from(*is_mirror)] += (tone(*light) - tone(*truth)).length_squared();
            }
            Ok([sums[0] / (is_mirror.len() - count) as f64, sums[1] / count as f64].map(f64::sqrt))
        };
        let (apart, together) = (error_of(APART)?, error_of(TOGETHER)?);
        println!("{way}: tone-mapped, rough and mirror: {apart:.4?}, together {together:.4?}");
        ensure!(apart[0] < 1.05 * together[0], "{way}: rough surfaces have {apart:?}, together {together:?}");
        ensure!(apart[1] < 0.7 * together[1], "{way}: the mirror has {apart:?}, together {together:?}");
    }
    Ok(())
}

/// A scene of rough surfaces pays nothing, and neither does one whose light no denoiser filters.
#[test]
fn only_smooth_scenes_pay() -> Result<()> {
    let Some(gpu) = gpu()? else { return Ok(()) };
    for (what, way, are_lights) in ways() {
        let cost = |roughness: f32, changes: &[&str]| -> Result<(Vec<String>, [u64; 3])> {
            let ran = run(&gpu, &floor(roughness, are_lights), &[way, changes].concat(), 0.0, &[1])?;
            Ok((ran[0].passes.clone(), ran[0].bytes))
        };
        ensure!(cost(0.9, &[APART])? == cost(0.9, &[TOGETHER])?, "{what}: a rough scene pays");
        let raw = "direct.denoiser=none";
        ensure!(cost(0.02, &[APART, raw])? == cost(0.02, &[TOGETHER, raw])?, "{what}: pays without a denoiser");
        // Of a coat nothing is known but that there is one; that alone must not split.
        let mut coated = floor(0.9, are_lights);
        coated.materials.iter_mut().for_each(|material| material.clearcoat = 1.0);
        for changes in [&[TOGETHER][..], &[APART, raw]] {
            let ran = run(&gpu, &coated, &[way, changes].concat(), 0.0, &[1])?;
            ensure!(!has_own(&ran[0]), "{what}, {changes:?}, coated: {:?}", ran[0].passes);
        }
        let (smooth, plain) = (cost(0.02, &[APART])?.1, cost(0.02, &[TOGETHER])?.1);
        println!("{what}: {smooth:?} bytes, together {plain:?}");
        ensure!(smooth.iter().zip(&plain).all(|(a, b)| a > b), "{what}: {smooth:?} bytes, together {plain:?}");
    }
    Ok(())
}

/// Where a mirror shows a lamp its distance is that of the lamp, and no filter is wider than the lobe.
#[test]
fn hints_are_those_of_the_lamps() -> Result<()> {
    let Some(gpu) = gpu()? else { return Ok(()) };
    let scene = floor(0.02, true);
    let [width, height] = SHOWN.size;
    for (way, changes, _) in &ways()[..2] {
        let image = |output: &str| -> Result<Vec<[f32; 4]>> {
            let options = RenderOptions { width, height, check: true, ..RenderOptions::default() };
            let config = config(&[&ALONE, *changes, &[APART][..]].concat())?;
            let mut renderer = Renderer::new(&gpu, &scene, &Slots::default(), &config, options)?;
            let view = Some(("direct.sampled", output));
            let request = FrameRequest { camera: &scene.cameras[0], time: 0.0, view, read_back: true };
            linear(renderer.frame(request)?.context("no frame")?).map(|pixels| pixels.values())
        };
        let (specular, distance, lobe) = (image("specular")?, image("hit_distance")?, image("width")?);
        let bright = |v: &[f32; 4]| v[0] + v[1] + v[2] > 5.0;
        let of_lamps = |hint: &[[f32; 4]]| -> Vec<f32> {
            specular.iter().zip(hint).filter(|(s, _)| bright(s)).map(|(_, hint)| hint[0]).collect()
        };
        let (lamps, widths) = (of_lamps(&distance), of_lamps(&lobe));
        println!("{way}: {} pixels show lamps", lamps.len());
        ensure!(lamps.len() > 20, "{way}: {} pixels show lamps", lamps.len());
        // From the floor between camera and lamps to one of them.
        ensure!(lamps.iter().all(|d| (0.5..6.0).contains(d)), "{way}: {lamps:?}");
        ensure!(widths.iter().all(|w| 64.0 * w < 1.0), "{way}: the lobe of a mirror is wider than a pixel");
    }
    Ok(())
}
