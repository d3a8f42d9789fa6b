//! Looking into the outputs of passes.
#![allow(clippy::unwrap_used, reason = "the helpers of tests fail as tests do")]

use std::{collections::HashSet, fs};

use serde_json::json;

mod window;
use window::*;

/// Outputs of passes in place of the picture: identifiers, depth, an image of half the size; what the frame does not have leaves the picture.
#[test]
fn outputs_of_passes_are_inspected() {
    let Some(display) = display() else { return };
    let folder = tempfile::tempdir().unwrap();
    let folder = folder.path();
    let inspect = |pass: &str, output: &str| json!({"inspect": [pass, output]});
    let steps = [
        (0, json!("panels")),
        (5, json!({"screenshot": "picture.png"})),
        (5, json!({"export": "before.csv"})),
        (6, inspect("gbuffer.draw", "ids")),
        (9, json!({"screenshot": "ids.png"})),
        (10, inspect("gbuffer.draw", "depth")),
        (14, json!({"screenshot": "depth.png"})),
        (15, json!({"inspect_as": {"colours": "plain", "range": [0, 1], "exposure": -20}})),
        (17, json!({"screenshot": "dark.png"})),
        (18, inspect("shadows.trace", "visibility")),
        (21, json!({"screenshot": "half.png"})),
        (22, json!({"pick": [60, 75]})),
        (25, json!({"screenshot": "picked.png"})),
        (26, json!({"pick": null})),
        (26, json!({"inspect_as": {"channel": "x"}})),
        (27, inspect("ao.search", "found")), // off
        (30, json!({"screenshot": "absent.png"})),
        (31, inspect("direct.shade", "no_such")),
        (33, inspect("rays.heat_map", "colours")), // left out unless it is inspected
        (36, json!({"screenshot": "heat.png"})),
        (37, json!({"set": "stages.rays=off"})),
        (40, json!({"screenshot": "gone.png"})),
        (41, inspect("direct.shade", "radiance")),
        (41, json!({"compare": true})),
        (44, json!("panels")),
        (46, json!({"panel": "graph"})),
        (47, json!("swap")),
        (50, json!({"compare": false})),
        (51, inspect("gbuffer.draw", "normal")),
        (51, json!({"inspect_as": {"zoom": 8, "centre": [0.9, 0.1]}})),
        (52, json!({"resize": [420, 310]})),
        (56, json!({"open": "builtin:carousel"})),
        (59, json!("inspect_nothing")),
        (59, json!({"pick": [1, 1]})),
        (60, json!({"inspect_as": {"exposure": 1}})),
    ];
    let script = actions(folder, &steps);
    let mut arguments = vec!["builtin:cornell", "--actions", script, "--frames", "64", "--check"];
    for set in ["stages.gi=off", "stages.ao=off", "stages.reflections=off", "stages.rays=heat-map"] {
        arguments.extend(["--set", set]);
    }
    arguments.extend(["--set", "shadows.resolution=half"]);
    done(&view(Some(display.name()), folder, &arguments));

    let picture = |name: &str| image::open(folder.join(name)).unwrap().into_rgb8();
    let colours = |name: &str| picture(name).pixels().map(|pixel| pixel.0).collect::<HashSet<_>>();
    // The walls, the boxes and the lamp; a colour for each, which no light changes.
    let ids = colours("ids.png");
    assert!((6..40).contains(&ids.len()) && colours("picture.png").len() > 200, "{ids:?}");
    // The range of false colours is that of the values.
    let depth = colours("depth.png");
    assert!(depth.contains(&[68, 1, 84]) && depth.contains(&[253, 231, 37]), "{} colours", depth.len());
    assert_eq!(colours("dark.png"), [[0; 3]].into());
    let half = picture("half.png");
    let blocks = |picture: &image::RgbImage| {
        let whole =
            |x: u32, y: u32| (0..4).all(|at| picture.get_pixel(x + at % 2, y + at / 2) == picture.get_pixel(x, y));
        (0..150).flat_map(|y| (0..200).map(move |x| (2 * x, 2 * y))).filter(|&(x, y)| whole(x, y)).count()
    };
    assert_eq!(half.dimensions(), (400, 300));
    assert!(blocks(&half) == 30_000 && blocks(&picture("picture.png")) < 25_000, "{}", blocks(&half));
    assert!(colours("half.png").len() > 1);
    // The pixel that is picked has a frame, and its values beside it.
    let picked = picture("picked.png");
    for (x, y) in [(118, 150), (123, 150), (127, 165)] {
        let [before, after] = [&half, &picked].map(|picture| picture.get_pixel(x, y).0[0]);
        assert!(before == 255 && after < 100, "{x} {y}: {before}, then {after}");
    }
    // Where there is no such image the picture is shown: it is as bright, however its noise falls.
    let all = [0.0, 0.0, 1.0, 1.0];
    let [shown, absent, gone, heat] =
        ["picture.png", "absent.png", "gone.png", "heat.png"].map(|name| mean(&folder.join(name), all)[1]);
    for same in [absent, gone] {
        assert!((same / shown - 1.0).abs() < 0.02, "{same} instead of {shown}");
    }
    assert!((heat / shown - 1.0).abs() > 0.1, "{heat} as {shown}");
    // What is not inspected costs nothing.
    assert!(!fs::read_to_string(folder.join("before.csv")).unwrap().contains("inspect."));
}
