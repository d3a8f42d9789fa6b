//! Strips comments and strings from Rust source, with a minimal lexer.

use super::tree::Tree;
use std::collections::BTreeSet;

/// `text` with comments and the contents of strings and characters blanked; lines and columns stay.
pub fn code(text: &str) -> String {
    let source: Vec<char> = text.chars().collect();
    let mut out = String::with_capacity(text.len());
    let mut at = 0;
    while at < source.len() {
        let end = match source[at] {
            '/' if source.get(at + 1) == Some(&'/') => line_end(&source, at),
            '/' if source.get(at + 1) == Some(&'*') => comment_end(&source, at),
            '"' => string_end(&source, at),
            'r' | 'b' | 'c' if !follows_word(&source, at) => prefixed_end(&source, at),
            '\'' => character_end(&source, at),
            _ => at,
        };
        if end == at {
            out.push(source[at]);
            at += 1;
        } else {
            out.extend(source[at..end].iter().map(|&c| if c == '\n' { '\n' } else { ' ' }));
            at = end;
        }
    }
    out
}

fn is_word(c: char) -> bool {
    c.is_alphanumeric() || c == '_'
}

fn follows_word(source: &[char], at: usize) -> bool {
    at > 0 && is_word(source[at - 1])
}

fn line_end(source: &[char], at: usize) -> usize {
    source[at..].iter().position(|&c| c == '\n').map_or(source.len(), |length| at + length)
}

/// Block comments nest.
fn comment_end(source: &[char], at: usize) -> usize {
    let (mut depth, mut here) = (0, at);
    while here + 1 < source.len() {
        match (source[here], source[here + 1]) {
            ('/', '*') => (depth, here) = (depth + 1, here + 2),
            ('*', '/') => (depth, here) = (depth - 1, here + 2),
            _ => here += 1,
        }
        if depth == 0 {
            return here;
        }
    }
    source.len()
}

/// `at` is the index of the opening quote.
fn string_end(source: &[char], at: usize) -> usize {
    let mut here = at + 1;
    while here < source.len() {
        match source[here] {
            '\\' => here += 2,
            '"' => return here + 1,
            _ => here += 1,
        }
    }
    source.len()
}

/// The end of a string with a prefix (`r"`, `r#"`, `b"`, `br"`, `c"`), or `at` if it is only a name.
fn prefixed_end(source: &[char], at: usize) -> usize {
    let mut here = at;
    while here < source.len() && matches!(source[here], 'r' | 'b' | 'c') && here - at < 2 {
        here += 1;
    }
    let raw = source[at..here].contains(&'r');
    let fence = source[here..].iter().take_while(|&&c| c == '#').count();
    if source.get(here + fence) != Some(&'"') || (fence > 0 && !raw) {
        return at;
    }
    if !raw {
        return string_end(source, here);
    }
    let mut here = here + fence + 1;
    while here < source.len() {
        if source[here] == '"' && source[here + 1..].iter().take(fence).filter(|&&c| c == '#').count() == fence {
            return here + 1 + fence;
        }
        here += 1;
    }
    source.len()
}

/// The end of a character literal, or `at` if the quote begins a lifetime.
fn character_end(source: &[char], at: usize) -> usize {
    match (source.get(at + 1), source.get(at + 2)) {
        (Some('\\'), Some(_)) => {
            let close = source[at + 3..].iter().position(|&c| c == '\'');
            close.map_or(source.len(), |length| at + 3 + length + 1)
        }
        (Some(_), Some('\'')) => at + 3,
        _ => at,
    }
}

/// [`code`] without the items of test builds.
pub fn code_without_tests(text: &str) -> String {
    let mut code = code(text);
    const MARK: &str = "#[cfg(test)]";
    while let Some(start) = code.find(MARK) {
        let end = item_end(&code, start + MARK.len());
        let blank: String = code[start..end].chars().map(|c| if c == '\n' { '\n' } else { ' ' }).collect();
        code.replace_range(start..end, &blank);
    }
    code
}

