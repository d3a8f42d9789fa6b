//! Colours and type. The fills are Paul Tol's light scheme, which suits black labels and all kinds of colour vision (Tol, "Colour
//! schemes", SRON technical note, 2021); marks also differ in shape.

use super::{
    super::super::{declaration::Declaration, plan::Plan},
    escape,
};

/// Fills of stages, by the order of their declaration.
const FILLS: [&str; 8] = ["#77aadd", "#ee8866", "#eedd88", "#ffaabb", "#99ddff", "#44bb99", "#bbcc33", "#aaaa00"];

pub(super) const STYLE: &str = "\
:root{color-scheme:light}\
body{font:15px/1.5 system-ui,'Segoe UI','Noto Sans','DejaVu Sans',sans-serif;margin:28px auto;padding:0 24px;max-width:1340px;color:#1d2129;background:#fff}\
header{display:flex;align-items:baseline;gap:18px;flex-wrap:wrap}h1{font-size:26px;margin:0}h2{font-size:18px;margin:30px 0 8px}p{margin:0;color:#4a5160}\
dl{display:grid;grid-template-columns:repeat(auto-fit,minmax(178px,1fr));gap:1px;margin:16px 0;background:#d9dde3;border:1px solid #d9dde3;border-radius:8px;overflow:hidden}\
dl div{background:#f7f8fa;padding:9px 14px}dt{font-size:12.5px;color:#4a5160}dd{margin:0;font-size:20px;font-weight:600;font-variant-numeric:tabular-nums}\
dd small{display:block;font-size:12.5px;font-weight:400;color:#4a5160}\
dd i{display:block;height:5px;margin:5px 0 2px;background:#d9dde3;border-radius:3px;overflow:hidden}dd i b{display:block;height:5px;background:#4477aa}\
ul{display:flex;flex-wrap:wrap;gap:4px 18px;list-style:none;margin:0 0 6px;padding:0;font-size:13px}li{display:flex;align-items:center;gap:6px}\
li span{width:16px;height:12px;border-radius:3px;border:1px solid #0003}li svg{display:block}\
figure{display:flex;margin:0;overflow-x:auto}figure svg{flex:none;font:12px system-ui,'Segoe UI','Noto Sans','DejaVu Sans',sans-serif}\
svg.names{position:sticky;left:0;background:#fff;z-index:1}\
text{fill:#1d2129;pointer-events:none}.head,.names text{pointer-events:auto}.head{font-size:12px}\
.heading{font-size:15px;font-weight:600}.row{font-size:12.5px}.more,.tick{fill:#4a5160;font-size:12px}.small{font-size:10px;fill:#4a5160}\
.grid{stroke:#eceef2;fill:none}.lane{fill:#f3f4f7}.batch{fill:#fff;stroke:#6b7280;stroke-width:1.2}\
.pass{stroke:#0005}.pass:hover,.life:hover,.bar:hover{stroke:#000;stroke-width:2}.weak{stroke-dasharray:3 2;stroke:#000}\
.number{font-size:12px;font-weight:600;text-anchor:middle}\
.before,.after{fill:#882255;stroke:#fff;stroke-width:1.2}.after{fill:#332288}.count{fill:#fff;font-size:9.5px;font-weight:700;text-anchor:middle}\
.wait{fill:none;stroke:#332288;stroke-width:2.2;marker-end:url(#tip)}.wait:hover{stroke-width:4}.last{stroke-dasharray:5 4;stroke-width:1.4}.tip{fill:#332288}\
.life{stroke:#0006}.held{fill-opacity:.22;stroke:#0004;stroke-dasharray:3 3}.end{fill:none;stroke:#6b7280;stroke-dasharray:3 3}.frame{fill:none;stroke:#6b7280}\
.bound{stroke:#882255;stroke-width:2;stroke-dasharray:7 5;fill:none}.boundtext{fill:#882255;font-size:12px;font-weight:600;paint-order:stroke;stroke:#fff;stroke-width:4px}\
.bar{fill:#dddddd;stroke:#0005}.kept{fill:#99ddff}.history{fill:#bbcc33}.write{fill:#1d2129;stroke:#1d2129}.read{fill:#fff;stroke:#1d2129}\
table{border-collapse:collapse;font-size:13.5px}th{text-align:left;font-weight:600;color:#4a5160}td,th{padding:3px 18px 3px 0;vertical-align:top;border-bottom:1px solid #eceef2}\
td.n,th.n{text-align:right;font-variant-numeric:tabular-nums}summary{cursor:pointer;font-size:18px;font-weight:600;margin:26px 0 8px}";

/// The fill of a stage.
pub(super) fn fill(declaration: &Declaration, stage: &str) -> &'static str {
    let at = stages(declaration).iter().position(|s| *s == stage);
    at.map_or("#dddddd", |at| FILLS[at % FILLS.len()])
}

/// The stages in the order of their declaration, so that a frame has the same colours in every plan.
fn stages(declaration: &Declaration) -> Vec<&str> {
    let mut stages: Vec<&str> = Vec::new();
    for pass in 0..declaration.passes.len() as u32 {
        let stage = declaration.stage(pass);
        if !stages.contains(&stage) {
            stages.push(stage);
        }
    }
    stages
}

/// Legend of the colours and marks.
pub(super) fn legend(declaration: &Declaration, plan: &Plan) -> String {
    let runs = |stage: &&&str| plan.order.iter().any(|&p| declaration.stage(p) == **stage);
    let stages: String = stages(declaration)
        .iter()
        .filter(runs)
        .map(|s| format!("<li><span style=\"background:{}\"></span>{}</li>", fill(declaration, s), escape(s)))
        .collect();
    let mark = |shape: &str, width: u32, words: &str| {
        format!("<li><svg width=\"{width}\" height=\"16\">{shape}</svg>{words}</li>")
    };
    let marks = [
        mark("<circle class=\"before\" cx=\"8\" cy=\"8\" r=\"7\"/>", 16, "barriers before a pass"),
        mark("<path class=\"after\" d=\"M8 0l8 8l-8 8l-8-8z\"/>", 16, "barriers after it, for other queues"),
        mark("<path class=\"wait\" d=\"M0 8h24\"/>", 26, "wait on a timeline semaphore"),
        mark(
            "<rect class=\"held\" x=\".5\" y=\"1.5\" width=\"15\" height=\"12\" fill=\"#77aadd\"/>",
            16,
            "memory held all frame",
        ),
        mark("<path class=\"bound\" d=\"M0 8h26\"/>", 26, "least memory that could do"),
        mark("<circle class=\"write\" cx=\"6\" cy=\"8\" r=\"4\"/>", 12, "written"),
        mark("<circle class=\"read\" cx=\"6\" cy=\"8\" r=\"4\"/>", 12, "read"),
    ];
    format!("<ul>{stages}</ul><ul>{}</ul>", marks.concat())
}
