//! Follows findings through passes and frames to where they arose.
//!
//! A finding is caused by an input of its pass that is bad itself: written so by another pass of the frame, left so by an earlier
//! frame in a history or a kept buffer, or brought in so. One whose inputs are all clean is an origin. All findings with one origin
//! make one report, however many passes and frames they go through.

use std::{
    collections::{BTreeSet, HashMap},
    fmt,
    rc::Rc,
};

use super::{
    super::{
        declaration::{Declaration, ImportKey, Origin, Writers},
        desc::Part,
    },
    Finding, Input, Seen, Unscanned,
};

/// Most reports that are kept, most outputs that one of them names, most links of a path.
const MOST: usize = 256;

/// One step on the way from an origin to where it surfaced.
#[derive(Clone, Debug, PartialEq, Eq)]
pub enum Link {
    /// A pass handed it on.
    Pass {
        /// The pass.
        pass: String,
        /// The output that was bad.
        output: String,
        /// The frame, and where it went round through a history, the last one.
        frames: [u32; 2],
    },
    /// It went to the next frame in a history.
    History(String),
    /// It stayed in a buffer that keeps its contents.
    Kept(String),
}

/// Everything that came of one origin.
#[derive(Clone, Debug, PartialEq)]
pub struct Report {
    /// The frame in which it first arose.
    pub frame: u32,
    /// The first pass that held it, where, and what it had read there.
    pub origin: Finding,
    /// The longest way that it went, the origin included.
    pub path: Vec<Link>,
    /// Frames in which the same output was an origin.
    pub arose: u32,
    /// The last frame in which anything of it was seen.
    pub last_frame: u32,
    /// Outputs that held it, `pass:output`; the first 256.
    pub outputs: BTreeSet<String>,
}

/// What is known of findings so far. It grows with the number of different outputs, not with that of frames.
#[derive(Debug, Default)]
pub struct Trail {
    reports: Vec<Report>,
    /// Origins beyond those that are kept.
    left_out: u64,
    /// What the last frame left bad, by history or kept buffer.
    carried: HashMap<Slot, Node>,
    unscanned: BTreeSet<(String, String)>,
}

#[derive(Clone, Copy, Debug, PartialEq, Eq, Hash)]
enum Slot {
    Pair(u32),
    Kept(u32),
}

/// Something bad: its report, if there is room for one, and the way to it.
#[derive(Clone, Debug)]
struct Node {
    report: Option<usize>,
    path: Rc<Vec<Link>>,
}

/// A frame while it is gone through.
struct Frame<'a> {
    declaration: &'a Declaration,
    writers: Writers,
    ran: Vec<bool>,
    /// Bad versions: what was found, and where that came from.
    bad: HashMap<(u32, u32), (&'a Finding, Node)>,
}

impl Trail {
    /// Takes in what a frame held: its number, its declaration, the passes that ran, what was found and what was not scanned.
    pub fn follow(
        &mut self,
        frame: u32,
        declaration: &Declaration,
        order: &[u32],
        findings: &[Finding],
        unscanned: &[Unscanned],
    ) {
        let room = MOST.saturating_sub(self.unscanned.len());
        self.unscanned.extend(unscanned.iter().take(room).map(|u| (u.name.clone(), u.why.clone())));
        if findings.is_empty() && self.carried.is_empty() {
            return;
        }
        let mut ran = vec![false; declaration.passes.len()];
        order.iter().for_each(|&pass| ran[pass as usize] = true);
        let mut now = Frame { declaration, writers: declaration.writers(), ran, bad: HashMap::new() };
        // What came in is a cause, never an effect; passes come after their causes.
        let mut sorted: Vec<&Finding> = findings.iter().collect();
        sorted.sort_by_key(|f| f.pass_index);
        for finding in sorted {
            let node = match self.cause(&now, finding) {
                Some(cause) => self.hand_on(frame, finding, &cause),
                None => self.arise(frame, finding),
            };
            if let Some(report) = node.report.map(|r| &mut self.reports[r]) {
                report.last_frame = frame;
                // What came in through a history is no step of its own.
                let step = finding.pass_index.is_some() || node.path.len() == 1;
                if step && report.outputs.len() < MOST {
                    report.outputs.insert(finding.name());
                }
                if step && node.path.len() > report.path.len() {
                    report.path = node.path.to_vec();
                }
            }
            now.bad.insert((finding.resource, finding.version), (finding, node));
        }
        self.carried = self.carry(&now);
    }

    /// The reports, in the order in which their origins were found: by frame, then by pass.
    pub fn reports(&self) -> &[Report] {
        &self.reports
    }

