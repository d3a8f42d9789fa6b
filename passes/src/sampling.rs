//! Resolution scale and jitter of a frame.
use magpie::prelude::*;
use magpie::slot::Needs;

/// How a frame samples the picture.
#[derive(Clone, Copy, Debug, PartialEq)]
pub struct Sampling {
    /// Rendered pixels over pixels of the picture, in each direction; above 0 and at most 1.
    pub scale: f64,
    /// Whether sample points differ from frame to frame, for temporal anti-aliasing.
    pub jittered: bool,
}

impl Sampling {
    /// From the merged needs of all effects.
    pub fn of(needs: &Needs) -> Self {
        Self { scale: needs.resolution_scale, jittered: needs.jitter }
    }

    /// Size to render for a picture of size `picture`, pixels; at least 1 in each direction.
    pub fn extent(self, picture: Extent) -> Extent {
        let side = |pixels: u32| ((f64::from(pixels) * self.scale).round() as u32).max(1);
        Extent::new(side(picture.width), side(picture.height))
    }

    /// Offset of the sample points of frame `frame` from the pixel centres, right and down, pixels, -0.5 to 0.5. Any run of consecutive frames
    /// covers the pixel evenly (Halton 1960, bases 2 and 3).
    pub fn jitter(self, frame: u32) -> [f32; 2] {
        if !self.jittered {
            return [0.0; 2];
        }
        [2, 3].map(|base| (radical_inverse(frame.wrapping_add(1), base) - 0.5) as f32)
    }
}

/// The radical inverse (van der Corput 1935): the digits of `number` in this base, mirrored at the radix point. 0 to below 1.
fn radical_inverse(mut number: u32, base: u32) -> f64 {
    let (mut place, mut sum) = (1.0 / f64::from(base), 0.0);
    while number > 0 {
        sum += f64::from(number % base) * place;
        number /= base;
        place /= f64::from(base);
    }
    sum
}

#[cfg(test)]
mod tests {
    use super::*;

    const JITTERED: Sampling = Sampling { scale: 1.0, jittered: true };

    #[test]
    fn every_run_of_frames_covers_the_pixel() {
        assert_eq!([1, 2, 3, 4].map(|n| radical_inverse(n, 2)), [0.5, 0.25, 0.75, 0.125]);
        assert_eq!([1, 2, 4].map(|n| radical_inverse(n, 3)), [1.0 / 3.0, 2.0 / 3.0, 4.0 / 9.0]);
        for first in [0, 17, 1000, u32::MAX - 3] {
            let points: Vec<[f32; 2]> = (0..72).map(|i| JITTERED.jitter(first_plus(first, i))).collect();
            assert!(points.iter().flatten().all(|x| (-0.5..=0.5).contains(x)), "{points:?}");
            let mut cells = [0; 72];
            for [x, y] in &points {
                // Points lie on the lower borders of cells or a ninth of a cell above; the added 1e-3 absorbs the rounding of thirds.
                let cell = |at: f32, cells: f32| (((at + 0.5) * cells + 1e-3) as usize).min(cells as usize - 1);
                cells[cell(*x, 8.0) * 9 + cell(*y, 9.0)] += 1;
            }
            // 72 consecutive points hit each of 8 by 9 cells once, unless the frame number wraps.
            let wanted = if first < 2000 { 1 } else { 2 };
            assert!(cells.iter().all(|&hits| hits <= wanted), "from {first}: {cells:?}");
            for axis in [0, 1] {
                let mean = points.iter().map(|p| p[axis]).sum::<f32>() / 72.0;
                assert!(mean.abs() < 0.02, "from {first}: mean {mean}");
            }
        }
        assert_eq!(Sampling { jittered: false, ..JITTERED }.jitter(5), [0.0; 2]);
    }

    fn first_plus(first: u32, i: u32) -> u32 {
        first.wrapping_add(i)
    }

    #[test]
    fn sizes_are_scaled_and_never_nothing() {
        let scaled = |scale: f64, width, height| Sampling { scale, jittered: false }.extent(Extent::new(width, height));
        assert_eq!(scaled(1.0, 641, 3), Extent::new(641, 3));
        assert_eq!(scaled(0.67, 640, 360), Extent::new(429, 241));
        assert_eq!(scaled(0.5, 1, 1), Extent::new(1, 1));
    }
}
