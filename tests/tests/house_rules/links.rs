//! Links in the documentation.

use super::tree::Tree;

/// Every local link and image of a Markdown file leads to a file or folder of the repository.
pub fn local(tree: &Tree) -> Vec<String> {
    let mut faults = Vec::new();
    for (path, text) in tree.texts().filter(|(path, _)| path.ends_with(".md")) {
        for (line, target) in targets(text) {
            let file = target.split(['#', '?']).next().unwrap_or_default();
            let elsewhere = target.contains("://") || target.starts_with("mailto:");
            if !elsewhere && !file.is_empty() && !resolve(path, file).is_some_and(|file| tree.has(&file)) {
                faults.push(format!("{path}:{line}: {target} is not there"));
            }
        }
    }
    faults
}

/// The link targets of a Markdown text with their lines: inline links and images, definitions, and HTML.
fn targets(text: &str) -> Vec<(usize, String)> {
    let mut targets = Vec::new();
    let mut fenced = false;
    for (index, line) in text.lines().enumerate() {
        if line.trim_start().starts_with("```") {
            fenced = !fenced;
        }
        if fenced {
            continue;
        }
        // Every second part between backticks is code.
        let prose: String = line.split('`').step_by(2).collect::<Vec<_>>().join("code");
        let mut add = |rest: &str, end: &[char]| {
            let target = rest.split(end).next().unwrap_or_default().trim_matches(['<', '>']);
            targets.push((index + 1, target.to_owned()));
        };
        prose.match_indices("](").for_each(|(at, mark)| add(&prose[at + mark.len()..], &[')', ' ']));
        for attribute in ["src=\"", "href=\""] {
            prose.match_indices(attribute).for_each(|(at, mark)| add(&prose[at + mark.len()..], &['"']));
        }
        if let Some((name, rest)) = prose.trim_start().split_once("]: ")
            && name.starts_with('[')
        {
            add(rest, &[' ']);
        }
    }
    targets
}

/// The path from the root of `target` in the file `from`; `None` if it leaves the repository.
fn resolve(from: &str, target: &str) -> Option<String> {
    let folder = from.rsplit_once('/').map_or("", |(folder, _)| folder);
    let mut parts: Vec<&str> = if target.starts_with('/') { Vec::new() } else { folder.split('/').collect() };
    parts.retain(|part| !part.is_empty());
    for part in target.split('/') {
        match part {
            "" | "." => {}
            ".." => drop(parts.pop()?),
            name => parts.push(name),
        }
    }
    Some(parts.join("/"))
}

#[test]
fn a_link_into_the_void_is_found() {
    let files =
        |text: &'static str| local(&Tree::of(&[("docs/a.md", text), ("docs/images/b.png", ""), ("README.md", "")]));
    let fine = "[x](../README.md#top) ![y](images/b.png \"title\") <img src=\"images/b.png\"> [z](#here) [w](https://a.example/c)\n\
                [d]: images/\n`[c](none.md)`\n```\n[e](none.md)\n```\n[f](<../README.md>)";
    assert_eq!(files(fine), [""; 0]);
    for broken in [
        "[x](none.md)",
        "![y](images/c.png)",
        "<img src=\"c.png\">",
        "[d]: none.md",
        "[x](../../README.md)",
        "```\n```\n[x](b.png)",
    ] {
        assert_eq!(files(broken).len(), 1, "{broken}");
    }
}
