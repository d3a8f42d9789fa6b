//! Images that were read back, as numbers and as something to look at.
use crate::graph::{Extent, Format};

mod mapping;

pub use mapping::{Mapping, NoMapping, Quantity, Scale};

/// An image in host memory.
#[derive(Clone, Debug)]
pub struct Pixels {
    /// Width and height.
    pub extent: Extent,
    /// How `bytes` is to be read.
    pub format: Format,
    /// Rows from the top, without gaps.
    pub bytes: Vec<u8>,
}

impl Pixels {
    /// Four channels per pixel as numbers: sRGB decoded, integers as they are, missing channels 0, missing alpha 1.
    pub fn values(&self) -> Vec<[f32; 4]> {
        let size = self.format.bytes_per_pixel() as usize;
        self.bytes.chunks_exact(size).map(|pixel| self.decode(pixel)).collect()
    }

    fn decode(&self, p: &[u8]) -> [f32; 4] {
        let unorm = |i: usize| f32::from(p[i]) / 255.0;
        let word = |i: usize| u32::from_le_bytes([p[4 * i], p[4 * i + 1], p[4 * i + 2], p[4 * i + 3]]);
        let float = |i: usize| f32::from_bits(word(i));
        let half = |i: usize| half::f16::from_le_bytes([p[2 * i], p[2 * i + 1]]).to_f32();
        let unorm16 = |i: usize| f32::from(u16::from_le_bytes([p[2 * i], p[2 * i + 1]])) / 65535.0;
        let snorm = |i: usize| (f32::from(i16::from_le_bytes([p[2 * i], p[2 * i + 1]])) / 32767.0).max(-1.0);
        match self.format {
            Format::R8Unorm => [unorm(0), 0.0, 0.0, 1.0],
            Format::Rg8Unorm => [unorm(0), unorm(1), 0.0, 1.0],
            Format::Rgba8Unorm => [unorm(0), unorm(1), unorm(2), unorm(3)],
            Format::Rgba8Srgb => [srgb_decode(unorm(0)), srgb_decode(unorm(1)), srgb_decode(unorm(2)), unorm(3)],
            Format::R16Unorm => [unorm16(0), 0.0, 0.0, 1.0],
            Format::Rg16Unorm => [unorm16(0), unorm16(1), 0.0, 1.0],
            Format::Rgba16Unorm => [unorm16(0), unorm16(1), unorm16(2), unorm16(3)],
            Format::A2Rgb10Unorm => {
                let bits = |shift: u32| ((word(0) >> shift) & 0x3ff) as f32 / 1023.0;
                [bits(20), bits(10), bits(0), (word(0) >> 30) as f32 / 3.0]
            }
            Format::Rg16Snorm => [snorm(0), snorm(1), 0.0, 1.0],
            Format::Rgba16Snorm => [snorm(0), snorm(1), snorm(2), snorm(3)],
            Format::R16Float => [half(0), 0.0, 0.0, 1.0],
            Format::Rg16Float => [half(0), half(1), 0.0, 1.0],
            Format::Rgba16Float => [half(0), half(1), half(2), half(3)],
            Format::R32Float | Format::D32Float => [float(0), 0.0, 0.0, 1.0],
            Format::Rg32Float => [float(0), float(1), 0.0, 1.0],
            Format::Rgba32Float => [float(0), float(1), float(2), float(3)],
            Format::R32Uint => [word(0) as f32, 0.0, 0.0, 1.0],
            Format::Rg32Uint => [word(0) as f32, word(1) as f32, 0.0, 1.0],
        }
    }

