//! Builds a binary BVH by the surface-area heuristic, for `obvhs` to widen and compress.
//!
//! The bottom-up builder of `obvhs` makes a chain as deep as the number of primitives, in quadratic time, from boxes that
//! coincide or nest, and takes quadratic time for a row of equal boxes. Fences, cables and stacked copies look like that, and
//! scene files are untrusted. So this builder works top-down, with binned splits (Wald 2007, "On fast Construction of SAH-based
//! Bounding Volume Hierarchies") and, from a certain depth on, median splits, which bounds depth and time for any input.
use super::Bounds;
use glam::Vec3A;
use obvhs::aabb::Aabb;
use obvhs::bvh2::Bvh2;
use obvhs::bvh2::node::Bvh2Node;

/// Largest number of bins per axis.
const BINS: usize = 16;

/// From this depth on, nodes are split at the median.
const BALANCED_FROM: u32 = 40;

/// Subtrees with more primitives than this are built in parallel.
const PARALLEL_FROM: usize = 2048;

/// Binary BVH over these boxes, with one primitive per leaf and children after their parent. Deterministic for any number of threads.
pub(super) fn binary_tree(boxes: &[Bounds]) -> Bvh2 {
    let mut tree = Bvh2::default();
    if boxes.is_empty() {
        return tree;
    }
    let mut items: Vec<Item> =
        (0..).zip(boxes).map(|(index, b)| Item { bounds: Aabb::new(b.min.into(), b.max.into()), index }).collect();
    let mut pairs = vec![[Bvh2Node::default(); 2]; boxes.len() - 1];
    let root = Part { first: 0, first_pair: 0, depth: 0 }.build(&mut items, &mut pairs);
    tree.nodes = std::iter::once(root).chain(pairs.into_iter().flatten()).collect();
    tree.primitive_indices = items.iter().map(|item| item.index).collect();
    tree
}

/// A primitive that has not reached its leaf yet.
#[derive(Clone, Copy)]
struct Item {
    bounds: Aabb,
    index: u32,
}

impl Item {
    fn centre(&self) -> Vec3A {
        0.5 * self.bounds.min + 0.5 * self.bounds.max
    }
}

/// A subtree to be built. It has one pair of siblings fewer than primitives, so its place among all pairs is known in advance.
struct Part {
    /// Index of its first primitive.
    first: usize,
    /// Index of its first pair of siblings.
    first_pair: usize,
    depth: u32,
}

impl Part {
    /// Sorts the primitives of the subtree, fills its pairs, and returns its root.
    fn build(self, items: &mut [Item], pairs: &mut [[Bvh2Node; 2]]) -> Bvh2Node {
        let bounds = items.iter().fold(Aabb::empty(), |b, item| b.union(&item.bounds));
        let Some((pair, pairs)) = pairs.split_first_mut() else {
            return Bvh2Node::new(bounds, 1, self.first as u32);
        };
        let count = items.len();
        let left = split(items, self.depth);
        let (left_items, right_items) = items.split_at_mut(left);
        let (left_pairs, right_pairs) = pairs.split_at_mut(left - 1);
        let (first, first_pair, depth) = (self.first, self.first_pair + 1, self.depth + 1);
        let to_left = Part { first, first_pair, depth };
        let to_right = Part { first: first + left, first_pair: first_pair + left - 1, depth };
        *pair = if count > PARALLEL_FROM {
            rayon::join(|| to_left.build(left_items, left_pairs), || to_right.build(right_items, right_pairs)).into()
        } else {
            [to_left.build(left_items, left_pairs), to_right.build(right_items, right_pairs)]
        };
        Bvh2Node::new(bounds, 0, (1 + 2 * self.first_pair) as u32)
    }
}

/// Sorts `items` so that the first `n` belong to the left child. Returns `n`, at least 1 and less than the number of items.
fn split(items: &mut [Item], depth: u32) -> usize {
    if items.len() == 2 {
        return 1;
    }
    let (lower, upper) = items.iter().fold((Vec3A::INFINITY, Vec3A::NEG_INFINITY), |(lower, upper), item| {
        let centre = item.centre();
        (lower.min(centre), upper.max(centre))
    });
    let extent = upper - lower;
    if depth < BALANCED_FROM && extent.max_element() > 0.0 {
        // Few primitives need few bins.
        let count = BINS.min(2 * items.len());
        let bins = Bins { lower, scale: count as f32 / extent, count };
        if let Some((axis, last_left)) = bins.cheapest(items, extent) {
            let left = partition(items, |item| bins.of(item.centre())[axis] <= last_left);
            // The smallest centre is in the first bin and the largest in the last, so neither side is empty.
            debug_assert!(left > 0 && left < items.len(), "{left} of {}", items.len());
            return left;
        }
    }
    let (axis, half) = (extent.max_position(), items.len() / 2);
    items
        .select_nth_unstable_by(half, |a, b| a.centre()[axis].total_cmp(&b.centre()[axis]).then(a.index.cmp(&b.index)));
    half
}

/// Equal slices of the bounding box of all centres.
struct Bins {
    lower: Vec3A,
    scale: Vec3A,
    count: usize,
}

impl Bins {
    /// Bin of a centre on each axis.
    fn of(&self, centre: Vec3A) -> [usize; 3] {
        // If the extent is so small that the scale is infinite, the lower end gives 0 * infinity = NaN, which converts to bin 0.
        ((centre - self.lower) * self.scale).to_array().map(|at| (at as usize).min(self.count - 1))
    }

    /// Axis and last bin of the left side of the cheapest split; `None` if no axis has an extent.
    fn cheapest(&self, items: &[Item], extent: Vec3A) -> Option<(usize, usize)> {
        let mut bins = [[(Aabb::empty(), 0_u32); BINS]; 3];
        for item in items {
            for (bins, at) in bins.iter_mut().zip(self.of(item.centre())) {
                bins[at] = (bins[at].0.union(&item.bounds), bins[at].1 + 1);
            }
        }
        let mut best = None;
        let mut best_cost = f32::INFINITY;
        for axis in (0..3).filter(|&a| extent[a] > 0.0) {
            let bins = &bins[axis][..self.count];
            // First the cost of everything to the right of each bin, then a sweep from the left.
            let mut right_costs = [0.0; BINS];
            let mut right = (Aabb::empty(), 0);
            for at in (1..self.count).rev() {
                right = (right.0.union(&bins[at].0), right.1 + bins[at].1);
                right_costs[at - 1] = cost(right);
            }
            let mut left = (Aabb::empty(), 0);
            for at in 0..self.count - 1 {
                left = (left.0.union(&bins[at].0), left.1 + bins[at].1);
                let total = cost(left) + right_costs[at];
                if total < best_cost {
                    best_cost = total;
                    best = Some((axis, at));
                }
            }
        }
        best
    }
}

/// Expected cost of one side of a split, up to a factor: half its surface area times its number of primitives.
fn cost((bounds, count): (Aabb, u32)) -> f32 {
    if count == 0 { 0.0 } else { bounds.half_area() * count as f32 }
}

/// Moves the items of the left side to the front and returns their number.
fn partition(items: &mut [Item], is_left: impl Fn(&Item) -> bool) -> usize {
    let mut left = 0;
    for at in 0..items.len() {
        if is_left(&items[at]) {
            items.swap(at, left);
            left += 1;
        }
    }
    left
}
