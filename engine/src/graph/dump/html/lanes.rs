//! Passes on one lane per queue, batch by batch, with the waits between batches.

use super::{
    super::{
        super::{
            access::Queue,
            declaration::Span,
            plan::{Batch, Plan},
        },
        Dump,
        describe::Describer,
        gains::counted,
    },
    escape,
    sheet::{Area, Sheet},
    style,
};

/// Height of a lane and of the parts inside it, pixels.
const LANE: f64 = 72.0;
const EMPTY: f64 = 26.0;
const GAP: f64 = 10.0;
const BATCH: f64 = 60.0;
const PASS: f64 = 30.0;

/// Positions of the lanes.
struct Lanes {
    /// Each queue with the top and the height of its lane, pixels.
    queues: Vec<(Queue, f64, f64)>,
}

impl Lanes {
    fn top_of(&self, queue: Queue) -> f64 {
        self.queues.iter().find(|(q, ..)| *q == queue).map_or(0.0, |(_, top, _)| *top)
    }
}

/// Draws the lanes.
pub(super) fn draw(dump: &Dump<'_>, sheet: &mut Sheet) {
    let plan = dump.plan;
    let mut lanes = Lanes { queues: Vec::new() };
    for queue in Queue::ALL.into_iter().filter(|q| plan.queues.has(*q)) {
        let used = queue == Queue::Graphics || plan.batches.iter().any(|b| b.queue == queue);
        let height = if used { LANE } else { EMPTY };
        lanes.queues.push((queue, sheet.y, height));
        sheet.y += height + GAP;
    }
    for &(queue, y, height) in &lanes.queues {
        let width = sheet.across();
        sheet.area(Area { x: 0.0, y, width, height }, "class=\"lane\" rx=\"6\"", "");
        if height < LANE {
            sheet.name(y + height / 2.0 + 5.0, "heading", queue.name(), "");
            sheet.text((12.0, y + height / 2.0 + 4.0), "class=\"more\"", "nothing runs here");
            continue;
        }
        let on = plan.batches.iter().filter(|b| b.queue == queue);
        let (batches, passes) = on.fold((0, 0), |(n, passes), b| (n + 1, passes + b.passes.len()));
        sheet.name(y + height / 2.0 - 2.0, "heading", queue.name(), "");
        let label = format!("{} in {}", counted(passes, "pass", "passes"), counted(batches, "batch", "batches"));
        sheet.name(y + height / 2.0 + 14.0, "more", &label, "");
    }
    for (number, batch) in plan.batches.iter().enumerate() {
        draw_batch(dump, &lanes, sheet, number, batch);
    }
    draw_waits(plan, &lanes, sheet);
    let end = plan.order.len();
    let area = Area {
        x: sheet.left(end) + 6.0,
        y: lanes.top_of(Queue::Graphics) + (LANE - BATCH) / 2.0 + 21.0,
        width: sheet.column() - 12.0,
        height: PASS,
    };
    sheet.area(area, "class=\"end\" rx=\"4\"", "the end of the frame: the graphics queue waits for all others");
    marks(dump, sheet, plan.end, (area.x, area.y + PASS), Place::End);
    sheet.y += 4.0;
}

fn draw_batch(dump: &Dump<'_>, lanes: &Lanes, sheet: &mut Sheet, number: usize, batch: &Batch) {
    let Dump { declaration, plan, .. } = *dump;
    let describer = Describer(declaration);
    let y = lanes.top_of(batch.queue) + (LANE - BATCH) / 2.0;
    let x = sheet.left(batch.passes.start as usize) + 2.0;
    let width = sheet.left(batch.passes.end as usize) - 2.0 - x;
    let waits: Vec<String> = plan.waits[batch.waits.range()].iter().map(|w| format!("batch {w}")).collect();
    let waits = if waits.is_empty() { "no other".to_owned() } else { waits.join(" and ") };
    let tooltip = format!("batch {number} on {}\n{} passes\nwaits for {waits}", batch.queue.name(), batch.passes.len());
    sheet.area(Area { x, y, width, height: BATCH }, "class=\"batch\" rx=\"6\"", &tooltip);
    let name = if width < 55.0 { number.to_string() } else { format!("batch {number}") };
    sheet.text((x + 7.0, y + 13.0), "class=\"small\"", &name);

    for position in batch.passes.range() {
        let index = plan.order[position];
        let pass = &declaration.passes[index as usize];
        let (x, y) = (sheet.left(position) + 6.0, y + 21.0);
        let area = Area { x, y, width: sheet.column() - 12.0, height: PASS };
        let weak = if pass.weak { " weak" } else { "" };
        let fill = style::fill(declaration, declaration.stage(index));
        let mut tooltip = vec![
            format!("{position} {}", declaration.pass_name(index)),
            format!("{}, {}", pass.domain.name(), describer.queue(index, batch.queue)),
        ];
        if pass.weak {
            tooltip.push("it only observes: nothing is kept for its sake".to_owned());
        }
        tooltip.extend(describer.uses_of(plan, index));
        sheet.area(area, &format!("class=\"pass{weak}\" rx=\"4\" fill=\"{fill}\""), &tooltip.join("\n"));
        sheet.text((sheet.middle(position), y + PASS / 2.0 + 4.0), "class=\"number\"", &position.to_string());
        marks(dump, sheet, plan.before[position], (x, y + PASS), Place::Before);
        marks(dump, sheet, plan.after[position], (x + area.width, y + 2.0), Place::After);
    }
}

