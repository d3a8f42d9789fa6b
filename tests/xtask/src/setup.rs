//! Checks the machine for Magpie's requirements, and installs what is missing where that is known to be safe.

use crate::apt::{self, Choice, Policy, Source, SourceFile};
use crate::probe::{self, Answer};
use crate::shell::Invocation;
use crate::system::System;
use crate::workplace::{Workplace, on_path};
use anyhow::{Context, Result, bail};
use std::fs;
use std::io::IsTerminal;
use std::path::Path;

/// First release of Mesa whose software driver traces rays (major, minor).
const OLDEST_MESA: (u32, u32) = (24, 1);
/// Debian's and Ubuntu's name for Mesa's drivers, the software one among them.
const MESA: &str = "mesa-vulkan-drivers";
/// What goes with a driver: the Vulkan loader, what windows need under X, and for the tests the validation layers and a display without a
/// screen.
const BESIDE: [&str; 8] = [
    "libvulkan1",
    "libx11-6",
    "libx11-xcb1",
    "libxcursor1",
    "libxi6",
    "libxkbcommon-x11-0",
    "vulkan-validationlayers",
    "xvfb",
];

/// `cargo xtask setup`.
pub fn setup(dry_run: bool) -> Result<()> {
    let mut place = Workplace::find()?;
    let mut installer = Installer::new(dry_run);
    compiler(&mut place, &mut installer)?;
    device(&place, &mut installer)
}

/// Set-up before other commands: the compiler, and unless `no_gpu` the device.
pub fn prepare(no_gpu: bool) -> Result<Workplace> {
    let mut place = Workplace::find()?;
    let mut installer = Installer::new(false);
    compiler(&mut place, &mut installer)?;
    if !no_gpu {
        device(&place, &mut installer)?;
    }
    Ok(place)
}

/// The shader compiler is C++ source, so cargo needs a C++ compiler before it can build the engine.
fn compiler(place: &mut Workplace, installer: &mut Installer) -> Result<()> {
    if cfg!(windows) {
        return Ok(()); // Rust itself needs the build tools there, and finds them outside the search path
    }
    let named = std::env::var("CXX").ok();
    let known = ["c++", "g++", "clang++"];
    if let Some(name) =
        named.as_deref().into_iter().chain(known).find(|name| on_path(name) || Path::new(name).is_file())
    {
        say(&format!("C++ compiler: {name}"));
        place.compile_with(name);
        return Ok(());
    }
    say("C++ compiler: none found");
    let System::Apt { .. } = installer.system else {
        bail!("a C++ compiler is needed and there is none; install it with:\n  {}", installer.system.compiler_advice());
    };
    installer.update()?;
    installer.install(None, &["g++"])
}

/// Builds `magpie`, looks for a device with it, and installs Mesa's software driver if there is none.
fn device(place: &Workplace, installer: &mut Installer) -> Result<()> {
    let build = place.cargo(&["build", "--release", "--package", "magpie-demo"]);
    if installer.dry_run {
        say("building magpie, which is asked for a device");
        installer.act(&build)?;
        if !place.magpie().is_file() {
            say("magpie is not built yet, so its answer is not known; where it finds no device:");
            return install_device(installer);
        }
    } else {
        say("building magpie, which is asked for a device");
        build.run()?;
    }
    match probe::probe(place)? {
        Answer::Device(list) => {
            say("this machine already has a device that Magpie accepts; nothing to do");
            println!("{list}");
            return Ok(());
        }
        Answer::None(reasons) => {
            say("no device that Magpie accepts");
            println!("{reasons}");
        }
    }
    install_device(installer)?;
    if installer.dry_run {
        return Ok(());
    }
    match probe::probe(place)? {
        Answer::Device(list) => {
            say("the device is there now");
            println!("{list}");
            Ok(())
        }
        Answer::None(reasons) => bail!("there is still no device that Magpie accepts:\n{reasons}"),
    }
}

