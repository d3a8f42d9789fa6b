//! Settings of implementations: what they are called, which values they take, and which of these trade accuracy for time.

use std::fmt;
use std::ops::RangeInclusive;

use serde::Serialize;

use crate::config::{Suggestion, Value};

/// Values that a setting may take.
#[derive(Clone, Debug, PartialEq, Serialize)]
#[serde(rename_all = "kebab-case")]
pub enum Range {
    /// Every finite value of the default's type.
    Any,
    /// A number between these, both included.
    Float {
        /// Least.
        min: f64,
        /// Greatest.
        max: f64,
    },
    /// A whole number between these, both included.
    Integer {
        /// Least.
        min: i64,
        /// Greatest.
        max: i64,
    },
    /// One of these names.
    OneOf(&'static [&'static str]),
    /// One of these whole numbers.
    Among(&'static [i64]),
}

impl fmt::Display for Range {
    fn fmt(&self, f: &mut fmt::Formatter<'_>) -> fmt::Result {
        match self {
            Self::Any => f.write_str("any"),
            Self::Float { min, max } => write!(f, "{min} to {max}"),
            Self::Integer { min, max } => write!(f, "whole number, {min} to {max}"),
            Self::OneOf(names) => write!(f, "{}", names.join(", ")),
            Self::Among(numbers) => {
                write!(f, "one of {}", numbers.iter().map(i64::to_string).collect::<Vec<_>>().join(", "))
            }
        }
    }
}

/// One setting of an implementation.
#[derive(Clone, Debug, PartialEq, Serialize)]
pub struct SettingSpec {
    /// Name in the configuration.
    pub key: &'static str,
    /// Unit, such as `degrees`; empty for a plain number, switch or name.
    pub unit: &'static str,
    /// What it does, and what higher and lower values do.
    pub about: &'static str,
    /// Value when nothing else is said; its type is the setting's type.
    pub default: Value,
    /// Accepted values.
    pub range: Range,
    /// Steps that trade accuracy for time, in the order in which they are measured; the default is one of them. Empty where the
    /// setting is a matter of taste, such as a tone curve.
    pub sweep: Vec<Value>,
}

impl SettingSpec {
    /// A number in a range.
    #[must_use]
    pub fn float(
        key: &'static str,
        unit: &'static str,
        about: &'static str,
        default: f64,
        range: RangeInclusive<f64>,
    ) -> Self {
        let (min, max) = range.into_inner();
        Self { key, unit, about, default: Value::Float(default), range: Range::Float { min, max }, sweep: Vec::new() }
    }

    /// A whole number in a range.
    #[must_use]
    pub fn integer(
        key: &'static str,
        unit: &'static str,
        about: &'static str,
        default: i64,
        range: RangeInclusive<i64>,
    ) -> Self {
        let (min, max) = range.into_inner();
        Self {
            key,
            unit,
            about,
            default: Value::Integer(default),
            range: Range::Integer { min, max },
            sweep: Vec::new(),
        }
    }

    /// One whole number out of several.
    #[must_use]
    pub fn among(
        key: &'static str,
        unit: &'static str,
        about: &'static str,
        default: i64,
        numbers: &'static [i64],
    ) -> Self {
        let range = Range::Among(numbers);
        Self { key, unit, about, default: Value::Integer(default), range, sweep: Vec::new() }
    }

    /// A switch.
    #[must_use]
    pub fn switch(key: &'static str, about: &'static str, default: bool) -> Self {
        Self { key, unit: "", about, default: Value::Bool(default), range: Range::Any, sweep: Vec::new() }
    }

