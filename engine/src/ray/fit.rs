//! The eight children of a compressed node: decoding them, fitting their boxes, and the stack that a traversal needs.
use super::Bounds;
use glam::Vec3;
use magpie_shaders::scene::BvhNode;
use std::ops::Range;

/// The content of one of the eight child slots of a node.
#[derive(Clone, Debug, PartialEq, Eq)]
pub enum Child {
    /// An empty slot.
    None,
    /// An inner child, as the index of its node.
    Node(usize),
    /// A leaf, as a range of primitives in the order of the leaves.
    Primitives(Range<usize>),
}

/// Decodes the child slots of a node (Ylitie et al. 2017, section 3.2).
pub fn children(node: &BvhNode) -> [Child; 8] {
    let inner = node.exponents_and_mask >> 24;
    std::array::from_fn(|slot| {
        let meta = byte(&node.meta, slot);
        if meta == 0 {
            Child::None
        } else if inner & (1 << slot) != 0 {
            // Inner children are contiguous, in the order of their slots.
            Child::Node((node.child_base + (inner & ((1 << slot) - 1)).count_ones()) as usize)
        } else {
            // The upper three bits are a unary count; the lower five are the offset of the first primitive.
            let first = (node.primitive_base + (meta & 31)) as usize;
            Child::Primitives(first..first + (meta >> 5).count_ones() as usize)
        }
    })
}

fn byte(words: &[u32; 2], slot: usize) -> u32 {
    (words[slot / 4] >> (8 * (slot % 4))) & 255
}

/// Recomputes the grids and quantised boxes of every node from the primitives, and returns the box of the root.
///
/// `obvhs` computes them in `f32`, where a rounding error can make a box too small. Here they are computed in `f64` and rounded
/// outwards, so that each decoded box contains everything below it. Nodes must precede their children, as `obvhs` writes them.
/// `primitives` are boxes in the order of the leaves.
pub(super) fn fit(nodes: &mut [BvhNode], primitives: &[Bounds]) -> Bounds {
    let mut bounds = vec![Bounds::EMPTY; nodes.len()];
    for index in (0..nodes.len()).rev() {
        let boxes = children(&nodes[index]).map(|child| match child {
            Child::None => Bounds::EMPTY,
            Child::Node(node) => bounds[node],
            Child::Primitives(range) => primitives[range].iter().fold(Bounds::EMPTY, |b, &p| b.union(p)),
        });
        bounds[index] = boxes.iter().fold(Bounds::EMPTY, |b, &c| b.union(c));
        if !bounds[index].is_empty() {
            quantise(&mut nodes[index], bounds[index], &boxes);
        }
    }
    bounds.first().copied().unwrap_or_default()
}

/// The nodes of a BVH by depth.
///
/// One workgroup can refit a BVH level by level, with a barrier in between, so that the children of a level are finished before
/// it. The box of a node is the union of its leaves' boxes, computed from the positions, and of its inner children's boxes. The
/// latter must be kept exactly (six `f32` per node) until the level above has read them: a box decoded from a child's grid is
/// also valid, but would grow with every level.
///
/// In `f32`, a box is quantised outwards per axis as follows, with `size = max - min` of the node. The cell is the smallest power
/// of two, at least 2^-60, with `size * (1 + 2^-20) <= 255 * cell`. The planes of a child are `floor((child.min - min) / cell *
/// (1 - 2^-21))` and `ceil((child.max - min) / cell * (1 + 2^-21))`, the latter at least 1 if `child.max > min`. The division is
/// exact except for underflow; the difference and the product have errors of 2^-24 each, which the factor covers; and the
/// condition on the cell keeps planes below 256.
#[derive(Clone, Debug, PartialEq, Eq)]
pub struct Levels {
    /// Indices of all nodes: the deepest level first and the root last, ascending within a level.
    pub nodes: Vec<u32>,
    /// Start of each level in `nodes`, and the end of the last one.
    pub offsets: Vec<u32>,
}

