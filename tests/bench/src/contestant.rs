//! The interface of the libraries that are compared.

use crate::{clock::Clock, work::Work};
use magpie::gpu::GpuError;
use magpie::graph::execute::ExecuteError;
use std::fmt::Display;

/// Why a benchmark could not be completed.
#[derive(Debug, thiserror::Error)]
pub enum BenchError {
    /// There is no usable device, or it failed.
    #[error(transparent)]
    Gpu(#[from] GpuError),
    /// Magpie's frame failed.
    #[error("magpie: {0}")]
    Graph(#[from] ExecuteError),
    /// Another contestant failed.
    #[error("{contestant}: {what}: {message}")]
    Failed {
        /// Name of the contestant.
        contestant: &'static str,
        /// The call or step that failed.
        what: &'static str,
        /// Its error message.
        message: String,
    },
    /// A frame produced a wrong result.
    #[error("{contestant}: word {word} after {} passes ({}): wanted {wanted:#010x}, got {got:#010x}", work.passes, work.variant.name())]
    Wrong {
        /// Name of the contestant.
        contestant: &'static str,
        /// The work that it did.
        work: Work,
        /// Index of the first wrong word.
        word: usize,
        /// Value computed on the CPU.
        wanted: u32,
        /// Value that was read back.
        got: u32,
    },
}

impl BenchError {
    /// Whether the error is a limit of the device or the library, so that less work may succeed.
    pub(crate) fn is_limit(&self) -> bool {
        use GpuError::Limit;
        matches!(self, Self::Gpu(Limit { .. }) | Self::Graph(ExecuteError::Pass { source: Limit { .. }, .. }))
    }

    /// For `map_err`: wraps a contestant's own error.
    pub(crate) fn failed<E: Display>(contestant: &'static str, what: &'static str) -> impl Fn(E) -> Self {
        move |error| Self::Failed { contestant, what, message: error.to_string() }
    }
}

/// Statistics of a frame.
#[derive(Clone, Copy, Debug, Default)]
pub struct Frame {
    /// Barriers of the whole frame; none if the library does not report them.
    pub barriers: Option<u32>,
}

/// A library or variant that runs the passes. Each has its own device; they take turns.
pub trait Contestant {
    /// Name in the report.
    fn name(&self) -> &'static str;

    /// One line for the report: what is rebuilt every frame and what is kept.
    fn about(&self) -> &'static str;

    /// Why it cannot do this work, if so.
    fn refuses(&self, _: Work) -> Option<String> {
        None
    }

    /// Creates everything that is kept from frame to frame, and drops that of the previous work.
    ///
    /// # Errors
    /// [`BenchError`] of the device or the library.
    fn prepare(&mut self, work: Work) -> Result<(), BenchError>;

    /// Runs one frame and waits for it, with the clock stopped during the wait.
    ///
    /// Zeroes the words that will be read back first, so that an earlier frame's result cannot be mistaken for this one's.
    ///
    /// # Errors
    /// [`BenchError`] of the device or the library.
    fn frame(&mut self, clock: &mut Clock) -> Result<Frame, BenchError>;

    /// The words that the last frame copied to CPU-visible memory.
    ///
    /// # Errors
    /// [`BenchError`] of the device or the library.
    fn result(&self) -> Result<Vec<u32>, BenchError>;
}

/// Compares a contestant's result with the expected words.
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

    struct FixedResult(Vec<u32>);

    impl Contestant for FixedResult {
        fn name(&self) -> &'static str {
            "fixed"
        }

        fn about(&self) -> &'static str {
            "returns a fixed result"
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
        assert!(check(&FixedResult(expected.clone()), work, &expected).is_ok());
        let mut wrong = expected.clone();
        wrong[11] ^= 1;
        let text = check(&FixedResult(wrong), work, &expected).unwrap_err().to_string();
        assert!(text.contains("fixed: word 11 after 9 passes (image)"), "{text}");
        assert!(check(&FixedResult(expected[..4].to_vec()), work, &expected).is_err());
        assert!(check(&FixedResult(vec![0; 16]), work, &expected).is_err());
    }
}