#[derive(Clone, Copy, PartialEq, Eq)]
enum Place {
    Before,
    After,
    End,
}

/// The barriers of one place, as a mark with their number.
fn marks(dump: &Dump<'_>, sheet: &mut Sheet, span: Span, (x, y): (f64, f64), place: Place) {
    if span.is_empty() {
        return;
    }
    let describer = Describer(dump.declaration);
    let head = counted(span.len(), "barrier", "barriers");
    let place_name = match place {
        Place::Before => "before the pass",
        Place::After => "after the pass, for other queues",
        Place::End => "at the end of the frame",
    };
    let mut tooltip = vec![format!("{head} {place_name}")];
    tooltip.extend(dump.plan.barriers[span.range()].iter().map(|b| describer.barrier(b)));
    let shape = match place {
        Place::After => format!("<path class=\"after\" d=\"M{x:.1} {:.1}l9 9l-9 9l-9-9z\"/>", y - 9.0),
        Place::Before | Place::End => format!("<circle class=\"before\" cx=\"{x:.1}\" cy=\"{y:.1}\" r=\"7.5\"/>"),
    };
    sheet.draw(&format!("<g class=\"barriers\"><title>{}</title>{shape}</g>", escape(&tooltip.join("\n"))));
    sheet.text((x, y + 3.4), "class=\"count\"", &span.len().to_string());
}

/// Arrows for the waits between batches, and for the wait of the graphics queue for the other queues at the end of the frame.
fn draw_waits(plan: &Plan, lanes: &Lanes, sheet: &mut Sheet) {
    for (number, batch) in plan.batches.iter().enumerate() {
        for &wait in &plan.waits[batch.waits.range()] {
            let before = &plan.batches[wait as usize];
            let tooltip = format!(
                "batch {number} on {} waits for batch {wait} on {}: a timeline semaphore",
                batch.queue.name(),
                before.queue.name()
            );
            arrow(lanes, sheet, before, (batch.queue, batch.passes.start), "wait", &tooltip);
        }
    }
    let end = plan.order.len() as u32;
    for &queue in lanes.queues.iter().map(|(q, ..)| q).filter(|q| **q != Queue::Graphics) {
        if let Some(before) = plan.batches.iter().rfind(|b| b.queue == queue) {
            let tooltip = format!("the end of the frame waits for {}", queue.name());
            arrow(lanes, sheet, before, (Queue::Graphics, end), "wait last", &tooltip);
        }
    }
}

/// An arrow from the end of a batch to a column on another lane.
fn arrow(lanes: &Lanes, sheet: &mut Sheet, from: &Batch, to: (Queue, u32), class: &str, tooltip: &str) {
    let inset = (LANE - BATCH) / 2.0;
    let (from_top, to_top) = (lanes.top_of(from.queue), lanes.top_of(to.0));
    let down = to_top > from_top;
    let edge = |top: f64, lower: bool| if lower { top + LANE - inset } else { top + inset };
    let (y0, y1) = (edge(from_top, down), edge(to_top, !down));
    let (x0, x1) = (sheet.left(from.passes.end as usize) - 8.0, sheet.left(to.1 as usize) + sheet.column() * 0.3);
    let bend = (y1 - y0) * 0.6;
    let path = format!("M{x0:.1} {y0:.1}C{x0:.1} {:.1} {x1:.1} {:.1} {x1:.1} {y1:.1}", y0 + bend, y1 - bend);
    sheet.draw(&format!("<path class=\"{class}\" d=\"{path}\"><title>{}</title></path>", escape(tooltip)));
}
