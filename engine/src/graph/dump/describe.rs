//! Names and phrases that the dumps share.

use super::super::{
    access::{Layout, Queue},
    declaration::{Declaration, ImportKey, Origin, Shape, Use},
    desc::Part,
    plan::{Barrier, Handover, Lane, Lifetime, Plan, Role},
};

/// Turns parts of a declaration into text.
#[derive(Clone, Copy)]
pub(super) struct Describer<'d>(pub &'d Declaration);

impl Describer<'_> {
    /// `sky.draw:sky version 1`.
    pub fn version(&self, resource: u32, version: u32) -> String {
        format!("{} version {version}", self.0.resource_name(resource))
    }

    /// Kind, format and size of a resource.
    pub fn shape(&self, shape: Shape) -> String {
        match shape {
            Shape::Image { format, extent, mips, layers } => {
                let several = |n: u32, what: &str| if n > 1 { format!(", {n} {what}") } else { String::new() };
                format!("image {format:?} {extent}{}{}", several(mips, "mips"), several(layers, "layers"))
            }
            Shape::Buffer { bytes } => format!("buffer of {bytes} bytes"),
            Shape::Accel { .. } => "acceleration structure".to_owned(),
        }
    }

    /// ` mips 1 to 2, layer 3`; empty for the whole resource.
    pub fn part(&self, resource: u32, part: Part) -> String {
        let (mips, layers) = self.0.resources[resource as usize].shape.parts();
        let some = |first: u16, count: u16, all: u32, what: &str| match count {
            _ if u32::from(count) >= all => None,
            1 => Some(format!("{what} {first}")),
            _ => Some(format!("{what}s {first} to {}", first + count - 1)),
        };
        let part = part.of(mips, layers);
        let ranges = [some(part.mip, part.mips, mips, "mip"), some(part.layer, part.layers, layers, "layer")];
        let ranges: Vec<String> = ranges.into_iter().flatten().collect();
        if ranges.is_empty() { String::new() } else { format!(" {}", ranges.join(", ")) }
    }

    /// A use, with the versions that it reads and writes.
    pub fn use_of(&self, u: &Use) -> String {
        let (name, part) = (self.0.resource_name(u.resource), self.part(u.resource, u.part));
        match (u.reads, u.writes) {
            (Some(read), Some(written)) => format!("change {name} version {read} to {written}: {}{part}", u.access),
            (None, Some(written)) => format!("make   {name} version {written}: {}{part}", u.access),
            (Some(read), None) => format!("read   {name} version {read}: {}{part}", u.access),
            (None, None) => format!("touch  {name}: {}{part}", u.access),
        }
    }

    /// The uses of a pass; attachments that are not stored are marked.
    pub fn uses_of(&self, plan: &Plan, pass: u32) -> Vec<String> {
        let describe = |index: usize| {
            let unstored = plan.unstored.binary_search(&(index as u32)).is_ok();
            let note = if unstored { ", not stored: nobody reads it later" } else { "" };
            format!("{}{note}", self.use_of(&self.0.uses[index]))
        };
        self.0.passes[pass as usize].uses.range().map(describe).collect()
    }

    /// A barrier: the uses that must be over, the uses that wait, and the layouts.
    pub fn barrier(&self, b: &Barrier) -> String {
        let layouts = match (b.layout_from, b.layout_to) {
            (_, Layout::Undefined) => String::new(),
            (from, to) if from == to => String::new(),
            (from, to) => format!(", layout {} to {}", from.name(), to.name()),
        };
        let discard = if b.discard { ", contents are new" } else { "" };
        let handover = b.handover.map(|h| format!(", {}", handover(h))).unwrap_or_default();
        let (name, part) = (self.0.resource_name(b.resource), self.part(b.resource, b.part));
        // Nothing on its own queue waits for a release.
        let to = if b.handover.is_some() && b.to.is_empty() { "the handover".to_owned() } else { b.to.to_string() };
        format!("{name}{part}: {} before {to}{layouts}{discard}{handover}", b.from)
    }

    /// The queue that a pass requests, and the one that it runs on.
    pub fn queue(&self, pass: u32, on: Queue) -> String {
        match self.0.passes[pass as usize].queue {
            wish if wish == on => format!("{} queue", on.name()),
            wish => format!("{} queue, would like {}", on.name(), wish.name()),
        }
    }
}