    /// Origins for which there was no room in [`Trail::reports`].
    pub fn left_out(&self) -> u64 {
        self.left_out
    }

    /// Outputs that could not be scanned, and why; the first 256.
    pub fn unscanned(&self) -> impl Iterator<Item = (&str, &str)> {
        self.unscanned.iter().map(|(name, why)| (name.as_str(), why.as_str()))
    }

    /// Forgets everything.
    pub fn clear(&mut self) {
        *self = Self::default();
    }

    /// The bad input that a finding is due to: one that is bad at that very place, else one that the pass wrote over, else the
    /// one that went bad first.
    fn cause(&self, now: &Frame<'_>, finding: &Finding) -> Option<Node> {
        let Some(pass) = finding.pass_index else { return self.came(now, finding.resource) };
        let shown = |resource: u32, part: Part| {
            let name = now.declaration.resource_name(resource);
            let mut same = finding.inputs.iter().filter(|i| i.name == name);
            let of_part = |i: &&Input| match i.seen {
                Seen::At(super::Place::Pixel { mip, .. }, _) => mip == u32::from(part.mip),
                Seen::At(..) | Seen::Not(_) => true,
            };
            same.find(of_part).map(|i| i.seen)
        };
        let reads = now.declaration.uses_of(pass).iter().filter_map(|u| Some((u, u.reads?)));
        let candidates = reads.filter_map(|(u, version)| {
            let node = self.bad_at(now, u.resource, version, u.part)?;
            let rank = match shown(u.resource, u.part) {
                Some(Seen::At(_, value)) if value.is_bad() => 0,
                Some(Seen::Not(_)) | None => 1,
                Some(Seen::At(..)) => 2,
            };
            Some((rank, node.report.unwrap_or(usize::MAX), node))
        });
        candidates.min_by_key(|(rank, report, _)| (*rank, *report)).map(|(.., node)| node)
    }

    /// Whether a part of a version is bad, and how that came.
    fn bad_at(&self, now: &Frame<'_>, resource: u32, version: u32, part: Part) -> Option<Node> {
        for version in (0..=version).rev() {
            let found = now.bad.get(&(resource, version)).filter(|(f, _)| f.parts.iter().any(|p| p.overlaps(part)));
            if let Some((_, node)) = found {
                return Some(node.clone());
            }
            let Some(writer) = now.writers.get(resource, version) else {
                // It was there before the frame. A history was scanned as it came, a kept buffer may not have been.
                return self.came(now, resource).filter(|_| matches!(now.slot(resource), Some((Slot::Kept(_), _))));
            };
            let wrote = |u: &super::super::declaration::Use| {
                u.resource == resource && u.writes == Some(version) && part.is_within(u.part)
            };
            if now.ran[writer as usize] && now.declaration.uses_of(writer).iter().any(wrote) {
                return None; // It wrote all of the part, and that is clean.
            }
        }
        None
    }

    /// What an earlier frame left in a resource from outside.
    fn came(&self, now: &Frame<'_>, resource: u32) -> Option<Node> {
        let (slot, is_previous) = now.slot(resource)?;
        let node = self.carried.get(&slot).filter(|_| is_previous)?;
        let name = now.declaration.text(now.declaration.resources[resource as usize].name);
        let link = match slot {
            Slot::Pair(_) => Link::History(name.strip_suffix(".previous").unwrap_or(name).to_owned()),
            Slot::Kept(_) => Link::Kept(name.to_owned()),
        };
        Some(Node { report: node.report, path: extended(&node.path, link) })
    }

    /// The finding has a cause: it goes on from there.
    fn hand_on(&self, frame: u32, finding: &Finding, cause: &Node) -> Node {
        if finding.pass_index.is_none() {
            return cause.clone();
        }
        Node { report: cause.report, path: extended(&cause.path, step(frame, finding)) }
    }

    /// The finding has no cause: it is an origin, one of old or a new one.
    fn arise(&mut self, frame: u32, finding: &Finding) -> Node {
        let path = vec![step(frame, finding)];
        let same = |r: &Report| r.origin.pass == finding.pass && r.origin.output == finding.output;
        let report = self.reports.iter().position(same);
        if let Some(at) = report {
            self.reports[at].arose += 1;
        } else if self.reports.len() < MOST {
            self.reports.push(Report {
                frame,
                origin: finding.clone(),
                path: path.clone(),
                arose: 1,
                last_frame: frame,
                outputs: BTreeSet::new(),
            });
        } else {
            self.left_out += 1;
        }
        let report = report.or_else(|| (self.left_out == 0).then(|| self.reports.len() - 1));
        Node { report, path: Rc::new(path) }
    }

