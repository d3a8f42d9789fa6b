//! Settings of `hybrid`.
use super::super::reconstruct::Reconstruction;
use crate::parts::{denoise, hit_shading};
use crate::precision;
use magpie::slot::SettingSpec;

/// Settings of `hybrid`.
pub fn settings() -> Vec<SettingSpec> {
    let spacing = "Distance of rays over the width of the lobe on the screen. Below 2 pixels every pixel has a ray, below 4 each 2x2, else each \
                   4x4. Higher: fewer rays, and reflections on rough surfaces lose detail.";
    let sparsest = "Greatest number of pixels that share a ray. Higher: fewer rays on rough surfaces.";
    let noise = "Standard error of the mean of the rays around a pixel, over that mean, from which on rays are denser by one step in the \
                 next frame. Lower: less noise, more rays.";
    let budget = "Greatest number of rays per frame, over the number of pixels; 0 for no limit. Rays are left out evenly over \
                  the picture.";
    let screen = "Rays are looked for on the screen before they are traced. Off: all are traced, which is exact where the screen \
                  has to guess how thick things are.";
    let thickness = "Of `screen`: assumed thickness of what the camera sees, at least two pixels' width. Higher: fewer rays are traced, and \
                     more of them end at things that they would pass behind.";
    let bounces =
        "Surfaces that a traced path may meet one after another. Higher: more reflections of reflections, more time.";
    let roughness_limit = "Roughness from which the fallback stands alone; 1 for none. Lower: less time, and rough surfaces lose \
                           reflections of things.";
    let faint = "Albedo of the lobe below which the fallback stands alone.";
    let fallback =
        "What stands for reflections that rays are not worth: the sky, or probes with their default settings.";
    let mut settings = vec![
        SettingSpec::float("spacing", "", spacing, 1.0, 0.0..=4.0).sweep([0.5, 1.0, 2.0]),
        SettingSpec::among("pixels_per_ray", "", sparsest, 4, &[1, 4, 16]).sweep_all(),
        SettingSpec::float("noise", "", noise, 0.5, 0.0..=1.0).sweep([0.25, 0.5, 1.0]),
        SettingSpec::float("budget", "rays per pixel", budget, 0.0, 0.0..=1.0).sweep([0.0, 0.0625, 0.25]),
        SettingSpec::switch("screen", screen, false).sweep_all(),
        SettingSpec::float("thickness", "m", thickness, 0.1, 0.0..=1000.0),
        SettingSpec::integer("bounces", "", bounces, 4, 1..=8).sweep([1, 2, 4]),
        hit_shading::regularization(),
        SettingSpec::float("roughness_limit", "", roughness_limit, 1.0, 0.0..=1.0).sweep([0.3, 0.6, 1.0]),
        SettingSpec::float("faint", "", faint, 0.02, 0.0..=1.0),
        SettingSpec::choice("fallback", fallback, "sky", &["sky", "probe"]).sweep_all(),
    ];
    settings.extend(Reconstruction::settings(5));
    settings.extend(denoise::settings_with("pica-pica"));
    settings.push(precision::setting());
    settings
}
