//! Ways to spoil a good plan.

use magpie::graph::{
    Access, BufferDesc, Declaration, Domain, Extent, Format, FrameGraph, ImageDesc, ImportKey, Layout, Queue, Record,
    plan,
    plan::{Barrier, Culled, Plan},
};

/// Spoils a plan in a way that `pick` chooses; false where there is nothing to spoil.
type Plant = fn(&Declaration, &mut Plan, usize) -> bool;

/// Every kind of mistake, by name.
pub const MISTAKES: &[(&str, Plant)] = &[
    ("a barrier is missing", |_, plan, pick| {
        let Some((batch, i)) = find(plan, pick, |_| true) else { return false };
        plan.barriers[batch].remove(i);
        true
    }),
    ("a barrier waits for nothing", |_, plan, pick| edit(plan, pick, |_| true, |b| b.from = [].into_iter().collect())),
    ("a barrier serves another domain", |_, plan, pick| {
        edit(plan, pick, |_| true, |b| b.to.1 = if b.to.1 == Domain::Raster { Domain::Compute } else { Domain::Raster })
    }),
    ("a barrier stands a pass too late", |_, plan, pick| {
        let last = plan.order.len();
        let end = plan.barriers.split_off(last);
        let found = find(plan, pick, |_| true);
        plan.barriers.extend(end);
        let Some((batch, i)) = found else { return false };
        let late = plan.barriers[batch].remove(i);
        plan.barriers[batch + 1].push(late);
        true
    }),
    ("an image ends up in a wrong layout", |_, plan, pick| {
        edit(plan, pick, is_image, |b| {
            b.layout_to = if b.layout_to == Layout::General { Layout::ShaderRead } else { Layout::General };
        })
    }),
    ("an image is taken to be in a wrong layout", |_, plan, pick| {
        edit(
            plan,
            pick,
            |b| is_image(b) && !b.discard,
            |b| {
                b.layout_from = if b.layout_from == Layout::General { Layout::ShaderRead } else { Layout::General };
            },
        )
    }),
    ("contents are discarded", |_, plan, pick| {
        edit(plan, pick, |b| is_image(b) && !b.discard, |b| (b.discard, b.layout_from) = (true, Layout::Undefined))
    }),
    ("a write does not wait for one of the readers", |d, plan, pick| {
        // Of a transient buffer: its readers wait for its writer, none for another.
        let several = |b: &Barrier| b.from.iter().count() > 1 && b.to.0.writes() && is_transient_buffer(d, b);
        edit(plan, pick, several, |b| {
            if let Some(one) = b.from.iter().next() {
                b.from.remove(one);
            }
        })
    }),
    ("two passes are swapped", |d, plan, pick| {
        let pairs = dependent(d, plan);
        let Some(&(a, b)) = pairs.get(pick % pairs.len().max(1)) else { return false };
        plan.order.swap(a, b);
        plan.barriers.swap(a, b);
        true
    }),
    ("a needed pass is left out", |_, plan, pick| {
        if plan.order.is_empty() {
            return false;
        }
        let at = pick % plan.order.len();
        let pass = plan.order.remove(at);
        plan.barriers.remove(at);
        plan.culled.push(Culled { pass, reason: "planted".to_owned() });
        true
    }),
    ("a pass that nothing needs is kept", |d, plan, pick| {
        // All that the planner would do for it is done, so only its being there is wrong.
        if plan.culled.is_empty() {
            return false;
        }
        let extra = plan.culled[pick % plan.culled.len()].pass;
        let mut wider = d.clone();
        let uses = d.passes[extra as usize].uses.iter();
        wider
            .outputs
            .extend(uses.filter_map(|u| Some(magpie::graph::OutputDecl { resource: u.resource, version: u.writes? })));
        let before = plan.order.len();
        let planned = self::plan(&wider);
        *plan = planned;
        plan.order.len() > before
    }),
    ("a lifetime ends early", |_, plan, pick| {
        let alive: Vec<usize> =
            (0..plan.lifetimes.len()).filter(|&r| plan.lifetimes[r].is_some_and(|l| l.last > l.first)).collect();
        let Some(&resource) = alive.get(pick % alive.len().max(1)) else { return false };
        plan.lifetimes[resource] = plan.lifetimes[resource].map(|mut l| {
            l.last -= 1;
            l
        });
        true
    }),
    ("a transient lacks a use", |_, plan, pick| {
        if plan.transients.is_empty() {
            return false;
        }
        let at = pick % plan.transients.len();
        let uses = &mut plan.transients[at].uses;
        if let Some(one) = uses.iter().next() {
            uses.remove(one);
        }
        true
    }),
    ("the least memory is too little", |_, plan, _| {
        plan.memory.lower_bound = plan.memory.lower_bound.wrapping_sub(1);
        true
    }),
];

