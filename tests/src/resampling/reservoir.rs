//! Weighted reservoir sampling (Chao 1982) of one sample, as ReSTIR keeps it per pixel (Bitterli et al. 2020, algorithm
//! 2).

/// The sample chosen from a stream, and what is needed to weight it. Without a sample it is empty.
#[derive(Clone, Copy, Debug, PartialEq)]
pub struct Reservoir<S> {
    /// The chosen sample `y`; `None` until something of positive weight came.
    pub sample: Option<S>,
    /// Sum `w_sum` of the weights so far. It means something within a pass only.
    pub weight_sum: f64,
    /// Confidence `M`: how many candidates the sample stands for.
    pub confidence: f64,
    /// Unbiased contribution weight `W`: an estimate of 1 over the sample's density.
    pub weight: f64,
}

impl<S> Default for Reservoir<S> {
    fn default() -> Self {
        Self::empty()
    }
}

impl<S> Reservoir<S> {
    /// Nothing seen: what a pixel without a surface keeps. Merging it changes nothing.
    pub fn empty() -> Self {
        Self { sample: None, weight_sum: 0.0, confidence: 0.0, weight: 0.0 }
    }

    /// Adds a candidate of this weight, and says whether it is now the chosen one (Bitterli et al. 2020, algorithm 2).
    pub fn update(&mut self, sample: S, weight: f64, u: f64) -> bool {
        self.take(sample, weight, 1.0, u)
    }

    /// Adds a sample that stands for `confidence` candidates. It is chosen with probability `weight / weight_sum`; the
    /// test is free of a division, and never true for weight 0.
    pub fn take(&mut self, sample: S, weight: f64, confidence: f64, u: f64) -> bool {
        assert!(weight >= 0.0 && weight.is_finite(), "resampling weight {weight}");
        self.confidence += confidence;
        self.weight_sum += weight;
        let chosen = u * self.weight_sum < weight;
        if chosen {
            self.sample = Some(sample);
        }
        chosen
    }

    /// Sets `W = w_sum / (normaliser p̂(y))`, where `target` is `p̂(y)`: with `M` as normaliser equation 6 of Bitterli
    /// et al. 2020. `W` is 0 where the target is; the confidence stays.
    pub fn finish(&mut self, target: f64, normaliser: f64) {
        assert!(target >= 0.0 && target.is_finite(), "target {target}");
        let scale = normaliser * target;
        self.weight = if scale > 0.0 { self.weight_sum / scale } else { 0.0 };
    }

    /// Throws the sample away, as when it is occluded. It still stands for all its candidates: the confidence stays.
    pub fn discard(&mut self) {
        self.weight = 0.0;
    }

    /// With no more confidence than `cap`.
    pub fn capped(self, cap: f64) -> Self {
        Self { confidence: self.confidence.min(cap), ..self }
    }

    /// The same with another sample in place of the chosen one; without any where `map` gives `None`.
    pub fn map<T>(self, map: impl FnOnce(S) -> Option<T>) -> Reservoir<T> {
        let sample = self.sample.and_then(map);
        let weight = if sample.is_some() { self.weight } else { 0.0 };
        Reservoir { sample, weight_sum: self.weight_sum, confidence: self.confidence, weight }
    }

    /// The estimate `f(y) W`.
    pub fn shade(&self, f: impl FnOnce(&S) -> f64) -> f64 {
        match &self.sample {
            Some(sample) if self.weight > 0.0 => f(sample) * self.weight,
            _ => 0.0,
        }
    }
}
