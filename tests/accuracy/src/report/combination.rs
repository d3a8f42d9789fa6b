//! Additive model of the errors of the picture.
//!
//! A picture with several changes is approximated by the default picture plus the difference that each change makes alone. As light is
//! additive, this is exact for stages that are summed; where one stage attenuates another, as shadows attenuate direct light, it is of
//! first order. The relative mean squared error of any combination then follows from inner products of these differences, weighted as in
//! the metric:
//!
//! ```text
//! relMSE = sum over i, j of <e_i, e_j>,   e_0 = default - truth,   e_i = variant_i - default
//! ```
use crate::AccuracyError;
use crate::metrics::{Picture, RELMSE_EPSILON};
use crate::pictures::read_exr;
use crate::plan::Plan;
use rayon::prelude::*;
use serde::{Deserialize, Serialize};
use std::path::Path;

/// Inner products of the default's error and of the setups' differences.
#[derive(Clone, Debug, PartialEq, Serialize, Deserialize)]
pub struct Combination {
    /// Ids of the setups; the first is the default, and stands for its error.
    pub setups: Vec<String>,
    /// Symmetric matrix; rows and columns in the order of `setups`.
    pub products: Vec<Vec<f64>>,
}

impl Combination {
    /// Reads the pictures of a folder; `None` if one of them is missing.
    ///
    /// # Errors
    /// [`AccuracyError::Image`].
    pub fn read(plan: &Plan, folder: &Path) -> Result<Option<Self>, AccuracyError> {
        let Some(default) = plan.default_setup() else { return Ok(None) };
        let others = plan.setups.iter().filter(|s| s.id != default.id && !s.moving).map(|s| s.id.clone());
        let setups: Vec<String> = std::iter::once(default.id.clone()).chain(others).collect();
        let file = |name: &str| folder.join(format!("{name}.exr"));
        if !file("truth.all").exists() || !setups.iter().all(|id| file(id).exists()) {
            return Ok(None);
        }
        let truth = read_exr(&file("truth.all"))?;
        let pictures = setups.iter().map(|id| read_exr(&file(id))).collect::<Result<Vec<_>, _>>()?;
        Ok(Some(Self::of(setups, &truth, &pictures)))
    }

    /// From pictures of the same size, the default's first.
    pub fn of(setups: Vec<String>, truth: &Picture, pictures: &[Picture]) -> Self {
        let flat = |p: &Picture| -> Vec<f64> { p.pixels.iter().flatten().map(|x| f64::from(*x)).collect() };
        let truth = flat(truth);
        let weights: Vec<f64> = truth.iter().map(|t| 1.0 / ((t * t + RELMSE_EPSILON) * truth.len() as f64)).collect();
        let mut differences: Vec<Vec<f64>> = pictures.iter().map(flat).collect();
        let (default, others) = differences.split_at_mut(1.min(pictures.len()));
        for default in default {
            for other in others.iter_mut() {
                other.iter_mut().zip(&*default).for_each(|(x, d)| *x -= d);
            }
            default.iter_mut().zip(&truth).for_each(|(x, t)| *x -= t);
        }
        let product = |a: &[f64], b: &[f64]| a.iter().zip(b).zip(&weights).map(|((a, b), w)| a * b * w).sum();
        let row = |a: &Vec<f64>| differences.iter().map(|b| product(a, b)).collect();
        Self { setups, products: differences.par_iter().map(row).collect() }
    }

    /// relMSE of the picture with these setups combined. Unknown ones, and the default, change nothing.
    pub fn relmse<'a>(&self, chosen: impl IntoIterator<Item = &'a str>) -> f64 {
        let mut parts = vec![0];
        for id in chosen {
            if let Some(at) = self.setups.iter().position(|s| s == id).filter(|at| !parts.contains(at)) {
                parts.push(at);
            }
        }
        self.sum(&parts)
    }

    /// The same by indices; 0 must be among them, and none twice.
    pub fn sum(&self, parts: &[usize]) -> f64 {
        parts.iter().map(|&a| parts.iter().map(|&b| self.products[a][b]).sum::<f64>()).sum::<f64>().max(0.0)
    }
}

#[cfg(test)]
mod tests {
    use super::*;
    use crate::metrics::relmse;

    #[test]
    fn changes_that_add_up_have_exactly_the_error_that_is_promised() {
        let picture = |of: &dyn Fn(f32) -> f32| {
            let pixels = (0..12).map(|i| [0.0, 0.5, 1.0].map(|c| of(i as f32 + c))).collect();
            Picture { width: 4, height: 3, pixels }
        };
        let truth = picture(&|x| 0.1 + 0.05 * x);
        let default = picture(&|x| 0.12 + 0.04 * x);
        let (bright, wavy) = (picture(&|x| 0.3 + 0.04 * x), picture(&|x| 0.12 + 0.04 * x + 0.02 * x.sin()));
        let both = picture(&|x| 0.3 + 0.04 * x + 0.02 * x.sin());
        let ids = ["default", "bright", "wavy"].map(str::to_owned).to_vec();
        let sum = Combination::of(ids, &truth, &[default.clone(), bright.clone(), wavy.clone()]);
        let near = |chosen: &[&str], test: &Picture| {
            let (promised, found) = (sum.relmse(chosen.iter().copied()), relmse(test, &truth).unwrap());
            assert!((promised / found - 1.0).abs() < 1e-5, "{chosen:?}: {promised} {found}");
        };
        near(&[], &default);
        near(&["default"], &default);
        near(&["bright"], &bright);
        near(&["wavy", "default"], &wavy);
        near(&["wavy", "bright"], &both);
        // Errors that cancel are not summed.
        assert!(sum.relmse(["wavy", "bright"]) != sum.relmse(["wavy"]) + sum.relmse(["bright"]));
    }
}