    /// One name out of several.
    #[must_use]
    pub fn choice(
        key: &'static str,
        about: &'static str,
        default: &'static str,
        names: &'static [&'static str],
    ) -> Self {
        Self {
            key,
            unit: "",
            about,
            default: Value::Text(default.to_owned()),
            range: Range::OneOf(names),
            sweep: Vec::new(),
        }
    }

    /// A text, read by the implementation.
    #[must_use]
    pub fn text(key: &'static str, about: &'static str, default: &'static str) -> Self {
        let default = Value::Text(default.to_owned());
        Self { key, unit: "", about, default, range: Range::Any, sweep: Vec::new() }
    }

    /// Says which values trade accuracy for time, for `magpie accuracy` to measure. The default belongs to them, whether it is
    /// named or not.
    #[must_use]
    pub fn sweep(mut self, steps: impl IntoIterator<Item = impl Into<Value>>) -> Self {
        self.sweep = steps.into_iter().map(Into::into).collect();
        if !self.sweep.contains(&self.default) {
            self.sweep.insert(0, self.default.clone());
        }
        self
    }

    /// The same with every value of a switch, a choice or one number out of several; of other settings with the default alone.
    #[must_use]
    pub fn sweep_all(self) -> Self {
        let steps: Vec<Value> = match (&self.range, &self.default) {
            (Range::OneOf(names), _) => names.iter().map(|name| Value::from(*name)).collect(),
            (Range::Among(numbers), _) => numbers.iter().map(|number| Value::from(*number)).collect(),
            (_, Value::Bool(on)) => vec![Value::Bool(*on), Value::Bool(!*on)],
            _ => Vec::new(),
        };
        self.sweep(steps)
    }

    /// What is wrong with the steps of the sweep: one that the range refuses, one that stands twice.
    pub(super) fn mistakes_of_sweep(&self) -> Vec<String> {
        let mut found = Vec::new();
        for (at, step) in self.sweep.iter().enumerate() {
            match self.accept(step) {
                Err(fault) => found.push(format!("the step {step} of its sweep does not suit it: {fault}")),
                Ok(value) if value != *step => {
                    found.push(format!("the step {step} of its sweep is a {}, not a {}", step.kind(), value.kind()));
                }
                Ok(_) if self.sweep[..at].contains(step) => found.push(format!("the step {step} stands twice")),
                Ok(_) => {}
            }
        }
        found
    }

    /// Checks a value and gives it the setting's type: a whole number is a fine value for a number.
    ///
    /// # Errors
    /// [`SettingFault`] when the type is wrong, or the value is not finite or out of range.
    pub fn accept(&self, value: &Value) -> Result<Value, SettingFault> {
        let value = match (&self.default, value) {
            (Value::Float(_), Value::Integer(whole)) => Value::Float(*whole as f64),
            (wanted, got) if wanted.kind() == got.kind() => got.clone(),
            (wanted, got) => {
                return Err(SettingFault::WrongType {
                    wanted: wanted.kind(),
                    range: self.range.clone(),
                    got: got.clone(),
                });
            }
        };
        if let Value::Float(number) = value
            && !number.is_finite()
        {
            return Err(SettingFault::NotFinite { range: self.range.clone(), got: number });
        }
        let inside = match (&self.range, &value) {
            (Range::Any, _) => true,
            (Range::Float { min, max }, Value::Float(x)) => (*min..=*max).contains(x),
            (Range::Integer { min, max }, Value::Integer(x)) => (*min..=*max).contains(x),
            (Range::Among(numbers), Value::Integer(x)) => numbers.contains(x),
            (Range::OneOf(names), Value::Text(name)) => {
                if names.contains(&name.as_str()) {
                    true
                } else {
                    let suggestion = Suggestion::find(name, names.iter().copied());
                    return Err(SettingFault::NotOneOf { names, got: name.clone(), suggestion });
                }
            }
            _ => false,
        };
        if inside { Ok(value) } else { Err(SettingFault::OutOfRange { range: self.range.clone(), got: value }) }
    }
}

/// Why a value does not suit a setting.
#[derive(Clone, Debug, PartialEq, thiserror::Error)]
pub enum SettingFault {
    /// Such as a text where a number belongs.
    #[error("wanted a {wanted} ({range}), got the {} {got}", got.kind())]
    WrongType {
        /// Name of the wanted type.
        wanted: &'static str,
        /// Accepted values.
        range: Range,
        /// What was given.
        got: Value,
    },
    /// NaN or infinite.
    #[error("wanted a finite number ({range}), got {got}")]
    NotFinite {
        /// Accepted values.
        range: Range,
        /// What was given.
        got: f64,
    },
    /// Too low or too high.
    #[error("wanted {range}, got {got}")]
    OutOfRange {
        /// Accepted values.
        range: Range,
        /// What was given.
        got: Value,
    },
    /// A name that is not in the list.
    #[error("wanted one of {}, got \"{got}\"{suggestion}", names.join(", "))]
    NotOneOf {
        /// Accepted names.
        names: &'static [&'static str],
        /// What was given.
        got: String,
        /// The closest accepted name.
        suggestion: Suggestion,
    },
}
