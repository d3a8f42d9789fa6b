//! The plan as one page that needs nothing else: passes on the lanes of their queues, resources as bars over their lifetimes,
//! transient memory below. Details show where the pointer rests.

use std::fmt::Write;

use super::{
    super::{
        access::Queue,
        declaration::{Declaration, ResourceDecl},
        plan::{Lifetime, Plan},
    },
    Words,
};

/// Sizes of the drawing, pixels. A column is as wide as the longest name of a pass asks for.
const LABEL: usize = 230;
const LETTER: usize = 7;
const ROW: usize = 22;
const MEMORY: usize = 90;

const STYLE: &str = "body{font:14px/1.45 system-ui,sans-serif;margin:2em;color:#222;background:#fcfcfa}\
svg{font:11px system-ui,sans-serif;display:block}table{border-collapse:collapse}td{padding:.15em 1em .15em 0;vertical-align:top}\
.pass rect{fill:#2c5d8f}.pass text{fill:#fff}.pass:hover rect{fill:#17395c}.transient{fill:#e0a458}.imported{fill:#8fb996}\
.transient:hover,.imported:hover{stroke:#222}.barrier{fill:#b5432f}.lane{fill:#eee9dd}.memory{fill:#e0a458}.bound{stroke:#b5432f;stroke-dasharray:4 3}\
.grid{stroke:#e5e2d8}";

/// The plan as a self-contained HTML page with a drawing (SVG), without scripts.
pub fn html(declaration: &Declaration, plan: &Plan) -> String {
    let words = Words(declaration);
    let barriers = plan.barriers.len();
    let mut page = String::new();
    let mut add = |text: String| writeln!(page, "{text}").unwrap_or_default();
    add(format!(
        "<!doctype html><html lang=\"en\"><meta charset=\"utf-8\"><title>Frame graph</title><style>{STYLE}</style><h1>Frame graph</h1>"
    ));
    add(format!(
        "<p>{} pixels, {} passes, {} left out, {barriers} barriers. Transient memory: {} without sharing, at least {} at one time.</p>",
        declaration.full,
        plan.order.len(),
        plan.culled.len(),
        bytes(plan.memory.unaliased),
        bytes(plan.memory.lower_bound)
    ));
    add(drawing(declaration, plan, &words));
    add("<p>Blue: passes, on the queue that each asks for; everything runs on the graphics queue. Red: barriers before a pass. \
         Orange: transient resources, green: imported ones. The dashed line is the least memory that holds all transients.</p>"
        .to_owned());
    if !plan.culled.is_empty() {
        add("<h2>Left out</h2><table>".to_owned());
        for culled in &plan.culled {
            let name = declaration.pass_name(culled.pass);
            add(format!("<tr><td>{}<td>{}", escape(name), escape(&culled.reason.to_string())));
        }
        add("</table>".to_owned());
    }
    page
}

