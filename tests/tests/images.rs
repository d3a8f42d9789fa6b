//! Image tests: the output of each effect on the courtyard against a golden, with further checks.
use anyhow::{Context, Result, ensure};
use glam::{Affine3A, Quat, Vec3};
use magpie::pixels::Pixels;
use magpie::prelude::Rays;
use magpie::scene::{Daylight, Environment, Scene};
use magpie_passes::{FrameRequest, FrameResult, RenderOptions, Renderer, Slots};
use magpie_tests::fixtures;
use magpie_tests::harness::{builtin, compare_with_golden, config, display, gpu, linear, render};

#[path = "images/ao.rs"]
mod ao;
#[path = "images/metrics.rs"]
mod metrics;
#[path = "images/reference.rs"]
mod reference;

const SIZE: [u32; 2] = [240, 135];
/// Greatest difference from a golden. Drivers round differently; a black, shifted or unshadowed picture exceeds this by far.
const LIMIT: f64 = 0.01;

/// The output of a pass on the courtyard.
fn output(pass: &str, output: &str, changes: &[&str]) -> Result<Option<Pixels>> {
    let Some(gpu) = gpu()? else { return Ok(None) };
    let scene = builtin("courtyard")?;
    linear(render(&gpu, &scene, &config(changes)?, SIZE, 2, Some((pass, output)))?).map(Some)
}

fn golden(name: &str, image: Option<&Pixels>) -> Result<()> {
    image.map_or(Ok(()), |image| compare_with_golden(name, image, LIMIT))
}

#[test]
fn gbuffer() -> Result<()> {
    for name in ["base_colour", "normal", "material", "depth", "ids"] {
        golden(&format!("gbuffer.{name}"), output("gbuffer.draw", name, &[])?.as_ref())?;
    }
    // Only the lantern's glass emits: too little of the picture for a golden.
    if let Some(emission) = output("gbuffer.draw", "emission", &[])? {
        let glowing = emission.values().iter().filter(|v| v[0] > 1.0 && v[0] > v[2]).count();
        let dark = emission.values().iter().filter(|v| v[..3] == [0.0; 3]).count();
        assert!((1..100).contains(&glowing), "{glowing} pixels glow");
        assert_eq!(glowing + dark, emission.values().len(), "all others emit nothing");
    }
    // With a static camera and static objects there is no motion.
    if let Some(motion) = output("gbuffer.draw", "motion", &[])? {
        assert!(motion.values().iter().all(|v| v[0].abs() < 1e-6 && v[1].abs() < 1e-6));
    }
    Ok(())
}

#[test]
fn shadows() -> Result<()> {
    let Some(image) = output("shadows.trace", "visibility", &["shadows.edges=hard"])? else { return Ok(()) };
    let values = image.values();
    let lit = values.iter().filter(|v| v[0] == 1.0).count() as f64 / values.len() as f64;
    assert!(values.iter().all(|v| v[0] == 0.0 || v[0] == 1.0), "hard shadows are 0 or 1");
    assert!((0.1..0.9).contains(&lit), "{lit} of the pixels see the sun");
    golden("shadows", Some(&image))
}

#[test]
fn denoise() -> Result<()> {
    // Soft shadows after a few frames: less noise than one ray, and fully lit or dark pixels are unchanged.
    let Some(noisy) = output("shadows.trace", "visibility", &[])? else { return Ok(()) };
    let Some(image) = output("shadows.level_3", "result", &["shadows.precision=32"])? else { return Ok(()) };
    let between = |image: &Pixels| image.values().iter().filter(|v| v[0] > 0.0 && v[0] < 1.0).count();
    ensure!(between(&noisy) == 0 && between(&image) > 100, "{} and {}", between(&noisy), between(&image));
    golden("denoise", Some(&image))
}

#[test]
fn direct() -> Result<()> {
    let Some(image) = output("direct.shade", "radiance", &[])? else { return Ok(()) };
    let Some(unshadowed) = output("direct.shade", "radiance", &["stages.shadows=off"])? else { return Ok(()) };
    let darker = image.values().iter().zip(unshadowed.values()).filter(|(a, b)| a[1] < b[1] * 0.5).count();
    let brighter = image.values().iter().zip(unshadowed.values()).filter(|(a, b)| a[1] > b[1]).count();
    assert!(darker > 500, "shadows darken {darker} pixels");
    assert_eq!(brighter, 0, "no shadow makes a pixel brighter");
    golden("direct", Some(&image))
}

#[test]
fn gi() -> Result<()> {
    golden("gi", output("gi.gather", "radiance", &[])?.as_ref())?;
    golden("gi.sky", output("gi.sky", "radiance", &["stages.gi=sky"])?.as_ref())
}

