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

/// Primitives `first..first + count` of the order, to become the subtree at `node`.
struct Task {
    node: usize,
    first: usize,
    count: usize,
    depth: u32,
}

/// Binary tree over these boxes, one primitive per leaf. Deterministic.
pub(super) fn binary_tree(boxes: &[Bounds]) -> Bvh2 {
    let mut tree = Bvh2::default();
    if boxes.is_empty() {
        return tree;
    }
    let mut order: Vec<u32> = (0..boxes.len() as u32).collect();
    let mut nodes = Vec::with_capacity(2 * boxes.len() - 1);
    nodes.push(Bvh2Node::default());
    let mut tasks = vec![Task { node: 0, first: 0, count: boxes.len(), depth: 0 }];
    while let Some(Task { node, first, count, depth }) = tasks.pop() {
        let part = &mut order[first..first + count];
        let bounds = part.iter().fold(Bounds::EMPTY, |b, &i| b.union(boxes[i as usize]));
        let aabb = Aabb::new(bounds.min.into(), bounds.max.into());
        if count == 1 {
            nodes[node] = Bvh2Node::new(aabb, 1, first as u32);
            continue;
        }
        let left = split(part, boxes, depth);
        let child = nodes.len();
        nodes[node] = Bvh2Node::new(aabb, 0, child as u32);
        nodes.resize(child + 2, Bvh2Node::default());
        tasks.push(Task { node: child + 1, first: first + left, count: count - left, depth: depth + 1 });
        tasks.push(Task { node: child, first, count: left, depth: depth + 1 });
    }
    tree.nodes = nodes;
    tree.primitive_indices = order;
    tree
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