fn handover(h: Handover) -> String {
    let (from, to) = (h.from.name(), h.to.name());
    match h.role {
        Role::Release => format!("released by {from} to {to}"),
        Role::Acquire => format!("acquired by {to} from {from}"),
    }
}

/// The origin of a resource, in a word or two.
pub(super) fn origin(origin: Origin) -> &'static str {
    match origin {
        Origin::Transient => "transient",
        Origin::Imported { key, .. } => match key {
            ImportKey::Caller(_) => "imported",
            ImportKey::Previous(_) => "history, read",
            ImportKey::Next(_) => "history, written",
            ImportKey::Kept(_) => "kept",
        },
    }
}

/// The first and last pass of a lifetime.
pub(super) fn life(life: &Lifetime) -> String {
    let passes = if life.first == life.last {
        format!("pass {}", life.first)
    } else {
        format!("passes {} to {}", life.first, life.last)
    };
    match life.lane {
        Lane::One(queue) => format!("{passes} on {}", queue.name()),
        Lane::Several => format!("{passes} on several queues"),
    }
}

/// Why a transient shares memory with no other; `None` if it does share.
pub(super) fn not_aliased(plan: &Plan, resource: u32) -> Option<String> {
    let (life, transient) = (plan.lifetimes[resource as usize]?, plan.transient(resource)?);
    if plan.successions.iter().any(|&(after, before)| after == resource || before == resource) {
        return None;
    }
    if !plan.alias {
        return Some("aliasing is switched off".to_owned());
    }
    if life.lane == Lane::Several {
        return Some("it is live on several queues, whose order says nothing about time".to_owned());
    }
    let apart = plan.transients.iter().any(|other| {
        other.heap == transient.heap
            && plan.lifetimes[other.resource as usize]
                .is_some_and(|o| o.lane == life.lane && (o.last < life.first || life.last < o.first))
    });
    Some(if apart {
        "nothing else fits here: those that live at other times lie elsewhere".to_owned()
    } else {
        "nothing else fits: all others of its queue and kind of memory live at the same time".to_owned()
    })
}

/// The queues and switches that a plan was made for.
pub(super) fn made_for(plan: &Plan) -> String {
    let queues: Vec<&str> = Queue::ALL.into_iter().filter(|q| plan.queues.has(*q)).map(Queue::name).collect();
    let mut text = match queues.as_slice() {
        [first @ .., last] if !first.is_empty() => format!("planned for the queues {} and {last}", first.join(", ")),
        all => format!("planned for the {} queue", all.join("")),
    };
    if plan.serial {
        text.push_str("; serial: each pass waits for everything before it");
    }
    if !plan.alias {
        text.push_str("; transients do not share memory");
    }
    text
}

/// A number of bytes with a readable unit.
pub(super) fn bytes(bytes: u64) -> String {
    match bytes {
        0..10_000 => format!("{bytes} bytes"),
        10_000..1_000_000 => format!("{:.1} kB", bytes as f64 / 1e3),
        1_000_000..1_000_000_000 => format!("{:.2} MB", bytes as f64 / 1e6),
        _ => format!("{:.2} GB", bytes as f64 / 1e9),
    }
}

#[cfg(test)]
mod tests {
    use super::*;

    #[test]
    fn sizes_have_few_digits() {
        let texts = [0, 9_999, 10_000, 999_949, 1_000_000, 16_720_000, 12_000_000_000].map(bytes);
        assert_eq!(texts, ["0 bytes", "9999 bytes", "10.0 kB", "999.9 kB", "1.00 MB", "16.72 MB", "12.00 GB"]);
    }
}
