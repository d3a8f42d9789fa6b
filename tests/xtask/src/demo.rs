//! `cargo xtask demo`: the default scene as an image, and the table of passes.

use crate::setup;
use crate::shell::Invocation;
use anyhow::{Context, Result, bail};
use std::fs;
use std::path::Path;

/// Sets up, builds, and renders.
pub fn demo(extra: &[String]) -> Result<()> {
    let place = setup::prepare(false)?;
    let picture = place.pictures().join("courtyard.png");
    fs::create_dir_all(place.pictures()).with_context(|| format!("making {}", place.pictures().display()))?;
    let has_display = ["DISPLAY", "WAYLAND_DISPLAY"].iter().any(|name| std::env::var_os(name).is_some());
    let arguments = arguments(extra, &picture, has_display);
    let arguments: Vec<&str> = arguments.iter().map(String::as_str).collect();
    let magpie = place.magpie();
    // Run in the caller's folder, so that relative paths among the arguments work.
    match Invocation::new(&magpie.to_string_lossy(), &arguments).shown_as("magpie").status()? {
        // Ctrl-C ends the window.
        Some(0 | 130) => {}
        Some(code) => bail!("magpie ended with status {code}"),
        None => bail!("magpie was ended by a signal"),
    }
    if arguments.contains(&picture.to_string_lossy().as_ref()) {
        println!("demo: the picture is {}", picture.display());
    }
    Ok(())
}

/// The arguments of `magpie`: those of the caller, and defaults for the rest. Where there is a display, and nothing but a scene is given, it is
/// shown in a window.
fn arguments(extra: &[String], picture: &Path, has_display: bool) -> Vec<String> {
    let own_scene = extra.first().is_some_and(|first| !first.starts_with('-'));
    let (scene, flags) = if own_scene { extra.split_at(1) } else { (&[] as &[String], extra) };
    let scene = scene.first().map_or("builtin:courtyard", String::as_str);
    if has_display && flags.is_empty() {
        return vec!["view".to_owned(), scene.to_owned()];
    }
    let mut all = vec!["render".to_owned(), scene.to_owned()];
    for (flag, value) in [("--size", "960x540"), ("--frames", "8"), ("--out", &picture.to_string_lossy())] {
        let given =
            |word: &String| word.strip_prefix(flag).is_some_and(|rest| rest.is_empty() || rest.starts_with('='));
        if !flags.iter().any(given) {
            all.extend([flag.to_owned(), value.to_owned()]);
        }
    }
    all.extend_from_slice(flags);
    all
}

#[cfg(test)]
mod tests {
    use super::*;

    fn line(extra: &str) -> String {
        let extra: Vec<String> = extra.split_whitespace().map(str::to_owned).collect();
        arguments(&extra, Path::new("c.png"), false).join(" ")
    }

    #[test]
    fn the_caller_overrides_each_default() {
        assert_eq!(line(""), "render builtin:courtyard --size 960x540 --frames 8 --out c.png");
        assert_eq!(line("--check"), "render builtin:courtyard --size 960x540 --frames 8 --out c.png --check");
        assert_eq!(line("builtin:cornell"), "render builtin:cornell --size 960x540 --frames 8 --out c.png");
        let shown = |extra: &[&str]| {
            let extra: Vec<String> = extra.iter().map(|&word| word.to_owned()).collect();
            arguments(&extra, Path::new("c.png"), true).join(" ")
        };
        assert_eq!([shown(&[]), shown(&["a.glb"])], ["view builtin:courtyard", "view a.glb"]);
        assert_eq!(shown(&["--out", "b.png"]), "render builtin:courtyard --size 960x540 --frames 8 --out b.png");
        assert_eq!(line("a.glb --size 64x64 --out=b.exr"), "render a.glb --frames 8 --size 64x64 --out=b.exr");
    }
}
