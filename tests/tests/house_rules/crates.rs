//! Rules about dependencies between crates, unsafe code, barriers and panics.

use super::code::{code, code_without_tests, lines_with, lines_with_word, test_files};
use super::tree::Tree;
use std::collections::BTreeMap;

/// The only folder that may use ash and unsafe code.
const GPU: &str = "engine/src/gpu/";
/// The only file that records a barrier into a command buffer, and the only folder that may ask it to.
const ENCODER: &str = "engine/src/gpu/encoder.rs";
const EXECUTE: &str = "engine/src/graph/execute/";

/// Files of the benchmark that may use Vulkan directly: the hand-written baseline, and a library whose interface consists of Vulkan types.
const BENCH_VULKAN: [&str; 2] = [FLOOR, "tests/bench/src/vk_graph.rs"];
/// Files of the benchmark with unsafe code: the hand-written baseline, a library with an unsafe interface, and the counting allocator,
/// whose trait is unsafe to implement.
const BENCH_UNSAFE: [&str; 3] = [FLOOR, "tests/bench/src/vulkano.rs", "tests/bench/src/allocations.rs"];
/// The hand-written baseline, which places its barriers itself.
const FLOOR: &str = "tests/bench/src/floor.rs";
/// The example of an application with a Vulkan device of its own. It has the bindings from Magpie.
const EMBED: &str = "demo/examples/embed.rs";

/// The crates of the workspace with their allowed dependencies.
const MAY_DEPEND: [(&str, &[&str]); 8] = [
    ("magpie-shaders", &[]),
    ("magpie", &["magpie-shaders"]),
    ("magpie-passes", &["magpie", "magpie-shaders"]),
    ("magpie-bench", &["magpie", "magpie-passes", "magpie-shaders"]),
    ("magpie-accuracy", &["magpie", "magpie-bench", "magpie-passes", "magpie-shaders"]),
    ("magpie-demo", &["magpie", "magpie-accuracy", "magpie-bench", "magpie-passes", "magpie-shaders"]),
    ("magpie-tests", &["magpie", "magpie-accuracy", "magpie-bench", "magpie-demo", "magpie-passes", "magpie-shaders"]),
    ("xtask", &[]),
];

/// The packages of the workspace: path of the manifest, name, and names of all dependencies.
fn packages(tree: &Tree) -> Vec<(&str, String, Vec<String>)> {
    let mut packages = Vec::new();
    for (path, text) in tree.texts().filter(|(path, _)| *path == "Cargo.toml" || path.ends_with("/Cargo.toml")) {
        let manifest: toml::Table = text.parse().unwrap_or_else(|error| panic!("{path}: {error}"));
        let name = manifest.get("package").and_then(|package| package.get("name")).and_then(toml::Value::as_str);
        let Some(name) = name else { continue }; // the workspace itself
        let mut dependencies = Vec::new();
        dependencies_of(&manifest, &mut dependencies);
        packages.push((path, name.to_owned(), dependencies));
    }
    packages
}

/// Dependencies of every kind, target-specific ones included, by their package names.
fn dependencies_of(manifest: &toml::Table, found: &mut Vec<String>) {
    for (key, value) in manifest {
        let Some(table) = value.as_table() else { continue };
        if ["dependencies", "dev-dependencies", "build-dependencies"].contains(&key.as_str()) {
            let name = |(name, value): (&String, &toml::Value)| {
                value.get("package").and_then(toml::Value::as_str).unwrap_or(name).to_owned()
            };
            found.extend(table.iter().map(name));
        } else if key == "target" {
            table.values().filter_map(toml::Value::as_table).for_each(|target| dependencies_of(target, found));
        }
    }
}

