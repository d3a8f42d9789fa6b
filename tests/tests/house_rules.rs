//! Enforces the rules of the architecture page.
//!
//! Each rule is a function from a file tree to the places that break it, and each is tested on a small tree that breaks it.
#![allow(clippy::unwrap_used)] // helpers of tests may panic

#[path = "house_rules/code.rs"]
mod code;
#[path = "house_rules/crates.rs"]
mod crates;
#[path = "house_rules/effects.rs"]
mod effects;
#[path = "house_rules/files.rs"]
mod files;
#[path = "house_rules/links.rs"]
mod links;
#[path = "house_rules/tree.rs"]
mod tree;

use tree::Tree;

/// Fails with every place in the repository that breaks `rule`.
fn hold(rule: fn(&Tree) -> Vec<String>) {
    let faults = rule(&Tree::of_repository());
    assert!(faults.is_empty(), "{} broken:\n  {}", faults.len(), faults.join("\n  "));
}

#[test]
fn the_repository_is_read() {
    let tree = Tree::of_repository();
    for path in ["Cargo.toml", "engine/src/lib.rs", "passes/src/lib.rs", "tests/tests/house_rules.rs"] {
        assert!(tree.text(path).is_some(), "{path} was not found below {}", tree::root().display());
    }
}

#[test]
fn dependencies_point_one_way() {
    hold(crates::dependencies);
}

#[test]
fn only_the_gpu_layer_knows_ash() {
    hold(crates::vulkan);
}

#[test]
fn only_the_gpu_layer_is_unsafe() {
    hold(crates::unsafe_code);
}

#[test]
fn every_unsafe_block_says_why_it_is_sound() {
    hold(crates::safety_comments);
}

#[test]
fn only_the_graph_places_barriers() {
    hold(crates::barriers);
}

#[test]
fn nothing_outside_tests_can_panic_by_choice() {
    hold(crates::panics);
}

#[test]
fn effects_meet_only_in_the_stages() {
    hold(effects::imports);
}

#[test]
fn every_effect_has_its_four_folders() {
    hold(effects::four_folders);
}

#[test]
fn every_shared_part_has_its_page_and_tests() {
    hold(effects::parts);
}

#[test]
fn files_fit_in_the_head() {
    hold(files::length);
}

#[test]
fn nothing_is_left_for_later() {
    hold(files::marks);
}

#[test]
fn no_file_names_a_machine_or_a_registry() {
    hold(files::places);
}

#[test]
fn links_of_the_documentation_lead_somewhere() {
    hold(links::local);
}
