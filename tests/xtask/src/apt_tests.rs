use super::*;

const PARAGRAPHS: &str = "\
# a comment
Types: deb deb-src
# another, inside
URIs: http://mirror.example/debian
Suites: bookworm bookworm-updates
Components: main contrib
Signed-By: /usr/share/keyrings/archive.gpg

Types: deb
URIs: http://security.example/debian
Suites: bookworm-security
Components: main

Enabled: no
Types: deb
URIs: http://off.example/debian
Suites: bookworm-backports
Components: main
";

const LINES: &str = "\
# deb http://old.example/debian bookworm-backports main
deb cdrom:[Debian 12 _Bookworm_ - amd64]/ bookworm main
deb-src http://mirror.example/debian bookworm main
deb [arch=amd64 signed-by=/usr/share/keyrings/a.gpg] http://mirror.example/debian bookworm main non-free # the mirror
deb http://security.example/debian-security\tbookworm-security main
";

fn line(options: Option<&str>, suite: &str) -> Source {
    Source::Line {
        options: options.map(str::to_owned),
        uri: "http://mirror.example/debian".to_owned(),
        suite: suite.to_owned(),
        components: vec!["main".to_owned()],
    }
}

#[test]
fn backports_follow_the_paragraph_of_the_release() {
    let sources = parse_paragraphs(PARAGRAPHS);
    assert_eq!(
        sources.iter().map(Source::suites).collect::<Vec<_>>(),
        [vec!["bookworm", "bookworm-updates"], vec!["bookworm-security"]]
    );
    let file = backports(&sources, "bookworm").unwrap();
    assert_eq!(file.path, "/etc/apt/sources.list.d/magpie-backports.sources");
    assert_eq!(
        file.text,
        "# Written by `cargo xtask setup` of Magpie.\n\
         Types: deb\n\
         URIs: http://mirror.example/debian\n\
         Suites: bookworm-backports\n\
         Components: main contrib\n\
         Signed-By: /usr/share/keyrings/archive.gpg\n"
    );
    // Reading the written file gives the source that was missing.
    let written = parse_paragraphs(&file.text);
    assert!(offers(&written, "bookworm-backports") && backports(&written, "bookworm").is_none());
}

#[test]
fn backports_follow_the_line_of_the_release() {
    let sources = parse_lines(LINES);
    assert_eq!(sources.len(), 2, "{sources:?}");
    let file = backports(&sources, "bookworm").unwrap();
    assert_eq!(file.path, "/etc/apt/sources.list.d/magpie-backports.list");
    let wanted = "deb [arch=amd64 signed-by=/usr/share/keyrings/a.gpg] http://mirror.example/debian bookworm-backports main non-free\n";
    assert_eq!(file.text, format!("# Written by `cargo xtask setup` of Magpie.\n{wanted}"));
    assert_eq!(parse_lines(&file.text)[0].suites(), ["bookworm-backports"]);
}

#[test]
fn backports_that_are_a_source_are_not_added_again() {
    let both = [line(None, "bookworm"), line(None, "bookworm-backports")];
    assert_eq!(backports(&both, "bookworm"), None);
    assert!(backports(&both[..1], "bookworm").is_some());
    let sloppy = [line(None, "bookworm"), line(None, "bookworm-backports-sloppy")];
    assert!(backports(&sloppy, "bookworm").is_some());
}

#[test]
fn nothing_is_added_without_the_release_itself() {
    assert_eq!(backports(&[], "bookworm"), None);
    assert_eq!(backports(&[line(None, "bookworm-security"), line(None, "trixie")], "bookworm"), None);
}

#[test]
fn a_key_inside_the_paragraph_is_kept_whole() {
    let text = "Types: deb\nURIs: http://a.example/debian http://b.example/debian\nSuites: bookworm\nComponents: main\n\
                Signed-By:\n -----BEGIN PGP PUBLIC KEY BLOCK-----\n .\n mDMEZ\n -----END PGP PUBLIC KEY BLOCK-----\n";
    let file = backports(&parse_paragraphs(text), "bookworm").unwrap();
    let wanted = text.replace("Suites: bookworm", "Suites: bookworm-backports");
    assert_eq!(file.text, format!("# Written by `cargo xtask setup` of Magpie.\n{wanted}"));
}

#[test]
fn field_names_are_read_in_any_case() {
    let sources = parse_paragraphs("types: deb\nuris: http://mirror.example/debian\nsuites: trixie\ncomponents: main");
    let file = backports(&sources, "trixie").unwrap();
    assert!(file.text.contains("suites: trixie-backports\n"), "{}", file.text);
}

const BOOKWORM: &str = "\
mesa-vulkan-drivers:
  Installed: (none)
  Candidate: 22.3.6-1+deb12u1
  Version table:
     25.0.7-2~bpo12+1 100
        100 http://mirror.example/debian bookworm-backports/main amd64 Packages
     22.3.6-1+deb12u1 500
        500 http://mirror.example/debian bookworm/main amd64 Packages
";

#[test]
fn a_backport_is_chosen_where_the_release_is_too_old() {
    let policy = Policy::parse(BOOKWORM);
    assert_eq!(policy.candidate.as_deref(), Some("22.3.6-1+deb12u1"));
    assert_eq!(
        policy.table[0],
        Offer { version: "25.0.7-2~bpo12+1".to_owned(), suites: vec!["bookworm-backports".to_owned()] }
    );
    let suite = "bookworm-backports".to_owned();
    assert_eq!(choose(&policy, (24, 1)), Choice::From { suite, version: "25.0.7-2~bpo12+1".to_owned() });
    assert_eq!(choose(&policy, (22, 3)), Choice::Candidate("22.3.6-1+deb12u1".to_owned()));
    assert_eq!(choose(&policy, (25, 1)), Choice::TooOld("22.3.6-1+deb12u1".to_owned()));
}

#[test]
fn an_update_of_ubuntu_is_the_candidate() {
    let policy = Policy::parse(
        "mesa-vulkan-drivers:\n  Installed: 23.2.1-1ubuntu3\n  Candidate: 24.2.8-1ubuntu1~24.04.1\n  Version table:\n     \
         24.2.8-1ubuntu1~24.04.1 500 (phased 20%)\n        500 http://mirror.example/ubuntu noble-updates/main amd64 Packages\n \
         *** 23.2.1-1ubuntu3 500\n        500 http://mirror.example/ubuntu noble/main amd64 Packages\n        \
         100 /var/lib/dpkg/status\n",
    );
    assert_eq!(policy.table.len(), 2, "{policy:?}");
    assert_eq!(policy.table[1].suites, ["noble"]);
    assert_eq!(choose(&policy, (24, 1)), Choice::Candidate("24.2.8-1ubuntu1~24.04.1".to_owned()));
}

#[test]
fn a_package_that_no_source_has_is_unknown() {
    assert_eq!(choose(&Policy::parse(""), (24, 1)), Choice::Unknown);
    let removed = "mesa-vulkan-drivers:\n  Installed: (none)\n  Candidate: (none)\n  Version table:\n";
    assert_eq!(choose(&Policy::parse(removed), (24, 1)), Choice::Unknown);
}

#[test]
fn versions_are_compared_by_number() {
    assert_eq!(release_of("25.0.7-2~bpo12+1"), Some((25, 0)));
    assert_eq!(release_of("1:24.10-1"), Some((24, 10)));
    assert!(release_of("24.10-1") > release_of("24.9-1"));
    assert_eq!(release_of("unknown"), None);
}