fn install_device(installer: &mut Installer) -> Result<()> {
    let System::Apt { codename } = installer.system.clone() else {
        let advice = installer.system.device_advice().join("\n  ");
        bail!("Magpie needs a Vulkan 1.3 device; install for one:\n  {advice}\nthen start this command again");
    };
    installer.update()?;
    let (major, minor) = OLDEST_MESA;
    let mut choice = apt::choose(&installer.policy(MESA)?, OLDEST_MESA);
    if matches!(choice, Choice::TooOld(_) | Choice::Unknown)
        && let Some(codename) = codename
        && let Some(file) = apt::backports(&sources(Path::new("/etc/apt"))?, &codename)
    {
        say(&format!("Mesa {major}.{minor} or newer is in none of apt's sources; adding the backports of {codename}"));
        choice = installer.with_backports(&file, &format!("{codename}-backports"), choice)?;
    }
    let with_driver: Vec<&str> = BESIDE.into_iter().chain([MESA]).collect();
    match choice {
        Choice::Candidate(version) => {
            say(&format!("installing the Vulkan loader, Mesa {version}, the validation layers, and what windows need"));
            installer.install(None, &with_driver)
        }
        Choice::From { suite, version } => {
            say(&format!(
                "installing the Vulkan loader, the validation layers, what windows need, and from {suite} Mesa {version}"
            ));
            installer.install(None, &BESIDE)?;
            installer.install(Some(&suite), &[MESA])
        }
        Choice::TooOld(version) => {
            say(&format!(
                "no Mesa {major}.{minor} or newer is on offer; installing {version}, whose software driver traces no rays itself"
            ));
            installer.install(None, &with_driver)
        }
        Choice::Unknown if installer.dry_run => {
            say(&format!("apt knows no {MESA} before the update above; with a new enough one on offer:"));
            installer.install(None, &with_driver)
        }
        Choice::Unknown => bail!("none of apt's sources offers {MESA}; add one that has Mesa {major}.{minor} or newer"),
    }
}

/// The entries of apt's sources below `folder`.
fn sources(folder: &Path) -> Result<Vec<Source>> {
    let mut files = vec![folder.join("sources.list")];
    if let Ok(entries) = fs::read_dir(folder.join("sources.list.d")) {
        files.extend(entries.filter_map(|entry| Some(entry.ok()?.path())));
    }
    files.sort();
    let mut sources = Vec::new();
    for file in files.iter().filter(|file| file.is_file()) {
        let parse = match file.extension().and_then(|extension| extension.to_str()) {
            Some("list") => apt::parse_lines,
            Some("sources") => apt::parse_paragraphs,
            _ => continue,
        };
        let text = fs::read_to_string(file).with_context(|| format!("reading {}", file.display()))?;
        sources.extend(parse(&text));
    }
    Ok(sources)
}

/// Changes the machine as root, or prints what it would change.
struct Installer {
    system: System,
    dry_run: bool,
    updated: bool,
}

impl Installer {
    fn new(dry_run: bool) -> Installer {
        Installer { system: System::here(), dry_run, updated: false }
    }

    fn act(&self, command: &Invocation) -> Result<()> {
        if self.dry_run {
            println!("  would run: {command}");
            return Ok(());
        }
        command.run()
    }

    /// `command` as root.
    fn as_root(&self, command: Invocation) -> Result<Invocation> {
        let id = Invocation::new("id", &["-u"]).output()?;
        if id.stdout.trim_ascii() == b"0" {
            return Ok(command);
        }
        if !on_path("sudo") && !self.dry_run {
            bail!(
                "this needs root and there is no sudo; as root, run (`--dry-run` of set-up shows the rest):\n  {command}"
            );
        }
        // Without a terminal nobody can type a password: fail instead of waiting.
        let prefix: &[&str] = if std::io::stdin().is_terminal() { &["sudo"] } else { &["sudo", "-n"] };
        Ok(command.through(&prefix.iter().map(|&word| word.to_owned()).collect::<Vec<_>>()))
    }