#[test]
fn reflections() -> Result<()> {
    golden("reflections", output("reflections.sky", "radiance", &[])?.as_ref())
}

#[test]
fn compose() -> Result<()> {
    let (Some(sum), Some(exact), Some(direct), Some(gi), Some(reflections)) = (
        output("compose.sum", "lit", &[])?,
        output("compose.sum", "lit", &["compose.precision=32"])?,
        output("direct.shade", "radiance", &[])?,
        output("gi.gather", "radiance", &[])?,
        output("reflections.sky", "radiance", &[])?,
    ) else {
        return Ok(());
    };
    let parts = direct.values().into_iter().zip(gi.values()).zip(reflections.values());
    let sums = sum.values().into_iter().zip(exact.values());
    for (pixel, ((sum, exact), ((d, g), r))) in sums.zip(parts).enumerate() {
        for c in 0..3 {
            let expected = d[c] + g[c] + r[c];
            let off = (exact[c] - expected).abs();
            assert!(off <= 1e-6 * expected.max(1.0), "pixel {pixel}: {} is not {expected}", exact[c]);
            // By default, the nearest number with a mantissa of ten bits.
            let off = (sum[c] - expected).abs();
            assert!(off <= 0.5_f32.powi(11) * expected.max(1e-4), "pixel {pixel}: {} is not {expected}", sum[c]);
        }
    }
    golden("compose", Some(&sum))
}

#[test]
fn sky() -> Result<()> {
    golden("sky", output("sky.fill", "lit", &[])?.as_ref())
}

/// A floor and three balls: white, polished metal, glossy blue. Lit by an environment map only.
#[test]
fn sky_of_an_environment_map() -> Result<()> {
    let Some(gpu) = gpu()? else { return Ok(()) };
    let mut scene = fixtures::scene("surrounded", fixtures::camera(Vec3::new(0.0, 1.3, 5.0), Vec3::new(0.0, 0.9, 0.0)));
    fixtures::add(&mut scene, fixtures::plane(4.0), fixtures::material([0.5; 3], 0.0, 0.9), Affine3A::IDENTITY);
    let balls = [([0.9; 3], 0.0, 1.0), ([0.95, 0.93, 0.9], 1.0, 0.0), ([0.05, 0.1, 0.5], 0.0, 0.2)];
    for (i, (colour, metalness, roughness)) in balls.into_iter().enumerate() {
        let at = Vec3::new(1.5 * (i as f32 - 1.0), 0.65, 0.0);
        let place = Affine3A::from_scale_rotation_translation(Vec3::splat(0.65), Quat::IDENTITY, at);
        fixtures::add(&mut scene, fixtures::sphere(48), fixtures::material(colour, metalness, roughness), place);
    }
    scene.environment = Some(Environment { turn: 0.3, ..fixtures::environment() });
    let picture = |scene: &Scene| display(render(&gpu, scene, &config(&[])?, SIZE, 1, None)?);
    let seen = picture(&scene)?;
    golden("sky.environment", Some(&seen))?;
    // The environment map replaces the analytic sky.
    scene.daylight = Some(Daylight::default());
    ensure!(picture(&scene)?.bytes == seen.bytes, "daylight shows beside the map");
    scene.environment = None;
    ensure!(picture(&scene)?.bytes != seen.bytes, "the map shows without being there");
    Ok(())
}

#[test]
fn post() -> Result<()> {
    let Some(gpu) = gpu()? else { return Ok(()) };
    let scene = builtin("courtyard")?;
    for curve in ["agx", "aces", "none"] {
        let picture = render(&gpu, &scene, &config(&[&format!("post.tone_map={curve}")])?, SIZE, 1, None)?;
        compare_with_golden(&format!("post.{curve}"), &display(picture)?, LIMIT)?;
    }
    // Two stops are a factor of four.
    let picture = |stops: &str| -> Result<Pixels> {
        let changes = ["post.tone_map=none", stops];
        display(render(&gpu, &scene, &config(&changes)?, SIZE, 1, None)?)
    };
    let (dark, bright) = (picture("post.exposure=-4.0")?, picture("post.exposure=-2.0")?);
    let decoded = |p: &Pixels| Pixels { format: magpie::graph::Format::Rgba8Srgb, ..p.clone() }.values();
    for (d, b) in decoded(&dark).into_iter().zip(decoded(&bright)) {
        if b[1] < 0.9 && d[1] > 0.05 {
            assert!((b[1] / d[1] - 4.0).abs() < 0.4, "{} against {}", b[1], d[1]);
        }
    }
    Ok(())
}

