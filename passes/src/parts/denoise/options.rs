//! Options of a denoiser, and the settings from which they are read.
use super::signal::Precision;
use magpie::slot::{SettingSpec, Settings, SlotError};

/// The algorithm of a denoiser.
#[derive(Clone, Copy, Debug, PartialEq, Eq)]
pub enum Method {
    /// No denoising.
    None,
    /// One edge-aware blur.
    Bilateral,
    /// Temporal accumulation along surfaces and reflections, then a bilateral blur where noise is left.
    PicaPica,
    /// Temporal accumulation along surfaces and reflections of blurred frames, with a blur that gets narrower with the length of the history.
    RecurrentBlur,
    /// Spatiotemporal variance-guided filtering.
    Svgf,
}

impl Method {
    /// The names in settings.
    pub const NAMES: [&str; 5] = ["svgf", "pica-pica", "recurrent-blur", "bilateral", "none"];

    /// The algorithm of that name; none for all others.
    #[must_use]
    pub fn named(name: &str) -> Self {
        match name {
            "svgf" => Self::Svgf,
            "pica-pica" => Self::PicaPica,
            "recurrent-blur" => Self::RecurrentBlur,
            "bilateral" => Self::Bilateral,
            _ => Self::None,
        }
    }
}

/// Options of one denoiser.
#[derive(Clone, Copy, Debug, PartialEq)]
pub struct Options {
    /// The algorithm.
    pub method: Method,
    /// Of denoisers with histories: limit of the history length, frames, 1 to 255.
    pub history: u32,
    /// Of `recurrent-blur`: the same for the mean that follows changes fast.
    pub fast_history: u32,
    /// Of `svgf`: levels of the à-trous filter, 1 to 6.
    pub levels: u32,
    /// Of `svgf`: difference in standard deviations at which the weight of a neighbour is 1/e; of `recurrent-blur` 1/2.
    pub sigma: f32,
    /// Of `bilateral` and the clean-up of `pica-pica`: radius, pixels. Of `recurrent-blur` that of a full history.
    pub radius: u32,
    /// Of `pica-pica`: deviation of the mean, over the mean, above which a pixel is blurred.
    pub clean_up: f32,
    /// Of `recurrent-blur`: standard deviations above the mean at which a sample of radiance is limited.
    pub outliers: f32,
    /// Bits per channel of the denoiser's images.
    pub precision: Precision,
}

impl Default for Options {
    fn default() -> Self {
        Self {
            method: Method::Svgf,
            history: 32,
            fast_history: 6,
            levels: 4,
            sigma: 2.0,
            radius: 4,
            clean_up: 0.05,
            outliers: 8.0,
            precision: Precision::Sixteen,
        }
    }
}

impl Options {
    /// Reads the [`settings`] of an effect.
    ///
    /// # Errors
    /// [`SlotError`] if the effect lacks one of them.
    pub fn read(settings: &Settings) -> Result<Self, SlotError> {
        Ok(Self {
            method: Method::named(settings.choice("denoiser")?),
            history: settings.u32("history")?,
            fast_history: settings.u32("fast_history")?,
            levels: settings.u32("levels")?,
            sigma: settings.f32("sigma")?,
            radius: settings.u32("radius")?,
            clean_up: settings.f32("clean_up")?,
            outliers: settings.f32("outliers")?,
            precision: if settings.u32("precision")? < 32 { Precision::Sixteen } else { Precision::ThirtyTwo },
        })
    }
}

/// Settings of an effect that has a denoiser. The effect also needs a setting `precision`: [`precision`] or its own.
pub fn settings() -> Vec<SettingSpec> {
    settings_with("svgf")
}

