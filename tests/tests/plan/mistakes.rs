//! Mistakes to plant in a correct plan, and a frame in which each is possible.

use magpie::graph::{
    Access, BufferDesc, Declaration, Domain, Extent, Format, FrameGraph, HistoryScope, ImageDesc, ImportKey, Layout,
    OutputDecl, Part, Queue, Record, Shape, Span, Use, Uses,
    plan::{Barrier, Culled, Handover, Lane, Plan, Role, Sharing},
};

/// A place for a mistake: two numbers whose meaning depends on its kind.
pub type Place = (usize, usize);

/// Plants a mistake in a plan. The function argument replans a declaration.
pub type Plant = fn(&Declaration, &mut Plan, Place, &dyn Fn(&Declaration) -> Plan);

/// A kind of mistake.
pub struct Mistake {
    /// What is wrong with the plan.
    pub name: &'static str,
    /// Every place in a plan where it is possible.
    pub places: fn(&Declaration, &Plan) -> Vec<Place>,
    /// Plants it at one of them.
    pub plant: Plant,
    /// Why some places are harmless; without a reason every planted mistake must be found.
    pub harmless: Option<&'static str>,
}

/// All kinds of mistakes.
pub const MISTAKES: &[Mistake] = &[
    Mistake {
        name: "a barrier is missing",
        places: |d, plan| certain(d, plan),
        plant: |_, plan, at, _| take_out(plan, at.0),
        harmless: None,
    },
    Mistake {
        name: "a barrier that changes no layout is missing beside other queues, or at the end",
        places: |d, plan| {
            let certain = certain(d, plan);
            barriers(plan, |_| true).into_iter().filter(|at| !certain.contains(at)).collect()
        },
        plant: |_, plan, at, _| take_out(plan, at.0),
        harmless: Some(
            "the queue has waited for another one that has waited for it or began after the frame before; what is only read and comes \
             readable is made ready at the end once more",
        ),
    },
    Mistake {
        name: "a barrier waits for nothing",
        places: |d, plan| {
            let waits = |&(b, _): &Place| !plan.barriers[b].from.is_empty();
            certain(d, plan).into_iter().filter(waits).collect()
        },
        plant: |_, plan, at, _| plan.barriers[at.0].from = Uses::EMPTY,
        harmless: None,
    },
    Mistake {
        name: "a barrier does not wait for one of the readers or writers",
        places: |_, plan| each_use(plan, |b| b.from),
        plant: |_, plan, (at, one), _| {
            let named = plan.barriers[at].from.iter().nth(one);
            named.into_iter().for_each(|one| plan.barriers[at].from.remove(one));
        },
        harmless: Some(
            "its queue knows of that one by a detour over another, or by the other uses that it waits for; or it is one at the end that \
             need not be",
        ),
    },
    Mistake {
        name: "a barrier does not wait for other queues",
        places: |_, plan| barriers(plan, |b| b.from.has_other_queues()),
        plant: |_, plan, at, _| plan.barriers[at.0].from = plan.barriers[at.0].from.iter().collect(),
        harmless: Some("a named use on this queue comes after the wait itself: the barrier goes on from it"),
    },
    Mistake {
        name: "a barrier makes nobody wait",
        places: |_, plan| barriers(plan, |b| !b.to.is_empty()),
        plant: |_, plan, at, _| plan.barriers[at.0].to = Uses::EMPTY,
        harmless: Some("its queue knows all by a detour over another, or it is one at the end that need not be"),
    },
    Mistake {
        name: "a barrier serves another domain",
        places: |_, plan| barriers(plan, |b| b.to.iter().any(|at| swapped(at) != at)),
        plant: |_, plan, at, _| plan.barriers[at.0].to = plan.barriers[at.0].to.iter().map(swapped).collect(),
        harmless: Some(
            "it serves both, or its queue knows all by a detour over another, or it is one at the end that need not be",
        ),
    },
    Mistake {
        name: "a barrier stands a pass too late",
        places: |d, plan| {
            let (certain, all) = (certain(d, plan), plan.before.iter().enumerate());
            let all = all.flat_map(|(position, stop)| stop.range().map(move |b| (b, position)));
            // A barrier for several uses may be needed by later ones only, if this pass can rely on the state before the frame.
            let moves = |b: usize| plan.barriers[b].layout_from != plan.barriers[b].layout_to;
            let one = |b: usize| moves(b) || plan.barriers[b].to.iter().count() == 1;
            all.filter(|&(b, _)| certain.contains(&(b, 0)) && one(b)).collect()
        },
        plant: |_, plan, (at, position), _| {
            let late = plan.barriers[at];
            take_out(plan, at);
            insert(plan, 2 * position + 1, late);
        },
        harmless: None,
    },
    Mistake {
        name: "an image ends up in a wrong layout",
        places: |_, plan| barriers(plan, is_image),
        plant: |_, plan, at, _| plan.barriers[at.0].layout_to = other(plan.barriers[at.0].layout_to),
        harmless: None,
    },
    Mistake {
        name: "an image is taken to be in a wrong layout",
        places: |_, plan| barriers(plan, |b| is_image(b) && !b.discard),
        plant: |_, plan, at, _| plan.barriers[at.0].layout_from = other(plan.barriers[at.0].layout_from),
        harmless: None,
    },
    Mistake {
        name: "wanted contents are discarded",
        places: |_, plan| barriers(plan, |b| !b.discard),
        plant: |_, plan, at, _| {
            let b = &mut plan.barriers[at.0];
            (b.discard, b.layout_from) = (true, Layout::Undefined);
        },
        harmless: Some("parts that nothing was written to have no contents, and what nobody reads again needs none"),
    },
    Mistake {
        name: "a barrier is for a wrong mip or too few",
        places: |d, plan| {
            let parts = |b: &Barrier| match d.resources[b.resource as usize].shape {
                Shape::Image { mips, .. } => mips > 1,
                Shape::Buffer { .. } | Shape::Accel { .. } => false,
            };
            barriers(plan, parts)
        },
        plant: |d, plan, at, _| {
            let b = &mut plan.barriers[at.0];
            let Shape::Image { mips, .. } = d.resources[b.resource as usize].shape else { return };
            match b.part.mips {
                1 => b.part.mip = (b.part.mip + 1) % mips as u16,
                _ => b.part.mips -= 1,
            }
        },
        harmless: Some("nobody uses the mip after it, or its queue knows all by a detour over another"),
    },
    Mistake {
        name: "two passes are swapped",
        places: dependent,
        plant: |_, plan, (a, b), _| {
            plan.order.swap(a, b);
            plan.before.swap(a, b);
            plan.after.swap(a, b);
        },
        harmless: None,
    },
    Mistake {
        name: "a needed pass is left out",
        places: |_, plan| (0..plan.order.len()).map(|position| (position, 0)).collect(),
        plant: |_, plan, (position, _), _| {
            plan.culled.push(Culled { pass: plan.order[position], reason: "planted".to_owned() });
            leave_out(plan, position);
        },
        harmless: None,
    },
    Mistake {
        name: "a pass that nothing needs is kept",
        places: |d, plan| {
            let writes = |pass: u32| uses_of(d, pass).iter().any(|u| u.writes.is_some());
            (0..plan.culled.len()).filter(|&i| writes(plan.culled[i].pass)).map(|i| (i, 0)).collect()
        },
        plant: |d, plan, (index, _), again| {
            // Replans with the pass's results as outputs, so that only its presence is wrong.
            let mut wider = d.clone();
            let written = uses_of(d, plan.culled[index].pass).iter();
            wider.outputs.extend(written.filter_map(|u| Some(OutputDecl { resource: u.resource, version: u.writes? })));
            *plan = again(&wider);
        },
        harmless: None,
    },
    Mistake {
        name: "a lifetime is too short",
        places: |_, plan| {
            let long = |r: &usize| plan.lifetimes[*r].is_some_and(|l| l.last > l.first);
            (0..plan.lifetimes.len()).filter(long).map(|r| (r, 0)).collect()
        },
        plant: |_, plan, at, _| plan.lifetimes[at.0].iter_mut().for_each(|l| l.last -= 1),
        harmless: None,
    },
    Mistake {
        name: "two live transients share bytes",
        places: |_, plan| {
            let t = &plan.transients;
            let life = |r: u32| plan.lifetimes[r as usize];
            let together = |a: usize, b: usize| match (life(t[a].resource), life(t[b].resource)) {
                (Some(x), Some(y)) if x.lane == y.lane && x.lane != Lane::Several => {
                    x.first <= y.last && y.first <= x.last
                }
                _ => false,
            };
            let fits =
                |a: usize, b: usize| t[a].heap == t[b].heap && t[a].offset % 1024 == 0 && t[a].offset != t[b].offset;
            pairs(t.len()).filter(|&(a, b)| fits(a, b) && together(a, b)).collect()
        },
        plant: |_, plan, (a, b), _| plan.transients[b].offset = plan.transients[a].offset,
        harmless: None,
    },
    Mistake {
        name: "transients of different queues share bytes",
        places: |_, plan| {
            let t = &plan.transients;
            let other = |a: usize, b: usize| match (t[a].sharing, t[b].sharing) {
                (Sharing::Alone(x), Sharing::Alone(y)) => x != y,
                _ => false,
            };
            let fits =
                |a: usize, b: usize| t[a].heap == t[b].heap && t[a].offset % 1024 == 0 && t[a].offset != t[b].offset;
            pairs(t.len()).filter(|&(a, b)| fits(a, b) && other(a, b)).collect()
        },
        plant: |_, plan, (a, b), _| plan.transients[b].offset = plan.transients[a].offset,
        harmless: Some("one queue happens to wait for all uses of the first before the first use of the second"),
    },
    Mistake {
        name: "who takes over memory does not wait for who had it",
        places: |d, plan| {
            let inherits = |b: &Barrier| plan.successions.iter().any(|(after, _)| *after == b.resource);
            let first = |b: &Barrier| b.discard || b.layout_to == Layout::Undefined;
            let fresh = |i: usize| !plan.barriers[..i].iter().any(|o| o.resource == plan.barriers[i].resource);
            let all = certain(d, plan).into_iter().map(|(i, _)| (i, &plan.barriers[i]));
            let all = all.filter(|(i, b)| inherits(b) && first(b) && !b.from.is_empty() && fresh(*i));
            all.map(|(i, _)| (i, 0)).collect()
        },
        plant: |_, plan, at, _| plan.barriers[at.0].from = Uses::EMPTY,
        harmless: None,
    },
    Mistake {
        name: "a batch does not wait for another queue",
        places: |_, plan| waits(plan),
        plant: |_, plan, (batch, at), _| {
            plan.waits.remove(at);
            plan.batches[batch].waits.end -= 1;
            plan.batches[batch + 1..]
                .iter_mut()
                .for_each(|b| (b.waits.start, b.waits.end) = (b.waits.start - 1, b.waits.end - 1));
        },
        harmless: Some("another batch that is waited for has waited for it"),
    },
    Mistake {
        name: "a batch waits for one that comes after it",
        places: |_, plan| waits(plan),
        plant: |_, plan, (batch, at), _| plan.waits[at] = batch as u32 + 1,
        harmless: None,
    },
    Mistake {
        name: "a batch waits for an older batch than it must",
        places: |_, plan| {
            let older = |at: usize| older_batch(plan, plan.waits[at]).is_some();
            waits(plan).into_iter().filter(|&(_, at)| older(at)).collect()
        },
        plant: |_, plan, (_, at), _| plan.waits[at] = older_batch(plan, plan.waits[at]).unwrap_or_default(),
        harmless: Some("another batch that is waited for has waited for the newer one"),
    },
    Mistake {
        name: "what was released is not acquired",
        places: |_, plan| barriers(plan, |b| has_role(b, Role::Acquire)),
        plant: |_, plan, at, _| take_out(plan, at.0),
        harmless: None,
    },
    Mistake {
        name: "what is acquired was not released",
        places: |_, plan| barriers(plan, |b| has_role(b, Role::Release)),
        plant: |_, plan, at, _| take_out(plan, at.0),
        harmless: None,
    },
    Mistake {
        name: "ownership goes to the wrong queue",
        places: |_, plan| barriers(plan, |b| b.handover.is_some()),
        plant: |_, plan, at, _| {
            if let Some(h) = &mut plan.barriers[at.0].handover {
                let third = Queue::ALL.into_iter().find(|q| *q != h.from && *q != h.to);
                *h = Handover { to: third.unwrap_or(h.from), ..*h };
            }
        },
        harmless: None,
    },
    Mistake {
        name: "what queues use in turn is handed over to nobody",
        places: |_, plan| sharing(plan, |s| s == Sharing::Concurrent),
        plant: |_, plan, at, _| plan.transients[at.0].sharing = Sharing::HandedOver,
        harmless: Some(
            "each queue uses mips and layers of its own, or contents are not kept, so that the next queue may take it",
        ),
    },
    Mistake {
        name: "what several queues use is said to be used by one alone",
        places: |_, plan| sharing(plan, |s| !matches!(s, Sharing::Alone(_))),
        plant: |_, plan, at, _| plan.transients[at.0].sharing = Sharing::Alone(Queue::Graphics),
        harmless: None,
    },
    Mistake {
        name: "an attachment that is read is not stored",
        places: read_attachments,
        plant: |_, plan, at, _| {
            plan.unstored.push(at.0 as u32);
            plan.unstored.sort_unstable();
        },
        harmless: None,
    },
    Mistake {
        name: "an import is not left as it was asked for",
        places: |d, plan| certain(d, plan).into_iter().filter(|(b, _)| plan.end.range().contains(b)).collect(),
        plant: |_, plan, at, _| take_out(plan, at.0),
        harmless: None,
    },
    Mistake {
        name: "a pass runs on another queue",
        places: |_, plan| (0..plan.batches.len()).map(|b| (b, 0)).collect(),
        plant: |_, plan, at, _| {
            let queue = plan.batches[at.0].queue;
            plan.batches[at.0].queue = if queue == Queue::Graphics { Queue::AsyncCompute } else { Queue::Graphics };
        },
        harmless: None,
    },
    Mistake {
        name: "a transient lacks a use",
        places: |_, plan| (0..plan.transients.len()).map(|t| (t, 0)).collect(),
        plant: |_, plan, at, _| {
            let uses = &mut plan.transients[at.0].uses;
            uses.iter().next().into_iter().for_each(|one| uses.remove(one));
        },
        harmless: None,
    },
    Mistake {
        name: "a heap is too small",
        places: |_, plan| (0..plan.heaps.len()).map(|h| (h, 0)).collect(),
        plant: |_, plan, at, _| plan.heaps[at.0].bytes -= 1,
        harmless: None,
    },
    Mistake {
        name: "a figure of memory is wrong",
        places: |_, _| vec![(0, 0), (1, 0), (2, 0)],
        plant: |_, plan, at, _| {
            let m = &mut plan.memory;
            *[&mut m.unaliased, &mut m.aliased, &mut m.lower_bound][at.0] += 1;
        },
        harmless: None,
    },
];

