//! Which lights cast shadows, and by which technique.
use magpie::scene::Caster;
use magpie::slot::{SettingSpec, Settings, SlotError};
use magpie_shaders::scene::{LIGHT_DIRECTIONAL, LIGHT_DISC, LIGHT_POINT, LIGHT_RECTANGLE, LIGHT_SPHERE, LIGHT_SPOT};
use magpie_shaders::view::MOST_CASTERS;
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
enum Whom {
    /// All lights of a kind, `LIGHT_*`.
    Kind(u32),
    /// One light, by its index in the scene.
    Light(u32),
}

/// The technique of each light, from the settings.
#[derive(Clone, Debug)]
pub struct Choice {
    /// Greatest number of lights that cast shadows.
    most: usize,
    /// Technique of lights to which no rule applies.
    otherwise: Technique,
    /// The last rule that applies to a light counts.
    rules: Vec<(Whom, Technique)>,
}

/// Lights whose visibility is in the same image.
#[derive(Clone, Debug)]
pub struct Group {
    /// The technique of all of them.
    pub technique: Technique,
    /// One to four lights, in the order of the channels.
    pub lights: Vec<Caster>,
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
        let whom: Vec<&str> = KINDS.iter().map(|(name, _)| *name).collect();
        let how: Vec<&str> = TECHNIQUES.iter().map(|(name, _)| *name).collect();
        let (whom, how) = (whom.join(", "), how.join(", "));
        write!(
            f,
            "shadows.per_light: wanted rules such as \"sun=rays 3=none\" (left: {whom}, or the number of a light; right: {how}), got \"{}\"",
            self.0
        )
    }
}

impl std::error::Error for BadRule {}

/// Settings that all implementations share.
pub fn settings() -> [SettingSpec; 2] {
    let most = i64::from(MOST_CASTERS);
    [
        SettingSpec::integer(
            "most_lights",
            "",
            "How many lights cast shadows, the sun and the strongest lamps first. Higher: fewer lights shine through walls; a ray or a \
             map more for each.",
            4,
            (1, most),
        ),
        SettingSpec::text(
            "per_light",
            "How the shadows of single lights are found where it is not as the implementation's name says: rules such as \
             `sun=rays spot=none 3=none`, the later ones count. Left: sun, point, spot, rectangle, disc, sphere, or a light's number in \
             the scene. Right: rays, map, hybrid, none.",
            "",
        ),
    ]
}

impl Choice {
    /// Reads the settings. `otherwise` is the technique of the implementation.
    pub fn new(settings: &Settings, otherwise: Technique) -> Result<Self, SlotError> {
        let mut rules = Vec::new();
        for rule in settings.choice("per_light")?.split_whitespace() {
            rules.push(parse(rule).ok_or_else(|| SlotError::other(BadRule(rule.to_owned())))?);
        }
        Ok(Self { most: settings.u32("most_lights")? as usize, otherwise, rules })
    }

    fn technique(&self, caster: &Caster) -> Technique {
        let fits = |whom: Whom| match whom {
            Whom::Kind(kind) => kind == caster.placed.kind,
            Whom::Light(light) => light == caster.light,
        };
        let rule = self.rules.iter().rev().find(|(whom, _)| fits(*whom));
        rule.map_or(self.otherwise, |(_, technique)| *technique)
    }

    /// Groups lights of the same technique. The most important light is in the first channel of the first group. If `tinted`, each light
    /// with shadow rays has a group of its own, with visibility in colour.
    pub fn groups(&self, casters: &[Caster], tinted: bool) -> Vec<Group> {
        let mut groups: Vec<Group> = Vec::new();
        let chosen = casters.iter().map(|c| (self.technique(c), c)).filter(|(t, _)| *t != Technique::None);
        for (technique, caster) in chosen.take(self.most) {
            let coloured = tinted && technique == Technique::Rays;
            match groups.iter_mut().find(|g| g.technique == technique && g.lights.len() < 4 && !coloured) {
                Some(group) => group.lights.push(*caster),
                None => groups.push(Group { technique, lights: vec![*caster], coloured }),
            }
        }
        groups
    }
}

fn parse(rule: &str) -> Option<(Whom, Technique)> {
    let (whom, how) = rule.split_once('=')?;
    let kind = KINDS.iter().find(|(name, _)| *name == whom).map(|(_, kind)| Whom::Kind(*kind));
    let whom = kind.or_else(|| whom.parse().ok().map(Whom::Light))?;
    TECHNIQUES.iter().find(|(name, _)| *name == how).map(|(_, technique)| (whom, *technique))
}
