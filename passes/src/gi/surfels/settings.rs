//! Settings of `surfels`.
use crate::parts::hit_shading;
use crate::precision;
use magpie::graph::Format;
use magpie::slot::{SettingSpec, Settings, SlotError};
use magpie_shaders::hit_shading::{MOST_SHEETS, MOST_TURNS};
use magpie_shaders::surfels::{MULTI_SCALE, RUNNING_MEAN, SECTORS};

/// Settings, read.
#[derive(Clone, Copy, Debug)]
pub struct Options {
    /// Places in the pool.
    pub capacity: u32,
    /// Radius of a surfel, as a share of the height of the picture.
    pub radius: f32,
    /// Sum of weights below which a pixel asks for a surfel.
    pub coverage: f32,
    /// Frames for which a surfel that nothing uses is kept.
    pub life: u32,
    /// Surfaces that a path meets.
    pub bounces: u32,
    /// Of lib/regularization.glsl.
    pub regularization: f32,
    /// `MULTI_SCALE` or `RUNNING_MEAN`.
    pub estimator: u32,
    /// Whether directions are drawn more often from where light came before.
    pub guided: bool,
    /// Whether hits take the light of surfels.
    pub feedback: bool,
    /// Of the radiance that the slot writes.
    pub format: Format,
    /// Rays of a frame at most.
    pub budget: u32,
}

/// Share of the rays that is kept free for surfels in their first frame.
const FOR_NEW: u32 = 4;

/// Surfaces that the first path of a surfel meets at least: in the first frame no surfels know the light at which paths could end.
const FIRST_BOUNCES: u32 = 4;

impl Options {
    /// Reads the settings.
    pub fn read(settings: &Settings) -> Result<Self, SlotError> {
        Ok(Self {
            capacity: settings.u32("surfels")?,
            radius: settings.f32("surfel_radius")?,
            coverage: settings.f32("coverage")?,
            life: settings.u32("life")?,
            bounces: settings.u32("bounces")?,
            regularization: settings.f32("regularization")?,
            estimator: if settings.choice("estimator")? == "multi-scale" { MULTI_SCALE } else { RUNNING_MEAN },
            guided: settings.switch("guided")?,
            feedback: settings.switch("feedback")?,
            format: precision::format(settings)?,
            budget: settings.u32("budget")?,
        })
    }

    /// Distance of the pixels that are looked at in a frame for whether surfels cover them: at most a third of a surfel's radius.
    pub fn stride(&self, height: u32) -> u32 {
        let radius = self.radius * height as f32;
        [4, 2].into_iter().find(|&stride| radius >= 3.0 * stride as f32).unwrap_or(1)
    }

    /// Rays of a path at most. `tinted`: there are surfaces that let light straight through, beyond each of which another ray starts.
    const fn rays_of_path(bounces: u32, tinted: bool) -> u32 {
        if tinted {
            // Along the path; towards a light from each of its surfaces past opaque things, through sheets, and beyond the last.
            MOST_TURNS + bounces * (MOST_SHEETS + 2)
        } else {
            // To each surface, to a light from each, and beyond the last.
            2 * bounces + 1
        }
    }

    /// Surfaces that the first path of a surfel meets. Where surfaces let light through it meets no more than others: the bound on its rays would leave room for
    /// two thirds of the surfels only.
    pub fn first_bounces(&self, tinted: bool) -> u32 {
        if self.feedback && !tinted { self.bounces.max(FIRST_BOUNCES) } else { self.bounces }
    }

    /// Rays of a surfel in its first frame at most. It looks into all sectors at once.
    pub fn rays_of_new(&self, tinted: bool) -> u32 {
        SECTORS + Self::rays_of_path(self.first_bounces(tinted), tinted)
    }

    /// Greatest number of older surfels that trace in one frame.
    pub const fn most_old(&self, tinted: bool) -> u32 {
        (self.budget - self.budget / FOR_NEW) / (1 + Self::rays_of_path(self.bounces, tinted))
    }
}

/// Describes the settings of the surfels themselves, which do not depend on what they light.
pub fn pool_settings() -> Vec<SettingSpec> {
    let surfels = "Places in the pool. Higher: more surfaces beside those in sight are remembered, with memory and time for each place.";
    let radius = "Radius of a surfel on the screen, over the height of the picture. Higher: fewer surfels, and light that changes more slowly \
                  over surfaces.";
    let coverage = "A pixel asks for a surfel where the weights of those around it add up to less. Higher: more surfels, less noise.";
    let budget = "Rays of surfels in a frame at most. Higher: light follows changes sooner.";
    let estimator = "How a surfel averages over time. `running-mean`: over all samples until the light changes. `multi-scale`: the published mean \
                     over a long and a short window.";
    let feedback = "Paths of surfels end at surfels, whose light they take: each frame adds a bounce. Without, light bounces `bounces` times.";
    let guided =
        "Surfels send their paths more often to where light came from before. Less noise from small bright places.";
    let life = "Frames for which a surfel that neither the picture nor a path uses is kept; less where the pool is nearly full.";
    vec![
        SettingSpec::integer("surfels", "", surfels, 1 << 17, 1 << 10..=1 << 20),
        SettingSpec::float("surfel_radius", "heights", radius, 0.02, 0.002..=0.1).sweep([0.01, 0.02, 0.04]),
        SettingSpec::float("coverage", "", coverage, 0.3, 0.01..=4.0).sweep([0.1, 0.3, 1.0]),
        SettingSpec::integer("budget", "rays", budget, 250_000, 1_000..=10_000_000).sweep([25_000, 250_000]),
        SettingSpec::choice("estimator", estimator, "running-mean", &["running-mean", "multi-scale"]).sweep_all(),
        SettingSpec::switch("feedback", feedback, true).sweep_all(),
        SettingSpec::switch("guided", guided, true).sweep_all(),
        SettingSpec::integer("life", "frames", life, 240, 1..=10_000),
    ]
}

/// Describes all settings.
pub fn settings() -> Vec<SettingSpec> {
    let bounces = "Surfaces that a path meets before it ends, where no surfels know the light. Higher: more light from places out of sight.";
    let resolution = "`full`: every pixel looks surfels up. `half`: one pixel of four, upsampled along surfaces; normal maps count less.";
    let mut settings = pool_settings();
    settings.extend([
        SettingSpec::integer("bounces", "", bounces, 2, 1..=8).sweep([1, 2, 4]),
        hit_shading::regularization(),
        SettingSpec::choice("resolution", resolution, "full", &["full", "half"]).sweep_all(),
        precision::setting(),
    ]);
    settings
}
