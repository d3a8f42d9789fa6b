//! Compares the hits of two backends.
use super::{Agreement, Case};
use magpie_shaders::bench::RayAnswer;

/// Relative difference up to which distances count as equal.
pub const SAME_DISTANCE: f64 = 1e-4;

/// What a backend answers to the rays of a table.
pub struct BackendAnswers<'a, T> {
    /// Name of the backend.
    pub name: String,
    /// One answer per ray.
    pub answers: &'a [T],
}

impl<'a, T> BackendAnswers<'a, T> {
    /// The answers of a backend.
    pub fn new(name: impl Into<String>, answers: &'a [T]) -> Self {
        Self { name: name.into(), answers }
    }
}

/// Compares closest hits.
pub fn agreement_of_closest(
    case: &Case,
    first: BackendAnswers<'_, RayAnswer>,
    second: BackendAnswers<'_, RayAnswer>,
) -> Agreement {
    let (a, b) = (first.answers, second.answers);
    let mut agreement = empty(case, first.name, second.name, a.len());
    // Missing answers count as different.
    agreement.differ = a.len().abs_diff(b.len()) as u64;
    for (a, b) in a.iter().zip(b) {
        let (ta, tb) = (f64::from(a.t), f64::from(b.t));
        let apart = if a.t == b.t { 0.0 } else { (ta - tb).abs() / ta.abs().max(tb.abs()) };
        if (a.instance, a.primitive, a.front) == (b.instance, b.primitive, b.front) {
            agreement.worst_distance = agreement.worst_distance.max(apart);
            continue;
        }
        agreement.differ += 1;
        let both_hit = a.instance != u32::MAX && b.instance != u32::MAX;
        let other_surface = (a.instance, a.primitive) != (b.instance, b.primitive);
        agreement.differ_at_same_distance += u64::from(both_hit && other_surface && apart <= SAME_DISTANCE);
    }
    agreement
}

/// Compares any-hit results.
pub fn agreement_of_any(case: &Case, first: BackendAnswers<'_, bool>, second: BackendAnswers<'_, bool>) -> Agreement {
    let (a, b) = (first.answers, second.answers);
    let mut agreement = empty(case, first.name, second.name, a.len());
    agreement.differ = a.len().abs_diff(b.len()) as u64 + a.iter().zip(b).filter(|(a, b)| a != b).count() as u64;
    agreement
}

fn empty(case: &Case, first: String, second: String, count: usize) -> Agreement {
    Agreement {
        case: case.clone(),
        first,
        second,
        count: count as u64,
        differ: 0,
        differ_at_same_distance: 0,
        worst_distance: 0.0,
    }
}

#[cfg(test)]
mod tests {
    use super::*;

    const HIT: RayAnswer = RayAnswer { t: 2.0, instance: 3, primitive: 4, barycentric: [0.1, 0.2], front: 1 };
    const MISS: RayAnswer =
        RayAnswer { t: 1e30, instance: u32::MAX, primitive: u32::MAX, barycentric: [0.0; 2], front: 0 };

    fn compare(a: &[RayAnswer], b: &[RayAnswer]) -> (u64, u64, f64) {
        let case = Case::new("scene", "", 0.0, "");
        let found = agreement_of_closest(&case, BackendAnswers::new("", a), BackendAnswers::new("", b));
        (found.differ, found.differ_at_same_distance, found.worst_distance)
    }

    #[test]
    fn every_kind_of_difference_is_told_apart() {
        assert_eq!(compare(&[HIT, MISS], &[HIT, MISS]), (0, 0, 0.0));
        assert_eq!(compare(&[HIT], &[MISS]), (1, 0, 0.0));
        assert_eq!(compare(&[HIT], &[RayAnswer { primitive: 5, ..HIT }]), (1, 1, 0.0));
        assert_eq!(compare(&[HIT], &[RayAnswer { primitive: 5, t: 2.1, ..HIT }]), (1, 0, 0.0));
        assert_eq!(compare(&[HIT], &[RayAnswer { t: 4.0, ..HIT }]), (0, 0, 0.5));
        assert_eq!(compare(&[HIT], &[RayAnswer { front: 0, ..HIT }]), (1, 0, 0.0));
        assert_eq!(compare(&[HIT], &[]), (1, 0, 0.0));
    }
}
