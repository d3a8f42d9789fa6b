//! The plan as text.

use std::fmt::Write;

use super::{
    super::{declaration::Span, plan::Sharing},
    Dump,
    describe::{Describer, bytes, life, made_for, not_aliased, origin},
};

pub(super) fn text(dump: &Dump<'_>) -> String {
    let Dump { declaration, plan, gains } = *dump;
    let describer = Describer(declaration);
    let mut out = String::new();
    // Writing to a string cannot fail, hence the ignored results.
    let mut line = |text: String| writeln!(out, "{text}").unwrap_or_default();

    line(format!("frame of {}, {}", declaration.full, made_for(plan)));
    line(gains.to_string());

    line("\npasses".to_owned());
    for (number, batch) in plan.batches.iter().enumerate() {
        let waits: Vec<String> = plan.waits[batch.waits.range()].iter().map(|w| format!("batch {w}")).collect();
        let waits = if waits.is_empty() { String::new() } else { format!(", waits for {}", waits.join(" and ")) };
        line(format!("batch {number} on {}{waits}", batch.queue.name()));
        for position in batch.passes.range() {
            let index = plan.order[position];
            let pass = &declaration.passes[index as usize];
            let weak = if pass.weak { ", weak" } else { "" };
            line(format!(
                "{position:4} {}  (stage {}, {}, {}{weak})",
                declaration.pass_name(index),
                declaration.stage(index),
                pass.domain.name(),
                describer.queue(index, batch.queue)
            ));
            let barriers = |span: Span| plan.barriers[span.range()].iter().map(|b| describer.barrier(b));
            barriers(plan.before[position]).for_each(|b| line(format!("       wait   {b}")));
            describer.uses_of(plan, index).into_iter().for_each(|u| line(format!("       {u}")));
            barriers(plan.after[position]).for_each(|b| line(format!("       after  {b}")));
        }
    }
    if !plan.end.is_empty() {
        line("end on graphics, waits for all".to_owned());
        let last = &plan.barriers[plan.end.range()];
        last.iter().for_each(|b| line(format!("       wait   {}", describer.barrier(b))));
    }

    if !plan.culled.is_empty() {
        line("\nleft out".to_owned());
    }
    for culled in &plan.culled {
        line(format!("     {}: {}", declaration.pass_name(culled.pass), culled.reason));
    }

    line("\nresources".to_owned());
    for (resource, decl) in (0..).zip(&declaration.resources) {
        let kind = if decl.is_transient() { String::new() } else { format!(", {}", origin(decl.origin)) };
        let lived = plan.lifetimes[resource as usize]
            .map_or_else(|| "not used".to_owned(), |l| format!("{} bytes, {}", l.bytes, life(&l)));
        line(format!("     {}  {}{kind}, {lived}", declaration.resource_name(resource), describer.shape(decl.shape)));
    }

    if !plan.heaps.is_empty() {
        line("\nmemory of transients".to_owned());
    }
    for (heap, memory) in (0..).zip(&plan.heaps) {
        line(format!("heap {heap}: {} of kind {}", bytes(memory.bytes), memory.kind));
        let mut here: Vec<_> = plan.transients.iter().filter(|t| t.heap == heap).collect();
        here.sort_by_key(|t| (t.offset, plan.lifetimes[t.resource as usize].map(|l| l.first), t.resource));
        for t in here {
            let name = declaration.resource_name(t.resource);
            let before: Vec<String> = plan
                .successions
                .iter()
                .filter(|(after, _)| *after == t.resource)
                .map(|(_, before)| declaration.resource_name(*before))
                .collect();
            let why = match not_aliased(plan, t.resource) {
                Some(reason) => format!(", shares with nobody: {reason}"),
                None if before.is_empty() => String::new(),
                None => format!(", after {}", before.join(" and ")),
            };
            line(format!("{:>12} {:>10}  {name}{why}", t.offset, t.bytes));
            if !matches!(t.sharing, Sharing::Alone(_)) {
                line(format!("{:23}  {}", "", t.sharing.reason()));
            }
        }
    }

    if !declaration.outputs.is_empty() {
        line("\noutputs".to_owned());
    }
    for output in &declaration.outputs {
        line(format!("     {}", describer.version(output.resource, output.version)));
    }
    for pair in &declaration.histories {
        let name = |resource: u32| declaration.resource_name(resource);
        line(format!("     next frame reads {} as {}", name(pair.next), name(pair.previous)));
    }
    out
}