fn drawing(declaration: &Declaration, plan: &Plan, words: &Words<'_>) -> String {
    let queues: Vec<Queue> = [Queue::Graphics, Queue::AsyncCompute, Queue::Transfer]
        .into_iter()
        .filter(|queue| plan.order.iter().any(|&p| declaration.passes[p as usize].queue == *queue))
        .collect();
    let bar = |(resource, life): (u32, &Option<Lifetime>)| {
        Some((declaration.resource_name(resource), &declaration.resources[resource as usize], (*life)?))
    };
    let mut bars: Vec<(String, &ResourceDecl, Lifetime)> = (0..).zip(&plan.lifetimes).filter_map(bar).collect();
    bars.sort_by_key(|(name, _, life)| (life.first, life.last, name.clone()));

    let longest = plan.order.iter().map(|&p| declaration.pass_name(p).len()).max().unwrap_or(0);
    let column = longest * LETTER + 24;
    let lanes_end = queues.len() * 2 * ROW;
    let bars_end = lanes_end + ROW + bars.len() * ROW;
    let (width, height) = (LABEL + plan.order.len() * column + 10, bars_end + 2 * ROW + MEMORY);
    let mut svg = format!("<svg width=\"{width}\" height=\"{height}\" viewBox=\"0 0 {width} {height}\">\n");
    let mut add = |text: String| writeln!(svg, "{text}").unwrap_or_default();
    for position in 0..=plan.order.len() {
        let x = LABEL + position * column;
        add(format!("<line class=\"grid\" x1=\"{x}\" x2=\"{x}\" y1=\"0\" y2=\"{bars_end}\"/>"));
    }

    // Passes on their lanes, each with its barriers before it.
    for (lane, queue) in queues.iter().enumerate() {
        let y = lane * 2 * ROW;
        add(format!("<rect class=\"lane\" x=\"0\" y=\"{}\" width=\"{width}\" height=\"{}\"/>", y + 2, 2 * ROW - 4));
        add(format!("<text x=\"6\" y=\"{}\">{}</text>", y + ROW + 4, queue.name()));
    }
    for (position, (&index, before)) in plan.order.iter().zip(&plan.before).enumerate() {
        let batch = &plan.barriers[before.range()];
        let pass = &declaration.passes[index as usize];
        let lane = queues.iter().position(|q| *q == pass.queue).unwrap_or(0);
        let (x, y) = (LABEL + position * column, lane * 2 * ROW);
        let mut told = format!("{} ({}, stage {})", declaration.pass_name(index), pass.domain.name(), declaration.stage(index));
        declaration.uses_of(index).iter().for_each(|u| write!(told, "\n{}", words.use_of(u)).unwrap_or_default());
        add(format!(
            "<g class=\"pass\"><title>{}</title><rect x=\"{}\" y=\"{}\" width=\"{}\" height=\"{}\" rx=\"3\"/><text x=\"{}\" y=\"{}\">{}</text></g>",
            escape(&told),
            x + 10,
            y + 8,
            column - 14,
            2 * ROW - 16,
            x + 15,
            y + ROW + 4,
            escape(declaration.pass_name(index))
        ));
        if !batch.is_empty() {
            let waits: Vec<String> = batch.iter().map(|b| words.barrier(b)).collect();
            let (top, bottom) = (y + 6, 2 * ROW - 12);
            add(format!(
                "<rect class=\"barrier\" x=\"{}\" y=\"{top}\" width=\"5\" height=\"{bottom}\"><title>{}</title></rect>",
                x + 3,
                escape(&waits.join("\n"))
            ));
        }
    }

    // Resources over their lifetimes.
    for (row, (name, resource, life)) in bars.iter().enumerate() {
        let y = lanes_end + ROW + row * ROW;
        let kind = if resource.is_transient() { "transient" } else { "imported" };
        let told = format!("{}\n{}\n{}", name, words.shape(resource.shape), bytes(life.bytes));
        let (x, length) = (LABEL + life.first as usize * column, (life.last - life.first + 1) as usize * column);
        add(format!("<text x=\"6\" y=\"{}\">{}</text>", y + 15, escape(name)));
        add(format!(
            "<rect class=\"{kind}\" x=\"{}\" y=\"{}\" width=\"{}\" height=\"{}\" rx=\"2\"><title>{}</title></rect>",
            x + 4,
            y + 4,
            length - 8,
            ROW - 8,
            escape(&told)
        ));
    }

    // Bytes of transients that are alive during each pass.
    let alive: Vec<u64> = (0..plan.order.len() as u32)
        .map(|at| {
            let lives = plan.transients.iter().filter_map(|t| plan.lifetimes[t.resource as usize]);
            lives.filter(|l| (l.first..=l.last).contains(&at)).map(|l| l.bytes).sum()
        })
        .collect();
    let most = plan.memory.unaliased.max(1) as f64;
    let tall = |bytes: u64| (bytes as f64 / most * MEMORY as f64) as usize;
    let floor = bars_end + ROW + MEMORY;
    add(format!("<text x=\"6\" y=\"{}\">transient memory alive</text>", floor - MEMORY / 2));
    for (position, &bytes_alive) in alive.iter().enumerate() {
        let (x, tall) = (LABEL + position * column, tall(bytes_alive));
        add(format!(
            "<rect class=\"memory\" x=\"{}\" y=\"{}\" width=\"{}\" height=\"{tall}\"><title>{}</title></rect>",
            x + 4,
            floor - tall,
            column - 8,
            bytes(bytes_alive)
        ));
    }
    let bound = floor - tall(plan.memory.lower_bound);
    add(format!("<line class=\"bound\" x1=\"{LABEL}\" x2=\"{width}\" y1=\"{bound}\" y2=\"{bound}\"/>"));
    svg.push_str("</svg>");
    svg
}

/// A size for people.
fn bytes(bytes: u64) -> String {
    match bytes {
        0..10_000 => format!("{bytes} bytes"),
        10_000..10_000_000 => format!("{:.1} kB", bytes as f64 / 1e3),
        _ => format!("{:.1} MB", bytes as f64 / 1e6),
    }
}

fn escape(text: &str) -> String {
    text.replace('&', "&amp;").replace('<', "&lt;").replace('>', "&gt;").replace('"', "&quot;")
}

#[cfg(test)]
mod tests {
    use super::super::super::{plan::plan_with, *};
    use super::*;

    #[test]
    fn the_page_names_everything_and_escapes_it() {
        let mut g = FrameGraph::new(Extent::new(64, 32));
        let desc = ImageDesc::full(Format::R32Float);
        let noise = g.pass("a<b.make", Queue::Graphics, |p| (p.create("noise", desc).0, |_: &mut Record| {}));
        let smooth = g.pass("ao.blur", Queue::AsyncCompute, |p| {
            p.sample(noise.read());
            (p.create("smooth", desc).0, |_: &mut Record| {})
        });
        let _ = g.pass("ao.unused", Queue::Graphics, |p| (p.create("lost", desc).0, |_: &mut Record| {}));
        g.output(smooth.read());
        let frame = g.finish().unwrap();
        let plan = plan_with(&frame.declaration, "");
        let page = html(&frame.declaration, &plan);
        for expected in
            ["a&lt;b.make", "ao.blur", "async compute", "smooth", "64x32", "Left out", "ao.unused", "16.4 kB"]
        {
            assert!(page.contains(expected), "{expected} is missing");
        }
        assert!(!page.contains("a<b") && !page.contains("http"), "names are escaped, nothing is fetched");
        assert_eq!(page.matches("class=\"pass\"").count(), 2);
        assert_eq!(page.matches("class=\"transient\"").count(), 2);
    }

    #[test]
    fn an_empty_frame_has_a_page() {
        let frame = FrameGraph::new(Extent::new(1, 1)).finish().unwrap();
        assert!(html(&frame.declaration, &plan_with(&frame.declaration, "")).contains("0 passes"));
    }
}
