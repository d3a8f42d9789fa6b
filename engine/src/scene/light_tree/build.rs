//! Builds a tree of lights by the surface-area and orientation heuristic (Conty Estevez and Kulla 2018, section 4.4), with binned splits along all
//! axes, by place and by direction. Its depth is bounded, so that the path to any light fits in 32 bits: where a split would leave more on one side than the rest of the path
//! can tell apart, it is made at the median.
use super::bounds::{Cone, node_above};
use crate::ray::Bounds;
use glam::Vec3;
use magpie_shaders::light_tree::LightNode;

/// Greatest depth of a leaf, one bit of a path for each level above it.
pub(super) const MOST_DEPTH: u32 = 32;
/// Largest number of bins per axis.
const BINS: usize = 16;
/// Subtrees with more lights than this are built in parallel.
const PARALLEL_FROM: usize = 1024;
/// Share of the square of its longest side that a box counts as area at least: lights in a row have none.
const LEAST_AREA: f32 = 0.01;

/// A tree over lights. Its root is the first node; nodes `1 + 2 i` and `2 + 2 i` are siblings, pair `i`.
pub(super) struct Built {
    pub nodes: Vec<LightNode>,
    /// The node above each pair.
    pub parents: Vec<u32>,
    /// Where each light is, in the order in which they were given.
    pub places: Vec<Place>,
}

/// The place of a light.
#[derive(Clone, Copy, Debug, Default, PartialEq, Eq)]
pub(super) struct Place {
    pub node: u32,
    /// The path from the root: bit `i` says which of two siblings follows at depth `i`.
    pub trail: u32,
}

/// Builds a tree over at least one leaf. The same for any number of threads.
pub(super) fn build(leaves: Vec<LightNode>) -> Built {
    let count = leaves.len();
    let mut items: Vec<Item> = (0..).zip(leaves).map(|(index, node)| Item { node, index }).collect();
    let mut nodes = vec![LightNode::default(); 2 * count - 1];
    let mut parents = vec![0; count - 1];
    let mut found = vec![(0_u32, Place::default()); count];
    if let Some((root, rest)) = nodes.split_first_mut() {
        let pairs = bytemuck::cast_slice_mut(rest);
        *root = Part::default().build(&mut items, Slices { pairs, parents: &mut parents, places: &mut found });
    }
    let mut places = vec![Place::default(); count];
    for (index, place) in found {
        places[index as usize] = place;
    }
    Built { nodes, parents, places }
}

/// A light that has not reached its leaf yet.
#[derive(Clone, Copy)]
struct Item {
    node: LightNode,
    index: u32,
}

impl Item {
    fn bounds(&self) -> Bounds {
        Bounds { min: self.node.min.into(), max: self.node.max.into() }
    }

    /// What tells lights apart: where they are, or where they shine.
    fn key(&self, by_direction: bool) -> Vec3 {
        if by_direction { self.node.axis.into() } else { self.bounds().centre() }
    }
}

/// A subtree to be built. It has one pair of siblings fewer than lights, so its place among all pairs is known in advance.
#[derive(Clone, Copy, Default)]
struct Part {
    place: Place,
    first_pair: usize,
    depth: u32,
}

/// Where a subtree is written.
struct Slices<'a> {
    pairs: &'a mut [[LightNode; 2]],
    parents: &'a mut [u32],
    places: &'a mut [(u32, Place)],
}

impl Part {
    /// Sorts the lights of the subtree, writes all below its root, and returns that.
    fn build(self, items: &mut [Item], to: Slices<'_>) -> LightNode {
        let Slices { pairs, parents, places } = to;
        let (Some((pair, pairs)), Some((parent, parents))) = (pairs.split_first_mut(), parents.split_first_mut())
        else {
            places[0] = (items[0].index, self.place);
            return items[0].node;
        };
        *parent = self.place.node;
        let (count, left) = (items.len(), split(items, self.depth));
        let (left_items, right_items) = items.split_at_mut(left);
        let (left_pairs, right_pairs) = pairs.split_at_mut(left - 1);
        let (left_parents, right_parents) = parents.split_at_mut(left - 1);
        let (left_places, right_places) = places.split_at_mut(left);
        let first = (1 + 2 * self.first_pair) as u32;
        let child = |second: bool, first_pair: usize| Part {
            place: Place { node: first + u32::from(second), trail: self.place.trail | u32::from(second) << self.depth },
            first_pair,
            depth: self.depth + 1,
        };
        let (to_left, to_right) = (child(false, self.first_pair + 1), child(true, self.first_pair + left));
        let left_to = Slices { pairs: left_pairs, parents: left_parents, places: left_places };
        let right_to = Slices { pairs: right_pairs, parents: right_parents, places: right_places };
        *pair = if count > PARALLEL_FROM {
            rayon::join(|| to_left.build(left_items, left_to), || to_right.build(right_items, right_to)).into()
        } else {
            [to_left.build(left_items, left_to), to_right.build(right_items, right_to)]
        };
        node_above(&pair[0], &pair[1], first)
    }
}

