//! Follows a plan step by step with a model of memory as simple as can be, and complains about the first thing that is wrong.
//!
//! For each resource it keeps every event (a use, a change of layout, or whatever happened before the frame) and to which uses
//! that event is known. A barrier makes known to `to` all events that happened at `from` or are known at `from`.

use std::collections::BTreeSet;

use magpie::graph::{
    Access, Declaration, Domain, Layout, Origin, Shape,
    plan::{Barrier, Lifetime, Plan},
};

type At = (Access, Domain);

/// Whether the plan is right; if not, the first complaint.
pub fn check(d: &Declaration, plan: &Plan) -> Result<(), String> {
    check_kept(d, plan)?;
    check_memory(d, plan)?;
    check_run(d, plan)
}

fn wrong<T>(text: String) -> Result<T, String> {
    Err(text)
}

// Which passes run.

/// Whether a version is only a weak pass's change of contents that were there before.
fn is_weak_change(d: &Declaration, resource: u32, version: u32) -> bool {
    let decl = &d.resources[resource as usize];
    let first = match decl.origin {
        Origin::Imported { last, .. } if last.iter().next().is_none() => 1,
        _ => 0,
    };
    version > first && decl.writers[version as usize].is_some_and(|w| d.passes[w as usize].weak)
}

/// The pass whose contents remain when weak passes that only changed a version are set aside.
fn base_writer(d: &Declaration, resource: u32, version: u32) -> Option<u32> {
    if is_weak_change(d, resource, version) {
        return base_writer(d, resource, version - 1);
    }
    d.resources[resource as usize].writers[version as usize]
}

fn writes_import(d: &Declaration, pass: u32) -> bool {
    let imported = |r: u32| matches!(d.resources[r as usize].origin, Origin::Imported { .. });
    d.passes[pass as usize].uses.iter().any(|u| u.writes.is_some() && imported(u.resource))
}

/// All that the given passes depend on, themselves included, found by going round until nothing changes.
fn closure(d: &Declaration, mut set: BTreeSet<u32>, writers: impl Fn(u32, u32) -> Vec<u32>) -> BTreeSet<u32> {
    loop {
        let before = set.len();
        for pass in set.clone() {
            for u in &d.passes[pass as usize].uses {
                set.extend(u.reads.into_iter().flat_map(|version| writers(u.resource, version)));
            }
        }
        if set.len() == before {
            return set;
        }
    }
}

fn check_kept(d: &Declaration, plan: &Plan) -> Result<(), String> {
    let mut all: Vec<u32> = plan.order.iter().copied().chain(plan.culled.iter().map(|c| c.pass)).collect();
    all.sort_unstable();
    if all != (0..d.passes.len() as u32).collect::<Vec<_>>() {
        return wrong(format!("passes are not each kept or left out once: {all:?}"));
    }
    let kept: BTreeSet<u32> = plan.order.iter().copied().collect();

    // What the frame needs, weak changes aside.
    let outputs = d.outputs.iter().filter_map(|o| base_writer(d, o.resource, o.version));
    let strong = (0..d.passes.len() as u32).filter(|&p| !d.passes[p as usize].weak && writes_import(d, p));
    let needed = closure(d, outputs.chain(strong).collect(), |r, v| base_writer(d, r, v).into_iter().collect());
    for &pass in &needed {
        if !kept.contains(&pass) {
            return wrong(format!("pass {pass} is needed and left out"));
        }
    }
    for &pass in &kept {
        if !d.passes[pass as usize].weak && !needed.contains(&pass) {
            return wrong(format!("pass {pass} is kept and not needed"));
        }
    }

    // What anything that is kept asks for, weak passes included: every version that it builds on, back to the first.
    let history = |r: u32, v: u32| -> Vec<u32> {
        let writers = d.resources[r as usize].writers[..=v as usize].iter().copied().flatten();
        writers.filter(|w| kept.contains(w)).collect()
    };
    let outputs = d.outputs.iter().flat_map(|o| history(o.resource, o.version));
    let roots = outputs.chain(kept.iter().copied().filter(|&p| writes_import(d, p))).collect();
    let asked = closure(d, roots, history);
    for &pass in &kept {
        if !asked.contains(&pass) {
            return wrong(format!("weak pass {pass} is kept and nobody asks for it"));
        }
    }
    for culled in plan.culled.iter().filter(|c| writes_import(d, c.pass)) {
        let uses = &d.passes[culled.pass as usize].uses;
        let missing = |r: u32, v: u32| base_writer(d, r, v).is_some_and(|w| !kept.contains(&w));
        if !uses.iter().any(|u| u.reads.is_some_and(|v| missing(u.resource, v))) {
            return wrong(format!("weak pass {} is left out though all it reads is made", culled.pass));
        }
    }
    Ok(())
}

// Memory.