    /// What this frame leaves bad for the next.
    fn carry(&self, now: &Frame<'_>) -> HashMap<Slot, Node> {
        let mut carried = HashMap::new();
        for (index, decl) in (0..).zip(&now.declaration.resources) {
            let slot = match decl.origin {
                Origin::Imported { key: ImportKey::Next(slot), .. } => Slot::Pair(slot),
                Origin::Imported { key: ImportKey::Kept(slot), .. } => Slot::Kept(slot),
                Origin::Imported { .. } | Origin::Transient => continue,
            };
            let (mips, layers) = decl.shape.parts();
            if let Some(node) = self.bad_at(now, index, decl.versions - 1, Part::ALL.of(mips, layers)) {
                carried.insert(slot, node);
            }
        }
        carried
    }
}

impl Frame<'_> {
    /// The slot of a history or kept buffer, and whether it brings what an earlier frame left.
    fn slot(&self, resource: u32) -> Option<(Slot, bool)> {
        match self.declaration.resources[resource as usize].origin {
            Origin::Imported { key: ImportKey::Previous(slot), .. } => Some((Slot::Pair(slot), true)),
            Origin::Imported { key: ImportKey::Next(slot), .. } => Some((Slot::Pair(slot), false)),
            Origin::Imported { key: ImportKey::Kept(slot), .. } => Some((Slot::Kept(slot), true)),
            Origin::Imported { key: ImportKey::Caller(_), .. } | Origin::Transient => None,
        }
    }
}

fn step(frame: u32, finding: &Finding) -> Link {
    Link::Pass { pass: finding.pass.clone(), output: finding.output.clone(), frames: [frame; 2] }
}

/// A path with one more link. An output that is on it twice already has gone round through histories: the path ends there the
/// second time, until the frame of the third.
fn extended(path: &Rc<Vec<Link>>, link: Link) -> Rc<Vec<Link>> {
    let second = path.iter().enumerate().filter(|(_, known)| known.is_same(&link)).map(|(at, _)| at).nth(1);
    let mut longer = path.to_vec();
    if let Some(at) = second {
        longer.truncate(at + 1);
        if let (Some(Link::Pass { frames: known, .. }), Link::Pass { frames, .. }) = (longer.last_mut(), &link) {
            known[1] = frames[1];
        }
    } else if longer.len() < MOST {
        longer.push(link);
    }
    Rc::new(longer)
}

impl Link {
    fn is_same(&self, other: &Self) -> bool {
        match (self, other) {
            (Self::Pass { pass, output, .. }, Self::Pass { pass: p, output: o, .. }) => (pass, output) == (p, o),
            (Self::History(a), Self::History(b)) | (Self::Kept(a), Self::Kept(b)) => a == b,
            (Self::Pass { .. } | Self::History(_) | Self::Kept(_), _) => false,
        }
    }
}

impl fmt::Display for Link {
    fn fmt(&self, f: &mut fmt::Formatter<'_>) -> fmt::Result {
        match self {
            Self::Pass { pass, frames: [first, last], .. } if first == last => write!(f, "{pass} (frame {first})"),
            Self::Pass { pass, frames: [first, last], .. } => write!(f, "{pass} (frames {first} to {last})"),
            Self::History(name) => write!(f, "history {name}"),
            Self::Kept(name) => write!(f, "kept buffer {name}"),
        }
    }
}

impl fmt::Display for Report {
    fn fmt(&self, f: &mut fmt::Formatter<'_>) -> fmt::Result {
        let Self { frame, origin, path, arose, last_frame, outputs } = self;
        writeln!(f, "frame {frame}, pass {}, output {}: {}", origin.pass, origin.output, origin.counts())?;
        if origin.pass_index.is_none() {
            writeln!(f, "  it came into the frame from outside")?;
        }
        for input in &origin.inputs {
            writeln!(f, "  read {input}")?;
        }
        let path: Vec<String> = path.iter().map(Link::to_string).collect();
        writeln!(f, "  went {}", path.join(" → "))?;
        write!(f, "  in {} output{}, last seen in frame {last_frame}", outputs.len(), plural(outputs.len()))?;
        if *arose > 1 {
            write!(f, "; it arose anew in {arose} frames")?;
        }
        Ok(())
    }
}

fn plural(count: usize) -> &'static str {
    if count == 1 { "" } else { "s" }
}

#[cfg(test)]
#[path = "trail_tests.rs"]
mod tests;