/// Dependencies point in one direction: demo and tests, passes, engine, shaders.
pub fn dependencies(tree: &Tree) -> Vec<String> {
    let allowed = BTreeMap::from(MAY_DEPEND);
    let mut faults = Vec::new();
    for (path, name, dependencies) in packages(tree) {
        let Some(may) = allowed.get(name.as_str()) else {
            faults.push(format!("{path}: the crate {name} has no place in the order of the crates"));
            continue;
        };
        let own = dependencies.iter().filter(|dependency| allowed.contains_key(dependency.as_str()));
        for dependency in own.filter(|dependency| !may.contains(&dependency.as_str())) {
            faults.push(format!("{path}: {name} may not depend on {dependency}, only on {may:?}"));
        }
    }
    faults
}

/// Only the GPU layer uses ash, under its own name or as the `vk` that it exports. The benchmark's named files may too, and the example of
/// embedding.
pub fn vulkan(tree: &Tree) -> Vec<String> {
    let mut faults = Vec::new();
    for (path, name, dependencies) in packages(tree) {
        if !["magpie", "magpie-bench"].contains(&name.as_str())
            && dependencies.iter().any(|dependency| dependency == "ash")
        {
            faults.push(format!("{path}: {name} may not depend on ash"));
        }
    }
    let outside = |path: &str| !path.starts_with(GPU) && !BENCH_VULKAN.contains(&path) && path != EMBED;
    for (path, text) in tree.rust().filter(|(path, _)| outside(path)) {
        let code = code(text);
        for word in ["ash", "vk"] {
            faults.extend(lines_with_word(&code, word).map(|line| format!("{path}:{line}: {word}")));
        }
    }
    faults
}

/// No unsafe code outside the GPU layer, not even in tests. The benchmark's named files are exempt, and the example of embedding.
pub fn unsafe_code(tree: &Tree) -> Vec<String> {
    let outside = |path: &str| !path.starts_with(GPU) && !BENCH_UNSAFE.contains(&path) && path != EMBED;
    tree.rust()
        .filter(|(path, _)| outside(path))
        .flat_map(|(path, text)| {
            let code = code(text);
            lines_with_word(&code, "unsafe").map(|line| format!("{path}:{line}: unsafe")).collect::<Vec<_>>()
        })
        .collect()
}

/// Lines before an unsafe block in which its `SAFETY:` comment may begin, for long comments and statements of several lines.
const REASON_WITHIN: usize = 12;

/// Every unsafe block and unsafe impl has its own comment with `SAFETY:` in the lines before it.
pub fn safety_comments(tree: &Tree) -> Vec<String> {
    let mut faults = Vec::new();
    for (path, text) in tree.rust() {
        let code = code(text);
        let original: Vec<&str> = text.lines().collect();
        let mut free_from = 0; // the first line that no earlier block has claimed
        for (index, line) in code.lines().enumerate() {
            let Some(at) = lines_with_word(line, "unsafe").next().and(line.find("unsafe")) else { continue };
            let rest = line[at + "unsafe".len()..].trim_start();
            let next =
                code.lines().skip(index + 1).map(str::trim_start).find(|line| !line.is_empty()).unwrap_or_default();
            let opens = rest.starts_with('{') || rest.starts_with("impl") || (rest.is_empty() && next.starts_with('{'));
            if !opens {
                continue; // an unsafe function: its callers state the reason
            }
            let from = free_from.max(index.saturating_sub(REASON_WITHIN));
            if !original[from..=index].iter().any(|line| line.contains("SAFETY:")) {
                faults.push(format!("{path}:{}: unsafe without a SAFETY comment of its own", index + 1));
            }
            free_from = index + 1;
        }
    }
    faults
}

/// Barriers are recorded in one place and asked for in one place. The baseline and the example of embedding record their own.
pub fn barriers(tree: &Tree) -> Vec<String> {
    let mut faults = Vec::new();
    for (path, text) in tree.rust() {
        let code = code(text);
        for (part, home) in [("cmd_pipeline_barrier", ENCODER), ("cmd_wait_events", ENCODER), (".barriers(", EXECUTE)] {
            let by_hand = [FLOOR, EMBED].contains(&path) && part == "cmd_pipeline_barrier";
            if !path.starts_with(home) && !by_hand {
                faults
                    .extend(lines_with(&code, part).map(|line| format!("{path}:{line}: `{part}` belongs into {home}")));
            }
        }
    }
    faults
}