fn check_memory(d: &Declaration, plan: &Plan) -> Result<(), String> {
    let positions_of = |resource: usize| -> Vec<u32> {
        let uses = |pass: u32| d.passes[pass as usize].uses.iter().any(|u| u.resource as usize == resource);
        (0..plan.order.len() as u32).filter(|&at| uses(plan.order[at as usize])).collect()
    };
    let (mut unaliased, mut transients) = (0, Vec::new());
    for (resource, decl) in d.resources.iter().enumerate() {
        let positions = positions_of(resource);
        let lifetime = positions.first().map(|&first| {
            let last = positions[positions.len() - 1];
            Lifetime { first, last, bytes: decl.bytes() }
        });
        if plan.lifetimes.get(resource) != Some(&lifetime) {
            let got = plan.lifetimes.get(resource);
            return wrong(format!("resource {resource} is used {lifetime:?}, planned {got:?}"));
        }
        if decl.origin == Origin::Transient && lifetime.is_some() {
            unaliased += decl.bytes();
            let mut uses = BTreeSet::new();
            for &at in &positions {
                let pass = &d.passes[plan.order[at as usize] as usize];
                let of_it = pass.uses.iter().filter(|u| u.resource as usize == resource);
                uses.extend(of_it.map(|u| key(u.access.at(pass.domain))));
            }
            transients.push((resource as u32, uses));
        }
    }
    let planned: Vec<_> =
        plan.transients.iter().map(|t| (t.resource, t.uses.iter().map(key).collect::<BTreeSet<_>>())).collect();
    if planned != transients {
        return wrong(format!("transients and their uses are {transients:?}, planned {planned:?}"));
    }
    let alive = |at: u32| -> u64 {
        let lives = transients.iter().filter_map(|(r, _)| plan.lifetimes[*r as usize]);
        lives.filter(|l| (l.first..=l.last).contains(&at)).map(|l| l.bytes).sum()
    };
    let most = (0..plan.order.len() as u32).map(alive).max().unwrap_or(0);
    if (plan.memory.unaliased, plan.memory.lower_bound) != (unaliased, most) {
        return wrong(format!("memory is {unaliased} and {most}, planned {:?}", plan.memory));
    }
    Ok(())
}

fn key((access, domain): At) -> (u8, u8) {
    (access as u8, domain as u8)
}

// Waiting, layouts and contents.

struct Event {
    what: String,
    /// The use it was; none for changes of layout and for what happened before the frame.
    at: Option<At>,
    /// Uses that come after it.
    known: Vec<At>,
    /// It changed contents, so reads must come after it too.
    changes: bool,
}

struct Model {
    name: String,
    is_image: bool,
    layout: Layout,
    /// Version that it holds; none before a transient is made.
    version: Option<u32>,
    defined: bool,
    events: Vec<Event>,
}

fn layout_for(access: Access) -> Layout {
    match access {
        Access::Color | Access::ColorLoad => Layout::ColorAttachment,
        Access::Depth | Access::DepthLoad => Layout::DepthAttachment,
        Access::Sample => Layout::ShaderRead,
        Access::StorageRead | Access::StorageWrite | Access::StorageReadWrite => Layout::General,
        Access::CopyRead => Layout::TransferSource,
        Access::CopyWrite => Layout::TransferTarget,
        other => panic!("images are not used as {other}"),
    }
}

fn is_write(access: Access) -> bool {
    use Access::*;
    [Color, ColorLoad, Depth, DepthLoad, StorageWrite, StorageReadWrite, BufferWrite, BufferReadWrite, CopyWrite]
        .contains(&access)
}

fn check_run(d: &Declaration, plan: &Plan) -> Result<(), String> {
    if plan.barriers.len() != plan.order.len() + 1 {
        return wrong(format!("{} batches for {} passes", plan.barriers.len(), plan.order.len()));
    }
    let mut models: Vec<Model> = d.resources.iter().map(|r| Model::before_frame(&r.name, r.shape, r.origin)).collect();
    for (&index, batch) in plan.order.iter().zip(&plan.barriers) {
        let pass = &d.passes[index as usize];
        let uses: Vec<(u32, At)> = pass.uses.iter().map(|u| (u.resource, u.access.at(pass.domain))).collect();
        apply(&mut models, batch, &uses)?;
        for (u, &(resource, at)) in pass.uses.iter().zip(&uses) {
            let model = &mut models[resource as usize];
            if let Some(version) = u.reads {
                let expected = version_left(d, plan, resource, version);
                if model.version != Some(expected) {
                    let held = model.version;
                    return wrong(format!("{} holds version {held:?}, {} wants {expected}", model.name, pass.name));
                }
                if !is_write(at.0) && !model.defined {
                    return wrong(format!("{} reads {}, which is not defined", pass.name, model.name));
                }
            }
            model.ready(at, &pass.name)?;
            model.happened(at, &pass.name);
            if u.writes.is_some() {
                (model.version, model.defined) = (u.writes, true);
            }
        }
    }
    let leave: Vec<(u32, At)> = (0..d.resources.len() as u32)
        .filter_map(|r| match d.resources[r as usize].origin {
            Origin::Imported { leave, .. } => leave.map(|at| (r, at)),
            Origin::Transient => None,
        })
        .collect();
    apply(&mut models, &plan.barriers[plan.order.len()], &leave)?;
    leave.iter().try_for_each(|&(resource, at)| models[resource as usize].ready(at, "the end of the frame"))
}