// Barriers and their places.

fn barriers(plan: &Plan, suits: impl Fn(&Barrier) -> bool) -> Vec<Place> {
    (0..plan.barriers.len()).filter(|&b| suits(&plan.barriers[b])).map(|b| (b, 0)).collect()
}

/// Barriers that are certainly needed. With several queues only those that change a layout: others may be implied by waits on other queues,
/// directly or indirectly.
fn certain(d: &Declaration, plan: &Plan) -> Vec<Place> {
    let several = plan.batches.iter().any(|b| b.queue != Queue::Graphics);
    let writes = |u: &Use, b: &Barrier| u.resource == b.resource && u.writes.is_some() && u.part.overlaps(b.part);
    let written = |b: &Barrier| plan.order.iter().any(|&p| uses_of(d, p).iter().any(|u| writes(u, b)));
    // At the end the planner also issues redundant barriers, for imports that were not in use, or were only read and stay readable.
    let needless = |i: usize, b: &Barrier| plan.end.range().contains(&i) && (b.from.is_empty() || !written(b));
    let is_certain = |i: usize, b: &Barrier| b.layout_from != b.layout_to || (!several && !needless(i, b));
    let all = plan.barriers.iter().enumerate();
    all.filter(|(i, b)| is_certain(*i, b)).map(|(i, _)| (i, 0)).collect()
}

