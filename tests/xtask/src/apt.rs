//! Parser for apt's package sources in both notations, and for the versions that they offer. No side effects.

use std::fmt::Write;

/// One enabled entry of apt's sources (sources.list(5)).
#[derive(Clone, Debug, PartialEq, Eq)]
pub enum Source {
    /// A paragraph of a `.sources` file (deb822): field names and values as written, without comments.
    Paragraph(Vec<(String, String)>),
    /// A line of a `.list` file.
    Line {
        /// The text in brackets.
        options: Option<String>,
        /// URI of the mirror.
        uri: String,
        /// Name of the release.
        suite: String,
        /// Components such as `main`.
        components: Vec<String>,
    },
}

impl Source {
    /// The releases that this entry offers as binary packages.
    pub fn suites(&self) -> Vec<&str> {
        match self {
            Source::Line { suite, .. } => vec![suite],
            Source::Paragraph(_) => self.field("Suites").unwrap_or_default().split_whitespace().collect(),
        }
    }

    fn field(&self, wanted: &str) -> Option<&str> {
        let Source::Paragraph(fields) = self else { return None };
        fields.iter().find(|(name, _)| name.eq_ignore_ascii_case(wanted)).map(|(_, value)| value.as_str())
    }

    /// A source file for `suite` from the same mirror, with the same components, keys and options.
    pub fn with_suite(&self, suite: &str) -> SourceFile {
        let mut text = String::from("# Written by `cargo xtask setup` of Magpie.\n");
        match self {
            Source::Line { options, uri, components, .. } => {
                let options = options.as_ref().map_or(String::new(), |options| format!("[{options}] "));
                text.push_str(&format!("deb {options}{uri} {suite} {}\n", components.join(" ")));
                SourceFile { path: "/etc/apt/sources.list.d/magpie-backports.list", text }
            }
            Source::Paragraph(fields) => {
                for (name, value) in fields {
                    let value = match name.to_ascii_lowercase().as_str() {
                        "suites" => suite,
                        "types" => "deb",
                        _ => value,
                    };
                    // A value that begins on the next line, such as a key, has no space after the colon.
                    let gap = if value.starts_with('\n') { "" } else { " " };
                    let _ = writeln!(text, "{name}:{gap}{value}"); // writing to a String cannot fail
                }
                SourceFile { path: "/etc/apt/sources.list.d/magpie-backports.sources", text }
            }
        }
    }
}

/// A file to write below apt's folder.
#[derive(Clone, Debug, PartialEq, Eq)]
pub struct SourceFile {
    /// Path below apt's folder.
    pub path: &'static str,
    /// Contents of the file.
    pub text: String,
}

/// The entries of a `.sources` file.
pub fn parse_paragraphs(text: &str) -> Vec<Source> {
    let mut sources = Vec::new();
    let mut fields: Vec<(String, String)> = Vec::new();
    for line in text.lines().chain(std::iter::once("")) {
        if line.starts_with('#') {
            continue;
        }
        if line.trim().is_empty() {
            let source = Source::Paragraph(std::mem::take(&mut fields));
            let binary = source.field("Types").unwrap_or_default().split_whitespace().any(|kind| kind == "deb");
            let off = source.field("Enabled").is_some_and(|value| ["no", "false", "off", "0"].contains(&value.trim()));
            if binary && !off {
                sources.push(source);
            }
        } else if line.starts_with([' ', '\t']) {
            if let Some((_, value)) = fields.last_mut() {
                value.push('\n');
                value.push_str(line);
            }
        } else if let Some((name, value)) = line.split_once(':') {
            fields.push((name.trim().to_owned(), value.trim().to_owned()));
        }
    }
    sources
}

/// The entries of a `.list` file.
pub fn parse_lines(text: &str) -> Vec<Source> {
    text.lines().filter_map(parse_line).collect()
}

fn parse_line(line: &str) -> Option<Source> {
    let line = line.split('#').next().unwrap_or_default().trim();
    let rest = line.strip_prefix("deb")?;
    if !rest.starts_with([' ', '\t', '[']) {
        return None; // deb-src
    }
    let rest = rest.trim_start();
    let (options, rest) = match rest.strip_prefix('[') {
        Some(inside) => {
            let (options, rest) = inside.split_once(']')?;
            (Some(options.trim().to_owned()), rest)
        }
        None => (None, rest),
    };
    let mut words = rest.split_whitespace().map(str::to_owned);
    let (uri, suite) = (words.next()?, words.next()?);
    // The name of a CD is in brackets too and may contain spaces; other releases do not come from a CD.
    (!uri.starts_with("cdrom:")).then(|| Source::Line { options, uri, suite, components: words.collect() })
}

