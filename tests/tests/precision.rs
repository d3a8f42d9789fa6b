//! Settings that trade accuracy for time have the stated effect, and slots provide their images with every implementation.
use anyhow::{Context, Result, ensure};
use magpie::graph::Format;
use magpie::pixels::Pixels;
use magpie::scene::Scene;
use magpie_passes::{FrameRequest, FrameResult, RenderOptions, Renderer, Slots};
use magpie_tests::harness::{builtin, config, gpu};

/// Odd, so that half sizes are rounded.
const SIZE: [u32; 2] = [161, 91];

/// One frame with every check on, and the images of these slots.
fn frame(scene: &Scene, changes: &[&str], slots: &[&str]) -> Result<Option<FrameResult>> {
    let Some(gpu) = gpu()? else { return Ok(None) };
    let options = RenderOptions { width: SIZE[0], height: SIZE[1], check: true, ..RenderOptions::default() };
    let mut renderer = Renderer::new(&gpu, scene, &Slots::default(), &config(changes)?, options)?;
    renderer.read_slots(slots)?;
    let request = FrameRequest { camera: &scene.cameras[0], time: 0.0, view: None, read_back: true };
    let result = renderer.frame(request)?.context("a size of zero")?;
    ensure!(result.findings.is_empty(), "{changes:?}: {}", result.findings[0]);
    Ok(Some(result))
}

fn image<'r>(result: &'r FrameResult, slot: &str) -> Result<&'r Pixels> {
    let found = result.slots.iter().find(|(name, _)| name == slot).with_context(|| format!("{slot} was not read"))?;
    found.1.as_ref().with_context(|| format!("{slot} gave no image"))
}

fn has_pass(result: &FrameResult, name: &str) -> bool {
    result.sample.passes.iter().any(|p| p.name == name)
}

#[test]
fn half_resolution_shadows_keep_their_own_pixels_and_err_at_edges_only() -> Result<()> {
    let scene = builtin("courtyard")?;
    let hard = "shadows.edges=hard";
    let Some(full) = frame(&scene, &[hard], &["shadows"])? else { return Ok(()) };
    let half = frame(&scene, &[hard, "shadows.resolution=half"], &["shadows"])?.context("the device is gone")?;
    ensure!(
        !has_pass(&full, "shadows.upsample") && has_pass(&half, "shadows.upsample"),
        "what is not needed costs no pass"
    );
    let of_shadows = |r: &FrameResult| -> u64 {
        r.sample.passes.iter().filter(|p| p.name.starts_with("shadows.")).map(|p| p.rays_any).sum()
    };
    let rays = |r: &FrameResult| of_shadows(r) as f64;
    let share = rays(&half) / rays(&full);
    ensure!((share - 0.25).abs() < 0.01, "{share} of the rays");

    let (a, b) = (image(&full, "shadows")?, image(&half, "shadows")?);
    ensure!(a.extent == b.extent, "{} and {}", a.extent, b.extent);
    let (a, b) = (a.values(), b.values());
    let [width, height] = SIZE.map(|n| n as usize);
    let lit = a.iter().filter(|v| v[0] == 1.0).count();
    ensure!(lit > a.len() / 10 && lit < a.len() * 9 / 10, "{lit} of {} pixels are lit: nothing to compare", a.len());
    let mut wrong = 0;
    for y in 0..height {
        for x in 0..width {
            let at = y * width + x;
            let off = (a[at][0] - b[at][0]).abs();
            ensure!(off == 0.0 || x % 2 == 1 || y % 2 == 1, "pixel {x}, {y} has a ray of its own: off by {off}");
            let around = (y.saturating_sub(1)..=(y + 1).min(height - 1))
                .flat_map(|y| (x.saturating_sub(1)..=(x + 1).min(width - 1)).map(move |x| y * width + x));
            let is_at_an_edge = around.into_iter().any(|other| a[other][0] != a[at][0]);
            ensure!(off < 1e-6 || is_at_an_edge, "pixel {x}, {y} is off by {off}, and all around it is alike");
            wrong += usize::from(off > 0.1);
        }
    }
    let share = wrong as f64 / a.len() as f64;
    println!("half resolution: {:.2} % of the pixels are off by more than 0.1", 100.0 * share);
    ensure!(wrong > 0 && share < 0.2, "{wrong} of {} pixels are wrong", a.len()); // leaves cover the whole picture
    Ok(())
}