fn is_image(b: &Barrier) -> bool {
    b.layout_to != Layout::Undefined
}

fn is_transient_buffer(d: &Declaration, b: &Barrier) -> bool {
    let decl = &d.resources[b.resource as usize];
    decl.is_transient() && matches!(decl.shape, magpie::graph::Shape::Buffer { .. })
}

/// Batch and place of one of the barriers that suit.
fn find(plan: &Plan, pick: usize, suits: impl Fn(&Barrier) -> bool) -> Option<(usize, usize)> {
    let all = plan.barriers.iter().enumerate();
    let all: Vec<(usize, usize)> = all
        .flat_map(|(batch, barriers)| barriers.iter().enumerate().map(move |(i, b)| (batch, i, b)))
        .filter(|(_, _, b)| suits(b))
        .map(|(batch, i, _)| (batch, i))
        .collect();
    all.get(pick % all.len().max(1)).copied()
}

fn edit(plan: &mut Plan, pick: usize, suits: impl Fn(&Barrier) -> bool, change: impl Fn(&mut Barrier)) -> bool {
    let Some((batch, i)) = find(plan, pick, suits) else { return false };
    change(&mut plan.barriers[batch][i]);
    true
}

/// Positions of passes that use one resource, which one of them at least writes.
fn dependent(d: &Declaration, plan: &Plan) -> Vec<(usize, usize)> {
    let uses = |at: usize| &d.passes[plan.order[at] as usize].uses;
    let depend = |a: usize, b: usize| {
        uses(a)
            .iter()
            .any(|x| uses(b).iter().any(|y| x.resource == y.resource && (x.writes.is_some() || y.writes.is_some())))
    };
    let count = plan.order.len();
    (0..count).flat_map(|a| (a + 1..count).map(move |b| (a, b))).filter(|&(a, b)| depend(a, b)).collect()
}

/// A frame in which every mistake can be made.
pub fn frame() -> FrameGraph {
    let mut g = FrameGraph::new(Extent::new(32, 32));
    let found = g.import_buffer("found", BufferDesc::new(16), Access::HostRead, ImportKey::Caller(0));
    g.leave(found.read(), Access::HostRead, Domain::Copy);
    let list = g
        .pass("list.make", Queue::Graphics, |p| (p.create_buffer("list", BufferDesc::new(256)).0, |_: &mut Record| {}));
    let drawn = g.pass("list.draw", Queue::Graphics, |p| {
        p.read(list.read());
        p.indirect(list.read());
        (p.color("drawn", ImageDesc::full(Format::Rgba16Float), [0.0; 4]).0, |_: &mut Record| {})
    });
    let lit = g.pass("light", Queue::Graphics, |p| {
        p.sample(drawn.read());
        p.read(list.read());
        (p.create("lit", ImageDesc::full(Format::Rgba16Float)).0, |_: &mut Record| {})
    });
    let list = g.pass("list.next", Queue::Graphics, |p| (p.write_buffer(list).0, |_: &mut Record| {}));
    let spare = g.pass("spare", Queue::Graphics, |p| {
        p.sample(lit.read());
        (p.create("spare", ImageDesc::half(Format::R8Unorm)).0, |_: &mut Record| {})
    });
    g.pass("spare.more", Queue::Graphics, |p| {
        p.sample(spare.read());
        let _ = p.create("more", ImageDesc::half(Format::R8Unorm));
        ((), |_: &mut Record| {})
    });
    g.output(lit.read());
    let _ = g.pass("copy", Queue::Transfer, |p| {
        p.copy_from(list.read());
        (p.copy_to(found).0, |_: &mut Record| {})
    });
    g
}
