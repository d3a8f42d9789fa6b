//! Which lights cast shadows, and how those of each are found.
use magpie::scene::Caster;
use magpie::slot::{SettingSpec, Settings, SlotError};
use magpie_shaders::scene::{LIGHT_DIRECTIONAL, LIGHT_DISC, LIGHT_POINT, LIGHT_RECTANGLE, LIGHT_SPHERE, LIGHT_SPOT};
use magpie_shaders::view::MOST_CASTERS;
use std::fmt;

/// How the shadows of a light are found.
#[derive(Clone, Copy, Debug, PartialEq, Eq)]
pub enum Technique {
    /// It casts none.
    None,
    /// By rays.
    Rays,
    /// By shadow maps.
    Map,
    /// By maps, and by rays where these are not sure.
    Hybrid,
}

/// Their names in the configuration.
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

/// Which lights a rule is for.
#[derive(Clone, Copy, Debug, PartialEq, Eq)]
enum Whom {
    Kind(u32),
    Light(u32),
}

/// What the configuration says.
#[derive(Clone, Debug)]
pub struct Choice {
    most: usize,
    otherwise: Technique,
    rules: Vec<(Whom, Technique)>,
}

/// Lights that share an image.
#[derive(Clone, Debug)]
pub struct Group {
    /// How their shadows are found.
    pub technique: Technique,
    /// One to four.
    pub lights: Vec<Caster>,
    /// One light, whose colours have a channel each.
    pub coloured: bool,
}

impl Group {
    /// How many channels of the image are its.
    pub fn channels(&self) -> usize {
        if self.coloured { 3 } else { self.lights.len() }
    }
}

/// A rule that says nothing.
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

/// The settings of every implementation.
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
    /// Reads them. `otherwise`: what the implementation stands for.
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

    /// Groups of lights that share a technique, the light that matters most in the first channel of the first. `tinted`: rays tell
    /// colours.
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
