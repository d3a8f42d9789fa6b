//! Who takes part in `magpie bench motion`, and with which settings.
use super::MotionOptions;
use crate::FrameBenchError;
use magpie::config::{Catalogue, Config};
use magpie_passes::Slots;

/// A variant of the slot's settings to compare.
#[derive(Clone, Copy, Debug, PartialEq, Eq)]
pub struct Contestant {
    /// Text in the legend.
    pub label: &'static str,
    /// Implementation of the slot.
    pub(super) implementation: &'static str,
    changes: &'static [(&'static str, &'static str)],
    /// The one slot that has it; without, it takes part where the implementation has a denoiser.
    only_in: Option<&'static str>,
}

/// The implementation of slots that trace.
const TRACED: &str = "ray-traced";
const TRUE: &[(&str, &str)] = &[("rays", "8"), ("denoiser", "none")];
/// Nothing that one frame takes from another, and as many bounces as there can be.
const TRUE_GI: &[(&str, &str)] = &[
    ("rays", "8"),
    ("denoiser", "none"),
    ("reuse", "false"),
    ("cache", "none"),
    ("bounces", "8"),
    ("regularization", "0"),
];
/// As many lights as there can be in a sample.
const TRUE_DIRECT: &[(&str, &str)] = &[("split_lights", "16"), ("split_threshold", "0"), ("denoiser", "none")];
/// The slot of diffuse indirect light, which has implementations that need no denoiser.
pub(super) const GI: &str = "gi";
/// The slot of direct light, whose implementations differ in how they choose lights.
pub(super) const DIRECT: &str = "direct";
/// The implementation of it that chooses lights by the light tree.
const TREE: &str = "light-tree";

impl Contestant {
    const fn new(label: &'static str, changes: &'static [(&'static str, &'static str)]) -> Self {
        Self { label, implementation: TRACED, changes, only_in: None }
    }

    const fn of(
        slot: &'static str,
        label: &'static str,
        implementation: &'static str,
        changes: &'static [(&'static str, &'static str)],
    ) -> Self {
        Self { label, implementation, changes, only_in: Some(slot) }
    }

    /// What the truth of a slot is the mean of.
    pub(super) fn truth(slot: &str) -> Self {
        match slot {
            GI => Self::new("truth", TRUE_GI),
            DIRECT => Self::of(DIRECT, "truth", TREE, TRUE_DIRECT),
            _ => Self::new("truth", TRUE),
        }
    }
}

/// The variants to compare, the raw one first. What an effect has no settings for is skipped.
pub const CONTESTANTS: [Contestant; 28] = [
    Contestant::new("one ray", &[("rays", "1"), ("denoiser", "none")]),
    Contestant::new("svgf", &[("rays", "1"), ("denoiser", "svgf")]),
    Contestant::new("svgf, fixed history", &[("rays", "1"), ("denoiser", "svgf"), ("adaptive", "false")]),
    Contestant::new("svgf, reconstructed", &[("rays", "1"), ("denoiser", "svgf"), ("reconstruct", "true")]),
    Contestant::new("pica-pica, raw", &[("rays", "1"), ("denoiser", "pica-pica"), ("reconstruct", "false")]),
    Contestant::new("pica-pica", &[("rays", "1"), ("denoiser", "pica-pica"), ("reconstruct", "true")]),
    Contestant::new("pica-pica, quarter rays", &[("pixels_per_ray", "4"), ("denoiser", "pica-pica")]),
    Contestant::new("blur", &[("rays", "1"), ("denoiser", "recurrent-blur"), ("reconstruct", "false")]),
    Contestant::new("blur, reconstructed", &[("rays", "1"), ("denoiser", "recurrent-blur"), ("reconstruct", "true")]),
    Contestant::new("blur, quarter rays", &[("pixels_per_ray", "4"), ("denoiser", "recurrent-blur")]),
    Contestant { implementation: "hybrid", ..Contestant::new("hybrid", &[("pixels_per_ray", "16")]) },
    Contestant::of(GI, "svgf, cache of surfels", TRACED, &[("rays", "1"), ("denoiser", "svgf"), ("cache", "surfels")]),
    Contestant::of(GI, "surfels", "surfels", &[]),
    Contestant::of(GI, "surfels, half", "surfels", &[("resolution", "half")]),
    Contestant::of(GI, "surfels, multi-scale", "surfels", &[("estimator", "multi-scale")]),
    Contestant::of(GI, "screen-space", "screen-space", &[]),
    Contestant::of(GI, "sky", "sky", &[]),
    Contestant::new("eight rays", TRUE),
    Contestant::of(DIRECT, "all lights", "all-lights", &[]),
    Contestant::of(DIRECT, "tree, raw", TREE, &[("denoiser", "none")]),
    Contestant::of(DIRECT, "tree, svgf", TREE, &[("denoiser", "svgf")]),
    Contestant::of(DIRECT, "tree, pica-pica", TREE, &[("denoiser", "pica-pica")]),
    Contestant::of(DIRECT, "tree, blur", TREE, &[("denoiser", "recurrent-blur")]),
    Contestant::of(DIRECT, "ris, svgf", "ris", &[("denoiser", "svgf")]),
    Contestant::of(DIRECT, "restir, raw", "restir", &[("denoiser", "none")]),
    Contestant::of(DIRECT, "restir, svgf", "restir", &[("denoiser", "svgf")]),
    Contestant::of(DIRECT, "restir, pica-pica", "restir", &[("denoiser", "pica-pica")]),
    Contestant::of(DIRECT, "restir, blur", "restir", &[("denoiser", "recurrent-blur")]),
];

/// The configuration of a contestant; settings that its implementation does not have are skipped. None if the slot does not have the
/// implementation, or it has no denoiser and is not meant for this slot.
pub(super) fn config(options: &MotionOptions, of: Contestant) -> Result<Option<Config>, FrameBenchError> {
    let catalogue: Catalogue = Slots::default().catalogue();
    let known = catalogue.slot(&options.slot).and_then(|s| s.implementation(of.implementation));
    let has = |key: &str| known.is_none_or(|i| i.settings.iter().any(|s| s.key == key));
    let takes_part = match of.only_in {
        Some(slot) => slot == options.slot && known.is_some(),
        None if options.slot == DIRECT => false,
        None => of.implementation == TRACED || (known.is_some() && has("denoiser")),
    };
    if !takes_part {
        return Ok(None);
    }
    let mut config = options.config.clone();
    if options.slot != GI && !options.picture && !config.stages.contains_key(GI) {
        // It changes no image of the slot, but where rays end at what it keeps.
        config.set(&format!("stages.{GI}=off"))?;
    }
    if config.stages.get(&options.slot).is_some_and(|chosen| chosen != of.implementation) {
        // They are those of another implementation.
        config.settings.remove(&options.slot);
    }
    config.set(&format!("stages.{}={}", options.slot, of.implementation))?;
    for (key, value) in of.changes.iter().filter(|(key, _)| has(key)) {
        config.set(&format!("{}.{key}={value}", options.slot))?;
    }
    catalogue.check(&config, "bench motion")?;
    Ok(Some(config))
}
