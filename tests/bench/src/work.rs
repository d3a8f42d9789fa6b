//! The work of every contestant in a frame, and its expected result.

use magpie_shaders::bench::{CELLS, FIRST_FACTOR, NUMBER_FACTOR, SECOND_FACTOR, SIDE};
use serde::Serialize;

/// Kind of resource that the passes write.
#[derive(Clone, Copy, Debug, PartialEq, Eq, Serialize)]
#[serde(rename_all = "lowercase")]
pub enum Variant {
    /// Buffers of 256 bytes, accessed by device address.
    Buffer,
    /// Images of 4x4 pixels, one unsigned integer each.
    Image,
}

impl Variant {
    /// Both variants.
    pub const ALL: [Self; 2] = [Self::Buffer, Self::Image];

    /// Name in the report.
    pub fn name(self) -> &'static str {
        match self {
            Self::Buffer => "buffer",
            Self::Image => "image",
        }
    }

    /// Words that a pass writes, one per thread.
    pub fn words(self) -> usize {
        match self {
            Self::Buffer => CELLS as usize,
            Self::Image => (SIDE * SIDE) as usize,
        }
    }

    /// Bytes that a pass writes.
    pub fn bytes(self) -> u64 {
        self.words() as u64 * size_of::<u32>() as u64
    }
}

/// A frame of `passes` passes.
///
/// Pass `i` reads the outputs of passes `i - 1` and `i - 2`, writes its own transient and dispatches one workgroup. The last output is
/// copied to CPU-visible memory.
#[derive(Clone, Copy, Debug, PartialEq, Eq)]
pub struct Work {
    /// Kind of resource.
    pub variant: Variant,
    /// Number of passes, without the final copy.
    pub passes: u32,
}

impl Work {
    /// Expected output of the last pass.
    pub fn expected(self) -> Vec<u32> {
        let lane = |lane: u32| {
            let (mut first, mut second) = (0_u32, 0_u32);
            for number in 0..self.passes {
                let value = first
                    .wrapping_mul(FIRST_FACTOR)
                    .wrapping_add(second.wrapping_mul(SECOND_FACTOR))
                    .wrapping_add(number.wrapping_mul(NUMBER_FACTOR))
                    .wrapping_add(lane);
                (first, second) = (value, first);
            }
            first
        };
        (0..self.variant.words() as u32).map(lane).collect()
    }
}

#[cfg(test)]
mod tests {
    use super::*;

    #[test]
    fn the_recurrence_by_hand() {
        let last = |passes| Work { variant: Variant::Buffer, passes }.expected()[5];
        assert_eq!(last(1), 5);
        let second = 5 * 1_664_525_u64 + 2_654_435_761 + 5;
        assert_eq!(u64::from(last(2)), second % (1 << 32));
        let third = (second % (1 << 32)) * 1_664_525 + 5 * 22_695_477 + 2 * 2_654_435_761 + 5;
        assert_eq!(u64::from(last(3)), third % (1 << 32));
        assert_eq!(Work { variant: Variant::Image, passes: 3 }.expected().len(), 16);
    }
}
