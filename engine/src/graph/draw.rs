//! Draws of a scene's instances, in lists by what they need of a pipeline.

use std::{borrow::Cow, sync::Arc};

use crate::gpu::Cull;

/// One indexed draw of one instance.
#[derive(Clone, Copy, Debug, PartialEq, Eq)]
pub struct Draw {
    /// First index in the index buffer.
    pub first_index: u32,
    /// Number of indices.
    pub index_count: u32,
    /// `gl_InstanceIndex` in the vertex shader.
    pub instance: u32,
    /// Which faces are culled.
    pub cull: Cull,
    /// What it needs of a pipeline.
    pub class: DrawClass,
}

/// What a draw needs of the pipeline that draws it.
#[derive(Clone, Copy, Debug, PartialEq, Eq, PartialOrd, Ord, Hash)]
#[repr(u8)]
pub enum DrawClass {
    /// Triangles that hide what is behind them.
    Opaque,
    /// Triangles whose material has a mask: fragments with an alpha below its cutoff are dropped.
    AlphaTested,
    /// Triangles whose material is blended: they cover what is behind them by their alpha.
    Blended,
    /// Spheres, drawn as boxes of eight corners each: the fragment shader finds where the ray through the pixel meets the sphere. Its
    /// material's alpha is not looked at.
    Procedural,
}

impl DrawClass {
    /// Every class, in discriminant order.
    pub const ALL: [Self; 4] = [Self::Opaque, Self::AlphaTested, Self::Blended, Self::Procedural];
}

/// Draws sorted by class, in each class by what culls them, and then by instance. A copy costs no more than a reference.
#[derive(Clone, Debug, Default, PartialEq, Eq)]
pub struct DrawLists {
    draws: Arc<[Draw]>,
    /// Where each class ends.
    ends: [u32; DrawClass::ALL.len()],
}

impl DrawLists {
    /// Sorts draws, which may come in any order.
    #[must_use]
    pub fn new(mut draws: Vec<Draw>) -> Self {
        draws.sort_by_key(|d| (d.class, order(d)));
        let ends = DrawClass::ALL.map(|class| draws.partition_point(|d| d.class <= class) as u32);
        Self { draws: draws.into(), ends }
    }

    /// All draws, class by class in the order of [`DrawClass::ALL`].
    #[must_use]
    pub fn all(&self) -> &[Draw] {
        &self.draws
    }

    /// The draws of one class.
    #[must_use]
    pub fn of(&self, class: DrawClass) -> &[Draw] {
        let class = class as usize;
        let first = class.checked_sub(1).map_or(0, |before| self.ends[before]);
        &self.draws[first as usize..self.ends[class] as usize]
    }

    /// The draws of two classes as one list, in the order in which a single class is: for those that one pipeline draws.
    #[must_use]
    pub fn merged(&self, [first, second]: [DrawClass; 2]) -> Cow<'_, [Draw]> {
        match (self.of(first), self.of(second)) {
            (some, []) | ([], some) => some.into(),
            (first, second) => {
                let mut both = [first, second].concat();
                both.sort_by_key(order);
                both.into()
            }
        }
    }

    /// The draws of one class, the farthest first, as blending needs them. `distance` is that of an instance from the eye, in any unit;
    /// where two are equally far, the instance with the lower index comes first.
    ///
    /// Instances are sorted as wholes: where they reach into each other, and among the triangles of one, the order may be wrong.
    #[must_use]
    pub fn back_to_front(&self, class: DrawClass, distance: impl Fn(u32) -> f64) -> Vec<Draw> {
        let mut far: Vec<(f64, Draw)> = self.of(class).iter().map(|d| (distance(d.instance), *d)).collect();
        far.sort_by(|(a, x), (b, y)| b.total_cmp(a).then(x.instance.cmp(&y.instance)));
        far.into_iter().map(|(_, draw)| draw).collect()
    }
}

/// The order within a class.
fn order(draw: &Draw) -> (u32, u32) {
    (draw.cull as u32, draw.instance)
}

#[cfg(test)]
mod tests {
    use super::*;
    use DrawClass::*;

    fn draw(instance: u32, class: DrawClass, cull: Cull) -> Draw {
        Draw { first_index: 0, index_count: 3, instance, cull, class }
    }

    fn instances(draws: &[Draw]) -> Vec<u32> {
        draws.iter().map(|d| d.instance).collect()
    }

    fn mixed() -> DrawLists {
        DrawLists::new(vec![
            draw(7, Procedural, Cull::Back),
            draw(6, Blended, Cull::None),
            draw(5, AlphaTested, Cull::Back),
            draw(4, Blended, Cull::Back),
            draw(3, Opaque, Cull::Back),
            draw(2, AlphaTested, Cull::None),
            draw(1, Blended, Cull::Back),
            draw(0, Opaque, Cull::BackMirrored),
        ])
    }

    #[test]
    fn each_class_is_a_slice_sorted_by_culling_and_instance() {
        let lists = mixed();
        let of = DrawClass::ALL.map(|class| instances(lists.of(class)));
        assert_eq!(of, [vec![3, 0], vec![2, 5], vec![6, 1, 4], vec![7]]);
        assert_eq!(instances(lists.all()), of.concat());
        let without = DrawLists::new(vec![draw(0, Blended, Cull::None)]);
        assert_eq!(DrawClass::ALL.map(|class| without.of(class).len()), [0, 0, 1, 0]);
        assert!(DrawLists::default().of(Procedural).is_empty());
    }

    #[test]
    fn two_classes_are_one_list() {
        assert_eq!(instances(&mixed().merged([AlphaTested, Blended])), [2, 6, 1, 4, 5]);
        let solid = DrawLists::new(vec![draw(1, Opaque, Cull::None), draw(0, Opaque, Cull::None)]);
        assert_eq!(instances(&solid.merged([Opaque, Blended])), [0, 1]);
        assert_eq!(instances(&solid.merged([Blended, Opaque])), [0, 1]);
    }

    #[test]
    fn the_farthest_comes_first_and_ties_go_by_index() {
        let lists = mixed();
        let sorted = |far: [f64; 7]| instances(&lists.back_to_front(Blended, |i| far[i as usize]));
        assert_eq!(sorted([9.0, 1.0, 9.0, 9.0, 3.0, 9.0, 2.0]), [4, 6, 1]);
        assert_eq!(sorted([9.0, 1.0, 9.0, 9.0, 1.0, 9.0, 1.0]), [1, 4, 6]);
        assert_eq!(sorted([9.0, 0.5, 9.0, 9.0, f64::INFINITY, 9.0, f64::INFINITY]), [4, 6, 1]);
    }
}
