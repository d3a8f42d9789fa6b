//! The example of docs/how-to-add-a-pass.md: a pass outside the engine's crates.
use anyhow::{Context, Result, ensure};
use magpie::config::Config;
use magpie_passes::{FrameRequest, RenderOptions, Renderer, Slots};
use magpie_tests::harness::{builtin, gpu};
use std::collections::BTreeSet;
use std::path::Path;

#[path = "../../demo/examples/own_pass.rs"]
#[allow(dead_code)] // its `main` is not used here
mod own_pass;

const WIDTH: u32 = 96;
const HEIGHT: u32 = 54;

/// The display image of the courtyard, and the names of the passes that ran.
type Displayed = (Vec<u8>, Vec<String>);

/// The result of one frame.
fn display(slots: &Slots, config: &Config) -> Result<Option<Displayed>> {
    Ok(displays(slots, config, 1)?.and_then(|mut frames| frames.pop()))
}

/// The results of several frames.
fn displays(slots: &Slots, config: &Config, frames: usize) -> Result<Option<Vec<Displayed>>> {
    let Some(gpu) = gpu()? else { return Ok(None) };
    let scene = builtin("courtyard")?;
    let options = RenderOptions { width: WIDTH, height: HEIGHT, seed: 0, check: true, ..RenderOptions::default() };
    let mut renderer = Renderer::new(&gpu, &scene, slots, config, options)?;
    let mut one = || {
        let request = FrameRequest { camera: &scene.cameras[0], time: 0.0, view: None, read_back: true };
        let result = renderer.frame(request)?.context("a size of zero")?;
        ensure!(result.findings.is_empty(), "{}", result.findings[0]);
        let display = result.images.and_then(|i| i.display).context("no picture")?;
        Ok((display.bytes, result.sample.passes.into_iter().map(|p| p.name).collect()))
    };
    Ok(Some((0..frames).map(|_| one()).collect::<Result<_>>()?))
}

#[test]
fn the_example_darkens_the_corners_and_not_the_centre() -> Result<()> {
    let (slots, config) = own_pass::slots_with_vignette(0.8)?;
    let (Some((with, passes)), Some((without, plain))) =
        (display(&slots, &config)?, display(&Slots::default(), &Config::default())?)
    else {
        return Ok(());
    };
    ensure!(passes.iter().any(|p| p == "post.vignette"), "no such pass: {passes:?}");
    ensure!(!plain.iter().any(|p| p == "post.vignette"), "{plain:?}");
    let mut darker = 0;
    for (i, (with, without)) in with.chunks_exact(4).zip(without.chunks_exact(4)).enumerate() {
        let (x, y) = (i as u32 % WIDTH, i as u32 / WIDTH);
        let (dx, dy) = ((f64::from(x) + 0.5) / f64::from(WIDTH) - 0.5, (f64::from(y) + 0.5) / f64::from(HEIGHT) - 0.5);
        let light = 1.0 - 1.6 * (dx * dx + dy * dy);
        for c in 0..3 {
            let expected = f64::from(without[c]) * light;
            ensure!((f64::from(with[c]) - expected).abs() <= 1.0, "({x}, {y}): {} is not {expected}", with[c]);
        }
        ensure!(with[3] == without[3], "({x}, {y}): alpha changed");
        let corner = (x == 0 || x == WIDTH - 1) && (y == 0 || y == HEIGHT - 1);
        darker += u32::from(corner && with[1] < without[1]);
    }
    ensure!(darker == 4, "{darker} corners are darker");
    let centre = 4 * (HEIGHT / 2 * WIDTH + WIDTH / 2) as usize;
    ensure!(with[centre..centre + 4] == without[centre..centre + 4], "the centre changed");
    Ok(())
}

/// With a vignette of strength 0, the configuration of the wrapped `post` gives the same frames, bit for bit, as without the wrapper:
/// exposure, TAA, jitter and resolution.
#[test]
fn the_settings_of_the_wrapped_post_act_as_they_do_without_the_wrapper() -> Result<()> {
    let settings = ["exposure=-6", "anti_aliasing=taa", "resolution_scale=0.5", "sharpening=0.5", "tone_map=aces"];
    let mut last: Option<Vec<u8>> = None;
    for count in [0, 1, 2, settings.len()] {
        let (slots, mut wrapped) = own_pass::slots_with_vignette(0.0)?;
        let mut plain = Config::default();
        for setting in &settings[..count] {
            wrapped.set(&format!("post.{setting}"))?;
            plain.set(&format!("post.{setting}"))?;
        }
        slots.catalogue().check(&wrapped, "test")?;
        let frames = 2;
        let (Some(with), Some(without)) =
            (displays(&slots, &wrapped, frames)?, displays(&Slots::default(), &plain, frames)?)
        else {
            return Ok(());
        };
        for (at, ((with, passes), (without, plain))) in with.iter().zip(&without).enumerate() {
            let set = &settings[..count];
            ensure!(with == without, "frame {at} with {set:?} differs from that of the standard post");
            // The vignette's memory may let others run in another order.
            let others: BTreeSet<_> = passes.iter().filter(|p| *p != "post.vignette").collect();
            ensure!(
                others == plain.iter().collect() && passes.len() == plain.len() + 1,
                "{set:?}: {others:?}, {plain:?}"
            );
            ensure!(passes.contains(&"post.taa".to_owned()) == (count > 1), "{set:?}: {passes:?}");
        }
        let picture = with.into_iter().next_back().map(|(picture, _)| picture);
        ensure!(picture != last, "{:?} changes nothing", settings[..count].last());
        last = picture;
    }
    Ok(())
}

#[test]
fn the_settings_of_the_wrapped_post_are_listed_and_checked() -> Result<()> {
    let (slots, config) = own_pass::slots_with_vignette(0.5)?;
    let post = slots.infos().into_iter().find(|slot| slot.name == "post").context("no post")?;
    let keys = |name: &str| -> Vec<&str> {
        post.implementation(name).map(|i| i.settings.iter().map(|s| s.key).collect()).unwrap_or_default()
    };
    let wanted: Vec<_> = std::iter::once("vignette").chain(keys("standard")).collect();
    ensure!(keys("vignette") == wanted && wanted.len() > 4, "{:?}", keys("vignette"));
    ensure!(post.mistakes().is_empty(), "{:?}", post.mistakes());
    let mut wrong = config;
    wrong.set("post.exposure=99")?;
    let message = slots.catalogue().check(&wrong, "test").map_err(|e| e.to_string());
    ensure!(message.as_ref().is_err_and(|m| m.contains("post.exposure") && m.contains("99")), "{message:?}");
    Ok(())
}

#[test]
fn its_settings_are_checked_as_those_of_any_stage() {
    let error = own_pass::slots_with_vignette(1.5).map(|_| ()).expect_err("1.5 is out of range").to_string();
    assert!(error.contains("post.vignette") && error.contains("1.5"), "{error}");
}

#[test]
fn the_page_shows_the_example_as_it_is() -> Result<()> {
    let root = Path::new(env!("CARGO_MANIFEST_DIR")).join("..");
    let example = std::fs::read_to_string(root.join("demo/examples/own_pass.rs"))?;
    let page = std::fs::read_to_string(root.join("docs/how-to-add-a-pass.md")).context("docs/how-to-add-a-pass.md")?;
    let block = format!("```rust\n{}\n```", example.trim_end());
    ensure!(page.contains(&block), "docs/how-to-add-a-pass.md does not hold demo/examples/own_pass.rs word for word");
    Ok(())
}