/// The same with another default denoiser.
pub fn settings_with(default: &'static str) -> Vec<SettingSpec> {
    vec![
        SettingSpec::choice(
            "denoiser",
            "`svgf`: temporal accumulation, then a spatial filter as wide as the variance asks for. `pica-pica`: temporal accumulation along \
             surfaces and along what they reflect, then a blur where noise is left. `recurrent-blur`: the same, but of \
             blurred frames, with a blur that gets narrower with every frame. `bilateral`: one edge-aware blur, cheap, which blurs \
             penumbrae as well as noise. `none`: no denoising.",
            default,
            &Method::NAMES,
        )
        .sweep_all(),
        SettingSpec::integer(
            "history",
            "frames",
            "Of `svgf`, `pica-pica` and `recurrent-blur`: greatest number of frames that are averaged. Higher: less noise, but changes of light \
             show later.",
            32,
            1..=255,
        ),
        SettingSpec::integer(
            "fast_history",
            "frames",
            "Of `recurrent-blur`: frames of a second mean, to whose range the long one is held. Higher: changes show later, but less noise \
             is taken for a change.",
            6,
            2..=64,
        ),
        SettingSpec::integer(
            "levels",
            "",
            "Of `svgf`: levels of the spatial filter, each of which doubles its reach from 1 pixel on. Higher: smoother wide penumbrae, \
             more time.",
            4,
            1..=6,
        ),
        SettingSpec::float(
            "sigma",
            "standard deviations",
            "Of `svgf` and `recurrent-blur`: difference, in standard deviations, at which the weight of a neighbour is 1/e or 1/2. Higher: \
             smoother, less detail.",
            2.0,
            0.1..=16.0,
        ),
        SettingSpec::integer(
            "radius",
            "pixels",
            "Of `bilateral` and `pica-pica`: radius of the blur. Of `recurrent-blur`: that of a full history; of a shorter one it is larger, \
             so that area times frames stay the same.",
            4,
            1..=16,
        ),
        SettingSpec::float(
            "clean_up",
            "",
            "Of `pica-pica`: noise that is left after the mean over frames, as a share of the mean, from which on a pixel is blurred. \
             Higher: sharper, noisier.",
            0.05,
            0.0..=10.0,
        ),
        SettingSpec::float(
            "outliers",
            "standard deviations",
            "Of `recurrent-blur`, of radiance: a sample is limited to this much above the mean of the samples around and before. Lower: fewer \
             bright specks, but light that is rarely found is lost.",
            8.0,
            1.0..=1e6,
        ),
    ]
}

/// The setting `precision`, for effects whose images other than the denoiser's have a fixed format.
pub fn precision() -> SettingSpec {
    let about = "Bits per channel of the denoiser's images. 32: no rounding. 16: half the memory and traffic.";
    SettingSpec::among("precision", "bits", about, 16, &[32, 16])
}

/// The setting `adaptive`, for effects that provide [`Hints::change`](super::Hints::change).
pub fn adaptive() -> SettingSpec {
    SettingSpec::switch(
        "adaptive",
        "Of `svgf` and `recurrent-blur` at full resolution: one pixel of nine traces the previous frame's ray again, and history is discarded \
         where the result differs. Moving shadows and switched lights show at once, for a ninth of a ray per pixel and some noise.",
        true,
    )
    .sweep_all()
}

/// The same for effects that lamps light.
pub fn adaptive_to_lamps() -> SettingSpec {
    let about = "Of denoisers with a history: in one pixel of nine a lamp is compared with what it was in the previous frame, and history is discarded where its \
                 light has changed. Lamps that are switched or move show at once, with some noise, for no ray.";
    SettingSpec::switch("adaptive", about, true).sweep_all()
}

/// The same for indirect light.
pub fn adaptive_to_paths() -> SettingSpec {
    let about = "Of denoisers with a history: one pixel of nine follows a path of the previous frame again, and history is discarded where many of them find other \
                 light. Changes of light show soon, for a ninth of a path per pixel and some noise.";
    SettingSpec::switch("adaptive", about, true).sweep_all()
}

/// Whether the denoiser has a history that is to follow changes of light.
pub fn follows_light(settings: &Settings) -> Result<bool, SlotError> {
    Ok(!["bilateral", "none"].contains(&settings.choice("denoiser")?) && settings.switch("adaptive")?)
}

/// Whether the denoiser uses [`Hints::change`](super::Hints::change).
pub fn is_adaptive(settings: &Settings) -> Result<bool, SlotError> {
    Ok(["svgf", "recurrent-blur"].contains(&settings.choice("denoiser")?) && settings.switch("adaptive")?)
}
