//! Mean and standard error of independent runs.

/// Running mean and variance (Welford 1962).
#[derive(Clone, Copy, Debug, Default)]
pub struct Estimate {
    count: f64,
    mean: f64,
    squares: f64,
}

impl Estimate {
    /// Of values that are independent of each other.
    pub fn of(values: impl IntoIterator<Item = f64>) -> Self {
        let mut all = Self::default();
        values.into_iter().for_each(|value| all.add(value));
        all
    }

    /// Adds the result of one run.
    pub fn add(&mut self, value: f64) {
        assert!(value.is_finite(), "run {}: {value}", self.count);
        self.count += 1.0;
        let from_old = value - self.mean;
        self.mean += from_old / self.count;
        self.squares += from_old * (value - self.mean);
    }

    /// Mean of the runs.
    pub fn mean(&self) -> f64 {
        self.mean
    }

    /// Variance of one run.
    pub fn variance(&self) -> f64 {
        self.squares / (self.count - 1.0)
    }

    /// Standard error of the mean.
    pub fn error(&self) -> f64 {
        (self.variance() / self.count).sqrt()
    }

    /// How many standard errors the mean lies above `truth`.
    pub fn deviate(&self, truth: f64) -> f64 {
        (self.mean - truth) / self.error()
    }
}

#[cfg(test)]
mod tests {
    use super::*;

    #[test]
    fn mean_and_error_of_four_numbers() {
        let four = Estimate::of([1.0, 2.0, 3.0, 6.0]);
        assert_eq!(four.mean(), 3.0);
        assert!((four.variance() - 14.0 / 3.0).abs() < 1e-12);
        assert!((four.deviate(2.0) - (12.0_f64 / 14.0).sqrt()).abs() < 1e-12);
    }
}
