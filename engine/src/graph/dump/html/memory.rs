//! Transients as rectangles: from the first to the last pass horizontally, over the bytes of the heap vertically.

use super::{
    super::{
        super::{
            access::Queue,
            plan::{Lane, Lifetime, Sharing, Transient},
        },
        Dump,
        describe::{Describer, bytes, life, not_aliased},
        gains::counted,
    },
    sheet::{Area, ROOM, Sheet, shortened},
    style,
};

/// Height of all heaps together, and least height of each, pixels.
const HEIGHT: f64 = 380.0;
const MIN_HEIGHT: f64 = 90.0;
/// Average width of a letter in a rectangle, pixels.
const LETTER: f64 = 6.4;

/// Draws a panel for each heap.
pub(super) fn draw(dump: &Dump<'_>, sheet: &mut Sheet) {
    let all: u64 = dump.plan.heaps.iter().map(|h| h.bytes).sum();
    for heap in 0..dump.plan.heaps.len() as u32 {
        draw_heap(dump, sheet, heap, all.max(1));
    }
}

/// A transient with its lifetime.
struct Placed<'p> {
    transient: &'p Transient,
    life: Lifetime,
    /// Its bytes are reserved for the whole frame.
    held: bool,
}

fn draw_heap(dump: &Dump<'_>, sheet: &mut Sheet, heap: u32, all: u64) {
    let Dump { plan, .. } = *dump;
    let size = plan.heaps[heap as usize];
    let placed: Vec<Placed<'_>> = plan
        .transients
        .iter()
        .filter(|t| t.heap == heap)
        .filter_map(|transient| {
            let life = plan.lifetimes[transient.resource as usize]?;
            Some(Placed { transient, life, held: !plan.alias || life.lane == Lane::Several })
        })
        .collect();
    let unaliased: u64 = placed.iter().map(|p| p.transient.bytes).sum();
    let bound = least(&placed, plan.order.len() as u32);
    let title = if plan.heaps.len() == 1 { "Transient memory".to_owned() } else { format!("Heap {heap}") };
    sheet.heading(
        &title,
        &format!(
            "{} for {}, which would take {} without sharing; no placement takes less than {}. Memory of kind {}.",
            bytes(size.bytes),
            counted(placed.len(), "transient", "transients"),
            bytes(unaliased),
            bytes(bound),
            size.kind
        ),
    );

    let height = (HEIGHT * size.bytes as f64 / all as f64).max(MIN_HEIGHT);
    sheet.y += 4.0;
    let (top, floor) = (sheet.y, sheet.y + height);
    let up = |offset: u64| floor - height * (offset as f64 / size.bytes.max(1) as f64);
    sheet.grid(top, floor);
    for tick in ticks(size.bytes, height) {
        let label = if tick == 0 { "0".to_owned() } else { bytes(tick) };
        sheet.name(up(tick) + 4.0, "tick", &label, "");
    }
    for one in &placed {
        draw_transient(dump, sheet, one, &up);
    }
    let frame = Area { x: 0.0, y: top, width: sheet.across(), height };
    sheet.area(frame, "class=\"frame\" pointer-events=\"none\"", "");
    let y = up(bound);
    sheet.draw(&format!("<path class=\"bound\" d=\"M0 {y:.1}H{:.1}\"/>", sheet.across()));
    // The label is above the line, unless the panel ends there.
    let text_y = if y - top < 18.0 { y + 15.0 } else { y - 5.0 };
    let label = format!("lower bound {}", bytes(bound));
    sheet.text((sheet.across().min(ROOM) - 6.0, text_y), "class=\"boundtext\" text-anchor=\"end\"", &label);
    sheet.y = floor + 16.0;
}

