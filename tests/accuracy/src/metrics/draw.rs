//! Two pictures and their FLIP map side by side.
use super::{Map, MetricError, Picture, flip_hdr_map, flip_ldr_map, magma};
use magpie::graph::{Extent, Format};
use magpie::pixels::Pixels;

/// Gap between the parts, pixels.
const GAP: usize = 4;

/// How two pictures are displayed, and which FLIP is drawn.
#[derive(Clone, Copy, Debug, PartialEq, Eq)]
pub enum DynamicRange {
    /// Values are clamped to 0..1; FLIP.
    Display,
    /// Radiance, displayed through `x / (1 + x)`; HDR-FLIP.
    High,
}

impl DynamicRange {
    fn shown(self, picture: &Picture) -> Vec<u8> {
        match self {
            Self::Display => picture.to_srgb8(),
            Self::High => {
                let pixels = picture.pixels.iter().map(|p| p.map(|x| x / (1.0 + x.max(0.0)))).collect();
                Picture { pixels, ..*picture }.to_srgb8()
            }
        }
    }

    fn map(self, test: &Picture, reference: &Picture) -> Result<Map, MetricError> {
        match self {
            Self::Display => flip_ldr_map(test, reference),
            Self::High => flip_hdr_map(test, reference),
        }
    }
}

/// The picture under test, the reference, and the FLIP map in the colours of [`magma`], from left to right, as a display image.
///
/// # Errors
/// [`MetricError`] if the pictures differ in size or are not finite.
pub fn side_by_side(test: &Picture, reference: &Picture, range: DynamicRange) -> Result<Pixels, MetricError> {
    let parts = [magma(&range.map(test, reference)?), range.shown(reference), range.shown(test)];
    let (width, height) = (test.width, test.height);
    let mut bytes = Vec::with_capacity((3 * width + 2 * GAP) * height * 4);
    for row in 0..height {
        for (at, part) in parts.iter().rev().enumerate() {
            if at > 0 {
                bytes.extend([255; 4 * GAP]);
            }
            let pixels = part[3 * row * width..3 * (row + 1) * width].as_chunks::<3>().0;
            bytes.extend(pixels.iter().flat_map(|&[r, g, b]| [r, g, b, 255]));
        }
    }
    let extent = Extent::new((3 * width + 2 * GAP) as u32, height as u32);
    Ok(Pixels { extent, format: Format::Rgba8Unorm, bytes })
}

#[cfg(test)]
mod tests {
    use super::*;

    fn pixel(image: &Pixels, x: usize, y: usize) -> [u8; 3] {
        let at = 4 * (y * image.extent.width as usize + x);
        [image.bytes[at], image.bytes[at + 1], image.bytes[at + 2]]
    }

    #[test]
    fn every_part_stands_in_its_place() {
        let reference = Picture::from_srgb8(5, 3, &[40; 45]);
        let mut bytes = [40; 45];
        bytes[3 * (2 * 5 + 4)] = 250;
        let drawn = side_by_side(&Picture::from_srgb8(5, 3, &bytes), &reference, DynamicRange::Display).unwrap();
        assert_eq!((drawn.extent.width, drawn.extent.height), (5 + 4 + 5 + 4 + 5, 3));
        assert_eq!((pixel(&drawn, 4, 2), pixel(&drawn, 0, 0)), ([250, 40, 40], [40; 3]));
        assert_eq!((pixel(&drawn, 5, 1), pixel(&drawn, 9 + 4, 2), pixel(&drawn, 17, 0)), ([255; 3], [40; 3], [255; 3]));
        let light = |[r, g, b]: [u8; 3]| u32::from(r) + u32::from(g) + u32::from(b);
        assert!(light(pixel(&drawn, 18 + 4, 2)) > light(pixel(&drawn, 18, 0)));
        let equal = side_by_side(&reference, &reference, DynamicRange::High).unwrap();
        assert!(light(pixel(&equal, 18 + 4, 2)) < 12, "no difference is black");
    }

    #[test]
    fn high_range_keeps_what_a_display_cuts() {
        let (test, reference) = (Picture::grey(8, 8, &[30.0; 64]), Picture::grey(8, 8, &[3.0; 64]));
        let cut = side_by_side(&test, &reference, DynamicRange::Display).unwrap();
        assert_eq!(pixel(&cut, 0, 0), pixel(&cut, 12, 0));
        let high = side_by_side(&test, &reference, DynamicRange::High).unwrap();
        assert!(pixel(&high, 0, 0)[0] > pixel(&high, 12, 0)[0] && pixel(&high, 24 + 4, 4) != pixel(&cut, 24 + 4, 4));
        assert!(side_by_side(&test, &Picture::grey(1, 1, &[1.0]), DynamicRange::High).is_err());
    }
}
