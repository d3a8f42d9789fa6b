//! Settings of `probe`.
use crate::precision;
use magpie::graph::Format;
use magpie::slot::{SettingSpec, Settings, SlotError};
use magpie_shaders::probe::{
    PROBE_CORRECTION_BOX, PROBE_CORRECTION_DISTANCE, PROBE_CORRECTION_OFF, PROBE_DIRECTION_CUBIC, PROBE_DIRECTION_FIT,
    PROBE_DIRECTION_MIRROR, PROBE_NARROWING_ALPHA, PROBE_NARROWING_OFF, PROBE_NARROWING_ROUGHNESS,
};

const CORRECTIONS: [(&str, u32); 3] =
    [("distance", PROBE_CORRECTION_DISTANCE), ("box", PROBE_CORRECTION_BOX), ("off", PROBE_CORRECTION_OFF)];
const NARROWINGS: [(&str, u32); 3] =
    [("alpha", PROBE_NARROWING_ALPHA), ("roughness", PROBE_NARROWING_ROUGHNESS), ("off", PROBE_NARROWING_OFF)];
const DIRECTIONS: [(&str, u32); 3] =
    [("fit", PROBE_DIRECTION_FIT), ("cubic", PROBE_DIRECTION_CUBIC), ("mirror", PROBE_DIRECTION_MIRROR)];

/// Values of the settings.
#[derive(Clone, Copy, Debug)]
pub struct Options {
    /// Texels of an edge of a face.
    pub side: u32,
    /// Faces captured per frame.
    pub faces: u32,
    /// Captures in a mean.
    pub average: u32,
    /// Hits gather indirect light.
    pub indirect: bool,
    /// Samples of the filter for each texel.
    pub samples: u32,
    /// They read means over their solid angle.
    pub filtered: bool,
    /// `PROBE_CORRECTION_*`.
    pub correction: u32,
    /// `PROBE_NARROWING_*`.
    pub narrowing: u32,
    /// `PROBE_DIRECTION_*`.
    pub direction: u32,
    /// Steps along a ray.
    pub steps: u32,
    /// Grid of the camera's probe, metres.
    pub spacing: f64,
    /// Distance at which the sky takes over, metres.
    pub reach: f32,
    /// Occlusion dims what probes show.
    pub occlusion: bool,
    /// Format of the radiance.
    pub format: Format,
}

/// The settings.
pub fn settings() -> Vec<SettingSpec> {
    let resolution = "Texels of an edge of a face. Higher: sharper mirrors; captures, memory and time of captures grow with the square.";
    let faces = "Faces that are captured per frame, of all probes together. Fewer: less time per frame; what changes shows later, after \
                 six frames per probe with 1.";
    let average = "Captures in the mean of a texel, where the scene moves; eight times as many where nothing does, after which nothing is \
                   captured. Higher: less noise, and changes of light show later.";
    let indirect = "What a probe sees gathers indirect light, by one more ray per texel, whose hit takes light from the probe itself. Off: \
                    direct light only.";
    let samples = "Samples for each texel of a blurred mip. Higher: smoother, with time proportional to the number.";
    let filtered =
        "Samples of the filter read means over their solid angle. Off: single texels, which needs many more samples.";
    let correction = "Where radiance lies that a probe has captured. distance: where the captured distances say. box: on the box that the \
                      scene gives the probe, and on that around the whole scene for the camera's. off: infinitely far.";
    let narrowing = "How roughness falls with the distance of what is reflected, over its distance from the probe. alpha: its square is \
                     proportional to that. roughness: it is itself. off: it does not.";
    let direction = "Direction in which probes are looked up. fit: the lobe's mean by Lagarde and de Rousiers. cubic: by the cube of \
                     roughness. mirror: the mirror direction.";
    let steps = "Steps along a ray with `correction=distance`. Higher: thin things are missed less often, more time.";
    let spacing =
        "Grid to which the camera's probe is snapped. Higher: it moves less often, and is farther from the camera.";
    let reach = "Distance from the camera's probe at which the sky has replaced it, beginning at half of that.";
    let occlusion = "Ambient occlusion dims what probes show, not only the sky. On: darker where surfaces meet.";
    vec![
        SettingSpec::among("resolution", "texels", resolution, 64, &[16, 32, 64, 128, 256]).sweep([32, 64, 128]),
        SettingSpec::among("faces", "", faces, 2, &[1, 2, 3, 6]).sweep_all(),
        SettingSpec::integer("average", "", average, 16, 1..=255).sweep([4, 16, 64]),
        SettingSpec::switch("indirect", indirect, true).sweep_all(),
        SettingSpec::among("filter_samples", "", samples, 32, &[8, 16, 32, 64, 128, 1024]).sweep([16, 32, 64]),
        SettingSpec::switch("filter_means", filtered, true),
        SettingSpec::choice("correction", correction, "distance", &["distance", "box", "off"]).sweep_all(),
        SettingSpec::choice("narrowing", narrowing, "alpha", &["alpha", "roughness", "off"]),
        SettingSpec::choice("direction", direction, "fit", &["fit", "cubic", "mirror"]),
        SettingSpec::integer("steps", "", steps, 8, 2..=64).sweep([4, 8, 16]),
        SettingSpec::float("spacing", "m", spacing, 1.0, 0.01..=1000.0),
        SettingSpec::float("reach", "m", reach, 100.0, 0.1..=1e6),
        SettingSpec::switch("occlusion", occlusion, true).sweep_all(),
        precision::setting(),
    ]
}

impl Options {
    /// Reads them.
    ///
    /// # Errors
    /// [`SlotError`] if one is missing.
    pub fn read(settings: &Settings) -> Result<Self, SlotError> {
        let named = |key: &str, all: &[(&str, u32)]| -> Result<u32, SlotError> {
            let name = settings.choice(key)?;
            Ok(all.iter().find(|(known, _)| *known == name).map_or(all[0].1, |(_, value)| *value))
        };
        Ok(Self {
            side: settings.u32("resolution")?,
            faces: settings.u32("faces")?,
            average: settings.u32("average")?,
            indirect: settings.switch("indirect")?,
            samples: settings.u32("filter_samples")?,
            filtered: settings.switch("filter_means")?,
            correction: named("correction", &CORRECTIONS)?,
            narrowing: named("narrowing", &NARROWINGS)?,
            direction: named("direction", &DIRECTIONS)?,
            steps: settings.u32("steps")?,
            spacing: settings.f64("spacing")?,
            reach: settings.f32("reach")?,
            occlusion: settings.switch("occlusion")?,
            format: precision::format(settings)?,
        })
    }

    /// Mips beside the first: down to faces of four texels, on which the cosine lobe is still smooth.
    pub fn mips(&self) -> u32 {
        self.side.ilog2() - 2
    }
}