fn draw_transient(dump: &Dump<'_>, sheet: &mut Sheet, one: &Placed<'_>, up: &impl Fn(u64) -> f64) {
    let declaration = dump.declaration;
    let Placed { transient, life, held } = *one;
    let full = declaration.resource_name(transient.resource);
    let decl = &declaration.resources[transient.resource as usize];
    let stage = decl.maker.map_or("", |maker| declaration.stage(maker));
    let fill = style::fill(declaration, stage);
    let (y, bottom) = (up(transient.offset + transient.bytes), up(transient.offset));
    let tooltip = tooltip(dump, one);
    if held {
        let all = Area { x: 0.0, y, width: sheet.across(), height: bottom - y };
        sheet.area(all, &format!("class=\"held\" fill=\"{fill}\""), &tooltip);
    }
    let x = sheet.left(life.first as usize) + 1.0;
    let area = Area { x, y, width: sheet.left(life.last as usize + 1) - 1.0 - x, height: bottom - y };
    sheet.area(area, &format!("class=\"life\" rx=\"2\" fill=\"{fill}\""), &tooltip);

    // The full name if it fits, else the local name, else its beginning; nothing if too little of it fits.
    let own = declaration.text(decl.name);
    let letters = |length: f64| ((length - 6.0) / LETTER).max(0.0) as usize;
    let centre = (area.x + area.width / 2.0, y + area.height / 2.0);
    let (across, along) = (letters(area.width), letters(area.height));
    let fits = |room: usize| [full.as_str(), own].into_iter().find(|n| n.chars().count() <= room);
    if area.height >= 13.0
        && let Some(name) = fits(across)
    {
        sheet.text((centre.0, centre.1 + 4.0), "text-anchor=\"middle\"", name);
    } else if area.width >= 13.0
        && let Some(name) = fits(along)
    {
        let turned = format!("text-anchor=\"middle\" transform=\"rotate(-90 {:.1} {:.1})\"", centre.0, centre.1);
        sheet.text((centre.0, centre.1 + 4.0), &turned, name);
    } else if area.height >= 13.0 && across >= 5 {
        sheet.text((centre.0, centre.1 + 4.0), "text-anchor=\"middle\"", &shortened(own, across));
    }
}

/// Tooltip of a transient.
fn tooltip(dump: &Dump<'_>, one: &Placed<'_>) -> String {
    let Dump { declaration, plan, .. } = *dump;
    let t = one.transient;
    let names = |of: Vec<u32>| of.into_iter().map(|r| declaration.resource_name(r)).collect::<Vec<_>>().join(" and ");
    let before: Vec<u32> = plan.successions.iter().filter(|(a, _)| *a == t.resource).map(|(_, b)| *b).collect();
    let after: Vec<u32> = plan.successions.iter().filter(|(_, b)| *b == t.resource).map(|(a, _)| *a).collect();
    let mut tooltip = vec![
        declaration.resource_name(t.resource),
        Describer(declaration).shape(declaration.resources[t.resource as usize].shape),
        format!("{} at {} of heap {}", bytes(t.bytes), t.offset, t.heap),
        life(&one.life),
        format!("used as {}", t.uses),
        t.sharing.reason().to_owned(),
    ];
    if !before.is_empty() {
        tooltip.push(format!("takes memory over from {}", names(before)));
    }
    if !after.is_empty() {
        tooltip.push(format!("leaves memory to {}", names(after)));
    }
    tooltip.extend(not_aliased(plan, t.resource).map(|why| format!("not aliased: {why}")));
    tooltip.join("\n")
}

/// Largest number of bytes alive at one time: per queue, plus everything that several queues use.
fn least(placed: &[Placed<'_>], positions: u32) -> u64 {
    let most_on = |queue: Queue| {
        // A transient adds its bytes at its first pass and removes them after its last.
        let mut change = vec![0_i128; positions as usize + 1];
        let here = placed.iter().filter(|p| p.transient.sharing == Sharing::Alone(queue));
        for Placed { transient, life, .. } in here {
            change[life.first as usize] += i128::from(transient.bytes);
            change[life.last as usize + 1] -= i128::from(transient.bytes);
        }
        let alive = change.into_iter().scan(0, |sum: &mut i128, step| {
            *sum += step;
            Some(*sum)
        });
        alive.max().and_then(|most| u64::try_from(most).ok()).unwrap_or(0)
    };
    let shared = placed.iter().filter(|p| !matches!(p.transient.sharing, Sharing::Alone(_)));
    Queue::ALL.into_iter().map(most_on).sum::<u64>() + shared.map(|p| p.transient.bytes).sum::<u64>()
}

/// Round tick values for a byte axis of `height` pixels, and the end of the axis.
fn ticks(most: u64, height: f64) -> Vec<u64> {
    let wanted = (height / 60.0).max(1.0);
    let rough = (most as f64 / wanted).max(1.0);
    let power = 10_f64.powf(rough.log10().floor());
    let step = [1.0, 2.0, 5.0, 10.0].into_iter().map(|m| m * power).find(|s| *s >= rough).unwrap_or(rough) as u64;
    // The last tick before the end is left out if its label would touch the end's.
    let clear = most.saturating_sub(step * 2 / 5);
    let mut ticks: Vec<u64> = (0..).map(|i| i * step).take_while(|t| *t <= clear && *t < most).collect();
    ticks.push(most);
    ticks
}

#[cfg(test)]
mod tests {
    use super::*;

    #[test]
    fn ticks_are_round_and_end_with_the_heap() {
        assert_eq!(ticks(1_000_000, 240.0), [0, 500_000, 1_000_000]);
        assert_eq!(ticks(2_150_000, 240.0), [0, 1_000_000, 2_150_000]);
        assert_eq!(ticks(1, 90.0), [0, 1]);
        assert_eq!(ticks(0, 90.0), [0]);
    }
}