#[test]
fn cornell() -> Result<()> {
    let Some(gpu) = gpu()? else { return Ok(()) };
    let picture = render(&gpu, &builtin("cornell")?, &config(&[])?, [128, 128], 1, None)?;
    compare_with_golden("cornell", &display(picture)?, LIMIT)
}

/// The carousel at a time, with this backend for rays.
fn carousel(rays: Rays, time: f64) -> Result<Option<FrameResult>> {
    let Some(gpu) = gpu()? else { return Ok(None) };
    if !gpu.rays().contains(&rays) {
        eprintln!("skipped: {} has no rays by {rays}", gpu.report().name);
        return Ok(None);
    }
    let scene = builtin("carousel")?;
    let options = RenderOptions { width: SIZE[0], height: SIZE[1], check: true, rays, ..RenderOptions::default() };
    let mut renderer = Renderer::new(&gpu, &scene, &Slots::default(), &config(&[])?, options)?;
    let mut frame = |time, read_back| {
        let request = FrameRequest { camera: &scene.cameras[0], time, view: None, read_back };
        renderer.frame(request)?.context("a size of zero")
    };
    for step in 0..3 {
        ensure!(frame(time - 0.1 * f64::from(3 - step), false)?.findings.is_empty(), "step {step}");
    }
    frame(time, true).map(Some)
}

fn picture(result: &FrameResult) -> Result<&Pixels> {
    let images = result.images.as_ref().context("no image was read back")?;
    images.display.as_ref().context("no display image")
}

#[test]
fn acceleration_moves_the_carousel_for_every_way_to_trace() -> Result<()> {
    let Some(first) = carousel(Rays::Software, 0.5)? else { return Ok(()) };
    golden("acceleration", Some(picture(&first)?))?;
    let ran = |result: &FrameResult, name: &str| result.sample.passes.iter().any(|p| p.name.starts_with(name));
    for name in ["scene.update", "acceleration.deform", "acceleration.refit", "acceleration.top"] {
        ensure!(ran(&first, name), "{name} did not run");
    }
    let pixels = |image: &Pixels| image.bytes.chunks_exact(4).map(<[u8]>::to_vec).collect::<Vec<_>>();
    let other = carousel(Rays::Software, 1.5)?.context("the device was there before")?;
    let differ = |a: &FrameResult, b: &FrameResult| -> Result<usize> {
        Ok(pixels(picture(a)?).iter().zip(pixels(picture(b)?)).filter(|(a, b)| **a != *b).count())
    };
    let moved = differ(&first, &other)?;
    ensure!(moved > 3000, "only {moved} pixels changed in a second");
    for rays in [Rays::Query, Rays::Pipeline] {
        let Some(result) = carousel(rays, 0.5)? else { continue };
        let off = differ(&first, &result)?;
        println!("{rays}: {off} pixels differ from software");
        // A shadow's edge may fall on another side of a pixel's centre.
        ensure!(
            off * 1000 < first.images.as_ref().map_or(0, |i| i.linear.values().len()),
            "{rays}: {off} pixels differ"
        );
    }
    Ok(())
}

#[test]
fn acceleration_of_what_stands_still_costs_nothing() -> Result<()> {
    let Some(gpu) = gpu()? else { return Ok(()) };
    let scene = builtin("cornell")?;
    let result = render(&gpu, &scene, &config(&[])?, SIZE, 2, None)?;
    let names: Vec<_> =
        result.declaration.passes.iter().zip(0..).map(|(_, i)| result.declaration.pass_name(i)).collect();
    let moving =
        |name: &&&str| name.starts_with("scene.") || name.starts_with("acceleration.") || name.starts_with("rays.");
    ensure!(!names.iter().any(|name| moving(&name)), "{names:?}");
    Ok(())
}

#[test]
fn rays_are_dearer_through_foliage_than_on_walls() -> Result<()> {
    let Some(image) = output("rays.heat_map", "steps", &["stages.rays=heat-map"])? else { return Ok(()) };
    let values = image.values();
    let steps = |v: &[f32; 4]| v[0] + v[1];
    ensure!(values.iter().all(|v| v[0] >= 1.0), "every ray looks at the root");
    let mut sorted: Vec<f32> = values.iter().map(steps).collect();
    sorted.sort_by(f32::total_cmp);
    let (median, hot) = (sorted[sorted.len() / 2], sorted[sorted.len() * 99 / 100]);
    println!("steps of a ray: median {median}, 99th percentile {hot}");
    ensure!(median < 80.0 && hot > 2.0 * median, "median {median}, 99th percentile {hot}");
    Ok(())
}