/// Barriers that name several uses, with the index of each.
fn each_use(plan: &Plan, uses: impl Fn(&Barrier) -> Uses) -> Vec<Place> {
    let several = |b: &usize| uses(&plan.barriers[*b]).iter().count() > 1;
    let all = (0..plan.barriers.len()).filter(several);
    all.flat_map(|b| (0..uses(&plan.barriers[b]).iter().count()).map(move |n| (b, n))).collect()
}

/// The barriers of each place, in order: before and after each pass, and at the end.
fn stops(plan: &Plan) -> Vec<Vec<Barrier>> {
    let spans = plan.before.iter().zip(&plan.after).flat_map(|(before, after)| [before, after]).chain([&plan.end]);
    spans.map(|span| plan.barriers[span.range()].to_vec()).collect()
}

fn set_stops(plan: &mut Plan, stops: Vec<Vec<Barrier>>) {
    let mut next = 0;
    let mut spans: Vec<Span> = Vec::new();
    for stop in &stops {
        spans.push(Span { start: next, end: next + stop.len() as u32 });
        next += stop.len() as u32;
    }
    plan.barriers = stops.into_iter().flatten().collect();
    let passes = plan.order.len();
    plan.before = (0..passes).map(|p| spans[2 * p]).collect();
    plan.after = (0..passes).map(|p| spans[2 * p + 1]).collect();
    plan.end = spans[2 * passes];
}