/// Sorts nodes by depth. Each must precede its children.
pub(super) fn levels(nodes: &[BvhNode]) -> Levels {
    let mut depths = vec![0_usize; nodes.len()];
    let mut counts = Vec::new();
    for index in 0..nodes.len() {
        let depth = depths[index];
        counts.resize(counts.len().max(depth + 1), 0_u32);
        counts[depth] += 1;
        for child in children(&nodes[index]) {
            if let Child::Node(node) = child {
                depths[node] = depth + 1;
            }
        }
    }
    let mut offsets = vec![0];
    offsets.extend(counts.iter().rev().scan(0, |end, count| {
        *end += count;
        Some(*end)
    }));
    let mut next: Vec<u32> = offsets[..counts.len()].iter().rev().copied().collect();
    let mut order = vec![0; nodes.len()];
    for (node, depth) in (0..).zip(depths) {
        order[next[depth] as usize] = node;
        next[depth] += 1;
    }
    Levels { nodes: order, offsets }
}

/// Exponent of the smallest grid cell, 2^-60. With smaller cells, the product with the inverse of a direction would underflow.
const FINEST: i32 = -60;

fn quantise(node: &mut BvhNode, bounds: Bounds, children: &[Bounds; 8]) {
    node.origin = bounds.min.to_array();
    let mut exponents = 0;
    let cells = [0, 1, 2].map(|axis| {
        let extent = f64::from(bounds.max[axis]) - f64::from(bounds.min[axis]);
        // The smallest power of two of which 255 cover the extent; the loop corrects a logarithm that was rounded down.
        let mut exponent = ((extent / 255.0).log2().ceil() as i32).max(FINEST);
        while 255.0 * f64::from(exponent).exp2() < extent {
            exponent += 1;
        }
        exponents |= ((exponent + 127) as u32) << (8 * axis);
        f64::from(exponent).exp2()
    });
    node.exponents_and_mask = node.exponents_and_mask & 0xff00_0000 | exponents;

    let planes = |axis: usize, side: fn(&Bounds) -> Vec3, round: fn(f64) -> f64| {
        let mut words = [0_u32; 2];
        for (slot, child) in children.iter().enumerate().filter(|(_, c)| !c.is_empty()) {
            let steps = (f64::from(side(child)[axis]) - f64::from(bounds.min[axis])) / cells[axis];
            words[slot / 4] |= (round(steps) as u32).min(255) << (8 * (slot % 4));
        }
        words
    };
    (node.min_x, node.max_x) = (planes(0, |b| b.min, f64::floor), planes(0, |b| b.max, f64::ceil));
    (node.min_y, node.max_y) = (planes(1, |b| b.min, f64::floor), planes(1, |b| b.max, f64::ceil));
    (node.min_z, node.max_z) = (planes(2, |b| b.min, f64::floor), planes(2, |b| b.max, f64::ceil));
}

/// Largest number of stack entries that a traversal of this BVH needs.
///
/// While the traversal visits an inner child, that child's siblings wait in one entry. `below` returns the entries that a
/// primitive's own BVH needs, or `None` for a triangle; while it is traversed, the inner children of the node wait in one entry.
pub(super) fn stack_need(nodes: &[BvhNode], below: impl Fn(usize) -> Option<u32>) -> u32 {
    let mut needs = vec![0; nodes.len()];
    for index in (0..nodes.len()).rev() {
        let slots = children(&nodes[index]);
        let inner = slots.iter().filter(|c| matches!(c, Child::Node(_))).count();
        let of_primitive = |p: usize| below(p).map_or(0, |need| u32::from(inner > 0) + need);
        needs[index] = slots
            .into_iter()
            .map(|child| match child {
                Child::None => 0,
                Child::Node(node) => u32::from(inner > 1) + needs[node],
                Child::Primitives(range) => range.map(of_primitive).max().unwrap_or(0),
            })
            .max()
            .unwrap_or(0);
    }
    needs.first().copied().unwrap_or(0)
}
