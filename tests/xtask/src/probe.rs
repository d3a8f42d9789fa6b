//! Finds out from Magpie itself whether there is a device that it accepts.

use crate::shell::Invocation;
use crate::workplace::Workplace;
use anyhow::{Result, bail};

/// Exit status of `magpie` for "no usable device".
const NO_DEVICE: i32 = 3;

/// Result of `magpie devices`.
#[derive(Clone, Debug, PartialEq, Eq)]
pub enum Answer {
    /// A device is accepted; the list of devices.
    Device(String),
    /// No device is accepted; the reasons.
    None(String),
}

/// Runs `magpie devices`, which must be built.
pub fn probe(place: &Workplace) -> Result<Answer> {
    let path = place.magpie();
    let output = Invocation::new(&path.to_string_lossy(), &["devices"]).output()?;
    let (out, err) = (String::from_utf8_lossy(&output.stdout), String::from_utf8_lossy(&output.stderr));
    answer(output.status.code(), &out, &err)
}

fn answer(code: Option<i32>, out: &str, err: &str) -> Result<Answer> {
    let both =
        [out.trim_end(), err.trim_end()].into_iter().filter(|text| !text.is_empty()).collect::<Vec<_>>().join("\n");
    match code {
        Some(0) => Ok(Answer::Device(out.trim_end().to_owned())),
        Some(NO_DEVICE) => Ok(Answer::None(both)),
        // A driver that crashes should be investigated; installing another one would not help.
        Some(code) => bail!("`magpie devices` ended with status {code}\n{both}"),
        None => bail!("`magpie devices` was ended by a signal\n{both}"),
    }
}

#[cfg(test)]
mod tests {
    use super::*;

    #[test]
    fn the_exit_status_decides() {
        assert_eq!(answer(Some(0), "llvmpipe\n", "a warning\n").unwrap(), Answer::Device("llvmpipe".to_owned()));
        assert_eq!(answer(Some(3), "", "no loader\n").unwrap(), Answer::None("no loader".to_owned()));
        assert_eq!(
            answer(Some(3), "old card\n", "none left\n").unwrap(),
            Answer::None("old card\nnone left".to_owned())
        );
    }

    #[test]
    fn a_crash_is_not_taken_for_a_missing_device() {
        let crash = answer(None, "", "").unwrap_err().to_string();
        assert!(crash.contains("signal"), "{crash}");
        let failure = answer(Some(101), "", "panicked").unwrap_err().to_string();
        assert!(failure.contains("status 101") && failure.contains("panicked"), "{failure}");
    }
}