/// Removes a barrier.
fn take_out(plan: &mut Plan, barrier: usize) {
    let (mut all, mut at) = (stops(plan), barrier);
    for stop in &mut all {
        if at < stop.len() {
            stop.remove(at);
            break;
        }
        at -= stop.len();
    }
    set_stops(plan, all);
}

fn insert(plan: &mut Plan, stop: usize, barrier: Barrier) {
    let mut all = stops(plan);
    all[stop].push(barrier);
    set_stops(plan, all);
}

/// Removes a pass with its barriers, and its batch if it becomes empty.
fn leave_out(plan: &mut Plan, position: usize) {
    let mut all = stops(plan);
    all.drain(2 * position..2 * position + 2);
    plan.order.remove(position);
    set_stops(plan, all);
    let at = position as u32;
    for batch in &mut plan.batches {
        batch.passes.start -= u32::from(batch.passes.start > at);
        batch.passes.end -= u32::from(batch.passes.end > at);
    }
    plan.batches.retain(|b| !b.passes.is_empty());
}

fn is_image(b: &Barrier) -> bool {
    b.layout_to != Layout::Undefined
}

fn has_role(b: &Barrier, role: Role) -> bool {
    b.handover.is_some_and(|h| h.role == role)
}

fn other(layout: Layout) -> Layout {
    if layout == Layout::General { Layout::ReadOnly } else { Layout::General }
}

