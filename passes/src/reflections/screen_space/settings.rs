//! Settings of `screen-space`.
use crate::parts::denoise;
use crate::precision;
use magpie::slot::SettingSpec;

/// Settings of `screen-space`.
pub fn settings() -> Vec<SettingSpec> {
    let march = "`pyramid`: steps over areas in which nothing can be hit, found in a pyramid of depths. `linear`: steps of equal length on the \
                 screen, which may miss things thinner than `stride`.";
    let steps = "Greatest number of steps of a ray. Higher: rays get farther. With `linear` a ray ends after `steps` times `stride` pixels.";
    let stride =
        "Of `linear`: distance of steps on the screen for mirrors. Higher: less time, and thin things are missed.";
    let rough_stride = "Of `linear`: distance of steps at `roughness_limit`; in between it grows with roughness. Never below `stride`.";
    let thickness = "Assumed thickness of what the camera sees, at least two pixels' width. Higher: fewer rays pass behind things unseen, \
                     but reflections of thin things are smeared downwards.";
    let distance = "Greatest length of a ray. Lower: less time with `linear`, and far things are missing.";
    let edge = "Share of the picture's width and height over which reflections fade at each border. Higher: the border of what is known \
                shows less, and so do reflections near it.";
    let limit = "Roughness from which no ray is marched and the fallback stands alone. Lower: less time, and glossy surfaces lose \
                 reflections of things.";
    let lobe = "`stochastic`: one direction per pixel and frame, sampled from the specular lobe, and a denoiser. `cone`: the mirror \
                direction, blurred as wide as the lobe is; no noise and no history, but blurrier edges.";
    let blur = "Of `cone`. `gaussian`: the same blur everywhere, which mixes surfaces at their edges. `bilateral`: only along surfaces.";
    let xi = "Of `cone`: share of the lobe's normals inside the cone. Higher: wider blur. The default was fitted to `stochastic`.";
    let resolution = "`full`: a ray from every pixel. `half`: from one pixel of four, upsampled along surfaces.";
    let mut settings = vec![
        SettingSpec::choice("march", march, "pyramid", &["pyramid", "linear"]).sweep_all(),
        SettingSpec::integer("steps", "", steps, 96, 1..=1024).sweep([24, 48, 96]),
        SettingSpec::integer("stride", "pixels", stride, 2, 1..=64),
        SettingSpec::integer("rough_stride", "pixels", rough_stride, 8, 1..=64),
        SettingSpec::float("thickness", "m", thickness, 0.1, 0.0..=1000.0),
        SettingSpec::float("distance", "m", distance, 100.0, 0.001..=1e6),
        SettingSpec::float("edge", "", edge, 0.1, 0.0..=0.5),
        SettingSpec::float("roughness_limit", "", limit, 0.6, 0.0..=1.0).sweep([0.3, 0.6, 1.0]),
        SettingSpec::choice("lobe", lobe, "stochastic", &["stochastic", "cone"]).sweep_all(),
        SettingSpec::choice("blur", blur, "bilateral", &["bilateral", "gaussian"]),
        SettingSpec::float("xi", "", xi, 0.5, 0.0..=0.999),
        SettingSpec::choice("resolution", resolution, "full", &["full", "half"]).sweep_all(),
    ];
    settings.extend(denoise::settings());
    settings.push(precision::setting());
    settings
}
