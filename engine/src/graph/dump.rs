//! The plan in words, as a picture and as data.

mod html;

use std::fmt::Write;

use serde_json::{Value, json};

use super::{
    access::Layout,
    declaration::{Declaration, Origin, Shape, Use},
    plan::{Barrier, Plan},
};

pub use html::html;

/// The plan in words: passes in order with all they wait for, passes left out and why, resources with their lifetimes.
pub fn text(declaration: &Declaration, plan: &Plan) -> String {
    let words = Words(declaration);
    let barriers = plan.barriers.len();
    let mut out = String::new();
    // Writing to a string cannot fail, hence the ignored results.
    let mut line = |text: String| writeln!(out, "{text}").unwrap_or_default();

    line(format!(
        "frame of {}: {} passes, {} left out, {barriers} barriers",
        declaration.full,
        plan.order.len(),
        plan.culled.len()
    ));
    line(format!(
        "transient memory: {} bytes when nothing is shared, {} at least",
        plan.memory.unaliased, plan.memory.lower_bound
    ));

    line("\npasses".to_owned());
    for (position, &index) in plan.order.iter().enumerate() {
        let batch = &plan.barriers[plan.before[position].range()];
        let pass = &declaration.passes[index as usize];
        let weak = if pass.weak { ", weak" } else { "" };
        line(format!(
            "{position:4} {}  (stage {}, {}, wants {} queue{weak})",
            declaration.pass_name(index),
            declaration.stage(index),
            pass.domain.name(),
            pass.queue.name()
        ));
        batch.iter().for_each(|b| line(format!("       wait   {}", words.barrier(b))));
        declaration.uses_of(index).iter().for_each(|u| line(format!("       {}", words.use_of(u))));
    }
    if !plan.end.is_empty() {
        let last = &plan.barriers[plan.end.range()];
        line(" end".to_owned());
        last.iter().for_each(|b| line(format!("       wait   {}", words.barrier(b))));
    }

    if !plan.culled.is_empty() {
        line("\nleft out".to_owned());
    }
    for culled in &plan.culled {
        line(format!("     {}: {}", declaration.pass_name(culled.pass), culled.reason));
    }

    line("\nresources".to_owned());
    for (resource, lifetime) in plan.lifetimes.iter().enumerate() {
        let decl = &declaration.resources[resource];
        let imported = if decl.is_transient() { "" } else { ", imported" };
        let life = match lifetime {
            Some(life) if life.first == life.last => format!("{} bytes, pass {}", life.bytes, life.first),
            Some(life) => format!("{} bytes, passes {} to {}", life.bytes, life.first, life.last),
            None => "not used".to_owned(),
        };
        let name = declaration.resource_name(resource as u32);
        line(format!("     {name}  {}{imported}, {life}", words.shape(decl.shape)));
    }

    if !declaration.outputs.is_empty() {
        line("\noutputs".to_owned());
    }
    for output in &declaration.outputs {
        line(format!("     {}", words.version(output.resource, output.version)));
    }
    out
}

/// The plan as a graph for Graphviz: passes are boxes, versions of resources ellipses, what is left out is dashed.
pub fn dot(declaration: &Declaration, plan: &Plan) -> String {
    let words = Words(declaration);
    let mut out = String::from("digraph frame {\n  rankdir=LR;\n  node [fontname=\"sans-serif\"];\n");
    let mut line = |text: String| writeln!(out, "  {text}").unwrap_or_default();
    for index in 0..declaration.passes.len() {
        let name = declaration.pass_name(index as u32);
        let kept = plan.order.iter().position(|&p| p as usize == index);
        let style = if kept.is_some() { "solid" } else { "dashed" };
        let label = kept.map_or_else(|| name.to_owned(), |position| format!("{position} {name}"));
        line(format!("p{index} [shape=box style={style} label={label:?}];"));
    }
    for (resource, decl) in declaration.resources.iter().enumerate() {
        let style = if plan.lifetimes[resource].is_some() { "solid" } else { "dashed" };
        for version in 0..decl.versions {
            let wanted = declaration.outputs.iter().any(|o| (o.resource as usize, o.version) == (resource, version));
            let rims = if wanted { 2 } else { 1 };
            let label = words.version(resource as u32, version);
            line(format!("r{resource}_{version} [shape=ellipse style={style} peripheries={rims} label={label:?}];"));
        }
    }
    for index in 0..declaration.passes.len() as u32 {
        for u in declaration.uses_of(index) {
            let label = u.access.name();
            if let Some(version) = u.reads {
                line(format!("r{}_{version} -> p{index} [label={label:?}];", u.resource));
            }
            if let Some(version) = u.writes {
                line(format!("p{index} -> r{}_{version} [label={label:?}];", u.resource));
            }
        }
    }
    out.push_str("}\n");
    out
}

