//! Tests of the packing against slow and obvious checks, and how tight it is on frames.

use super::*;
use proptest::prelude::*;
use std::collections::BTreeSet;

/// SplitMix64 (Steele, Lea and Flood 2014): the frames below are the same on every run.
pub(super) struct Random(pub(super) u64);

impl Random {
    pub(super) fn below(&mut self, end: u64) -> u64 {
        self.0 = self.0.wrapping_add(0x9e37_79b9_7f4a_7c15);
        let z = (self.0 ^ self.0 >> 30).wrapping_mul(0xbf58_476d_1ce4_e5b9);
        let z = (z ^ z >> 27).wrapping_mul(0x94d0_49bb_1331_11eb);
        (z ^ z >> 31) % end
    }

    fn between(&mut self, low: u64, high: u64) -> u64 {
        low + self.below(high - low + 1)
    }

    fn one(&mut self, of: &[u64]) -> u64 {
        of[self.below(of.len() as u64) as usize]
    }
}

/// How a device aligns.
#[derive(Clone, Copy, Debug)]
enum Device {
    /// All alike.
    Fixed(u64),
    /// 64 KiB for images of at least that size, 4 KiB for smaller ones, 256 bytes for buffers.
    Desktop,
    /// Anything for anything.
    Any,
}

/// The items of a frame as an engine makes them, pass after pass.
struct Frame {
    random: Random,
    device: Device,
    size: (u64, u64),
    passes: u32,
    items: Vec<Item>,
}

impl Frame {
    fn add(&mut self, bytes: u64, image: bool, first: u32, last: u32) {
        let align = match self.device {
            Device::Fixed(align) => align,
            Device::Desktop if !image => 256,
            Device::Desktop if bytes < 65536 => 4096,
            Device::Desktop => 65536,
            Device::Any => 64 << self.random.below(11),
        };
        let end = self.passes - 1;
        self.items.push(Item { bytes, align, first: first.min(end), last: last.min(end), lane: 0 });
    }

    /// Bytes of an image of the frame's size over 2^shift, with its mips if asked.
    fn image(&self, shift: u32, texel: u64, pyramid: bool) -> u64 {
        let level = |mip: u32| (self.size.0 >> mip).max(1) * (self.size.1 >> mip).max(1) * texel;
        let mips = if pyramid { 64 - self.size.0.max(self.size.1).leading_zeros() } else { shift + 1 };
        (shift..mips.max(shift + 1)).map(level).sum()
    }
}

/// A frame: a long-lived G-buffer, then effects until the passes are used up: chains, fan-outs, pyramids, buffers.
pub(super) fn frame(seed: u64, passes: u32) -> Vec<Item> {
    let mut random = Random(seed);
    let size = [(1920, 1080), (1280, 720), (641, 359), (1919, 1079), (997, 563)][random.below(5) as usize];
    let device = match random.below(6) {
        0 => Device::Fixed(64),
        1 => Device::Fixed(4096),
        2 => Device::Fixed(65536),
        3 | 4 => Device::Desktop,
        _ => Device::Any,
    };
    let mut f = Frame { random, device, size, passes, items: Vec::new() };
    // Depth, base colour, normal, material, emission, motion, identifiers.
    for texel in [4, 4, 8, 2, 8, 4, 8] {
        let last = f.random.between(u64::from(passes) / 3, u64::from(passes) - 4) as u32;
        f.add(f.image(0, texel, false), true, 0, last);
    }
    let mut pass = 1;
    while pass < passes {
        let (shift, texel) = (f.random.one(&[0, 0, 0, 1, 1, 2]) as u32, f.random.one(&[1, 2, 4, 4, 8, 8, 16]));
        let length = f.random.between(2, 7) as u32;
        let image = f.image(shift, texel, false);
        match f.random.below(5) {
            // A chain, such as a blur: each pass reads the image of the one before.
            0 | 1 => (0..length).for_each(|i| f.add(image, true, pass + i, pass + i + 1)),
            // One image that several passes read, each of which makes one that the last of them gathers.
            2 => {
                f.add(image, true, pass, pass + length);
                for i in 1..length {
                    let (shift, texel) = (f.random.below(3) as u32, f.random.one(&[1, 2, 4, 8]));
                    f.add(f.image(shift, texel, false), true, pass + i, pass + length);
                }
            }
            // A pyramid, level by level, then read by one more pass.
            3 => f.add(f.image(shift, texel, true), true, pass, pass + length),
            // Moments and radiance side by side, as in a denoiser, with a small buffer.
            _ => {
                for i in 0..length {
                    f.add(image, true, pass + i, pass + i + 1);
                    f.add(f.image(shift, 8, false), true, pass + i, pass + i + 1);
                }
                let bytes = f.random.between(16, 100_000);
                f.add(bytes, false, pass, pass + length);
            }
        }
        // What the effect hands on is gathered much later.
        if f.random.below(2) == 0 {
            let later = f.random.between(3, 25) as u32;
            f.add(image, true, pass + length - 1, pass + length + later);
        }
        pass += length;
    }
    f.items
}

fn ratio(items: &[Item]) -> f64 {
    pack(items).bytes as f64 / lower_bound(items) as f64
}

#[test]
fn frames_take_little_more_than_what_is_alive_at_once() {
    for (passes, seeds) in [(60, 2000u64), (100, 300), (250, 100)] {
        let ratios: Vec<f64> = (0..seeds).map(|seed| ratio(&frame(seed, passes))).collect();
        let worst = ratios.iter().enumerate().max_by(|a, b| a.1.total_cmp(b.1)).unwrap();
        let mean = ratios.iter().sum::<f64>() / seeds as f64;
        println!("{passes} passes: mean {mean:.4}, worst {:.4} (seed {})", worst.1, worst.0);
        assert!(*worst.1 <= 1.05, "{passes} passes, seed {}: {} times the lower bound", worst.0, worst.1);
    }
}
