//! Resources that outlive the frame, as bars: histories, kept buffers, and imports of the caller.

use super::{
    super::{
        super::declaration::{ImportKey, Origin},
        Dump,
        describe::{Describer, bytes, life, origin},
    },
    sheet::{Area, NAMES, Sheet, shortened},
};

/// Height of a row, pixels.
const ROW: f64 = 22.0;
/// Average width of a letter of a name, pixels.
const LETTER: f64 = 6.6;

/// Draws a row for each import that is used.
pub(super) fn draw(dump: &Dump<'_>, sheet: &mut Sheet) {
    let Dump { declaration, plan, .. } = *dump;
    let describer = Describer(declaration);
    let rank = |o: Origin| match o {
        Origin::Imported { key: ImportKey::Previous(index), .. } => (0, index, 0),
        Origin::Imported { key: ImportKey::Next(index), .. } => (0, index, 1),
        Origin::Imported { key: ImportKey::Kept(index), .. } => (1, index, 0),
        Origin::Imported { key: ImportKey::Caller(key), .. } => (2, key, 0),
        Origin::Transient => (3, 0, 0),
    };
    let mut rows: Vec<u32> = (0..declaration.resources.len() as u32)
        .filter(|&r| !declaration.resources[r as usize].is_transient() && plan.lifetimes[r as usize].is_some())
        .collect();
    if rows.is_empty() {
        return;
    }
    rows.sort_by_key(|&r| (rank(declaration.resources[r as usize].origin), r));
    sheet.heading(
        "Beyond the frame",
        "Histories, kept buffers and imports: they have memory of their own and share it with nobody.",
    );
    let top = sheet.y;
    for resource in rows {
        let decl = &declaration.resources[resource as usize];
        let Some(lived) = plan.lifetimes[resource as usize] else { continue };
        let name = declaration.resource_name(resource);
        let mut tooltip = vec![
            format!("{name} ({})", origin(decl.origin)),
            describer.shape(decl.shape),
            bytes(lived.bytes),
            life(&lived),
        ];
        if let Origin::Imported { leave: Some((access, domain)), .. } = decl.origin {
            tooltip.push(format!("left ready for {access} ({})", domain.name()));
        }
        let tooltip = tooltip.join("\n");
        let kind = match decl.origin {
            Origin::Imported { key: ImportKey::Previous(_) | ImportKey::Next(_), .. } => "history",
            Origin::Imported { key: ImportKey::Kept(_), .. } => "kept",
            Origin::Imported { key: ImportKey::Caller(_), .. } | Origin::Transient => "imported",
        };
        let (y, x) = (sheet.y, sheet.left(lived.first as usize) + 2.0);
        let room = ((NAMES - 16.0) / LETTER) as usize;
        sheet.name(y + 15.0, "row", &shortened(&name, room), &tooltip);
        let area = Area { x, y: y + 5.0, width: sheet.left(lived.last as usize + 1) - 2.0 - x, height: ROW - 10.0 };
        sheet.area(area, &format!("class=\"bar {kind}\" rx=\"3\""), &tooltip);
        for (position, &pass) in plan.order.iter().enumerate() {
            let mut uses = declaration.uses_of(pass).iter().filter(|u| u.resource == resource).peekable();
            if uses.peek().is_some() {
                let class = if uses.any(|u| u.access.writes()) { "write" } else { "read" };
                let (cx, cy) = (sheet.middle(position), y + ROW / 2.0);
                sheet.draw(&format!(
                    "<circle class=\"{class}\" cx=\"{cx:.1}\" cy=\"{cy:.1}\" r=\"4\" pointer-events=\"none\"/>"
                ));
            }
        }
        sheet.y += ROW;
    }
    sheet.grid(top, sheet.y);
    sheet.y += 8.0;
}
