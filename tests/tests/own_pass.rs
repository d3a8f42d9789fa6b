//! The example of docs/how-to-add-a-pass.md: a pass from outside the engine's crates.
use anyhow::{Context, Result, ensure};
use magpie::config::Config;
use magpie_passes::{FrameRequest, RenderOptions, Renderer, Slots};
use magpie_tests::harness::{builtin, gpu};
use std::path::Path;

#[path = "../../demo/examples/own_pass.rs"]
#[allow(dead_code)] // its `main` writes a file
mod own_pass;

const WIDTH: u32 = 96;
const HEIGHT: u32 = 54;

/// The display image of the courtyard, and the names of the passes that ran.
fn display(slots: &Slots, config: &Config) -> Result<Option<(Vec<u8>, Vec<String>)>> {
    let Some(gpu) = gpu()? else { return Ok(None) };
    let scene = builtin("courtyard")?;
    let options = RenderOptions { width: WIDTH, height: HEIGHT, seed: 0, check: true, ..RenderOptions::default() };
    let mut renderer = Renderer::new(&gpu, &scene, slots, config, options)?;
    let result = renderer.frame(FrameRequest { camera: &scene.cameras[0], time: 0.0, view: None, read_back: true })?;
    let result = result.context("a size of zero")?;
    ensure!(result.findings.is_empty(), "{}", result.findings[0]);
    let display = result.images.and_then(|i| i.display).context("no picture")?;
    let passes = result.sample.passes.into_iter().map(|p| p.name).collect();
    Ok(Some((display.bytes, passes)))
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