/// The version in place when one is asked for: weak changes that were left out leave the one before them.
fn version_left(d: &Declaration, plan: &Plan, resource: u32, version: u32) -> u32 {
    let writer = d.resources[resource as usize].writers[version as usize];
    let is_left_out = writer.is_some_and(|w| !plan.order.contains(&w));
    if is_left_out && is_weak_change(d, resource, version) {
        version_left(d, plan, resource, version - 1)
    } else {
        version
    }
}

/// All barriers of a batch at once. Each must serve one of the uses that follow.
fn apply(models: &mut [Model], batch: &[Barrier], uses: &[(u32, At)]) -> Result<(), String> {
    let mut news = Vec::new();
    for b in batch {
        let model = &models[b.resource as usize];
        if !uses.contains(&(b.resource, b.to)) {
            return wrong(format!("a barrier prepares {} for {:?}, which does not follow", model.name, b.to));
        }
        if b.discard && (model.defined || b.layout_from != Layout::Undefined) {
            return wrong(format!("a barrier discards {}", model.name));
        }
        let expected = if model.is_image { model.layout } else { Layout::Undefined };
        if !b.discard && b.layout_from != expected {
            return wrong(format!("{} is in layout {expected:?}, not {:?}", model.name, b.layout_from));
        }
        let at_from = |at: &At| b.from.iter().any(|from| from == *at);
        let waits = |e: &Event| b.from.is_any() || e.at.as_ref().is_some_and(at_from) || e.known.iter().any(at_from);
        let moves = b.layout_from != b.layout_to;
        for (event, e) in model.events.iter().enumerate() {
            if waits(e) {
                news.push((b.resource as usize, event, b.to));
            } else if moves {
                return wrong(format!("{} changes layout without waiting for {}", model.name, e.what));
            }
        }
    }
    for (resource, event, to) in news {
        models[resource].events[event].known.push(to);
    }
    for b in batch {
        let model = &mut models[b.resource as usize];
        if b.layout_from != b.layout_to {
            let what = format!("its change of layout to {:?}", b.layout_to);
            model.events.push(Event { what, at: None, known: vec![b.to], changes: true });
        }
        model.layout = b.layout_to;
    }
    Ok(())
}

impl Model {
    fn before_frame(name: &str, shape: Shape, origin: Origin) -> Self {
        let is_image = matches!(shape, Shape::Image { .. });
        let what = "what happened before the frame".to_owned();
        let mut model = Self {
            name: name.to_owned(),
            is_image,
            layout: Layout::Undefined,
            version: None,
            defined: false,
            events: Vec::new(),
        };
        if let Origin::Imported { last, layout, .. } = origin {
            model.version = Some(0);
            if last.iter().next().is_some() {
                (model.layout, model.defined) = (layout, true);
                for at in last.iter() {
                    let changes = is_write(at.0);
                    model.events.push(Event { what: what.clone(), at: Some(at), known: Vec::new(), changes });
                }
                let readers: Vec<At> = last.iter().filter(|at| !is_write(at.0)).collect();
                if !readers.is_empty() {
                    // Someone wrote what these have read.
                    model.events.push(Event { what, at: None, known: readers, changes: true });
                }
                return model;
            }
        }
        model.events.push(Event { what, at: None, known: Vec::new(), changes: true });
        model
    }

    /// Whether a use finds the right layout and comes after all that it must come after.
    fn ready(&self, at: At, who: &str) -> Result<(), String> {
        if self.is_image && self.layout != layout_for(at.0) {
            return wrong(format!("{who} finds {} in layout {:?}, wants {at:?}", self.name, self.layout));
        }
        let before = self.events.iter().filter(|e| e.changes || is_write(at.0));
        match before.into_iter().find(|e| !e.known.contains(&at)) {
            Some(e) => wrong(format!("{who} uses {} as {at:?} and does not wait for {}", self.name, e.what)),
            None => Ok(()),
        }
    }

    fn happened(&mut self, at: At, who: &str) {
        let what = format!("{who} ({at:?})");
        self.events.push(Event { what, at: Some(at), known: Vec::new(), changes: is_write(at.0) });
    }
}