/// Sorts `items` so that the first `n` belong to the first child. Returns `n`, at least 1 and less than the number of items.
fn split(items: &mut [Item], depth: u32) -> usize {
    let count = items.len();
    if count == 2 {
        return 1;
    }
    // What either side may hold.
    let most = 1_usize << (MOST_DEPTH - depth - 1);
    // Few lights need few bins.
    let [places, directions] = [false, true].map(|by_direction| Bins::of(items, by_direction, BINS.min(2 * count)));
    let split = match (places.cheapest(items), directions.cheapest(items)) {
        (Some(place), Some(direction)) if direction.cost < place.cost => Some((&directions, direction)),
        (Some(place), _) => Some((&places, place)),
        (None, direction) => direction.map(|split| (&directions, split)),
    };
    if let Some((bins, Split { axis, last_left, .. })) = split {
        let left = partition(items, |item| bins.bin(item)[axis] <= last_left);
        if left > 0 && left.max(count - left) <= most && left < count {
            return left;
        }
    }
    let (bins, half) = (if places.extent == Vec3::ZERO { &directions } else { &places }, count / 2);
    let axis = bins.extent.max_position();
    let key = |item: &Item| item.key(bins.by_direction)[axis];
    items.select_nth_unstable_by(half, |a, b| key(a).total_cmp(&key(b)).then(a.index.cmp(&b.index)));
    half
}

/// Sorts those for which `is_left` holds before the others. Returns how many they are.
fn partition(items: &mut [Item], is_left: impl Fn(&Item) -> bool) -> usize {
    let mut left = 0;
    for at in 0..items.len() {
        if is_left(&items[at]) {
            items.swap(left, at);
            left += 1;
        }
    }
    left
}

/// Equal slices of the box around all keys.
struct Bins {
    lower: Vec3,
    extent: Vec3,
    scale: Vec3,
    count: usize,
    by_direction: bool,
    /// All lights are one point, without an area to compare.
    one_point: bool,
}

/// A split between two bins.
struct Split {
    cost: f32,
    axis: usize,
    last_left: usize,
}

/// The lights in one bin, or in several.
#[derive(Clone, Copy)]
struct Lights {
    bounds: Bounds,
    /// `None` where nothing shines.
    cone: Option<Cone>,
    intensity: f32,
    count: u32,
}

impl Lights {
    const NONE: Self = Self { bounds: Bounds::EMPTY, cone: None, intensity: 0.0, count: 0 };

    fn of(item: &Item) -> Self {
        if item.node.intensity > 0.0 {
            let (cone, intensity) = (Some(Cone::of(&item.node)), item.node.intensity);
            Self { bounds: item.bounds(), cone, intensity, count: 1 }
        } else {
            Self { count: 1, ..Self::NONE }
        }
    }

    fn and(self, other: Self) -> Self {
        let cone = match (self.cone, other.cone) {
            (Some(a), Some(b)) => Some(a.union(b)),
            (a, b) => a.or(b),
        };
        Self {
            bounds: self.bounds.union(other.bounds),
            cone,
            intensity: self.intensity + other.intensity,
            count: self.count + other.count,
        }
    }

    /// Expected cost up to a factor: intensity times the measures of area and of directions.
    fn cost(&self, one_point: bool) -> f32 {
        let Some(cone) = self.cone else { return 0.0 };
        let longest = (self.bounds.max - self.bounds.min).max_element();
        let area = if one_point { 1.0 } else { self.bounds.half_area() + LEAST_AREA * longest * longest };
        self.intensity * area * cone.measure()
    }
}

impl Bins {
    fn of(items: &[Item], by_direction: bool, count: usize) -> Self {
        let keys = items.iter().map(|item| item.key(by_direction));
        let (lower, upper) =
            keys.fold((Vec3::INFINITY, Vec3::NEG_INFINITY), |(lower, upper), key| (lower.min(key), upper.max(key)));
        let extent = upper - lower;
        let one_point = by_direction && {
            let bounds = items.iter().fold(Bounds::EMPTY, |bounds, item| bounds.union(item.bounds()));
            bounds.min == bounds.max
        };
        Self { lower, extent, scale: count as f32 / extent, count, by_direction, one_point }
    }

    /// Bin of a light on each axis.
    fn bin(&self, item: &Item) -> [usize; 3] {
        // If the extent is so small that the scale is infinite, the lower end gives 0 * infinity = NaN, which converts to bin 0.
        let at = (item.key(self.by_direction) - self.lower) * self.scale;
        at.to_array().map(|at| (at as usize).min(self.count - 1))
    }

    /// The cheapest split; `None` if there is no split between bins, or nothing shines.
    fn cheapest(&self, items: &[Item]) -> Option<Split> {
        if self.extent.max_element() <= 0.0 {
            return None;
        }
        let mut bins = [[Lights::NONE; BINS]; 3];
        for item in items {
            let own = Lights::of(item);
            for (bins, at) in bins.iter_mut().zip(self.bin(item)) {
                bins[at] = bins[at].and(own);
            }
        }
        let mut best: Option<Split> = None;
        for axis in (0..3).filter(|axis| self.extent[*axis] > 0.0) {
            let bins = &bins[axis][..self.count];
            // Thin slices across the longest side are worth less (section 4.4).
            let thinness = if self.by_direction { 1.0 } else { self.extent.max_element() / self.extent[axis] };
            // First what is to the right of each bin, then a sweep from the left.
            let mut to_right = [Lights::NONE; BINS];
            for at in (1..self.count).rev() {
                to_right[at - 1] = to_right[at].and(bins[at]);
            }
            let mut left = Lights::NONE;
            for last_left in 0..self.count - 1 {
                left = left.and(bins[last_left]);
                let right = &to_right[last_left];
                let shines = left.intensity > 0.0 || right.intensity > 0.0;
                let cost = thinness * (left.cost(self.one_point) + right.cost(self.one_point));
                let cheaper = cost < best.as_ref().map_or(f32::INFINITY, |best| best.cost);
                if left.count > 0 && right.count > 0 && shines && cheaper {
                    best = Some(Split { cost, axis, last_left });
                }
            }
        }
        best
    }
}