/// The plan as data.
pub fn json(declaration: &Declaration, plan: &Plan) -> String {
    let words = Words(declaration);
    let barriers = |batch: &[Barrier]| batch.iter().map(|b| words.barrier_json(b)).collect::<Vec<_>>();
    let passes: Vec<Value> = plan
        .order
        .iter()
        .zip(&plan.before)
        .map(|(&index, before)| {
            let pass = &declaration.passes[index as usize];
            let batch = &plan.barriers[before.range()];
            let uses: Vec<Value> = declaration
                .uses_of(index)
                .iter()
                .map(|u| {
                    let resource = declaration.resource_name(u.resource);
                    json!({"resource": resource, "access": u.access.name(), "reads": u.reads, "writes": u.writes})
                })
                .collect();
            json!({
                "name": declaration.pass_name(index), "stage": declaration.stage(index), "queue": pass.queue.name(), "domain": pass.domain.name(),
                "weak": pass.weak, "barriers": barriers(batch), "uses": uses,
            })
        })
        .collect();
    let culled: Vec<Value> = plan
        .culled
        .iter()
        .map(|c| json!({"name": declaration.pass_name(c.pass), "reason": c.reason}))
        .collect();
    let resources: Vec<Value> = declaration
        .resources
        .iter()
        .zip(&plan.lifetimes)
        .zip(0..)
        .map(|((decl, life), resource)| {
            json!({
                "name": declaration.resource_name(resource), "shape": words.shape(decl.shape), "imported": !decl.is_transient(),
                "leave": match decl.origin {
                    Origin::Imported { leave: Some((access, _)), .. } => Some(access.name()),
                    Origin::Imported { leave: None, .. } | Origin::Transient => None,
                },
                "bytes": life.map(|l| l.bytes), "first": life.map(|l| l.first), "last": life.map(|l| l.last),
            })
        })
        .collect();
    let outputs: Vec<Value> = declaration
        .outputs
        .iter()
        .map(|o| json!({"resource": declaration.resource_name(o.resource), "version": o.version}))
        .collect();
    let end = barriers(&plan.barriers[plan.end.range()]);
    let all = json!({
        "size": [declaration.full.width, declaration.full.height],
        "passes": passes, "barriers_at_end": end, "left_out": culled, "resources": resources, "outputs": outputs,
        "memory": {"transient_unaliased": plan.memory.unaliased, "transient_lower_bound": plan.memory.lower_bound},
    });
    format!("{all:#}\n")
}

struct Words<'d>(&'d Declaration);

impl Words<'_> {
    fn version(&self, resource: u32, version: u32) -> String {
        format!("{} version {version}", self.0.resource_name(resource))
    }

    fn shape(&self, shape: Shape) -> String {
        match shape {
            Shape::Image { format, extent, mips, layers } => {
                let several = |n: u32, what: &str| if n > 1 { format!(", {n} {what}") } else { String::new() };
                format!("image {format:?} {extent}{}{}", several(mips, "mips"), several(layers, "layers"))
            }
            Shape::Buffer { bytes } => format!("buffer of {bytes} bytes"),
            Shape::Accel { .. } => "acceleration structure".to_owned(),
        }
    }

    fn use_of(&self, u: &Use) -> String {
        let name = self.0.resource_name(u.resource);
        match (u.reads, u.writes) {
            (Some(read), Some(written)) => format!("change {name} version {read} to {written}: {}", u.access),
            (None, Some(written)) => format!("make   {name} version {written}: {}", u.access),
            (Some(read), None) => format!("read   {name} version {read}: {}", u.access),
            (None, None) => format!("touch  {name}: {}", u.access),
        }
    }

    fn barrier(&self, b: &Barrier) -> String {
        let layouts = match (b.layout_from, b.layout_to) {
            (_, Layout::Undefined) => String::new(),
            (from, to) if from == to => String::new(),
            (from, to) => format!(", layout {} to {}", from.name(), to.name()),
        };
        let discard = if b.discard { ", contents are new" } else { "" };
        let name = self.0.resource_name(b.resource);
        format!("{name}: {} before {}{layouts}{discard}", b.from, b.to)
    }

    fn barrier_json(&self, b: &Barrier) -> Value {
        json!({
            "resource": self.0.resource_name(b.resource),
            "from": b.from.to_string(), "to": b.to.to_string(),
            "layout_from": b.layout_from.name(), "layout_to": b.layout_to.name(), "discard": b.discard,
        })
    }
}

#[cfg(test)]
#[path = "dump_tests.rs"]
mod tests;
