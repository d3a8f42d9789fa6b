//! Lifetimes, memory and placement of resources.

use magpie::graph::{
    Declaration, Queue, Shape,
    plan::{Lane, Lifetime, Plan, Sharing},
};

use super::{Checked, PlanRequest, access, wrong};

/// Bytes of the contents.
pub fn bytes(shape: Shape) -> u64 {
    match shape {
        Shape::Buffer { bytes } | Shape::Accel { bytes, .. } => bytes,
        Shape::Image { format, extent, mips, layers } => {
            let side = |full: u32, mip: u32| u64::from((full >> mip).max(1));
            let pixels: u64 = (0..mips).map(|m| side(extent.width, m) * side(extent.height, m)).sum();
            pixels * u64::from(layers) * u64::from(format.bytes_per_pixel())
        }
    }
}

/// First and last position of each resource's uses.
pub fn lives(d: &Declaration, order: &[u32]) -> Vec<Option<(u32, u32)>> {
    let mut lives: Vec<Option<(u32, u32)>> = vec![None; d.resources.len()];
    for (at, &pass) in (0..).zip(order) {
        for u in &d.uses[d.passes[pass as usize].uses.range()] {
            let life = &mut lives[u.resource as usize];
            *life = Some((life.map_or(at, |(first, _)| first), at));
        }
    }
    lives
}

fn round_up(value: u64, to: u64) -> u64 {
    value.div_ceil(to) * to
}

struct Placed {
    heap: u32,
    /// Bytes, rounded up to the alignment.
    bytes: u64,
    life: (u32, u32),
    queue: Option<Queue>,
}

pub fn check(d: &Declaration, plan: &Plan, request: &PlanRequest<'_>) -> Checked {
    let queue_at = |at: u32| plan.batches.iter().find(|b| b.passes.range().contains(&(at as usize))).map(|b| b.queue);
    let lives = lives(d, &plan.order);
    if plan.lifetimes.len() != d.resources.len() {
        return wrong(format!("{} lifetimes", plan.lifetimes.len()));
    }
    // Each lifetime, with all queues that use the resource.
    let mut queues: Vec<Vec<Queue>> = vec![Vec::new(); d.resources.len()];
    let mut uses: Vec<access::Set> = vec![0; d.resources.len()];
    for (at, &pass) in (0..).zip(&plan.order) {
        let decl = &d.passes[pass as usize];
        for u in &d.uses[decl.uses.range()] {
            queues[u.resource as usize].extend(queue_at(at));
            uses[u.resource as usize] |= access::pair(u.access, decl.domain);
        }
    }
    let mut expected_transients = Vec::new();
    for (resource, decl) in d.resources.iter().enumerate() {
        let (first_queue, others) = (queues[resource].first().copied(), &queues[resource]);
        let one = first_queue.filter(|q| others.iter().all(|o| o == q));
        let lane = one.map_or(Lane::Several, Lane::One);
        let expected = lives[resource].map(|(first, last)| Lifetime { first, last, lane, bytes: bytes(decl.shape) });
        if plan.lifetimes[resource] != expected {
            return wrong(format!("resource {resource} is used {expected:?}, planned {:?}", plan.lifetimes[resource]));
        }
        if decl.maker.is_some() && expected.is_some() {
            expected_transients.push(resource as u32);
        }
    }
    if !plan.transients.iter().map(|t| t.resource).eq(expected_transients.iter().copied()) {
        return wrong(format!("transients are {expected_transients:?}"));
    }

    let is_image = |resource: u32| matches!(d.resources[resource as usize].shape, Shape::Image { .. });
    let mut placed = Vec::new();
    for t in &plan.transients {
        let shape = d.resources[t.resource as usize].shape;
        if access::Scope::of(t.uses).pairs != uses[t.resource as usize] {
            return wrong(format!("transient {} is planned for {}", t.resource, t.uses));
        }
        let lane = plan.lifetimes[t.resource as usize].map(|l| l.lane);
        let alone = match lane {
            Some(Lane::One(queue)) => Some(queue),
            _ => None,
        };
        let shared = match t.sharing {
            Sharing::Alone(queue) => Some(queue),
            Sharing::HandedOver | Sharing::Concurrent => None,
        };
        if alone != shared {
            return wrong(format!("transient {} is shared as {:?}, used on {lane:?}", t.resource, t.sharing));
        }
        let Some(heap) = plan.heaps.get(t.heap as usize) else { return wrong(format!("no heap {}", t.heap)) };
        let print = (request.footprint)(shape, t.uses, t.sharing);
        // If images and other resources share a heap, each may need whole pages.
        let here = || plan.transients.iter().filter(|o| o.heap == t.heap);
        let mixed = here().any(|o| is_image(o.resource)) && here().any(|o| !is_image(o.resource));
        let padded = if mixed { round_up(print.bytes, request.granularity) } else { print.bytes };
        let align = if mixed { print.align.max(request.granularity) } else { print.align };
        if heap.kind != print.kind || t.bytes != padded || t.offset % print.align != 0 {
            return wrong(format!("transient {} needs {print:?}, planned {t:?} in {heap:?}", t.resource));
        }
        if t.offset + t.bytes > heap.bytes {
            return wrong(format!("transient {} ends outside of its heap of {} bytes", t.resource, heap.bytes));
        }
        let Some(life) = lives[t.resource as usize] else { return wrong(format!("{} has no life", t.resource)) };
        placed.push(Placed { heap: t.heap, bytes: round_up(t.bytes, align.max(1)), life, queue: alone });
    }
    check_figures(plan, &placed)
}

/// Checks the totals, and the lower bound for any placement: on each queue the most that is alive at one position; resources used by
/// several queues count as alive throughout.
fn check_figures(plan: &Plan, placed: &[Placed]) -> Checked {
    let mut least = 0;
    for heap in 0..plan.heaps.len() as u32 {
        let here = || placed.iter().filter(|p| p.heap == heap);
        let throughout: u64 = here().filter(|p| p.queue.is_none()).map(|p| p.bytes).sum();
        let mut least_here = throughout;
        for queue in Queue::ALL {
            let alive = |at: u32| -> u64 {
                let alive = here().filter(|p| p.queue == Some(queue) && p.life.0 <= at && at <= p.life.1);
                alive.map(|p| p.bytes).sum()
            };
            least_here += (0..plan.order.len() as u32).map(alive).max().unwrap_or(0);
        }
        least += least_here;
        if plan.heaps[heap as usize].bytes < least_here {
            return wrong(format!("heap {heap} has {} bytes, needs {least_here}", plan.heaps[heap as usize].bytes));
        }
    }
    let unaliased: u64 = plan.transients.iter().map(|t| t.bytes).sum();
    let aliased: u64 = plan.heaps.iter().map(|h| h.bytes).sum();
    let figures = (plan.memory.unaliased, plan.memory.aliased, plan.memory.lower_bound);
    if figures != (unaliased, aliased, least) {
        return wrong(format!("memory takes {unaliased}, {aliased}, {least}, planned {:?}", plan.memory));
    }
    Ok(())
}
