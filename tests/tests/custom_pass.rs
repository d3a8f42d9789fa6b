//! The example of an effect in a slot of one's own: a configuration chooses among its implementations as among Magpie's.
use anyhow::{Result, ensure};
use magpie::config::Config;
use magpie::pixels::Pixels;
use magpie_passes::{RenderOptions, Renderer};
use magpie_tests::harness::{builtin, gpu};

#[path = "../../demo/examples/custom_pass.rs"]
#[allow(dead_code)] // its `main` is not used here
mod custom_pass;

const SIZE: [u32; 2] = [96, 54];

/// A configuration without shadows, which take long, with these changes.
fn config(changes: &[&str]) -> Result<Config> {
    let mut config = Config::default();
    for change in [&["stages.gi=sky", "stages.shadows=off"], changes].concat() {
        config.set(change)?;
    }
    custom_pass::slots().0.catalogue().check(&config, "test")?;
    Ok(config)
}

fn options() -> RenderOptions {
    RenderOptions { width: SIZE[0], height: SIZE[1], check: true, ..RenderOptions::default() }
}

/// The frames after each of these configurations, in one run.
fn frames(configs: &[&[&str]]) -> Result<Option<Vec<[Pixels; 2]>>> {
    let Some(gpu) = gpu()? else { return Ok(None) };
    let scene = builtin("courtyard")?;
    let mut styled = custom_pass::Styled::new(&gpu, &scene, &config(configs[0])?, options())?;
    let mut frames = Vec::new();
    for changes in configs {
        styled.configure(&config(changes)?)?;
        frames.push(styled.frame(&scene)?);
    }
    Ok(Some(frames))
}

fn texels(pixels: &Pixels) -> &[[u8; 4]] {
    pixels.bytes.as_chunks().0
}

#[test]
fn lines_are_dark_and_leave_the_rest() -> Result<()> {
    let (full, none) = (["stages.style=lines", "style.darkness=1"], ["stages.style=lines", "style.darkness=0"]);
    let Some(frames) = frames(&[&full, &none])? else { return Ok(()) };
    let ([plain, lines], [also_plain, without]) = (&frames[0], &frames[1]);
    ensure!(also_plain.bytes == without.bytes, "lines that are not dark change the picture");
    let changed: Vec<[u8; 4]> =
        texels(plain).iter().zip(texels(lines)).filter(|(before, after)| before != after).map(|(_, a)| *a).collect();
    ensure!(changed.iter().all(|texel| *texel == [0, 0, 0, 255]), "a line is not black");
    let share = changed.len() as f64 / texels(plain).len() as f64;
    ensure!((0.01..0.5).contains(&share), "{share} of the picture is lines");
    Ok(())
}

/// Where nothing is near, only haze is left; where nothing is far enough, none is seen.
#[test]
fn haze_lies_between_the_picture_and_grey() -> Result<()> {
    let haze =
        |half| ["stages.style=haze".to_owned(), "style.grey=0.5".to_owned(), format!("style.half_metres={half}")];
    let all = [haze("1e6"), haze("10.0"), haze("0.1")];
    let all: Vec<Vec<&str>> = all.iter().map(|changes| changes.iter().map(String::as_str).collect()).collect();
    let Some(frames) = frames(&all.iter().map(Vec::as_slice).collect::<Vec<_>>())? else { return Ok(()) };
    let [clear, some, thick] = &frames[..] else { unreachable!("three configurations") };
    let grey = |texel: &[u8; 4]| texel[..3].iter().all(|c| c.abs_diff(128) <= 1);
    ensure!(texels(&thick[1]).iter().all(grey), "something is seen through haze that leaves nothing");
    for ((clear, some), plain) in texels(&clear[1]).iter().zip(texels(&some[1])).zip(texels(&clear[0])) {
        // The sky is infinitely far.
        ensure!(grey(clear) || clear.iter().zip(plain).all(|(a, b)| a.abs_diff(*b) <= 1), "{clear:?} is not {plain:?}");
        for c in 0..3 {
            let (low, high) = (plain[c].min(127), plain[c].max(129));
            ensure!((low..=high).contains(&some[c]), "{some:?} is not between {plain:?} and grey");
        }
    }
    ensure!(
        texels(&some[1]).iter().any(|texel| !grey(texel)) && some[1].bytes != clear[1].bytes,
        "haze of one density"
    );
    Ok(())
}

#[test]
fn the_slot_is_swapped_as_any_other() -> Result<()> {
    let (lines, haze) = (["stages.style=lines"], ["stages.style=haze"]);
    let Some(swapped) = frames(&[&lines, &haze, &lines])? else { return Ok(()) };
    let Some(lines) = frames(&[&lines, &lines, &lines])? else { return Ok(()) };
    let Some(haze) = frames(&[&haze, &haze, &haze])? else { return Ok(()) };
    let same = |a: &[Pixels; 2], b: &[Pixels; 2]| a[0].bytes == b[0].bytes && a[1].bytes == b[1].bytes;
    ensure!(same(&swapped[0], &lines[0]), "the first frame depends on what comes later");
    ensure!(same(&swapped[1], &haze[1]), "haze after lines is not haze from the start");
    ensure!(same(&swapped[2], &lines[2]), "lines after haze are not lines from the start");
    ensure!(lines[0][1].bytes != haze[0][1].bytes, "both draw the same");
    Ok(())
}

#[test]
fn mistakes_are_errors_that_name_what_there_is() -> Result<()> {
    let (slots, slot) = custom_pass::slots();
    ensure!(slot.info().mistakes().is_empty(), "{:?}", slot.info().mistakes());
    for (change, wanted) in [
        ("stages.style=line", "did you mean \"lines\""),
        ("style.darkness=2", "style.darkness"),
        ("style.lightness=1", "lightness"),
        ("stages.styles=lines", "did you mean \"style\""),
    ] {
        let mut wrong = Config::default();
        wrong.set(change)?;
        let error = slots.catalogue().check(&wrong, "test").map_err(|error| error.to_string());
        ensure!(error.as_ref().is_err_and(|text| text.contains(wanted)), "{change}: {error:?}");
    }
    let lines = ["stages.style=lines"];
    let Some(undisturbed) = frames(&[&lines, &lines])? else { return Ok(()) };
    let Some(gpu) = gpu()? else { return Ok(()) };
    let scene = builtin("courtyard")?;
    let good = config(&lines)?;
    let mut styled = custom_pass::Styled::new(&gpu, &scene, &good, options())?;
    ensure!(styled.frame(&scene)?[1].bytes == undisturbed[0][1].bytes, "two runs differ");
    // One is wrong in the slot, one in another: neither changes anything.
    for change in ["stages.style=line", "stages.ao=none"] {
        let mut wrong = config(&["stages.style=haze"])?;
        wrong.set(change)?;
        ensure!(styled.configure(&wrong).is_err(), "{change} is accepted");
    }
    ensure!(styled.frame(&scene)?[1].bytes == undisturbed[1][1].bytes, "a mistake changed the picture");
    // Without the slot in its catalogue a renderer does not know the name.
    let mut alone = Renderer::new(&gpu, &scene, &Default::default(), &Config::default(), options())?;
    ensure!(
        alone.configure(&good).is_err_and(|error| error.to_string().contains("style")),
        "an unknown slot is accepted"
    );
    Ok(())
}
