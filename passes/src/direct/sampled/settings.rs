//! Settings of `ris` and `restir`.
use crate::direct::{lobes, shade};
use crate::parts::denoise;
use crate::precision;
use magpie::slot::{SettingSpec, Settings, SlotError};
use magpie_shaders::resampling::*;

/// Settings; `reuse`: those of reuse too.
pub fn settings(reuse: bool) -> Vec<SettingSpec> {
    let candidates = "Lights that a pixel draws each frame, of which it keeps one. Higher: less noise, with time proportional to the number.";
    let source = "How they are drawn. `tree`: by the light tree, which knows how far they are and where they shine. `power`: by power alone. `uniform`: all \
                  alike.";
    let lobe = "Roughness up to which one more is drawn by a ray along the specular lobe, which finds what smooth surfaces reflect. 0: never.";
    let directional = "Who lights surfaces from directional lights. `every-pixel`: each of them everywhere, with the visibility of the slot `shadows`. \
                       `sampled`: they are drawn like all others.";
    let mut settings = vec![
        SettingSpec::integer("candidates", "", candidates, 8, 1..=128).sweep([1, 2, 4, 8, 16, 32]),
        SettingSpec::choice("source", source, "tree", &["tree", "power", "uniform"]).sweep_all(),
        SettingSpec::float("lobe", "", lobe, 0.5, 0.0..=1.0).sweep([0.0, 0.25, 0.5]),
        SettingSpec::choice("directional", directional, "every-pixel", &["every-pixel", "sampled"]).sweep_all(),
    ];
    if reuse {
        settings.extend(reuse_settings());
    }
    settings.push(SettingSpec { sweep: Vec::new(), ..shade::area() });
    settings.extend(lobes::settings(lobes::SMOOTH));
    settings.push(denoise::adaptive_to_lamps());
    settings.push(precision::setting());
    settings
}

fn reuse_settings() -> [SettingSpec; 6] {
    let weights = "How a sample counts that several pixels could have drawn. `biased`: by their confidence; darker beside shadows. `unbiased`: by that of the \
                   pixels that see it, a shadow ray for each. `pairwise`: by what it gives to each; the same rays, less noise.";
    let cap = "Greatest confidence of what comes from the previous frame, in frames. Higher: less noise, slower after changes. 0: nothing comes from there.";
    let rounds = "Rounds of reuse from pixels around. Higher: less noise, more blotches from frame to frame.";
    let neighbours = "Pixels around that a round asks.";
    let radius = "Their greatest distance.";
    let test = "Which samples a shadow ray tests when reservoirs are merged. `chosen`: the one that is kept. `all`: each before, so that hidden ones are never kept; \
                less noise in shadows, more rays.";
    [
        SettingSpec::choice("weights", weights, "pairwise", &["biased", "unbiased", "pairwise"]).sweep_all(),
        SettingSpec::integer("cap", "frames", cap, 8, 0..=1000).sweep([0, 2, 8, 20]),
        SettingSpec::integer("rounds", "", rounds, 1, 0..=4).sweep([0, 1, 2]),
        SettingSpec::integer("neighbours", "", neighbours, 3, 0..=i64::from(MAX_NEIGHBOURS)).sweep([1, 3, 5]),
        SettingSpec::choice("test", test, "chosen", &["chosen", "all"]).sweep_all(),
        SettingSpec::float("reach", "px", radius, 20.0, 1.0..=128.0).sweep([5.0, 20.0]),
    ]
}

/// What the settings say.
#[derive(Clone, Copy, Debug)]
pub struct Options {
    pub candidates: u32,
    pub source: u32,
    /// Alpha up to which there is a candidate along the lobe.
    pub widest_alpha: f32,
    /// Directional lights are drawn like all others.
    pub directional: bool,
    pub reuse: Option<Reuse>,
}

/// Reuse of what others have drawn.
#[derive(Clone, Copy, Debug)]
pub struct Reuse {
    /// `WEIGHTS_*`.
    pub weights: u32,
    pub cap: u32,
    pub rounds: u32,
    pub neighbours: u32,
    pub radius: f32,
    /// Samples are tested before they are merged.
    pub tests_all: bool,
}

impl Options {
    /// Over how many frames a pixel's samples are alike. A frame keeps the sample of the one before with the probability `cap / (cap + 1)` where all
    /// candidates are as good; of such a chain that is the sum of all correlations.
    pub fn alike(&self) -> f32 {
        1.0 + 2.0 * self.reuse.map_or(0, |reuse| reuse.cap) as f32
    }

    /// Reads them.
    pub fn read(settings: &Settings, reuse: bool) -> Result<Self, SlotError> {
        let source = match settings.choice("source")? {
            "uniform" => SOURCE_UNIFORM,
            "power" => SOURCE_POWER,
            _ => SOURCE_TREE,
        };
        Ok(Self {
            candidates: settings.u32("candidates")?,
            source,
            widest_alpha: settings.f32("lobe")?.powi(2),
            directional: settings.choice("directional")? == "sampled",
            reuse: reuse.then(|| Reuse::read(settings)).transpose()?,
        })
    }
}

impl Reuse {
    fn read(settings: &Settings) -> Result<Self, SlotError> {
        let weights = match settings.choice("weights")? {
            "biased" => WEIGHTS_BIASED,
            "unbiased" => WEIGHTS_COUNTED,
            _ => WEIGHTS_PAIRWISE,
        };
        let neighbours = settings.u32("neighbours")?;
        let rounds = if neighbours == 0 { 0 } else { settings.u32("rounds")? };
        Ok(Self {
            weights,
            cap: settings.u32("cap")?,
            rounds,
            neighbours,
            radius: settings.f32("reach")?,
            tests_all: settings.choice("test")? == "all",
        })
    }
}