/// The same access in a pass of another domain, if possible.
fn swapped((access, domain): (Access, Domain)) -> (Access, Domain) {
    access.at(if domain == Domain::Raster { Domain::Compute } else { Domain::Raster })
}

// Batches, passes and memory.

/// Each wait, with its batch.
fn waits(plan: &Plan) -> Vec<Place> {
    plan.batches.iter().enumerate().flat_map(|(b, batch)| batch.waits.range().map(move |w| (b, w))).collect()
}

fn older_batch(plan: &Plan, batch: u32) -> Option<u32> {
    let queue = plan.batches[batch as usize].queue;
    (0..batch).rev().find(|&b| plan.batches[b as usize].queue == queue)
}

fn pairs(count: usize) -> impl Iterator<Item = (usize, usize)> {
    (0..count).flat_map(move |a| (0..count).map(move |b| (a, b))).filter(|(a, b)| a != b)
}

fn uses_of(d: &Declaration, pass: u32) -> &[Use] {
    &d.uses[d.passes[pass as usize].uses.range()]
}

/// Positions of one batch whose passes use the same part of a resource, at least one of them writing.
fn dependent(d: &Declaration, plan: &Plan) -> Vec<Place> {
    let meets = |x: &Use, y: &Use| {
        x.resource == y.resource && x.part.overlaps(y.part) && (x.writes.is_some() || y.writes.is_some())
    };
    let uses = |at: usize| uses_of(d, plan.order[at]);
    let depend = |a: usize, b: usize| uses(a).iter().any(|x| uses(b).iter().any(|y| meets(x, y)));
    let of_batch = |b: Span| b.range().flat_map(move |x| (x + 1..b.end as usize).map(move |y| (x, y)));
    plan.batches.iter().flat_map(|b| of_batch(b.passes)).filter(|&(a, b)| depend(a, b)).collect()
}

/// Attachments of running passes whose contents are read later, or are outputs of the frame.
fn read_attachments(d: &Declaration, plan: &Plan) -> Vec<Place> {
    let attached = |i: &usize| d.uses[*i].access.is_attachment();
    let wanted = |i: usize| {
        let u = &d.uses[i];
        let reads =
            |r: &Use| r.resource == u.resource && r.reads.is_some() && r.reads == u.writes && r.part.overlaps(u.part);
        let output = d.outputs.iter().any(|o| o.resource == u.resource && Some(o.version) == u.writes);
        output || plan.order.iter().any(|&p| uses_of(d, p).iter().any(reads))
    };
    let all = plan.order.iter().flat_map(|&p| d.passes[p as usize].uses.range());
    all.filter(attached).filter(|&i| wanted(i)).map(|i| (i, 0)).collect()
}

