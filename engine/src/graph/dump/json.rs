//! The plan as JSON.

use serde_json::{Value, json};

use super::{
    super::{
        access::{Layout, Queue},
        declaration::{Origin, Shape, Span},
        desc::Part,
        plan::{Barrier, Handover, Lane, Role},
    },
    Dump,
    describe::{Describer, not_aliased, origin},
};

pub(super) fn json(dump: &Dump<'_>) -> String {
    let Dump { declaration, plan, gains } = *dump;
    let describer = Describer(declaration);
    let outputs: Vec<Value> = declaration
        .outputs
        .iter()
        .map(|o| json!({"resource": declaration.resource_name(o.resource), "version": o.version}))
        .collect();
    let culled: Vec<Value> =
        plan.culled.iter().map(|c| json!({"name": declaration.pass_name(c.pass), "reason": c.reason})).collect();
    let histories: Vec<Value> = declaration
        .histories
        .iter()
        .map(|h| json!({"previous": declaration.resource_name(h.previous), "next": declaration.resource_name(h.next)}))
        .collect();
    let heaps: Vec<Value> = plan.heaps.iter().map(|h| json!({"kind": h.kind, "bytes": h.bytes})).collect();
    let queues: Vec<&str> = Queue::ALL.into_iter().filter(|q| plan.queues.has(*q)).map(Queue::name).collect();
    let all = json!({
        "size": [declaration.full.width, declaration.full.height],
        "queues": queues, "serial": plan.serial, "alias": plan.alias,
        "gains": gains,
        "batches": batches(dump), "passes": passes(dump, describer), "end": barriers(dump, describer, plan.end),
        "left_out": culled, "resources": resources(dump), "heaps": heaps, "outputs": outputs, "histories": histories,
    });
    format!("{all:#}\n")
}

fn batches(dump: &Dump<'_>) -> Vec<Value> {
    let one = |b: &super::super::plan::Batch| {
        json!({
            "queue": b.queue.name(), "first": b.passes.start, "last": b.passes.end - 1,
            "waits": &dump.plan.waits[b.waits.range()],
        })
    };
    dump.plan.batches.iter().map(one).collect()
}

fn passes(dump: &Dump<'_>, describer: Describer<'_>) -> Vec<Value> {
    let Dump { declaration, plan, .. } = *dump;
    let mut passes = Vec::with_capacity(plan.order.len());
    for (number, batch) in plan.batches.iter().enumerate() {
        for position in batch.passes.range() {
            let index = plan.order[position];
            let pass = &declaration.passes[index as usize];
            let used = |at: usize| {
                let u = &declaration.uses[at];
                json!({
                    "resource": declaration.resource_name(u.resource), "access": u.access.name(),
                    "part": part(describer, u.resource, u.part), "reads": u.reads, "writes": u.writes,
                    "stored": plan.unstored.binary_search(&(at as u32)).is_err(),
                })
            };
            let uses: Vec<Value> = pass.uses.range().map(used).collect();
            passes.push(json!({
                "name": declaration.pass_name(index), "stage": declaration.stage(index), "domain": pass.domain.name(),
                "queue": batch.queue.name(), "wish": pass.queue.name(), "batch": number, "weak": pass.weak, "uses": uses,
                "before": barriers(dump, describer, plan.before[position]), "after": barriers(dump, describer, plan.after[position]),
            }));
        }
    }
    passes
}

fn resources(dump: &Dump<'_>) -> Vec<Value> {
    let Dump { declaration, plan, .. } = *dump;
    let one = |resource: u32| {
        let (decl, life) = (&declaration.resources[resource as usize], plan.lifetimes[resource as usize]);
        let memory = plan.transient(resource).map(|t| {
            let before = plan.successions.iter().filter(|(after, _)| *after == resource);
            let before: Vec<String> = before.map(|(_, b)| declaration.resource_name(*b)).collect();
            json!({
                "heap": t.heap, "offset": t.offset, "bytes": t.bytes, "sharing": t.sharing.reason(), "after": before,
                "not_aliased": not_aliased(plan, resource),
            })
        });
        let leave = match decl.origin {
            Origin::Imported { leave: Some((access, _)), .. } => Some(access.name()),
            Origin::Imported { leave: None, .. } | Origin::Transient => None,
        };
        let queue = life.map(|l| match l.lane {
            Lane::One(queue) => queue.name(),
            Lane::Several => "several",
        });
        json!({
            "name": declaration.resource_name(resource), "shape": shape(decl.shape), "kind": origin(decl.origin),
            "leave": leave, "bytes": life.map(|l| l.bytes), "first": life.map(|l| l.first), "last": life.map(|l| l.last),
            "queue": queue, "memory": memory,
        })
    };
    (0..declaration.resources.len() as u32).map(one).collect()
}

fn shape(shape: Shape) -> Value {
    match shape {
        Shape::Image { format, extent, mips, layers } => {
            let size = [extent.width, extent.height];
            json!({"is": "image", "format": format!("{format:?}"), "size": size, "mips": mips, "layers": layers})
        }
        Shape::Buffer { bytes } => json!({"is": "buffer", "bytes": bytes}),
        Shape::Accel { bytes, .. } => json!({"is": "acceleration structure", "bytes": bytes}),
    }
}

/// First mip and layer of a part with their counts; null for the whole resource.
fn part(describer: Describer<'_>, resource: u32, part: Part) -> Value {
    if describer.part(resource, part).is_empty() {
        return Value::Null;
    }
    json!({"mip": part.mip, "mips": part.mips, "layer": part.layer, "layers": part.layers})
}

fn barriers(dump: &Dump<'_>, describer: Describer<'_>, span: Span) -> Vec<Value> {
    let one = |b: &Barrier| {
        let handover = |h: Handover| {
            let role = match h.role {
                Role::Release => "release",
                Role::Acquire => "acquire",
            };
            json!({"from": h.from.name(), "to": h.to.name(), "role": role})
        };
        let layout = |layout: Layout| (b.layout_to != Layout::Undefined).then(|| layout.name());
        json!({
            "resource": dump.declaration.resource_name(b.resource), "part": part(describer, b.resource, b.part),
            "from": b.from.to_string(), "to": b.to.to_string(),
            "layout_from": layout(b.layout_from), "layout_to": layout(b.layout_to), "discard": b.discard,
            "handover": b.handover.map(handover),
        })
    };
    dump.plan.barriers[span.range()].iter().map(one).collect()
}
