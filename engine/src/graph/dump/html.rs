//! The plan as one self-contained page: the graph's savings, passes on one lane per queue, memory below them, and culled passes.
//! Details are tooltips. No scripts, nothing is fetched.

mod imports;
mod lanes;
mod memory;
mod sheet;
mod style;
mod tables;

use super::{Dump, describe::made_for};
use sheet::Sheet;

/// The whole page.
pub(super) fn html(dump: &Dump<'_>) -> String {
    let mut sheet = Sheet::new(dump);
    lanes::draw(dump, &mut sheet);
    memory::draw(dump, &mut sheet);
    imports::draw(dump, &mut sheet);
    let style = style::STYLE;
    let lead = format!("{} pixels, {}.", dump.declaration.full, made_for(dump.plan));
    let parts = [
        format!(
            "<!doctype html>\n<html lang=\"en\"><meta charset=\"utf-8\"><title>Frame graph</title><style>{style}</style>"
        ),
        format!("<header><h1>Frame graph</h1><p>{}</p></header>", escape(&lead)),
        tables::gains(&dump.gains),
        style::legend(dump.declaration, dump.plan),
        sheet.finish(),
        tables::left_out(dump),
        tables::transients(dump),
        "</html>\n".to_owned(),
    ];
    parts.join("\n")
}

/// Escapes a text so that it is safe in an element or an attribute.
fn escape(text: &str) -> String {
    text.replace('&', "&amp;").replace('<', "&lt;").replace('>', "&gt;").replace('"', "&quot;").replace('\'', "&#39;")
}