#[test]
fn sixteen_bits_round_to_eleven_significant_ones() -> Result<()> {
    let scene = builtin("courtyard")?;
    for slot in ["direct", "gi", "reflections", "compose"] {
        let all = ["direct.precision=32", "gi.precision=32", "reflections.precision=32", "compose.precision=32"];
        let Some(exact) = frame(&scene, &all, &[slot])? else { return Ok(()) };
        let setting = format!("{slot}.precision=16");
        let changes = [&all[..], &[&setting]].concat();
        let rounded = frame(&scene, &changes, &[slot])?.context("the device is gone")?;
        let (a, b) = (image(&exact, slot)?, image(&rounded, slot)?);
        ensure!((a.format, b.format) == (Format::Rgba32Float, Format::Rgba16Float), "{:?}, {:?}", a.format, b.format);
        let (mut worst, mut seen) = (0.0_f32, 0);
        for (a, b) in a.values().into_iter().zip(b.values()) {
            // Half floats below 2^-14 are subnormal, with a constant step.
            for (a, b) in a.into_iter().zip(b).take(3).filter(|(a, _)| *a > 6.2e-5 && *a < 65504.0) {
                worst = worst.max((a - b).abs() / a);
                seen += 1;
            }
        }
        // To nearest, whatever way the device rounds.
        ensure!(seen > 1000 && worst > 1e-5 && worst <= 1.001 / 2048.0, "{slot}: {worst:e} over {seen} numbers");
    }
    Ok(())
}

#[test]
fn the_whole_g_buffer_in_floats_shows_the_same_picture() -> Result<()> {
    let scene = builtin("courtyard")?;
    let Some(compact) = frame(&scene, &[], &["compose"])? else { return Ok(()) };
    let full = frame(&scene, &["gbuffer.precision=full"], &["compose"])?.context("the device is gone")?;
    let (a, b) = (image(&compact, "compose")?.values(), image(&full, "compose")?.values());
    let mean = |v: &[[f32; 4]]| v.iter().map(|p| f64::from(p[0] + p[1] + p[2])).sum::<f64>() / v.len() as f64;
    let off = a.iter().zip(&b).map(|(a, b)| (0..3).map(|c| f64::from((a[c] - b[c]).abs())).sum::<f64>()).sum::<f64>();
    let relative = off / a.len() as f64 / mean(&a);
    println!("compact against full: {relative:.5} of the mean");
    ensure!(
        relative > 1e-6 && relative < 0.01,
        "{relative} of the mean: formats of 8 and 16 bits are not that far off"
    );
    let bytes = |r: &FrameResult| r.sample.memory.transient_unaliased;
    ensure!(bytes(&full) > bytes(&compact) + 30 * u64::from(SIZE[0] * SIZE[1]), "{} bytes", bytes(&full));
    Ok(())
}

#[test]
fn slots_that_are_off_give_nothing_and_the_others_what_their_pass_wrote() -> Result<()> {
    let scene = builtin("courtyard")?;
    let all = ["post", "gi", "shadows", "sky"];
    let Some(result) = frame(&scene, &["stages.shadows=off", "stages.reflections=off"], &all)? else { return Ok(()) };
    let names: Vec<&str> = result.slots.iter().map(|(name, _)| name.as_str()).collect();
    ensure!(names == all, "{names:?}: in the order in which they were asked for");
    ensure!(result.slots[2].1.is_none(), "shadows are off");
    let images = result.images.as_ref().context("the frame's own images")?;
    ensure!(image(&result, "sky")?.bytes == images.linear.bytes, "the sky's image is the frame's radiance");
    ensure!(Some(&image(&result, "post")?.bytes) == images.display.as_ref().map(|d| &d.bytes), "post is the display");
    ensure!(image(&result, "gi")?.values().iter().any(|v| v[0] > 0.0), "gi is black");

    let Some(gpu) = gpu()? else { return Ok(()) };
    let mut renderer = Renderer::new(&gpu, &scene, &Slots::default(), &config(&[])?, RenderOptions::default())?;
    let message = renderer.read_slots(&["shadow"]).err().context("there is no such slot")?.to_string();
    ensure!(message.contains("did you mean \"shadows\"?"), "{message}");
    Ok(())
}
