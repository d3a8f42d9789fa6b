//! From when until when each resource is used, and what that means for memory.

use super::super::{access::Uses, declaration::Declaration};

/// First and last use of a resource, as positions in the plan's order.
#[derive(Clone, Copy, Debug, PartialEq, Eq)]
pub struct Lifetime {
    /// Position of the first pass that uses it.
    pub first: u32,
    /// Position of the last pass that uses it.
    pub last: u32,
    /// Bytes that its contents take, without padding.
    pub bytes: u64,
}

/// An image or a buffer to make for this frame.
#[derive(Clone, Copy, Debug, PartialEq, Eq)]
pub struct Transient {
    /// Index of the resource.
    pub resource: u32,
    /// All that the frame does with it.
    pub uses: Uses,
}

/// Bytes of transient contents, without padding.
#[derive(Clone, Copy, Debug, Default, PartialEq, Eq)]
pub struct Memory {
    /// When each transient has memory of its own.
    pub unaliased: u64,
    /// Most that is alive at one time: no placement takes less.
    pub lower_bound: u64,
}

/// Lifetime of each resource; none for those that no kept pass uses.
pub(super) fn lifetimes(declaration: &Declaration, order: &[u32]) -> Vec<Option<Lifetime>> {
    let mut lifetimes: Vec<Option<Lifetime>> = vec![None; declaration.resources.len()];
    for (position, &pass) in order.iter().enumerate() {
        let position = position as u32;
        for u in &declaration.passes[pass as usize].uses {
            let bytes = declaration.resources[u.resource as usize].bytes();
            lifetimes[u.resource as usize].get_or_insert(Lifetime { first: position, last: position, bytes }).last =
                position;
        }
    }
    lifetimes
}

/// Transients that kept passes use, by resource.
pub(super) fn transients(declaration: &Declaration, order: &[u32]) -> Vec<Transient> {
    let mut uses = vec![Uses::EMPTY; declaration.resources.len()];
    for &pass in order {
        let decl = &declaration.passes[pass as usize];
        for u in &decl.uses {
            uses[u.resource as usize].insert(u.access.at(decl.domain));
        }
    }
    let used = uses.into_iter().zip(&declaration.resources).enumerate();
    used.filter(|(_, (uses, resource))| resource.is_transient() && !uses.is_empty())
        .map(|(resource, (uses, _))| Transient { resource: resource as u32, uses })
        .collect()
}

/// Memory of the transients.
pub(super) fn memory(transients: &[Transient], lifetimes: &[Option<Lifetime>], passes: usize) -> Memory {
    // What is made and what ends at each position; a resource is alive during its first and its last pass.
    let (mut made, mut ended) = (vec![0; passes], vec![0; passes]);
    let mut memory = Memory::default();
    for lifetime in transients.iter().filter_map(|t| lifetimes[t.resource as usize]) {
        made[lifetime.first as usize] += lifetime.bytes;
        ended[lifetime.last as usize] += lifetime.bytes;
        memory.unaliased += lifetime.bytes;
    }
    let mut alive = 0;
    for (made, ended) in made.into_iter().zip(ended) {
        alive += made;
        memory.lower_bound = memory.lower_bound.max(alive);
        alive -= ended;
    }
    memory
}

#[cfg(test)]
mod tests {
    use super::super::super::*;
    use super::*;

    #[test]
    fn a_chain_needs_two_images_at_a_time() {
        let mut g = FrameGraph::new(Extent::new(10, 10));
        let desc = ImageDesc::full(Format::R32Float);
        let mut image = g.pass("0", Queue::Graphics, |p| (p.create("x", desc).0, |_: &mut Record| {}));
        for name in ["1", "2", "3"] {
            image = g.pass(name, Queue::Graphics, |p| {
                p.sample(image.read());
                (p.create("x", desc).0, |_: &mut Record| {})
            });
        }
        g.output(image.read());
        let frame = g.finish().unwrap();
        let plan = plan(&frame.declaration);
        assert_eq!(plan.memory, Memory { unaliased: 4 * 400, lower_bound: 2 * 400 });
        assert_eq!(plan.lifetimes[1], Some(Lifetime { first: 1, last: 2, bytes: 400 }));
        assert_eq!(plan.lifetimes[3], Some(Lifetime { first: 3, last: 3, bytes: 400 }));
        let uses: Uses =
            [(Access::StorageWrite, Domain::Compute), (Access::Sample, Domain::Compute)].into_iter().collect();
        assert_eq!(plan.transients[1], Transient { resource: 1, uses });
    }

    #[test]
    fn mips_count_and_culled_ones_do_not() {
        let mut g = FrameGraph::new(Extent::new(4, 2));
        let desc = ImageDesc { mips: 3, ..ImageDesc::full(Format::R8Unorm) };
        let kept = g.pass("kept", Queue::Graphics, |p| (p.create("x", desc).0, |_: &mut Record| {}));
        let _ = g.pass("culled", Queue::Graphics, |p| (p.create("x", desc).0, |_: &mut Record| {}));
        g.output(kept.read());
        let frame = g.finish().unwrap();
        let plan = plan(&frame.declaration);
        assert_eq!(plan.memory, Memory { unaliased: 8 + 2 + 1, lower_bound: 11 });
        assert_eq!(plan.lifetimes[1], None);
        assert_eq!(plan.transients.len(), 1);
    }

    #[test]
    fn imports_take_no_transient_memory() {
        let mut g = FrameGraph::new(Extent::new(4, 4));
        let buffer = g.import_buffer("b", BufferDesc::new(100), Access::HostRead, ImportKey(0));
        let _ = g.pass("fill", Queue::Graphics, |p| (p.write_buffer(buffer).0, |_: &mut Record| {}));
        let frame = g.finish().unwrap();
        let plan = plan(&frame.declaration);
        assert_eq!(plan.memory, Memory::default());
        assert_eq!(plan.lifetimes[0].map(|l| l.bytes), Some(100));
    }
}
