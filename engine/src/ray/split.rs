//! A binary tree by the surface-area heuristic, ready for `obvhs` to widen and compress.
//!
//! The bottom-up builder of `obvhs` makes a chain as deep as there are primitives, in quadratic time, from boxes that coincide or nest, and
//! takes quadratic time for a row of equal boxes. Fences, cables and stacked copies do occur, and a file may come from anyone,
//! so the tree is made top-down: binned splits (Wald 2007, "On fast Construction of SAH-based Bounding Volume Hierarchies"), and
//! splits in equal halves below a certain depth, which bounds depth and time whatever the input.
use super::Bounds;
use glam::Vec3;
use obvhs::aabb::Aabb;
use obvhs::bvh2::Bvh2;
use obvhs::bvh2::node::Bvh2Node;

/// Bins per axis.
const BINS: usize = 16;

/// From this depth on, nodes are split in equal halves.
const BALANCED_FROM: u32 = 40;

/// Subtrees of more primitives than this are built side by side.
const PARALLEL_FROM: usize = 4096;

/// Binary tree over these boxes, one primitive per leaf, children after their parent. Deterministic, on however many cores.
pub(super) fn binary_tree(boxes: &[Bounds]) -> Bvh2 {
    let mut tree = Bvh2::default();
    if boxes.is_empty() {
        return tree;
    }
    let mut order: Vec<u32> = (0..boxes.len() as u32).collect();
    let mut pairs = vec![[Bvh2Node::default(); 2]; boxes.len() - 1];
    let root = Part { first: 0, first_pair: 0, depth: 0 }.build(&mut order, &mut pairs, boxes);
    tree.nodes = std::iter::once(root).chain(pairs.into_iter().flatten()).collect();
    tree.primitive_indices = order;
    tree
}

/// A subtree to be made. As it has one pair of nodes fewer than primitives, its place among the pairs is known beforehand.
struct Part {
    /// Its first primitive in the order.
    first: usize,
    /// Its first pair of siblings.
    first_pair: usize,
    depth: u32,
}

impl Part {
    /// Orders the part's primitives, fills its pairs, and gives its root.
    fn build(self, order: &mut [u32], pairs: &mut [[Bvh2Node; 2]], boxes: &[Bounds]) -> Bvh2Node {
        let bounds = order.iter().fold(Bounds::EMPTY, |b, &i| b.union(boxes[i as usize]));
        let aabb = Aabb::new(bounds.min.into(), bounds.max.into());
        let Some((pair, pairs)) = pairs.split_first_mut() else {
            return Bvh2Node::new(aabb, 1, self.first as u32);
        };
        let count = order.len();
        let left = split(order, boxes, self.depth);
        let (left_order, right_order) = order.split_at_mut(left);
        let (left_pairs, right_pairs) = pairs.split_at_mut(left - 1);
        let (first, first_pair, depth) = (self.first, self.first_pair + 1, self.depth + 1);
        let (to_left, to_right) =
            (Part { first, first_pair, depth }, Part { first: first + left, first_pair: first_pair + left - 1, depth });
        let make_left = || to_left.build(left_order, left_pairs, boxes);
        let make_right = || to_right.build(right_order, right_pairs, boxes);
        let made = if count > PARALLEL_FROM {
            rayon::join(make_left, make_right)
        } else {
            one_after_the_other(make_left, make_right)
        };
        *pair = made.into();
        Bvh2Node::new(aabb, 0, (1 + 2 * self.first_pair) as u32)
    }
}

fn one_after_the_other<A, B>(a: impl FnOnce() -> A, b: impl FnOnce() -> B) -> (A, B) {
    (a(), b())
}

/// Orders `part` so that its first `n` primitives go to the left; gives `n`, at least 1 and less than its length.
fn split(part: &mut [u32], boxes: &[Bounds], depth: u32) -> usize {
    let centre = |i: u32| boxes[i as usize].centre();
    let spread = part.iter().fold(Bounds::EMPTY, |b, &i| b.union(Bounds { min: centre(i), max: centre(i) }));
    let extent = spread.max - spread.min;
    if depth < BALANCED_FROM && extent.max_element() > 0.0 {
        let bins = Bins { lower: spread.min, scale: BINS as f32 / extent };
        if let Some((axis, last_left)) = bins.cheapest(part, boxes, extent) {
            let left = partition(part, |i| bins.of(centre(i), axis) <= last_left);
            // The least centre is in the first bin and the greatest in the last, so neither side is empty.
            debug_assert!(left > 0 && left < part.len(), "{left} of {}", part.len());
            return left;
        }
    }
    let (axis, half) = (extent.max_position(), part.len() / 2);
    part.select_nth_unstable_by(half, |&a, &b| centre(a)[axis].total_cmp(&centre(b)[axis]).then(a.cmp(&b)));
    half
}

/// Equal slices of the box around all centres.
struct Bins {
    lower: Vec3,
    scale: Vec3,
}

impl Bins {
    fn of(&self, centre: Vec3, axis: usize) -> usize {
        // A spread so small that its scale is infinite gives 0 * infinity = NaN for the lower end, which converts to bin 0.
        (((centre - self.lower)[axis] * self.scale[axis]) as usize).min(BINS - 1)
    }

    /// Axis and last bin of the left side of the cheapest split.
    fn cheapest(&self, part: &[u32], boxes: &[Bounds], extent: Vec3) -> Option<(usize, usize)> {
        let mut best = None;
        let mut best_cost = f32::INFINITY;
        for axis in (0..3).filter(|&a| extent[a] > 0.0) {
            let mut bins = [(Bounds::EMPTY, 0_u32); BINS];
            for &i in part {
                let b = boxes[i as usize];
                let bin = &mut bins[self.of(b.centre(), axis)];
                *bin = (bin.0.union(b), bin.1 + 1);
            }
            // Cost of everything to the right of each bin, then a sweep from the left.
            let mut right_costs = [0.0; BINS];
            let mut right = (Bounds::EMPTY, 0);
            for at in (1..BINS).rev() {
                right = (right.0.union(bins[at].0), right.1 + bins[at].1);
                right_costs[at - 1] = cost(right);
            }
            let mut left = (Bounds::EMPTY, 0);
            for at in 0..BINS - 1 {
                left = (left.0.union(bins[at].0), left.1 + bins[at].1);
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

/// Expected work for one side of a split, up to a factor: half its surface times its primitives.
fn cost((bounds, count): (Bounds, u32)) -> f32 {
    if count == 0 { 0.0 } else { bounds.half_area() * count as f32 }
}

/// Moves what belongs to the left to the front; gives how many.
fn partition(part: &mut [u32], is_left: impl Fn(u32) -> bool) -> usize {
    let mut left = 0;
    for at in 0..part.len() {
        if is_left(part[at]) {
            part.swap(at, left);
            left += 1;
        }
    }
    left
}