/// No `unwrap`, `expect` or `panic` outside tests: errors are values.
pub fn panics(tree: &Tree) -> Vec<String> {
    let tests = test_files(tree);
    let is_test = |path: &str| {
        let ships = ["tests/xtask/", "tests/bench/"].iter().any(|part| path.starts_with(part));
        let in_crate = path.starts_with("tests/") && !ships;
        let beside = path.contains("/tests/")
            && !["tests/xtask/src/", "tests/bench/src/"].iter().any(|src| path.starts_with(src));
        in_crate || beside || tests.contains(path)
    };
    let mut faults = Vec::new();
    for (path, text) in tree.rust().filter(|(path, _)| !is_test(path)) {
        let code = code_without_tests(text);
        for part in [".unwrap()", ".expect(", "panic!("] {
            faults.extend(lines_with(&code, part).map(|line| format!("{path}:{line}: `{part}`")));
        }
    }
    faults
}

fn one_fault(rule: fn(&Tree) -> Vec<String>, files: &[(&str, &str)], part: &str) {
    let faults = rule(&Tree::of(files));
    assert!(faults.len() == 1 && faults[0].contains(part), "wanted one fault with `{part}`, got {faults:?}");
}

#[test]
fn a_dependency_against_the_order_is_found() {
    let fine = (
        "passes/Cargo.toml",
        "[package]\nname = \"magpie-passes\"\n[dependencies]\nmagpie.workspace = true\nglam = \"1\"",
    );
    assert_eq!(dependencies(&Tree::of(&[fine])), [""; 0]);
    for table in ["dependencies", "dev-dependencies", "build-dependencies", "target.'cfg(unix)'.dependencies"] {
        let text = format!("[package]\nname = \"magpie\"\n[{table}]\nmagpie-passes.workspace = true");
        one_fault(dependencies, &[fine, ("engine/Cargo.toml", &text)], "magpie may not depend on magpie-passes");
    }
    let renamed =
        "[package]\nname = \"magpie-shaders\"\n[dependencies]\nbird = { package = \"magpie\", path = \"../engine\" }";
    one_fault(dependencies, &[("shaders/Cargo.toml", renamed)], "magpie-shaders may not depend on magpie,");
    one_fault(dependencies, &[("new/Cargo.toml", "[package]\nname = \"new\"")], "no place");
}

#[test]
fn ash_outside_the_gpu_layer_is_found() {
    let fine =
        [("engine/src/gpu/mod.rs", "use ash::vk;"), ("engine/src/lib.rs", "// ash::vk\nlet x = hash::of(slash::y);")];
    assert_eq!(vulkan(&Tree::of(&fine)), [""; 0]);
    one_fault(vulkan, &[("engine/src/graph/execute/mod.rs", "let x: ash::Device;")], "execute/mod.rs:1: ash");
    one_fault(vulkan, &[("passes/src/a/mod.rs", "fn f() -> vk::Format {}")], "passes/src/a/mod.rs:1: vk");
    one_fault(vulkan, &[("demo/src/a.rs", "use magpie::gpu::{Device, vk};")], "demo/src/a.rs:1: vk");
    assert_eq!(vulkan(&Tree::of(&BENCH_VULKAN.map(|path| (path, "use ash::vk;")))), [""; 0]);
    one_fault(vulkan, &[("tests/bench/src/magpie.rs", "use x::vk;")], "tests/bench/src/magpie.rs:1: vk");
    one_fault(
        vulkan,
        &[("demo/Cargo.toml", "[package]\nname = \"magpie-demo\"\n[dependencies]\nash = \"1\"")],
        "depend on ash",
    );
}

