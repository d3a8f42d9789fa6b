//! The plan as a graph for Graphviz.

use std::fmt::Write;

use super::{Dump, describe::Describer};

pub(super) fn dot(dump: &Dump<'_>) -> String {
    let Dump { declaration, plan, .. } = *dump;
    let describer = Describer(declaration);
    let mut out = String::from("digraph frame {\n  rankdir=LR;\n  compound=true;\n  node [fontname=\"sans-serif\"];\n");
    let mut line = |text: String| writeln!(out, "  {text}").unwrap_or_default();
    for (number, batch) in plan.batches.iter().enumerate() {
        let label = quoted(&format!("batch {number}, {}", batch.queue.name()));
        line(format!("subgraph cluster_{number} {{ label={label};"));
        for position in batch.passes.range() {
            let index = plan.order[position];
            let label = quoted(&format!("{position} {}", declaration.pass_name(index)));
            line(format!("  p{index} [shape=box style=solid label={label}];"));
        }
        line("}".to_owned());
    }
    for culled in &plan.culled {
        let label = quoted(declaration.pass_name(culled.pass));
        let reason = quoted(&culled.reason);
        line(format!("p{} [shape=box style=dashed label={label} tooltip={reason}];", culled.pass));
    }
    for (resource, decl) in declaration.resources.iter().enumerate() {
        let style = if plan.lifetimes[resource].is_some() { "solid" } else { "dashed" };
        for version in 0..decl.versions {
            let wanted = declaration.outputs.iter().any(|o| (o.resource as usize, o.version) == (resource, version));
            let rims = if wanted { 2 } else { 1 };
            let label = quoted(&describer.version(resource as u32, version));
            line(format!("r{resource}_{version} [shape=ellipse style={style} peripheries={rims} label={label}];"));
        }
    }
    for index in 0..declaration.passes.len() as u32 {
        for u in declaration.uses_of(index) {
            let label = quoted(&format!("{}{}", u.access.name(), describer.part(u.resource, u.part)));
            if let Some(version) = u.reads {
                line(format!("r{}_{version} -> p{index} [label={label}];", u.resource));
            }
            if let Some(version) = u.writes {
                line(format!("p{index} -> r{}_{version} [label={label}];", u.resource));
            }
        }
    }
    for (number, batch) in plan.batches.iter().enumerate() {
        for &wait in &plan.waits[batch.waits.range()] {
            let before = &plan.batches[wait as usize];
            let ends = (plan.order[before.passes.end as usize - 1], plan.order[batch.passes.start as usize]);
            line(format!(
                "p{} -> p{} [style=bold ltail=cluster_{wait} lhead=cluster_{number} label=\"wait\"];",
                ends.0, ends.1
            ));
        }
    }
    out.push_str("}\n");
    out
}

/// A quoted string in DOT, where only quotes and backslashes are special.
fn quoted(text: &str) -> String {
    format!("\"{}\"", text.replace('\\', "\\\\").replace('"', "\\\"").replace('\n', " "))
}
