//! Tables: the graph's savings, culled passes, and every transient.

use super::{
    super::{
        Dump,
        describe::{Describer, bytes, life, not_aliased},
        gains::{Gains, counted},
    },
    escape,
};

/// The savings, at the top of the page.
pub(super) fn gains(gains: &Gains) -> String {
    let memory = |name: &str, of: u64, note: &str| {
        let percent = 100.0 * gains.share(of);
        format!(
            "<div><dt>{name}</dt><dd>{}<i><b style=\"width:{percent:.1}%\"></b></i><small>{percent:.0} %{note}</small></dd></div>",
            bytes(of)
        )
    };
    let figure = |name: &str, value: String, note: String| {
        format!("<div><dt>{name}</dt><dd>{value}<small>{note}</small></dd></div>")
    };
    let overlap = match gains.overlap_ms {
        Some(ms) => figure("Overlap of queues", format!("{ms:.3} ms"), "saved by running side by side".to_owned()),
        None => String::new(),
    };
    let unstored = match gains.unstored {
        0 => "every attachment reaches memory".to_owned(),
        n => format!("{} not stored", counted(n, "attachment is", "attachments are")),
    };
    let all = [
        memory("Transients, unaliased", gains.unaliased, ": each with memory of its own"),
        memory("Transients, aliased", gains.aliased, &format!(", {:.2} times the bound", gains.over_bound())),
        memory("Lower bound", gains.lower_bound, ": the most alive at once"),
        figure("Passes", gains.passes.to_string(), format!("{} culled; {unstored}", gains.culled)),
        figure(
            "Barriers",
            gains.barriers.to_string(),
            format!("{:.1} per pass, in {}", gains.barriers_per_pass, counted(gains.barrier_calls, "call", "calls")),
        ),
        figure(
            "Batches",
            gains.batches.to_string(),
            format!(
                "on {}, {}",
                counted(gains.queues, "queue", "queues"),
                counted(gains.waits, "wait between them", "waits between them")
            ),
        ),
        overlap,
    ];
    format!("<section aria-label=\"What the graph gained\"><dl>{}</dl></section>", all.concat())
}

/// The culled passes, and why each is left out.
pub(super) fn left_out(dump: &Dump<'_>) -> String {
    let Dump { declaration, plan, .. } = *dump;
    if plan.culled.is_empty() {
        return "<h2>Left out</h2><p>Every pass that was declared runs.</p>".to_owned();
    }
    let row = |c: &super::super::super::plan::Culled| {
        let name = escape(declaration.pass_name(c.pass));
        format!("<tr><td>{name}</td><td>{}</td></tr>\n", escape(&c.reason))
    };
    let rows: String = plan.culled.iter().map(row).collect();
    format!("<h2>Left out</h2><table><tr><th>Pass</th><th>Why</th></tr>\n{rows}</table>")
}

/// A table of every transient, folded.
pub(super) fn transients(dump: &Dump<'_>) -> String {
    let Dump { declaration, plan, .. } = *dump;
    let describer = Describer(declaration);
    let mut rows = String::new();
    for t in &plan.transients {
        let before: Vec<String> = plan
            .successions
            .iter()
            .filter(|(after, _)| *after == t.resource)
            .map(|(_, b)| declaration.resource_name(*b))
            .collect();
        let memory = match not_aliased(plan, t.resource) {
            Some(why) => format!("alone: {why}"),
            None if before.is_empty() => "first of those that share".to_owned(),
            None => format!("after {}", before.join(" and ")),
        };
        let lived = plan.lifetimes[t.resource as usize].map(|l| life(&l)).unwrap_or_default();
        let shape = describer.shape(declaration.resources[t.resource as usize].shape);
        rows.push_str(&format!(
            "<tr><td>{}</td><td>{}</td><td>{lived}</td><td class=\"n\">{}</td><td class=\"n\">{}</td><td class=\"n\">{}</td><td>{}</td></tr>\n",
            escape(&declaration.resource_name(t.resource)),
            escape(&shape),
            t.bytes,
            t.heap,
            t.offset,
            escape(&memory)
        ));
    }
    format!(
        "<details><summary>Transients</summary><table><tr><th>Name</th><th>What it is</th><th>Alive</th><th class=\"n\">Bytes</th>\
         <th class=\"n\">Heap</th><th class=\"n\">Offset</th><th>Memory</th></tr>\n{rows}</table></details>"
    )
}
