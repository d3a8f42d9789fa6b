//! Textures in host memory: 8-bit RGBA with all mips.
use rayon::prelude::*;
use std::sync::LazyLock;

/// How the three colour channels are encoded. Alpha is always linear.
#[derive(Clone, Copy, Debug, PartialEq, Eq, Hash)]
pub enum ColourSpace {
    /// IEC 61966-2-1 curve, Rec.709 primaries: base colour and emission.
    Srgb,
    /// The codes are the values: normals, roughness, metalness, occlusion.
    Linear,
}

/// A texture with all its mips.
#[derive(Clone, Debug)]
pub struct Texture {
    /// Name, for messages.
    pub name: String,
    /// Width and height of mip 0, texels, at least 1.
    pub size: [u32; 2],
    /// How the colour channels are encoded.
    pub colour_space: ColourSpace,
    /// RGBA, 8 bits each, row by row from the top. Mip 0 is the full image, the last is 1x1, and mip `i` measures `max(1, size >> i)`.
    pub mips: Vec<Vec<u8>>,
}

impl Texture {
    /// A texture from `size[0] * size[1] * 4` bytes of RGBA; computes its mips.
    pub fn new(name: String, size: [u32; 2], colour_space: ColourSpace, rgba: Vec<u8>) -> Self {
        Self { name, size, colour_space, mips: mip_chain(size, rgba, colour_space) }
    }

    /// Width and height of a mip, texels.
    pub fn mip_size(&self, mip: usize) -> [u32; 2] {
        self.size.map(|n| n.checked_shr(mip as u32).unwrap_or(0).max(1))
    }
}

/// All mips of an image, mip 0 first, down to 1x1. Each is half as large as the one before, rounded down, and at least 1.
///
/// An exact box filter in linear light: a texel is the mean of the area that it covers in the mip before, even if that is 2.5
/// texels wide. Rows are computed in parallel.
///
/// # Panics
/// If `rgba` does not hold `size[0] * size[1]` texels of 4 bytes, or if a size is 0.
pub fn mip_chain(size: [u32; 2], rgba: Vec<u8>, colour_space: ColourSpace) -> Vec<Vec<u8>> {
    let mut size = size.map(|n| n as usize);
    assert!(size[0] > 0 && size[1] > 0, "a texture of {size:?} texels has no mips");
    assert_eq!(rgba.len(), size[0] * size[1] * 4, "bytes of a texture of {size:?} texels");
    let mut mips = vec![rgba];
    while size != [1, 1] {
        let next = size.map(|n| (n / 2).max(1));
        let mip = halve(&mips[mips.len() - 1], size, next, colour_space);
        mips.push(mip);
        size = next;
    }
    mips
}

fn halve(from: &[u8], size: [usize; 2], next: [usize; 2], colour_space: ColourSpace) -> Vec<u8> {
    let columns: Vec<Cover> = (0..next[0]).map(|i| Cover::new(i, size[0], next[0])).collect();
    let mut to = vec![0_u8; next[0] * next[1] * 4];
    to.par_chunks_mut(next[0] * 4).enumerate().for_each(|(y, row)| {
        let rows = Cover::new(y, size[1], next[1]);
        for (texel, cover) in row.chunks_exact_mut(4).zip(&columns) {
            let mut sum = [0.0_f32; 4];
            for (sy, wy) in rows.taps() {
                for (sx, wx) in cover.taps() {
                    let at = (sy * size[0] + sx) * 4;
                    for c in 0..4 {
                        sum[c] += wy * wx * decode(from[at + c], colour_space, c);
                    }
                }
            }
            for c in 0..4 {
                texel[c] = encode(sum[c], colour_space, c);
            }
        }
    });
    to
}

/// The texels of a row that one texel of the next mip covers, with weights that sum to 1.
struct Cover {
    first: usize,
    weights: [f32; 4],
    count: usize,
}

impl Cover {
    /// Texel `i` of `to` covers `from / to` texels. Both are counted in units of `1 / to`, so that the arithmetic is exact.
    fn new(i: usize, from: usize, to: usize) -> Self {
        let (start, end) = (i * from, (i + 1) * from);
        let first = start / to;
        let count = end.div_ceil(to) - first;
        let mut weights = [0.0; 4];
        for (k, weight) in weights.iter_mut().enumerate().take(count) {
            let texel = first + k;
            let covered = end.min((texel + 1) * to) - start.max(texel * to);
            *weight = covered as f32 / from as f32;
        }
        Self { first, weights, count }
    }

