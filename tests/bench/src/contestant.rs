//! Who takes part.

use crate::{clock::Clock, work::Work};
use magpie::gpu::GpuError;
use magpie::graph::execute::ExecuteError;
use std::fmt::Display;

/// Why a benchmark did not come to its end.
#[derive(Debug, thiserror::Error)]
pub enum BenchError {
    /// No device, or it failed.
    #[error(transparent)]
    Gpu(#[from] GpuError),
    /// Magpie's frame did not run.
    #[error("magpie: {0}")]
    Graph(#[from] ExecuteError),
    /// Another contestant could not do its part.
    #[error("{contestant}: {what}: {message}")]
    Failed {
        /// Who.
        contestant: &'static str,
        /// Which call or step.
        what: &'static str,
        /// What it said.
        message: String,
    },
    /// A frame came out wrong.
    #[error("{contestant}: word {word} after {} passes ({}): wanted {wanted:#010x}, got {got:#010x}", work.passes, work.variant.name())]
    Wrong {
        /// Who.
        contestant: &'static str,
        /// Doing what.
        work: Work,
        /// Index of the word.
        word: usize,
        /// What the CPU says.
        wanted: u32,
        /// What was read back.
        got: u32,
    },
}

impl BenchError {
    /// Whether the device or the library cannot do so much; less may go well.
    pub(crate) fn is_limit(&self) -> bool {
        use GpuError::Limit;
        matches!(self, Self::Gpu(Limit { .. }) | Self::Graph(ExecuteError::Pass { source: Limit { .. }, .. }))
    }

    /// For `map_err`: a contestant's own error, in its words.
    pub(crate) fn failed<E: Display>(contestant: &'static str, what: &'static str) -> impl Fn(E) -> Self {
        move |error| Self::Failed { contestant, what, message: error.to_string() }
    }
}

/// What a frame says about itself.
#[derive(Clone, Copy, Debug, Default)]
pub struct Frame {
    /// Barriers of the whole frame; none where the library does not tell.
    pub barriers: Option<u32>,
}

/// One way to run the passes. Each has a device of its own and takes turns with the others.
pub trait Contestant {
    /// Name in the report.
    fn name(&self) -> &'static str;

    /// One line: what is made anew every frame and what is kept.
    fn about(&self) -> &'static str;

    /// Why it cannot take part in this work, if so.
    fn refuses(&self, _: Work) -> Option<String> {
        None
    }

    /// Makes everything that is kept from frame to frame, and drops that of the work before.
    ///
    /// # Errors
    /// [`BenchError`] of the device or the library.
    fn prepare(&mut self, work: Work) -> Result<(), BenchError>;

    /// Runs one frame and waits for it. The clock stands during the wait.
    ///
    /// Fills the words that the CPU will read with zeros first, so that an earlier frame cannot pass for this one.
    ///
    /// # Errors
    /// [`BenchError`] of the device or the library.
    fn frame(&mut self, clock: &mut Clock) -> Result<Frame, BenchError>;

    /// What the last frame left in the memory that the CPU reads.
    ///
    /// # Errors
    /// [`BenchError`] of the device or the library.
    fn result(&self) -> Result<Vec<u32>, BenchError>;
}

/// Compares what came out with what the CPU says.
pub(crate) fn check(contestant: &dyn Contestant, work: Work, expected: &[u32]) -> Result<(), BenchError> {
    let result = contestant.result()?;
    let name = contestant.name();
    if result.len() != expected.len() {
        let message = format!("wanted {} words, got {}", expected.len(), result.len());
        return Err(BenchError::Failed { contestant: name, what: "result", message });
    }
    let wrong = expected.iter().zip(&result).position(|(wanted, got)| wanted != got);
    wrong.map_or(Ok(()), |word| {
        Err(BenchError::Wrong { contestant: name, work, word, wanted: expected[word], got: result[word] })
    })
}

#[cfg(test)]
mod tests {
    use super::*;
    use crate::Variant;

    struct Told(Vec<u32>);

    impl Contestant for Told {
        fn name(&self) -> &'static str {
            "told"
        }

        fn about(&self) -> &'static str {
            "says what it is told"
        }

        fn prepare(&mut self, _: Work) -> Result<(), BenchError> {
            Ok(())
        }

        fn frame(&mut self, _: &mut Clock) -> Result<Frame, BenchError> {
            Ok(Frame::default())
        }

        fn result(&self) -> Result<Vec<u32>, BenchError> {
            Ok(self.0.clone())
        }
    }

    #[test]
    fn a_wrong_word_is_named() {
        let work = Work { variant: Variant::Image, passes: 9 };
        let expected = work.expected();
        assert!(check(&Told(expected.clone()), work, &expected).is_ok());
        let mut wrong = expected.clone();
        wrong[11] ^= 1;
        let text = check(&Told(wrong), work, &expected).unwrap_err().to_string();
        assert!(text.contains("told: word 11 after 9 passes (image)"), "{text}");
        assert!(check(&Told(expected[..4].to_vec()), work, &expected).is_err());
        assert!(check(&Told(vec![0; 16]), work, &expected).is_err());
    }
}