    /// 8-bit RGBA to look at: display images as they are; single channels of up to 16 bits too, which are shares; radiance through
    /// `x / (1 + x)`; normals and motion around middle grey; depth brightened towards the far; ids as colours that differ.
    pub fn presentable(&self) -> Vec<u8> {
        if self.format == Format::Rgba8Unorm {
            return self.bytes.clone();
        }
        let values = self.values();
        let nearest = values.iter().map(|v| v[0]).fold(f32::MIN_POSITIVE, f32::max);
        values
            .into_iter()
            .flat_map(|v| {
                let rgb = match self.format {
                    Format::Rgba8Srgb => [v[0], v[1], v[2]].map(srgb_encode),
                    Format::Rg16Snorm => [0.5 + 0.5 * v[0], 0.5 + 0.5 * v[1], 0.5],
                    Format::Rgba16Snorm => [v[0], v[1], v[2]].map(|x| 0.5 + 0.5 * x),
                    Format::Rg16Float | Format::Rg32Float => [0.5 + v[0], 0.5 + v[1], 0.5],
                    Format::D32Float => [(v[0] / nearest).max(0.0).cbrt(); 3],
                    Format::R32Uint | Format::Rg32Uint => id_colour(v[0] as u32),
                    Format::R8Unorm | Format::R16Unorm | Format::R16Float => [v[0]; 3],
                    Format::Rgba16Float | Format::Rgba32Float => {
                        [v[0], v[1], v[2]].map(|x| srgb_encode(x / (1.0 + x.max(0.0))))
                    }
                    Format::R32Float => [srgb_encode(v[0] / (1.0 + v[0].max(0.0))); 3],
                    Format::Rg8Unorm
                    | Format::Rgba8Unorm
                    | Format::Rg16Unorm
                    | Format::Rgba16Unorm
                    | Format::A2Rgb10Unorm => [v[0], v[1], v[2]],
                };
                let [r, g, b] = rgb.map(|x| (x.clamp(0.0, 1.0) * 255.0 + 0.5) as u8);
                [r, g, b, 255]
            })
            .collect()
    }
}

/// A colour for an id; 0 is black. Golden-ratio steps keep neighbours apart.
fn id_colour(id: u32) -> [f32; 3] {
    if id == 0 {
        return [0.0; 3];
    }
    let hash = id.wrapping_mul(0x9e37_79b9);
    [hash >> 24, (hash >> 16) & 0xff, (hash >> 8) & 0xff].map(|c| 0.2 + 0.8 * c as f32 / 255.0)
}

/// IEC 61966-2-1, from the encoded value to the linear one.
pub fn srgb_decode(x: f32) -> f32 {
    if x <= 0.04045 { x / 12.92 } else { ((x + 0.055) / 1.055).powf(2.4) }
}

/// IEC 61966-2-1, from the linear value to the encoded one.
pub fn srgb_encode(x: f32) -> f32 {
    if x <= 0.003_130_8 { x * 12.92 } else { 1.055 * x.powf(1.0 / 2.4) - 0.055 }
}

#[cfg(test)]
mod tests {
    use super::*;

    fn one(format: Format, bytes: &[u8]) -> [f32; 4] {
        Pixels { extent: Extent::new(1, 1), format, bytes: bytes.to_vec() }.values()[0]
    }

    #[test]
    fn every_format_decodes() {
        assert_eq!(one(Format::R8Unorm, &[255]), [1.0, 0.0, 0.0, 1.0]);
        assert_eq!(one(Format::Rgba8Unorm, &[0, 51, 102, 255]), [0.0, 0.2, 0.4, 1.0]);
        assert!((one(Format::Rgba8Srgb, &[188, 0, 0, 0])[0] - 0.5).abs() < 4e-3);
        assert_eq!(
            one(Format::A2Rgb10Unorm, &(3 << 30 | 1023 << 10 | 341_u32).to_le_bytes()),
            [0.0, 1.0, 341.0 / 1023.0, 1.0]
        );
        assert_eq!(one(Format::Rgba16Snorm, &[0xff, 0x7f, 0, 0x80, 1, 0x80, 0, 0]), [1.0, -1.0, -1.0, 0.0]);
        assert_eq!(one(Format::R16Float, &[0, 0x3a]), [0.75, 0.0, 0.0, 1.0]);
        assert_eq!(one(Format::Rg16Float, &[0, 0x3c, 0, 0xc0]), [1.0, -2.0, 0.0, 1.0]);
        assert_eq!(one(Format::D32Float, &0.25_f32.to_le_bytes()), [0.25, 0.0, 0.0, 1.0]);
        assert_eq!(one(Format::R32Uint, &7_u32.to_le_bytes()), [7.0, 0.0, 0.0, 1.0]);
    }

    #[test]
    fn srgb_is_its_own_inverse() {
        for i in 0..=255 {
            let x = i as f32 / 255.0;
            assert!((srgb_encode(srgb_decode(x)) - x).abs() < 1e-6, "{i}");
        }
    }
}
