//! Parameters of built-in scenes.

use super::refused;

/// Every command that takes a scene refuses them alike.
#[test]
fn parameters_of_built_in_scenes() {
    let folder = tempfile::tempdir().unwrap();
    let commands: [&[&str]; 8] = [
        &["render"],
        &["view", "--frames", "1"],
        &["plan"],
        &["reference", "--samples", "1", "--out", "o.exr"],
        &["accuracy", "--quick", "--out", "report"],
        &["bench", "rays", "--scene"],
        &["bench", "motion"],
        &["bench", "pairs"],
    ];
    for command in commands {
        let arguments = [command, &["builtin:night-market?lights=9"]].concat();
        refused(folder.path(), &arguments, 2, &["night-market", "lights", "\"9\"", "10 to 100000"]);
    }
    for (scene, names) in [
        ("builtin:night-market?lights=100001", &["\"100001\"", "10 to 100000"][..]),
        ("builtin:night-market?lights=many", &["\"many\"", "a whole number"]),
        ("builtin:night-market?lights=-10", &["\"-10\"", "a whole number"]),
        ("builtin:night-market?lights=10&lights=10", &["lights", "twice"]),
        ("builtin:night-market?light=10", &["\"light\"", "did you mean \"lights\"", "known: lights"]),
        ("builtin:night-market?", &["KEY=VALUE"]),
        ("builtin:night-market?lights", &["KEY=VALUE", "\"lights\""]),
        ("builtin:cornell?lights=10", &["cornell", "\"lights\"", "no parameters"]),
        ("builtin:night-markt?lights=10", &["did you mean \"night-market\""]),
    ] {
        refused(folder.path(), &["plan", scene], 2, names);
    }
}
