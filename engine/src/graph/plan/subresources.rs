//! Numbers the parts of resources that are tracked separately: subresources. Most resources have
//! one; an image whose mips or layers are used separately has one for each.

use super::super::{
    declaration::{Declaration, Use},
    desc::Part,
};

/// The numbering of a declaration.
pub(super) struct Subresources {
    /// For each resource, its first subresource and the numbers of mips and layers that are tracked separately.
    resources: Vec<(u32, u16, u16)>,
    count: u32,
}

impl Subresources {
    pub fn new(declaration: &Declaration) -> Self {
        let mut resources = vec![(0, 1, 1); declaration.resources.len()];
        for u in &declaration.uses {
            let (mips, layers) = declaration.resources[u.resource as usize].shape.parts();
            let known = &mut resources[u.resource as usize];
            if u32::from(u.part.mips) < mips {
                known.1 = mips as u16;
            }
            if u32::from(u.part.layers) < layers {
                known.2 = layers as u16;
            }
        }
        let mut count = 0;
        for (first, mips, layers) in &mut resources {
            *first = count;
            count += u32::from(*mips) * u32::from(*layers);
        }
        Self { resources, count }
    }

    /// Total number of subresources.
    pub fn count(&self) -> usize {
        self.count as usize
    }

    /// The subresources that a use covers.
    pub fn of(&self, u: &Use) -> impl Iterator<Item = u32> + use<> {
        let (first, mips, layers) = self.resources[u.resource as usize];
        let (mip_range, layer_range) =
            (range(u.part.mip, u.part.mips, mips), range(u.part.layer, u.part.layers, layers));
        let subresource = move |layer: u32, mip: u32| first + layer * u32::from(mips) + mip;
        layer_range.flat_map(move |layer| mip_range.clone().map(move |mip| subresource(layer, mip)))
    }

    /// All subresources of a resource.
    pub fn of_resource(&self, resource: u32) -> std::ops::Range<u32> {
        let (first, mips, layers) = self.resources[resource as usize];
        first..first + u32::from(mips) * u32::from(layers)
    }

    /// The part of the resource that a subresource stands for.
    pub fn part(&self, declaration: &Declaration, resource: u32, subresource: u32) -> Part {
        let (first, mips, layers) = self.resources[resource as usize];
        let (all_mips, all_layers) = declaration.resources[resource as usize].shape.parts();
        let at = subresource - first;
        let (mip, layer) = ((at % u32::from(mips)) as u16, (at / u32::from(mips)) as u16);
        let one = |tracked: u16, at: u16, all: u32| if tracked == 1 { (0, all as u16) } else { (at, 1) };
        let ((mip, mips), (layer, layers)) = (one(mips, mip, all_mips), one(layers, layer, all_layers));
        Part { mip, mips, layer, layers }
    }
}

/// Range of subresources along one dimension; 0..1 if it is not tracked separately.
fn range(first: u16, count: u16, tracked: u16) -> std::ops::Range<u32> {
    if tracked == 1 { 0..1 } else { u32::from(first)..u32::from(first) + u32::from(count) }
}

#[cfg(test)]
mod tests {
    use super::super::super::*;
    use super::*;

    #[test]
    fn only_what_is_used_apart_is_told_apart() {
        let mut g = FrameGraph::new(Extent::new(8, 8));
        let desc = ImageDesc { mips: 4, layers: 2, ..ImageDesc::full(Format::R32Float) };
        let (whole, by_mip) = g.pass("a", Queue::Graphics, |p| {
            let (whole, _) = p.create("whole", desc);
            let (by_mip, _) = p.create_part("by mip", desc, Part::mip(0));
            ((whole, by_mip), |_: &mut Record| {})
        });
        g.pass("b", Queue::Graphics, |p| {
            p.sample(whole.read());
            p.sample_part(by_mip.read(), Part { mip: 0, mips: 1, layer: 1, layers: 1 });
            ((), |_: &mut Record| {})
        });
        let declaration = g.declaration();
        let subresources = Subresources::new(declaration);
        assert_eq!(subresources.count(), 1 + 8);
        let touched: Vec<Vec<u32>> = declaration.uses.iter().map(|u| subresources.of(u).collect()).collect();
        assert_eq!(touched, [vec![0], vec![1, 5], vec![0], vec![5]]);
        assert_eq!(subresources.part(declaration, 0, 0), Part { mip: 0, mips: 4, layer: 0, layers: 2 });
        assert_eq!(subresources.part(declaration, 1, 6), Part { mip: 1, mips: 1, layer: 1, layers: 1 });
    }
}
