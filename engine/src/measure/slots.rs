//! What of a frame runs, slot by slot, and why the rest does not.

use std::borrow::Cow;

use serde::Serialize;

use crate::{
    graph::{Declaration, ImportKey, Origin, Plan, ResourceDecl},
    slot::SlotNeeds,
};

/// A slot of a frame that was planned.
#[derive(Clone, Debug, PartialEq, Serialize)]
pub struct SlotReport {
    /// Name of the slot.
    pub slot: String,
    /// Name of the implementation in it.
    pub implementation: String,
    /// Any of its passes runs.
    pub runs: bool,
    /// Why none does.
    #[serde(skip_serializing_if = "Option::is_none")]
    pub reason: Option<Cow<'static, str>>,
    /// Parts of the implementation that can be idle by themselves.
    #[serde(skip_serializing_if = "Vec::is_empty")]
    pub parts: Vec<PartReport>,
    /// Its passes that run, in the order of the plan.
    pub passes: Vec<String>,
    /// Bytes that its passes read and write, as declared: [`Declaration::traffic`].
    pub bytes: u64,
    /// Memory of what its passes make for this frame alone, if nothing of it were shared, bytes.
    pub transient_bytes: u64,
    /// Memory of what its passes keep from frame to frame, bytes.
    pub history_bytes: u64,
}

/// A part of an implementation.
#[derive(Clone, Debug, PartialEq, Serialize)]
pub struct PartReport {
    /// Name of the part.
    pub part: String,
    /// Any of its passes runs.
    pub runs: bool,
    /// Why none does.
    #[serde(skip_serializing_if = "Option::is_none")]
    pub reason: Option<Cow<'static, str>>,
    /// The setting of the slot that leaves it out, as `key=value`.
    #[serde(skip)]
    pub without: Option<&'static str>,
}

const OFF: Cow<'static, str> = Cow::Borrowed("switched off");
const NO_PASS: Cow<'static, str> = Cow::Borrowed("nothing to do in this frame");
const UNUSED: Cow<'static, str> = Cow::Borrowed("nothing reads what it makes");

/// What runs in each slot of a planned frame, in the order of the frame; then, by their own names, passes that belong to no slot.
#[must_use]
pub fn slot_reports(needs: &[SlotNeeds], declaration: &Declaration, plan: &Plan) -> Vec<SlotReport> {
    let mut reports: Vec<SlotReport> = needs.iter().map(|slot| report(slot, declaration, plan)).collect();
    for &pass in &plan.order {
        let stage = declaration.stage(pass);
        if !reports.iter().any(|r| r.slot == stage) {
            let mut shared = sum(stage, declaration, plan);
            shared.implementation = "shared".to_owned();
            reports.push(shared);
        }
    }
    reports
}

fn report(slot: &SlotNeeds, declaration: &Declaration, plan: &Plan) -> SlotReport {
    let SlotNeeds { slot, implementation, needs } = slot;
    let mut report = sum(slot, declaration, plan);
    report.implementation.clone_from(implementation);
    let declared = (0..declaration.passes.len() as u32).any(|pass| declaration.stage(pass) == *slot);
    report.reason = match &needs.idle {
        _ if report.runs => None,
        Some(reason) => Some(reason.clone()),
        None if declared => Some(UNUSED),
        None if implementation == "off" => Some(OFF),
        None => Some(NO_PASS),
    };
    let part = |part: &crate::slot::Part| {
        let runs =
            part.idle.is_none() && report.passes.iter().any(|name| name.starts_with(&format!("{slot}.{}", part.name)));
        let reason = part.idle.clone().or(if runs { None } else { Some(NO_PASS) });
        PartReport { part: part.name.to_owned(), runs, reason, without: part.without }
    };
    report.parts = needs.parts.iter().map(part).collect();
    report
}

/// The passes of a slot, and what they take together.
fn sum(slot: &str, declaration: &Declaration, plan: &Plan) -> SlotReport {
    let passes: Vec<u32> = plan.order.iter().copied().filter(|&pass| declaration.stage(pass) == slot).collect();
    let mut report = SlotReport {
        slot: slot.to_owned(),
        implementation: String::new(),
        runs: !passes.is_empty(),
        reason: None,
        parts: Vec::new(),
        passes: passes.iter().map(|&pass| declaration.pass_name(pass).to_owned()).collect(),
        bytes: passes.iter().map(|&pass| declaration.traffic(pass)).sum(),
        transient_bytes: 0,
        history_bytes: 0,
    };
    let mut kept: Vec<u32> = Vec::new();
    for &pass in &passes {
        for u in declaration.uses_of(pass) {
            let resource: &ResourceDecl = &declaration.resources[u.resource as usize];
            match resource.origin {
                Origin::Transient if resource.maker == Some(pass) && u.writes.is_some() => {
                    report.transient_bytes += resource.bytes();
                }
                Origin::Imported { key: ImportKey::Previous(_) | ImportKey::Next(_) | ImportKey::Kept(_), .. }
                    if !kept.contains(&u.resource) =>
                {
                    kept.push(u.resource);
                }
                _ => {}
            }
        }
    }
    report.history_bytes = kept.iter().map(|&r| declaration.resources[r as usize].bytes()).sum();
    report
}

/// The same as a table for a terminal; `pixels`: those of the picture. `share`: of the whole frame's time, where that was measured.
#[must_use]
pub fn slot_table(reports: &[SlotReport], pixels: u64, share: impl Fn(&str) -> Option<f64>) -> String {
    let mut rows =
        vec![["slot", "implementation", "", "passes", "B/px", "transient", "kept", "share"].map(str::to_owned)];
    for report in reports {
        let SlotReport { slot, implementation, runs, reason, parts, passes, bytes, .. } = report;
        let share = share(slot).map_or_else(String::new, |share| format!("{:.1} %", 100.0 * share));
        let number = |n: u64| if *runs { n.to_string() } else { String::new() };
        let memory = |bytes: u64| {
            if bytes > 0 { format!("{:.2} MiB", bytes as f64 / f64::from(1 << 20)) } else { String::new() }
        };
        let state =
            |reason: &Option<Cow<'static, str>>| reason.as_ref().map_or("runs".to_owned(), |r| format!("idle: {r}"));
        rows.push([
            slot.clone(),
            implementation.clone(),
            state(reason),
            number(passes.len() as u64),
            number(bytes.div_ceil(pixels.max(1))),
            memory(report.transient_bytes),
            memory(report.history_bytes),
            share,
        ]);
        for part in parts {
            let mut row = [const { String::new() }; 8];
            (row[0], row[2]) = (format!("  {slot}.{}", part.part), state(&part.reason));
            rows.push(row);
        }
    }
    // A column without a value in any row is left out, its head too.
    let width = |c: usize| rows.iter().map(|r| r[c].chars().count()).max().unwrap_or(0);
    let is_shown = |c: &usize| rows[1..].iter().any(|row| !row[*c].is_empty());
    let shown: Vec<(usize, usize)> = (0..8).filter(is_shown).map(|c| (c, width(c))).collect();
    let mut text = String::new();
    for row in &rows {
        let cells = shown.iter().map(
            |&(c, width)| {
                if c < 3 { format!("{:<width$}", row[c]) } else { format!("{:>width$}", row[c]) }
            },
        );
        text += cells.collect::<Vec<_>>().join("  ").trim_end();
        text.push('\n');
    }
    text
}