fn sharing(plan: &Plan, suits: impl Fn(Sharing) -> bool) -> Vec<Place> {
    (0..plan.transients.len()).filter(|&t| suits(plan.transients[t].sharing)).map(|t| (t, 0)).collect()
}

/// A frame in which every mistake is possible, on two queues.
pub fn frame() -> FrameGraph {
    let mut g = FrameGraph::new(Extent::new(32, 32));
    let float = ImageDesc::full(Format::Rgba16Float);
    let found = g.import_buffer("found", BufferDesc::new(16), Access::HostRead, ImportKey::Caller(0));
    g.leave(found.read(), Access::HostRead, Domain::Copy);
    let counts = g.import_buffer("counts", BufferDesc::new(16), Access::BufferRead, ImportKey::Caller(1));
    let scope = HistoryScope::new();
    let light = g.history(&scope, "light", float);
    let list = g.pass("list.make", Queue::Graphics, |p| {
        let _ = p.write_buffer(counts);
        (p.create_buffer("list", BufferDesc::new(256)).0, |_: &mut Record<'_>| {})
    });
    let (drawn, marked) = g.pass("list.draw", Queue::Graphics, |p| {
        p.read(list.read());
        p.indirect(list.read());
        let (drawn, _) = p.color("drawn", float, [0.0; 4]);
        let (marked, _) = p.color("marked", float, [0.0; 4]);
        ((drawn, marked), |_: &mut Record<'_>| {})
    });
    let shadows = g.pass("shadows", Queue::AsyncCompute, |p| {
        p.sample(drawn.read());
        let (first, _) = p.create("first", ImageDesc::half(Format::R8Unorm));
        (first, |_: &mut Record<'_>| {})
    });
    let smooth = g.pass("shadows.smooth", Queue::AsyncCompute, |p| {
        p.sample(shadows.read());
        (p.create("smooth", ImageDesc::half(Format::R8Unorm)).0, |_: &mut Record<'_>| {})
    });
    let smooth = g.pass("shadows.again", Queue::AsyncCompute, |p| {
        p.sample(smooth.read());
        (p.create("smoother", ImageDesc::half(Format::R8Unorm)).0, |_: &mut Record<'_>| {})
    });
    let chain = g.pass("mips.make", Queue::Graphics, |p| {
        p.sample(marked.read());
        let desc = ImageDesc { mips: 3, ..float };
        (p.create_part("chain", desc, Part::mip(0)).0, |_: &mut Record<'_>| {})
    });
    let chain = [0, 1].into_iter().fold(chain, |chain, mip| {
        g.pass(&format!("mips.{mip}"), Queue::Graphics, |p| {
            p.sample_part(chain.read(), Part::mip(mip));
            (p.write_part(chain, Part::mip(mip + 1)).0, |_: &mut Record<'_>| {})
        })
    });
    let lit = g.pass("light", Queue::Graphics, |p| {
        p.sample(chain.read());
        p.sample(smooth.read());
        p.sample(light.previous);
        p.read(list.read());
        (p.write(light.next).0, |_: &mut Record<'_>| {})
    });
    let list = g.pass("list.next", Queue::Graphics, |p| (p.write_buffer(list).0, |_: &mut Record<'_>| {}));
    let tinted = g.pass("tint", Queue::Graphics, |p| {
        p.sample(lit.read());
        (p.create("tinted", float).0, |_: &mut Record<'_>| {})
    });
    let spare = g.pass("spare", Queue::Graphics, |p| {
        p.sample(lit.read());
        (p.create("spare", ImageDesc::half(Format::R8Unorm)).0, |_: &mut Record<'_>| {})
    });
    g.pass("spare.more", Queue::Graphics, |p| {
        p.sample(spare.read());
        let _ = p.create("more", ImageDesc::half(Format::R8Unorm));
        ((), |_: &mut Record<'_>| {})
    });
    g.output(tinted.read());
    let _ = g.pass("copy", Queue::Transfer, |p| {
        p.copy_from(list.read());
        (p.copy_to(found).0, |_: &mut Record<'_>| {})
    });
    g
}
