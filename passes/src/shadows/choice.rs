//! Which lights cast shadows, and by which technique.
use magpie::scene::ShadowLight;
use magpie::slot::{SettingSpec, Settings, SlotError};
use magpie_shaders::scene::{LIGHT_DIRECTIONAL, LIGHT_DISC, LIGHT_POINT, LIGHT_RECTANGLE, LIGHT_SPHERE, LIGHT_SPOT};
use magpie_shaders::view::MAX_SHADOW_LIGHTS;
use std::fmt;

/// How the visibility of a light is computed.
#[derive(Clone, Copy, Debug, PartialEq, Eq)]
pub enum Technique {
    /// The light is unshadowed.
    None,
    /// Shadow rays.
    Rays,
    /// Shadow maps.
    Map,
    /// Shadow maps, and rays where the maps are unsure.
    Hybrid,
}

/// Names of the techniques in the configuration.
const TECHNIQUES: [(&str, Technique); 4] =
    [("none", Technique::None), ("rays", Technique::Rays), ("map", Technique::Map), ("hybrid", Technique::Hybrid)];

/// Names of the kinds of lights in the configuration.
const KINDS: [(&str, u32); 6] = [
    ("sun", LIGHT_DIRECTIONAL),
    ("point", LIGHT_POINT),
    ("spot", LIGHT_SPOT),
    ("rectangle", LIGHT_RECTANGLE),
    ("disc", LIGHT_DISC),
    ("sphere", LIGHT_SPHERE),
];

/// The lights to which a rule applies.
#[derive(Clone, Copy, Debug, PartialEq, Eq)]
enum Target {
    /// All lights of a kind, `LIGHT_*`.
    Kind(u32),
    /// One light, by its index in the scene.
    Light(u32),
}

/// The technique of each light, from the settings.
#[derive(Clone, Debug)]
pub struct Choice {
    /// Greatest number of shadow-casting lights.
    max_lights: usize,
    /// Technique of lights to which no rule applies.
    default: Technique,
    /// The last rule that applies to a light counts.
    rules: Vec<(Target, Technique)>,
}

/// Lights whose visibility is in the same image.
#[derive(Clone, Debug)]
pub struct Group {
    /// The technique of all of them.
    pub technique: Technique,
    /// One to four lights, in the order of the channels.
    pub lights: Vec<ShadowLight>,
    /// There is one light only, whose visibility is in red, green and blue.
    pub coloured: bool,
}

impl Group {
    /// Number of channels in use.
    pub fn channels(&self) -> usize {
        if self.coloured { 3 } else { self.lights.len() }
    }
}

/// A rule that could not be parsed.
#[derive(Debug)]
struct BadRule(String);

impl fmt::Display for BadRule {
    fn fmt(&self, f: &mut fmt::Formatter<'_>) -> fmt::Result {
        let kinds: Vec<&str> = KINDS.iter().map(|(name, _)| *name).collect();
        let techniques: Vec<&str> = TECHNIQUES.iter().map(|(name, _)| *name).collect();
        let (kinds, techniques) = (kinds.join(", "), techniques.join(", "));
        write!(
            f,
            "shadows.per_light: wanted rules such as \"sun=rays 3=none\" (left: {kinds}, or the number of a light; right: {techniques}), got \"{}\"",
            self.0
        )
    }
}

impl std::error::Error for BadRule {}

/// Settings that all implementations share.
pub fn settings() -> [SettingSpec; 2] {
    let max_lights = i64::from(MAX_SHADOW_LIGHTS);
    [
        SettingSpec::integer(
            "most_lights",
            "",
            "Number of lights that cast shadows: directional lights first, then the most powerful local lights. Higher: fewer lights \
             shine through walls, for a ray or a map more for each.",
            4,
            1..=max_lights,
        ),
        SettingSpec::text(
            "per_light",
            "Techniques of single lights, where they differ from the implementation's: rules such as `sun=rays spot=none 3=none`, of \
             which later ones take precedence. Left: sun, point, spot, rectangle, disc, sphere, or the index of a light in the scene. \
             Right: rays, map, hybrid, none.",
            "",
        ),
    ]
}

impl Choice {
    /// Reads the settings. `default` is the technique of the implementation.
    pub fn new(settings: &Settings, default: Technique) -> Result<Self, SlotError> {
        let mut rules = Vec::new();
        for rule in settings.choice("per_light")?.split_whitespace() {
            rules.push(parse(rule).ok_or_else(|| SlotError::other(BadRule(rule.to_owned())))?);
        }
        Ok(Self { max_lights: settings.u32("most_lights")? as usize, default, rules })
    }

    fn technique(&self, light: &ShadowLight) -> Technique {
        let applies = |target: Target| match target {
            Target::Kind(kind) => kind == light.placed.kind,
            Target::Light(index) => index == light.light,
        };
        let rule = self.rules.iter().rev().find(|(target, _)| applies(*target));
        rule.map_or(self.default, |(_, technique)| *technique)
    }

    /// Groups lights of the same technique. The most important light is in the first channel of the first group. If `tinted`, each light
    /// with shadow rays has a group of its own, with visibility in colour.
    pub fn groups(&self, shadow_lights: &[ShadowLight], tinted: bool) -> Vec<Group> {
        let mut groups: Vec<Group> = Vec::new();
        let shadowed =
            shadow_lights.iter().map(|light| (self.technique(light), light)).filter(|(t, _)| *t != Technique::None);
        for (technique, light) in shadowed.take(self.max_lights) {
            let coloured = tinted && technique == Technique::Rays;
            match groups.iter_mut().find(|g| g.technique == technique && g.lights.len() < 4 && !coloured) {
                Some(group) => group.lights.push(*light),
                None => groups.push(Group { technique, lights: vec![*light], coloured }),
            }
        }
        groups
    }
}

fn parse(rule: &str) -> Option<(Target, Technique)> {
    let (left, right) = rule.split_once('=')?;
    let kind = KINDS.iter().find(|(name, _)| *name == left).map(|(_, kind)| Target::Kind(*kind));
    let target = kind.or_else(|| left.parse().ok().map(Target::Light))?;
    TECHNIQUES.iter().find(|(name, _)| *name == right).map(|(_, technique)| (target, *technique))
}
