//! Names of built-in scenes with parameters: `NAME?KEY=VALUE&KEY=VALUE`.
use super::BUILTIN;
use crate::config::Suggestion;

/// A parameter of a built-in scene: a whole number.
#[derive(Clone, Copy, Debug, PartialEq, Eq)]
pub struct BuiltinParameter {
    /// Its key.
    pub key: &'static str,
    /// What it says, in a few words.
    pub about: &'static str,
    /// The least value.
    pub least: u32,
    /// The greatest value.
    pub most: u32,
    /// The value where none is given.
    pub default: u32,
}

/// Number of lamps of the night market.
const LIGHTS: BuiltinParameter =
    BuiltinParameter { key: "lights", about: "number of lamps", least: 10, most: 100_000, default: 1_000 };

/// The parameters of the built-in scene of this name, without `builtin:`. Most have none.
#[must_use]
pub fn builtin_parameters(name: &str) -> &'static [BuiltinParameter] {
    match name {
        "night-market" => &[LIGHTS],
        _ => &[],
    }
}

/// Why there is no such built-in scene.
#[derive(Clone, Debug, PartialEq, Eq, thiserror::Error)]
#[non_exhaustive]
pub enum BuiltinError {
    /// No built-in scene has this name.
    #[error("unknown built-in scene {name:?}{}; known: {}", suggestion(name, names()), listed(names()))]
    Name {
        /// The name that was asked for.
        name: String,
    },
    /// What follows the name is not a list of keys with values.
    #[error("built-in scene {scene:?}: parameters are KEY=VALUE with & between them, got {got:?}")]
    Form {
        /// Name of the scene.
        scene: &'static str,
        /// The part that is wrong.
        got: String,
    },
    /// The scene has no parameter with this key.
    #[error("built-in scene {scene:?}: unknown parameter {key:?}{}; {}", suggestion(key, keys(scene)), known(scene))]
    Key {
        /// Name of the scene.
        scene: &'static str,
        /// The key.
        key: String,
    },
    /// A parameter is given twice.
    #[error("built-in scene {scene:?}: the parameter {key:?} is given twice")]
    Twice {
        /// Name of the scene.
        scene: &'static str,
        /// The key.
        key: &'static str,
    },
    /// A value is not one of those that the parameter can have.
    #[error(
        "built-in scene {scene:?}: {} is {got:?}, wanted a whole number from {} to {}",
        parameter.key, parameter.least, parameter.most
    )]
    Value {
        /// Name of the scene.
        scene: &'static str,
        /// The parameter.
        parameter: BuiltinParameter,
        /// The value that was given.
        got: String,
    },
}

fn names() -> impl Iterator<Item = &'static str> {
    BUILTIN.iter().map(|(name, _)| *name)
}

fn keys(scene: &str) -> impl Iterator<Item = &'static str> {
    builtin_parameters(scene).iter().map(|parameter| parameter.key)
}

fn suggestion(wanted: &str, among: impl Iterator<Item = &'static str>) -> Suggestion {
    Suggestion::find(wanted, among)
}

fn listed(names: impl Iterator<Item = &'static str>) -> String {
    names.collect::<Vec<_>>().join(", ")
}

fn known(scene: &str) -> String {
    let known = listed(keys(scene));
    if known.is_empty() { "the scene has no parameters".to_owned() } else { format!("known: {known}") }
}

/// A built-in scene that was asked for: its name, and the values of its parameters in their order.
#[derive(Debug, PartialEq, Eq)]
pub(super) struct Wanted {
    pub name: &'static str,
    pub values: Vec<u32>,
}

/// Reads `NAME` or `NAME?KEY=VALUE&KEY=VALUE`.
pub(super) fn parse(wanted: &str) -> Result<Wanted, BuiltinError> {
    let (name, given) = wanted.split_once('?').map_or((wanted, None), |(name, given)| (name, Some(given)));
    let known = names().find(|known| *known == name);
    let scene = known.ok_or_else(|| BuiltinError::Name { name: name.to_owned() })?;
    let parameters = builtin_parameters(scene);
    let mut values: Vec<Option<u32>> = vec![None; parameters.len()];
    for part in given.into_iter().flat_map(|given| given.split('&')) {
        let pair = part.split_once('=').filter(|(key, _)| !key.is_empty());
        let (key, value) = pair.ok_or_else(|| BuiltinError::Form { scene, got: part.to_owned() })?;
        let found = parameters.iter().zip(&mut values).find(|(parameter, _)| parameter.key == key);
        let (parameter, slot) = found.ok_or_else(|| BuiltinError::Key { scene, key: key.to_owned() })?;
        // `parse` alone would take a sign as well.
        let number = value.bytes().all(|b| b.is_ascii_digit()).then(|| value.parse().ok()).flatten();
        let number = number.filter(|n| (parameter.least..=parameter.most).contains(n));
        let wrong = || BuiltinError::Value { scene, parameter: *parameter, got: value.to_owned() };
        if slot.replace(number.ok_or_else(wrong)?).is_some() {
            return Err(BuiltinError::Twice { scene, key: parameter.key });
        }
    }
    let filled = parameters.iter().zip(values).map(|(parameter, value)| value.unwrap_or(parameter.default)).collect();
    Ok(Wanted { name: scene, values: filled })
}

#[cfg(test)]
mod tests {
    use super::*;

    fn values(wanted: &str) -> Vec<u32> {
        parse(wanted).unwrap().values
    }

    #[test]
    fn parameters_follow_the_name() {
        assert_eq!(parse("cornell"), Ok(Wanted { name: "cornell", values: Vec::new() }));
        assert_eq!(values("night-market"), [1_000]);
        assert_eq!(values("night-market?lights=10"), [10]);
        assert_eq!(values("night-market?lights=100000"), [100_000]);
    }

    #[test]
    fn defaults_are_in_range() {
        for parameter in names().flat_map(builtin_parameters) {
            assert!((parameter.least..=parameter.most).contains(&parameter.default), "{parameter:?}");
        }
    }

    #[test]
    fn each_mistake_has_its_refusal() {
        let refused = |wanted: &str| parse(wanted).unwrap_err().to_string();
        for (wanted, words) in [
            ("cornel", &["\"cornel\"", "did you mean \"cornell\"", "known: courtyard"][..]),
            ("", &["known: courtyard"]),
            ("night-market?", &["night-market", "KEY=VALUE", "got \"\""]),
            ("night-market?lights", &["KEY=VALUE", "\"lights\""]),
            ("night-market?=5", &["KEY=VALUE", "\"=5\""]),
            ("night-market?lights=10&", &["KEY=VALUE", "got \"\""]),
            ("night-market?light=10", &["\"light\"", "did you mean \"lights\"", "known: lights"]),
            ("night-market?lights=10&lights=20", &["lights", "twice"]),
            ("night-market?lights=9", &["\"9\"", "10 to 100000"]),
            ("night-market?lights=100001", &["\"100001\"", "10 to 100000"]),
            ("night-market?lights=99999999999999999999", &["10 to 100000"]),
            ("night-market?lights=+50", &["\"+50\"", "a whole number"]),
            ("night-market?lights=1e3", &["\"1e3\"", "a whole number"]),
            ("night-market?lights=", &["\"\"", "a whole number"]),
            ("cornell?lights=10", &["cornell", "\"lights\"", "no parameters"]),
        ] {
            let message = refused(wanted);
            assert!(words.iter().all(|word| message.contains(word)), "{wanted}: {message}");
        }
    }
}
