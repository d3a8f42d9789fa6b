//! Means of many samples per pixel, with their standard errors.
use glam::DVec3;

/// Mean and squared deviations of a number of independent samples per pixel, for each channel, in `f64`.
#[derive(Clone, Debug, PartialEq)]
pub struct Estimate {
    /// Width, pixels.
    pub width: u32,
    /// Height, pixels.
    pub height: u32,
    /// Samples per pixel.
    pub samples: u64,
    /// Mean of each pixel: red, green and blue; rows from the top.
    pub mean: Vec<DVec3>,
    /// Sum of the squared deviations from the mean, for each pixel.
    pub squares: Vec<DVec3>,
}

/// Two estimates of different sizes.
#[derive(Debug, thiserror::Error)]
#[error("estimates of {0} x {1} and {2} x {3} pixels cannot be merged")]
pub struct SizeMismatch(u32, u32, u32, u32);

impl Estimate {
    /// An estimate without samples.
    pub fn new(width: u32, height: u32) -> Self {
        let pixels = width as usize * height as usize;
        Self { width, height, samples: 0, mean: vec![DVec3::ZERO; pixels], squares: vec![DVec3::ZERO; pixels] }
    }

    /// Adds the samples of another estimate (Chan, Golub and LeVeque 1979, "Updating Formulae and a Pairwise Algorithm for Computing Sample
    /// Variances", equation 2.1). The samples must be independent: of another seed, or further samples of the same seed.
    ///
    /// # Errors
    /// [`SizeMismatch`].
    pub fn merge(&mut self, other: &Self) -> Result<(), SizeMismatch> {
        if (self.width, self.height) != (other.width, other.height) {
            return Err(SizeMismatch(self.width, self.height, other.width, other.height));
        }
        let (n, m) = (self.samples as f64, other.samples as f64);
        if other.samples > 0 {
            let mine = self.mean.iter_mut().zip(&mut self.squares);
            for ((mean, squares), (their_mean, their_squares)) in mine.zip(other.mean.iter().zip(&other.squares)) {
                let difference = *their_mean - *mean;
                *mean += difference * (m / (n + m));
                *squares += *their_squares + difference * difference * (n * m / (n + m));
            }
            self.samples += other.samples;
        }
        Ok(())
    }

    /// Standard error of each pixel's mean: the square root of the unbiased variance over the number of samples. Infinite for fewer than two
    /// samples.
    pub fn standard_error(&self) -> Vec<DVec3> {
        let n = self.samples as f64;
        if self.samples < 2 {
            return vec![DVec3::INFINITY; self.mean.len()];
        }
        self.squares.iter().map(|s| DVec3::from(s.to_array().map(|s| (s / (n * (n - 1.0))).sqrt()))).collect()
    }
}