/// The end of the item that begins at `start`: its closing brace, or a semicolon if it comes first.
fn item_end(code: &str, start: usize) -> usize {
    let mut depth = 0;
    for (offset, c) in code[start..].char_indices() {
        match c {
            '{' | '(' | '[' => depth += 1,
            '}' | ')' | ']' => {
                depth -= 1;
                if c == '}' && depth <= 0 {
                    let end = start + offset + 1;
                    return end + usize::from(code[end..].starts_with(';')); // `use a::{b, c};`
                }
            }
            ';' if depth == 0 => return start + offset + 1,
            _ => {}
        }
    }
    code.len()
}

/// Files of modules in test builds only: `#[cfg(test)] mod tests;`, with or without a `#[path]`.
pub fn test_files(tree: &Tree) -> BTreeSet<String> {
    let mut files = BTreeSet::new();
    for (path, text) in tree.rust() {
        let (folder, file) = path.rsplit_once('/').unwrap_or(("", path));
        let stem = file.trim_end_matches(".rs");
        let inside =
            if ["mod", "lib", "main"].contains(&stem) { folder.to_owned() } else { format!("{folder}/{stem}") };
        for (start, mark) in text.match_indices("#[cfg(test)]") {
            let item = text[start + mark.len()..].split(['{', ';']).next().unwrap_or_default();
            if let Some(named) = item.split("#[path = \"").nth(1).and_then(|rest| rest.split('"').next()) {
                files.insert(format!("{folder}/{named}"));
            }
            if let Some(name) = item.split_whitespace().skip_while(|&word| word != "mod").nth(1) {
                files.insert(format!("{inside}/{name}.rs"));
                files.insert(format!("{inside}/{name}/mod.rs"));
            }
        }
    }
    files
}

/// The lines, from 1, that contain `word` as a whole word.
pub fn lines_with_word<'a>(code: &'a str, word: &'a str) -> impl Iterator<Item = usize> + 'a {
    let whole = move |line: &str| {
        line.match_indices(word).any(|(at, _)| {
            let (before, after) = (line[..at].chars().next_back(), line[at + word.len()..].chars().next());
            !before.is_some_and(is_word) && !after.is_some_and(is_word)
        })
    };
    code.lines().enumerate().filter(move |(_, line)| whole(line)).map(|(number, _)| number + 1)
}

/// The lines, from 1, that contain `part`.
pub fn lines_with<'a>(code: &'a str, part: &'a str) -> impl Iterator<Item = usize> + 'a {
    code.lines().enumerate().filter(move |(_, line)| line.contains(part)).map(|(number, _)| number + 1)
}

#[test]
fn comments_and_strings_are_not_code() {
    let text =
        "a(\"x \\\" y\"); // z\n/* u /* v */\n w */ b('\\'', '\"', br#\"k\"l\"#, r\"m\\\"); fn c<'a>(d: &'a str) {}";
    let kept: Vec<String> = code(text).lines().map(|line| line.split_whitespace().collect()).collect();
    assert_eq!(kept, ["a();", "", "b(,,,);fnc<'a>(d:&'astr){}"]);
    assert_eq!(code(text).chars().count(), text.chars().count());
}

#[test]
fn test_items_are_cut() {
    let text = "fn a() {}\n#[cfg(test)]\nmod tests {\n fn b() { c(\"}\") }\n}\n#[cfg(test)]\nuse d::{e, f};\nfn g() {}\n#[cfg(test)] mod h;\nfn i() {}";
    let kept: String = code_without_tests(text).split_whitespace().collect();
    assert_eq!(kept, "fna(){}fng(){}fni(){}");
}

#[test]
fn files_of_tests_are_known() {
    let tree = Tree::of(&[
        ("a/src/plan.rs", "#[cfg(test)]\nmod tests;\nmod other;"),
        ("a/src/lib.rs", "#[cfg(test)]\n#[path = \"x_tests.rs\"]\nmod tests;"),
    ]);
    let files = test_files(&tree);
    assert!(files.contains("a/src/plan/tests.rs") && files.contains("a/src/x_tests.rs"), "{files:?}");
    assert!(!files.iter().any(|file| file.contains("other")), "{files:?}");
}