    fn apt_get(&self, arguments: &[&str]) -> Result<Invocation> {
        // Waits up to two minutes if the machine is updating itself. A minimal root environment has no pseudo-terminals.
        let all = [&["-qq", "-o", "DPkg::Lock::Timeout=120", "-o", "Dpkg::Use-Pty=0"], arguments].concat();
        self.as_root(Invocation::new("apt-get", &all).with_env("DEBIAN_FRONTEND", "noninteractive").quietly())
    }

    /// Fetches the package lists, once.
    fn update(&mut self) -> Result<()> {
        if self.updated {
            return Ok(());
        }
        self.updated = true;
        let update = self.apt_get(&["update"])?;
        if let Err(error) = self.act(&update) {
            // One broken source among several is common and may not matter: the installation will tell.
            say(&format!("{error:#}; going on with the package lists that are there"));
        }
        Ok(())
    }

    fn install(&self, suite: Option<&str>, packages: &[&str]) -> Result<()> {
        let mut arguments = vec!["install", "-y", "--no-install-recommends"];
        arguments.extend(suite.into_iter().flat_map(|suite| ["-t", suite]));
        arguments.extend(packages);
        self.act(&self.apt_get(&arguments)?)
    }

    fn policy(&self, package: &str) -> Result<Policy> {
        let output = Invocation::new("apt-cache", &["policy", package]).with_env("LC_ALL", "C").output()?;
        Ok(Policy::parse(&String::from_utf8_lossy(&output.stdout)))
    }

    /// Adds a source and chooses again; removes it if it offers nothing better than `before`.
    fn with_backports(&mut self, file: &SourceFile, suite: &str, before: Choice) -> Result<Choice> {
        if self.dry_run {
            println!("  would write {}:", file.path);
            file.text.lines().for_each(|line| println!("    {line}"));
            self.act(&self.apt_get(&["update"])?)?;
            return Ok(Choice::From { suite: suite.to_owned(), version: "as new as it has".to_owned() });
        }
        println!("  writing {}:", file.path);
        file.text.lines().for_each(|line| println!("    {line}"));
        self.as_root(Invocation::new("tee", &[file.path]).fed(&file.text).quietly())?.run()?;
        self.updated = false;
        self.update()?;
        let choice = apt::choose(&self.policy(MESA)?, OLDEST_MESA);
        if matches!(choice, Choice::Candidate(_) | Choice::From { .. }) {
            return Ok(choice);
        }
        say(&format!("{suite} has nothing newer; taking it away again"));
        self.as_root(Invocation::new("rm", &[file.path]))?.run()?;
        self.updated = false;
        self.update()?;
        Ok(before)
    }
}

fn say(line: &str) {
    println!("setup: {line}");
}

#[cfg(test)]
mod tests {
    use super::*;

    #[test]
    fn every_notation_below_the_folder_is_read() {
        let folder = std::env::temp_dir().join(format!("magpie-xtask-{}", std::process::id()));
        let parts = folder.join("sources.list.d");
        fs::create_dir_all(&parts).unwrap();
        fs::write(folder.join("sources.list"), "deb http://a.example/debian trixie main\n").unwrap();
        fs::write(parts.join("b.list"), "deb http://b.example/debian trixie-updates main\n").unwrap();
        fs::write(parts.join("c.sources"), "Types: deb\nURIs: http://c.example\nSuites: x y\nComponents: main\n")
            .unwrap();
        fs::write(parts.join("d.list.save"), "deb http://d.example/debian off main\n").unwrap();
        let found = sources(&folder).unwrap();
        fs::remove_dir_all(&folder).unwrap();
        assert_eq!(found.iter().flat_map(Source::suites).collect::<Vec<_>>(), ["trixie", "trixie-updates", "x", "y"]);
    }

    #[test]
    fn a_machine_without_any_source_has_none() {
        assert_eq!(sources(Path::new("no/such/folder")).unwrap(), []);
    }
}