#[test]
fn unsafe_code_outside_the_gpu_layer_is_found() {
    let word = ["un", "safe"].concat();
    let block = format!("\nfn f() {{ {word} {{ g() }} }}");
    let lint = format!("#![deny({word}_code)] // {word}\nlet x = \"{word}\";");
    assert_eq!(unsafe_code(&Tree::of(&[("engine/src/gpu/a.rs", &block), ("engine/src/lib.rs", &lint)])), [""; 0]);
    one_fault(unsafe_code, &[("engine/src/ray/a.rs", &block)], "engine/src/ray/a.rs:2");
    one_fault(unsafe_code, &[("demo/src/a.rs", &block)], "demo/src/a.rs:2");
    assert_eq!(unsafe_code(&Tree::of(&BENCH_UNSAFE.map(|path| (path, block.as_str())))), [""; 0]);
    one_fault(unsafe_code, &[("tests/bench/src/vk_graph.rs", &block)], "tests/bench/src/vk_graph.rs:2");
}

#[test]
fn an_unsafe_block_without_a_reason_is_found() {
    let word = ["un", "safe"].concat();
    let block = format!("{word} {{ f() }}");
    let reason = "// SAFETY: f has no condition.";
    let path = "engine/src/gpu/a.rs";
    let fine = format!("{reason}\n{block}\n{reason}\nlet x =\n    {block};\n{word} fn g() {{}}\n// {block}");
    assert_eq!(safety_comments(&Tree::of(&[(path, &fine)])), [""; 0]);
    one_fault(safety_comments, &[(path, &block)], ":1:");
    one_fault(safety_comments, &[(path, &format!("{reason}\n{block}\n{block}"))], ":3:");
    one_fault(safety_comments, &[(path, &format!("{reason}\n{}{block}", "\n".repeat(REASON_WITHIN)))], "own");
    one_fault(safety_comments, &[(path, &format!("{word} impl Send for X {{}}"))], ":1:");
    one_fault(safety_comments, &[(path, &format!("{word}\n{{ f() }}"))], ":1:");
}

#[test]
fn a_barrier_outside_the_graph_is_found() {
    let record = "device.cmd_pipeline_barrier2(buffer, &info)";
    let fine = [
        (ENCODER, record),
        ("engine/src/graph/execute/commands.rs", "encoder.barriers(&batch)"),
        (FLOOR, record),
        ("engine/src/graph/plan/a.rs", "plan.barriers.len()"),
    ];
    assert_eq!(barriers(&Tree::of(&fine)), [""; 0]);
    one_fault(barriers, &[("engine/src/gpu/image.rs", record)], ENCODER);
    one_fault(barriers, &[("tests/bench/src/vk_graph.rs", record)], ENCODER);
    one_fault(barriers, &[(FLOOR, "c.barriers(&[x])")], EXECUTE);
    one_fault(barriers, &[("passes/src/a/mod.rs", "c.barriers(&[x])")], EXECUTE);
}

#[test]
fn a_panic_outside_tests_is_found() {
    let test = "#[cfg(test)]\nmod tests { fn f() { x.unwrap() } }";
    let fine = [
        ("engine/src/a.rs", test),
        ("engine/src/b.rs", "x.unwrap_or(1); // .unwrap()\n#[cfg(test)]\nmod tests;"),
        ("engine/src/b/tests.rs", "x.unwrap()"),
        ("engine/tests/c.rs", "x.unwrap()"),
        ("tests/src/lib.rs", "x.unwrap()"),
        ("tests/bench/tests/c.rs", "x.unwrap()"),
    ];
    assert_eq!(panics(&Tree::of(&fine)), [""; 0]);
    for part in ["x.unwrap();", "x.expect(\"y\");", "panic!(\"z\");"] {
        one_fault(panics, &[("passes/src/a/mod.rs", &format!("{test}\n{part}"))], "passes/src/a/mod.rs:3");
        one_fault(panics, &[("tests/xtask/src/main.rs", part)], "tests/xtask/src/main.rs:1");
        one_fault(panics, &[("tests/bench/src/run.rs", part)], "tests/bench/src/run.rs:1");
    }
}
