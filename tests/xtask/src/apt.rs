//! What apt knows: package sources in both of their notations, and the versions that they offer. Text in, values out.

use std::fmt::Write;

/// One entry of apt's sources that is switched on (sources.list(5)).
#[derive(Clone, Debug, PartialEq, Eq)]
pub enum Source {
    /// A paragraph of a `.sources` file (deb822): names and values as written, without comments.
    Paragraph(Vec<(String, String)>),
    /// A line of a `.list` file.
    Line {
        /// What stands in brackets, without them.
        options: Option<String>,
        /// The mirror.
        uri: String,
        /// The release.
        suite: String,
        /// `main` and others.
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

    /// Text of a file that offers `suite` from the same mirror, with the same components, keys and options.
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
                    // A value that begins on the next line, such as a key, has no blank after the colon.
                    let gap = if value.starts_with('\n') { "" } else { " " };
                    let _ = writeln!(text, "{name}:{gap}{value}"); // writing to a String cannot fail
                }
                SourceFile { path: "/etc/apt/sources.list.d/magpie-backports.sources", text }
            }
        }
    }
}

/// A file to be written below apt's folder.
#[derive(Clone, Debug, PartialEq, Eq)]
pub struct SourceFile {
    /// Where it goes.
    pub path: &'static str,
    /// What it holds.
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
    // The name of a disc is in brackets too and may hold blanks; no other release comes from a disc.
    (!uri.starts_with("cdrom:")).then(|| Source::Line { options, uri, suite, components: words.collect() })
}

/// Whether one of the sources offers `suite`.
pub fn offers(sources: &[Source], suite: &str) -> bool {
    sources.iter().any(|source| source.suites().contains(&suite))
}

/// The file that adds the backports of release `codename` from the mirror that the release itself comes from.
/// `None` where they are a source already, or where no source offers the release.
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

/// What `apt-cache policy PACKAGE` says.
#[derive(Clone, Debug, Default, PartialEq, Eq)]
pub struct Policy {
    /// The version that `apt-get install` takes.
    pub candidate: Option<String>,
    /// Every version on offer.
    pub table: Vec<Offer>,
}

impl Policy {
    /// Reads the output, which must be in the C locale.
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

/// The first two numbers of a Debian version: `1:25.0.7-2~bpo12+1` is 25.0.
pub fn release_of(version: &str) -> Option<(u32, u32)> {
    let upstream = version.split_once(':').map_or(version, |(_, rest)| rest);
    let mut numbers = upstream.split(|c: char| !c.is_ascii_digit());
    Some((numbers.next()?.parse().ok()?, numbers.next()?.parse().ok()?))
}

/// Which Mesa is to be installed.
#[derive(Clone, Debug, PartialEq, Eq)]
pub enum Choice {
    /// What `apt-get install` takes by itself is new enough.
    Candidate(String),
    /// A release that apt only takes when it is asked to.
    From {
        /// For example `bookworm-backports`.
        suite: String,
        /// The version there.
        version: String,
    },
    /// Nothing is new enough; the newest that there is.
    TooOld(String),
    /// No source offers the package.
    Unknown,
}

/// Chooses among the versions on offer; `oldest` is major and minor of the first version that will do.
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