/// Whether one of the sources offers `suite`.
pub fn offers(sources: &[Source], suite: &str) -> bool {
    sources.iter().any(|source| source.suites().contains(&suite))
}

/// The file that adds the backports of release `codename` from the release's own mirror. `None` if they are enabled already, or if no
/// source offers the release.
pub fn backports(sources: &[Source], codename: &str) -> Option<SourceFile> {
    let suite = format!("{codename}-backports");
    if offers(sources, &suite) {
        return None;
    }
    sources.iter().find(|source| source.suites().contains(&codename)).map(|source| source.with_suite(&suite))
}

/// One line of the version table of `apt-cache policy`.
#[derive(Clone, Debug, PartialEq, Eq)]
pub struct Offer {
    /// The version, as apt writes it.
    pub version: String,
    /// The releases that have it; empty for a package that is only installed.
    pub suites: Vec<String>,
}

/// Parsed output of `apt-cache policy PACKAGE`.
#[derive(Clone, Debug, Default, PartialEq, Eq)]
pub struct Policy {
    /// The version that `apt-get install` chooses.
    pub candidate: Option<String>,
    /// Every version on offer.
    pub table: Vec<Offer>,
}

impl Policy {
    /// Parses the output, which must be in the C locale.
    pub fn parse(text: &str) -> Policy {
        let mut policy = Policy::default();
        for line in text.lines() {
            let words: Vec<&str> = line.split_whitespace().skip_while(|&word| word == "***").collect();
            match words[..] {
                ["Candidate:", version] if version != "(none)" => policy.candidate = Some(version.to_owned()),
                // `500 mirror bookworm/main amd64 Packages` below the version that it offers
                [priority, _, suite, _, "Packages"] if priority.parse::<i32>().is_ok() => {
                    let suite = suite.split('/').next().unwrap_or(suite).to_owned();
                    if let Some(offer) = policy.table.last_mut().filter(|offer| !offer.suites.contains(&suite)) {
                        offer.suites.push(suite);
                    }
                }
                // `22.3.6-1 500`, on Ubuntu also `22.3.6-1 500 (phased 20%)`
                [version, priority, ..] if version != "Version" && priority.parse::<i32>().is_ok() => {
                    policy.table.push(Offer { version: version.to_owned(), suites: Vec::new() });
                }
                _ => {}
            }
        }
        policy
    }
}

/// The first two numbers of a Debian version: `1:25.0.7-2~bpo12+1` gives 25 and 0.
pub fn release_of(version: &str) -> Option<(u32, u32)> {
    let upstream = version.split_once(':').map_or(version, |(_, rest)| rest);
    let mut numbers = upstream.split(|c: char| !c.is_ascii_digit());
    Some((numbers.next()?.parse().ok()?, numbers.next()?.parse().ok()?))
}

/// Which version of Mesa to install.
#[derive(Clone, Debug, PartialEq, Eq)]
pub enum Choice {
    /// The version that `apt-get install` chooses is new enough.
    Candidate(String),
    /// A version of a release that apt only uses on request.
    From {
        /// Name of the release, such as `bookworm-backports`.
        suite: String,
        /// The version in that release.
        version: String,
    },
    /// No version is new enough; this is the newest.
    TooOld(String),
    /// No source offers the package.
    Unknown,
}

/// Chooses among the offered versions; `oldest` is the major and minor number of the first version that is new enough.
pub fn choose(policy: &Policy, oldest: (u32, u32)) -> Choice {
    let enough = |version: &str| release_of(version).is_some_and(|release| release >= oldest);
    let Some(candidate) = &policy.candidate else { return Choice::Unknown };
    if enough(candidate) {
        return Choice::Candidate(candidate.clone());
    }
    let other = policy.table.iter().filter(|offer| enough(&offer.version)).find_map(|offer| {
        let suite = offer.suites.first()?.clone();
        Some(Choice::From { suite, version: offer.version.clone() })
    });
    other.unwrap_or_else(|| Choice::TooOld(candidate.clone()))
}

#[cfg(test)]
#[path = "apt_tests.rs"]
mod tests;
