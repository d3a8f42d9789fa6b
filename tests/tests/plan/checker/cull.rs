//! The passes that a frame needs.
//!
//! The rule, for a frame with culling:
//!
//! 1. A weak pass that modifies existing contents makes a *mere change*: readers of the result need the contents before it, not the change.
//!    The *base* of a version is the pass that made it, mere changes skipped.
//! 2. Needed are: the bases of the frame's outputs; passes that are not weak and write resources of the caller; the bases of everything
//!    that needed passes read; and if a needed pass that is not weak uses either half of a history, or a kept buffer, the base of what it
//!    holds after the frame, since the next frame relies on it.
//! 3. A weak pass is possible if the bases of everything that it reads are needed or possible.
//! 4. Kept are: needed passes; possible weak passes that write resources of the caller; possible weak passes whose mere change is between a
//!    version that a kept pass reads, an output names or rule 2 passes on to the next frame, and its base; and the bases of everything that
//!    kept passes read.

use std::collections::BTreeSet;

use magpie::graph::{Declaration, ImportKey, Origin, plan::Plan};

use super::{Checked, Versions, wrong};

pub fn check(d: &Declaration, plan: &Plan, enabled: bool) -> Checked {
    let all = 0..d.passes.len() as u32;
    let expected = if enabled { kept(d, &Versions::new(d, plan)) } else { all.collect() };
    let planned: BTreeSet<u32> = plan.order.iter().copied().collect();
    if let Some(pass) = expected.difference(&planned).next() {
        return wrong(format!("pass {} is needed and left out", d.pass_name(*pass)));
    }
    if let Some(pass) = planned.difference(&expected).next() {
        return wrong(format!("pass {} is kept and not needed", d.pass_name(*pass)));
    }
    Ok(())
}

fn base(v: &Versions<'_>, resource: u32, version: u32) -> Option<u32> {
    let based = (0..=version).rev().find(|&w| !v.is_mere_change(resource, w))?;
    v.writer(resource, based)
}

/// Resources and versions that a pass reads.
fn reads(d: &Declaration, pass: u32) -> Vec<(u32, u32)> {
    let uses = &d.uses[d.passes[pass as usize].uses.range()];
    uses.iter().filter_map(|u| Some((u.resource, u.reads?))).collect()
}

fn is_callers(d: &Declaration, pass: u32) -> bool {
    let callers = |r: u32| matches!(d.resources[r as usize].origin, Origin::Imported { key: ImportKey::Caller(_), .. });
    d.uses[d.passes[pass as usize].uses.range()].iter().any(|u| u.writes.is_some() && callers(u.resource))
}

/// The resource that carries contents to the next frame when `resource` is used.
fn carried(d: &Declaration, resource: u32) -> Option<u32> {
    match d.resources[resource as usize].origin {
        Origin::Imported { key: ImportKey::Kept(_), .. } => Some(resource),
        _ => d.histories.iter().find(|h| h.previous == resource || h.next == resource).map(|h| h.next),
    }
}

fn kept(d: &Declaration, v: &Versions<'_>) -> BTreeSet<u32> {
    let passes = 0..d.passes.len() as u32;
    let weak = |p: u32| d.passes[p as usize].weak;
    let bases = |p: u32| -> Vec<u32> { reads(d, p).iter().filter_map(|&(r, w)| base(v, r, w)).collect() };

    // Contents that a pass passes on to the next frame.
    let handed = |p: u32| -> Vec<(u32, u32)> {
        let next = reads(d, p).into_iter().filter(|_| !weak(p)).filter_map(|(r, _)| carried(d, r));
        next.map(|r| (r, d.resources[r as usize].versions - 1)).collect()
    };

    let mut needed: BTreeSet<u32> = d.outputs.iter().filter_map(|o| base(v, o.resource, o.version)).collect();
    needed.extend(passes.clone().filter(|&p| !weak(p) && is_callers(d, p)));
    grow(&mut needed, |p| {
        let handed = handed(p).into_iter().filter_map(|(r, w)| base(v, r, w));
        bases(p).into_iter().chain(handed).collect()
    });

    let mut possible = BTreeSet::new();
    loop {
        let before = possible.len();
        for p in passes.clone().filter(|&p| weak(p)) {
            if bases(p).iter().all(|b| needed.contains(b) || possible.contains(b)) {
                possible.insert(p);
            }
        }
        if possible.len() == before {
            break;
        }
    }

    let mut kept = needed;
    kept.extend(possible.iter().copied().filter(|&p| is_callers(d, p)));
    let between = |r: u32, version: u32| -> Vec<u32> {
        let changes = (0..=version).rev().take_while(|&w| v.is_mere_change(r, w));
        changes.filter_map(|w| v.writer(r, w)).filter(|p| possible.contains(p)).collect()
    };
    kept.extend(d.outputs.iter().flat_map(|o| between(o.resource, o.version)));
    grow(&mut kept, |p| {
        let changes = reads(d, p).into_iter().chain(handed(p)).flat_map(|(r, w)| between(r, w));
        bases(p).into_iter().chain(changes).collect()
    });
    kept
}

/// Adds the passes that `more` returns for members, until nothing changes.
fn grow(set: &mut BTreeSet<u32>, more: impl Fn(u32) -> Vec<u32>) {
    loop {
        let added: Vec<u32> = set.iter().flat_map(|&p| more(p)).collect();
        let before = set.len();
        set.extend(added);
        if set.len() == before {
            return;
        }
    }
}
