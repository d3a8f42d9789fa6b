//! Settings of `restir`.
use crate::gi::paths;
use crate::parts::denoise;
use crate::precision;
use magpie::slot::{SettingSpec, Settings, SlotError};
use magpie_shaders::path_reservoirs::*;
use magpie_shaders::resampling::{WEIGHTS_BIASED, WEIGHTS_COUNTED, WEIGHTS_PAIRWISE};

/// Describes them.
pub fn settings() -> Vec<SettingSpec> {
    let source = "Directions of the paths. `cosine`: by the cosine to the shading normal. `uniform`: all alike.";
    let resolution =
        "`full`: every pixel. `half`: one pixel of four, upsampled along surfaces; normal maps count less.";
    let cap = "Greatest confidence of a reservoir, in samples. Higher: less noise, slower after changes that no path of the pixel met. 0: nothing comes from \
               the previous frame.";
    let life = "Frames after which a sample is dropped. 0: never. Lower: less that lasts, and a little too dark, as bright samples last longest.";
    let validate = "Frames after which the path of a sample is traced again, and the pixel begins anew if it finds other light. Lower: sooner after changes, \
                    more rays. 0: never.";
    let rounds = "Rounds of reuse from pixels around. Higher: less noise, more blotches from frame to frame.";
    let neighbours = "Pixels around that a round asks.";
    let reach = "Their greatest distance.";
    let keep = "What the next frame goes on from. `temporal`: the pixel's own samples. `spatial`: those of pixels around too, as the last round leaves them; \
                   less noise, and the same sample in many pixels.";
    let weights = "How a sample counts that several pixels could have drawn. `biased`: by their confidence; darker in corners. `unbiased`: by that of the \
                   pixels that see it, a shadow ray for each. `pairwise`: by what it gives to each; the same rays, less noise.";
    let jacobian = "Weights account for how large a sample looks from another pixel. Off: wrong in corners.";
    let stretch = "Greatest factor of that, and one over the least. What is beyond is not reused. Higher: less noise in corners, more bright specks.";
    let visibility =
        "Shadow rays to samples of pixels around. Off: fewer rays, and light leaks past what hides it from the pixel.";
    let mut settings = vec![
        SettingSpec::choice("source", source, "cosine", &["cosine", "uniform"]).sweep_all(),
        SettingSpec::choice("resolution", resolution, "full", &["full", "half"]).sweep_all(),
        SettingSpec::integer("cap", "", cap, 30, 0..=1000).sweep([0, 10, 30, 100]),
        SettingSpec::integer("sample_life", "frames", life, 0, 0..=65_535),
        SettingSpec::integer("validate", "frames", validate, 8, 0..=255).sweep([0, 4, 8, 16]),
        SettingSpec::integer("rounds", "", rounds, 1, 0..=4).sweep([0, 1, 2]),
        SettingSpec::integer("neighbours", "", neighbours, 3, 0..=i64::from(MAX_PATH_NEIGHBOURS)).sweep([1, 3, 5]),
        SettingSpec::float("reach", "px", reach, 10.0, 1.0..=128.0).sweep([5.0, 10.0, 20.0]),
        SettingSpec::choice("keep", keep, "temporal", &["temporal", "spatial"]).sweep_all(),
        SettingSpec::choice("weights", weights, "pairwise", &["biased", "unbiased", "pairwise"]).sweep_all(),
        SettingSpec::switch("jacobian", jacobian, true).sweep_all(),
        SettingSpec::float("stretch", "", stretch, 10.0, 1.0..=1e6).sweep([3.0, 10.0]),
        SettingSpec::switch("visibility", visibility, true).sweep_all(),
    ];
    settings.extend(paths::settings().into_iter().map(|spec| SettingSpec { sweep: Vec::new(), ..spec }));
    settings.extend(denoise::settings());
    settings.push(precision::setting());
    settings
}

/// What the settings say.
#[derive(Clone, Copy, Debug)]
pub struct Options {
    /// One pixel of four.
    pub half: bool,
    pub cap: u32,
    pub life: u32,
    pub validate: u32,
    pub rounds: u32,
    pub neighbours: u32,
    pub reach: f32,
    /// The next frame goes on from the last round.
    pub keeps_spatial: bool,
    pub stretch: f32,
    /// `PATH_*`.
    pub modes: u32,
}

impl Options {
    /// Reads them.
    pub fn read(settings: &Settings) -> Result<Self, SlotError> {
        let half = settings.choice("resolution")? == "half";
        let weights = match settings.choice("weights")? {
            "biased" => WEIGHTS_BIASED,
            "unbiased" => WEIGHTS_COUNTED,
            _ => WEIGHTS_PAIRWISE,
        };
        let bits = [
            (settings.switch("jacobian")?, PATH_JACOBIAN),
            (settings.switch("visibility")?, PATH_VISIBILITY),
            (settings.choice("source")? == "uniform", PATH_UNIFORM),
            (half, PATH_HALF),
        ];
        let flags = bits.into_iter().filter(|(on, _)| *on).fold(0, |all, (_, bit)| all | bit);
        let (cap, neighbours) = (settings.u32("cap")?, settings.u32("neighbours")?);
        let rounds = if neighbours == 0 { 0 } else { settings.u32("rounds")? };
        Ok(Self {
            half,
            cap,
            life: settings.u32("sample_life")?,
            validate: if cap == 0 { 0 } else { settings.u32("validate")? },
            rounds,
            neighbours,
            reach: settings.f32("reach")?,
            keeps_spatial: settings.choice("keep")? == "spatial" && rounds > 0,
            stretch: settings.f32("stretch")?,
            modes: weights | flags | settings.u32("bounces")? << PATH_BOUNCES,
        })
    }
}