    fn taps(&self) -> impl Iterator<Item = (usize, f32)> + '_ {
        (0..self.count).map(|k| (self.first + k, self.weights[k]))
    }
}

/// The sRGB decoding curve (IEC 61966-2-1), 0 to 1 in and out.
pub(super) fn srgb_to_linear(s: f32) -> f32 {
    if s <= 0.04045 { s / 12.92 } else { ((s + 0.055) / 1.055).powf(2.4) }
}

struct Curve {
    /// Linear value of each code.
    linear: [f32; 256],
    /// Smallest linear value that rounds to code `i + 1`.
    above: [f32; 255],
    /// For index `x * 1023`: a code equal to the right one or slightly below.
    guess: [u8; 1024],
}

static CURVE: LazyLock<Curve> = LazyLock::new(|| {
    let above: [f32; 255] = std::array::from_fn(|i| srgb_to_linear((i as f32 + 0.5) / 255.0));
    let guess = std::array::from_fn(|i| above.partition_point(|t| *t <= i as f32 / 1023.0) as u8);
    Curve { linear: std::array::from_fn(|i| srgb_to_linear(i as f32 / 255.0)), above, guess }
});

fn decode(code: u8, colour_space: ColourSpace, channel: usize) -> f32 {
    if colour_space == ColourSpace::Srgb && channel < 3 { CURVE.linear[code as usize] } else { code as f32 / 255.0 }
}

/// The nearest code, measured on the encoded scale.
fn encode(value: f32, colour_space: ColourSpace, channel: usize) -> u8 {
    if colour_space == ColourSpace::Srgb && channel < 3 {
        let curve = &*CURVE;
        let mut code = curve.guess[((value * 1023.0) as usize).min(1023)];
        while code < 255 && curve.above[code as usize] <= value {
            code += 1;
        }
        code
    } else {
        (value * 255.0 + 0.5) as u8
    }
}

#[cfg(test)]
mod tests {
    use super::*;

    #[test]
    fn every_size_ends_at_one_texel() {
        for size in [[1, 1], [2, 2], [3, 5], [7, 1], [1, 9], [640, 33], [255, 257]] {
            let bytes = vec![200_u8; (size[0] * size[1] * 4) as usize];
            for space in [ColourSpace::Srgb, ColourSpace::Linear] {
                let t = Texture::new("t".into(), size, space, bytes.clone());
                for (i, mip) in t.mips.iter().enumerate() {
                    let [w, h] = t.mip_size(i);
                    assert_eq!(mip.len(), (w * h * 4) as usize, "{size:?} mip {i}");
                    assert!(mip.iter().all(|b| *b == 200), "a flat image stays flat: {size:?} mip {i}");
                }
                assert_eq!(t.mip_size(t.mips.len() - 1), [1, 1]);
                assert_eq!(t.mips.len() as u32, 32 - size[0].max(size[1]).leading_zeros());
            }
        }
    }

    #[test]
    fn codes_survive_the_round_trip() {
        for space in [ColourSpace::Srgb, ColourSpace::Linear] {
            for code in 0..=255 {
                for channel in [0, 3] {
                    assert_eq!(encode(decode(code, space, channel), space, channel), code);
                }
            }
        }
    }

    #[test]
    fn black_and_white_meet_in_linear_light() {
        let checker = [0, 0, 0, 0, 255, 255, 255, 255];
        // Half the light is code 188 in sRGB and 128 in linear; alpha is always linear.
        assert_eq!(mip_chain([2, 1], checker.to_vec(), ColourSpace::Srgb)[1], [188, 188, 188, 128]);
        assert_eq!(mip_chain([2, 1], checker.to_vec(), ColourSpace::Linear)[1], [128; 4]);
    }

    #[test]
    fn odd_sizes_weigh_by_area() {
        // From 5 texels to 2, each covers 2.5: (0 + 100 + 50 / 2) / 2.5 and (50 / 2 + 200 + 250) / 2.5.
        let row: Vec<u8> = [0, 100, 50, 200, 250].iter().flat_map(|v| [*v; 4]).collect();
        let mip = &mip_chain([5, 1], row, ColourSpace::Linear)[1];
        assert_eq!((mip[0], mip[4]), (50, 190));
    }
}
