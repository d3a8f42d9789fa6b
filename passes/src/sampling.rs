//! How many pixels a frame renders for its picture, and where in each it looks.
use magpie::prelude::*;
use magpie::slot::Needs;

/// Both, of one frame.
#[derive(Clone, Copy, Debug, PartialEq)]
pub struct Sampling {
    /// Rendered pixels over those of the picture, each way; above 0 and at most 1.
    pub scale: f64,
    /// Pixels are sampled somewhere else in each frame, and the frames made one picture.
    pub jittered: bool,
}

impl Sampling {
    /// What the effects of a frame ask for together.
    pub fn of(needs: &Needs) -> Self {
        Self { scale: needs.resolution_scale, jittered: needs.jitter }
    }

    /// Pixels to render for a picture of that size, one at least.
    pub fn extent(self, picture: Extent) -> Extent {
        let side = |pixels: u32| ((f64::from(pixels) * self.scale).round() as u32).max(1);
        Extent::new(side(picture.width), side(picture.height))
    }

    /// Where frame number `frame` samples its pixels: pixels from their centres, right and down. Any run of frames covers the pixel
    /// evenly (Halton 1960, bases 2 and 3).
    pub fn jitter(self, frame: u32) -> [f32; 2] {
        if !self.jittered {
            return [0.0; 2];
        }
        [2, 3].map(|base| (radical_inverse(frame.wrapping_add(1), base) - 0.5) as f32)
    }
}

/// The digits of a number behind the point, in the other order: van der Corput 1935.
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
                // Points lie on the lower borders of cells, or a ninth of one away: thirds are rounded.
                let cell = |at: f32, cells: f32| (((at + 0.5) * cells + 1e-3) as usize).min(cells as usize - 1);
                cells[cell(*x, 8.0) * 9 + cell(*y, 9.0)] += 1;
            }
            // 72 points of the sequence hit each of 8 by 9 cells once, unless the numbers begin anew.
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
