//! Follows findings through passes and frames to the pass where they arose.
//!
//! The cause of a finding is an input of its pass that is itself bad: written by another pass of the frame, kept by an earlier
//! frame in a history or a kept buffer, or imported. A finding whose inputs are all clean is an origin. All findings with the
//! same origin make one report, however many passes and frames they spread through.

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
    Finding, Input, InputValue, Unscanned,
};

/// Limit on the reports that are kept, on the outputs that each one names, and on the links of a path.
const MAX_ENTRIES: usize = 256;

/// One step on the path from an origin to where the value was last seen.
#[derive(Clone, Debug, PartialEq, Eq)]
pub enum Link {
    /// A pass read the value and wrote it on.
    Pass {
        /// Name of the pass.
        pass: String,
        /// Name of the bad output.
        output: String,
        /// First and last frame in which the value passed here; they differ where it circulates through a history.
        frames: [u32; 2],
    },
    /// It reached the next frame through a history, named here.
    History(String),
    /// It stayed in a kept buffer, named here.
    Kept(String),
}

/// All findings with one origin.
#[derive(Clone, Debug, PartialEq)]
pub struct Report {
    /// The frame in which it first arose, counted from 0.
    pub frame: u32,
    /// The finding of the origin: the pass, the place, and the inputs there.
    pub origin: Finding,
    /// The longest path that the value took, the origin included.
    pub path: Vec<Link>,
    /// Number of frames in which the same output was an origin.
    pub arose: u32,
    /// The last frame in which the value was found anywhere.
    pub last_frame: u32,
    /// Outputs that held the value, as `pass:output`; the first 256.
    pub outputs: BTreeSet<String>,
}

/// The findings of all frames so far. Its size grows with the number of different outputs, not with the number of frames.
#[derive(Debug, Default)]
pub struct FindingTracker {
    reports: Vec<Report>,
    /// Number of origins that found no room in `reports`.
    left_out: u64,
    /// The histories and kept buffers that the last frame left bad.
    carried: HashMap<Carrier, Node>,
    unscanned: BTreeSet<(String, String)>,
}

#[derive(Clone, Copy, Debug, PartialEq, Eq, Hash)]
enum Carrier {
    History(u32),
    Kept(u32),
}

/// Something bad: the index of its report, if there was room for one, and the path to it.
#[derive(Clone, Debug)]
struct Node {
    report: Option<usize>,
    path: Rc<Vec<Link>>,
}

/// The frame that is being followed.
struct Frame<'a> {
    declaration: &'a Declaration,
    writers: Writers,
    ran: Vec<bool>,
    /// The bad versions, by resource and version, with their finding and where it came from.
    bad: HashMap<(u32, u32), (&'a Finding, Node)>,
}

impl FindingTracker {
    /// Takes in one frame: its number, its declaration, the passes that ran, the findings, and the outputs that were not scanned.
    pub fn follow(
        &mut self,
        frame: u32,
        declaration: &Declaration,
        order: &[u32],
        findings: &[Finding],
        unscanned: &[Unscanned],
    ) {
        let room = MAX_ENTRIES.saturating_sub(self.unscanned.len());
        self.unscanned.extend(unscanned.iter().take(room).map(|u| (u.name.clone(), u.why.clone())));
        if findings.is_empty() && self.carried.is_empty() {
            return;
        }
        let mut ran = vec![false; declaration.passes.len()];
        order.iter().for_each(|&pass| ran[pass as usize] = true);
        let mut now = Frame { declaration, writers: declaration.writers(), ran, bad: HashMap::new() };
        // Imports sort first, because they are causes and never effects. Passes come after their causes.
        let mut sorted: Vec<&Finding> = findings.iter().collect();
        sorted.sort_by_key(|f| f.pass_index);
        for finding in sorted {
            let node = match self.cause(&now, finding) {
                Some(cause) => self.propagate(frame, finding, &cause),
                None => self.add_origin(frame, finding),
            };
            if let Some(report) = node.report.map(|r| &mut self.reports[r]) {
                report.last_frame = frame;
                // The import of a history adds no step to the path; the history's own link does.
                let step = finding.pass_index.is_some() || node.path.len() == 1;
                if step && report.outputs.len() < MAX_ENTRIES {
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

    /// Number of origins for which there was no room in [`FindingTracker::reports`].
    pub fn left_out(&self) -> u64 {
        self.left_out
    }

    /// Outputs that could not be scanned, as (`pass:output`, reason); the first 256.
    pub fn unscanned(&self) -> impl Iterator<Item = (&str, &str)> {
        self.unscanned.iter().map(|(name, why)| (name.as_str(), why.as_str()))
    }

    /// Forgets all reports.
    pub fn clear(&mut self) {
        *self = Self::default();
    }

    /// The bad input that caused a finding. In order of preference: one that is bad at the same place, one whose value is unknown
    /// (such as one that the pass overwrote), one that is bad elsewhere; among equals, the one whose origin is the oldest.
    fn cause(&self, now: &Frame<'_>, finding: &Finding) -> Option<Node> {
        let Some(pass) = finding.pass_index else { return self.carried_into(now, finding.resource) };
        let shown = |resource: u32, part: Part| {
            let name = now.declaration.resource_name(resource);
            let mut same = finding.inputs.iter().filter(|i| i.name == name);
            let of_part = |i: &&Input| match i.seen {
                InputValue::At(super::Place::Pixel { mip, .. }, _) => mip == u32::from(part.mip),
                InputValue::At(..) | InputValue::Unknown(_) => true,
            };
            same.find(of_part).map(|i| i.seen)
        };
        let reads = now.declaration.uses_of(pass).iter().filter_map(|u| Some((u, u.reads?)));
        let candidates = reads.filter_map(|(u, version)| {
            let node = self.bad_part(now, u.resource, version, u.part)?;
            let rank = match shown(u.resource, u.part) {
                Some(InputValue::At(_, value)) if value.is_bad() => 0,
                Some(InputValue::Unknown(_)) | None => 1,
                Some(InputValue::At(..)) => 2,
            };
            Some((rank, node.report.unwrap_or(usize::MAX), node))
        });
        candidates.min_by_key(|(rank, report, _)| (*rank, *report)).map(|(.., node)| node)
    }

    /// The bad value in a part of a version, with its path; `None` if the part is clean.
    fn bad_part(&self, now: &Frame<'_>, resource: u32, version: u32, part: Part) -> Option<Node> {
        for version in (0..=version).rev() {
            let found = now.bad.get(&(resource, version)).filter(|(f, _)| f.parts.iter().any(|p| p.overlaps(part)));
            if let Some((_, node)) = found {
                return Some(node.clone());
            }
            let Some(writer) = now.writers.get(resource, version) else {
                // The contents are from before the frame. A history was scanned when it was imported, but a kept buffer may not have been.
                return self
                    .carried_into(now, resource)
                    .filter(|_| matches!(now.carrier(resource), Some((Carrier::Kept(_), _))));
            };
            let wrote = |u: &super::super::declaration::Use| {
                u.resource == resource && u.writes == Some(version) && part.is_within(u.part)
            };
            if now.ran[writer as usize] && now.declaration.uses_of(writer).iter().any(wrote) {
                return None; // The writer overwrote the whole part with clean values.
            }
        }
        None
    }

    /// The bad value that an earlier frame left in an imported resource.
    fn carried_into(&self, now: &Frame<'_>, resource: u32) -> Option<Node> {
        let (carrier, is_previous) = now.carrier(resource)?;
        let node = self.carried.get(&carrier).filter(|_| is_previous)?;
        let name = now.declaration.text(now.declaration.resources[resource as usize].name);
        let link = match carrier {
            Carrier::History(_) => Link::History(name.strip_suffix(".previous").unwrap_or(name).to_owned()),
            Carrier::Kept(_) => Link::Kept(name.to_owned()),
        };
        Some(Node { report: node.report, path: extended(&node.path, link) })
    }

    /// Extends the path of the cause by this finding.
    fn propagate(&self, frame: u32, finding: &Finding, cause: &Node) -> Node {
        if finding.pass_index.is_none() {
            return cause.clone();
        }
        Node { report: cause.report, path: extended(&cause.path, step(frame, finding)) }
    }

    /// The finding has no cause: it is an origin, either a known one again or a new one.
    fn add_origin(&mut self, frame: u32, finding: &Finding) -> Node {
        let path = vec![step(frame, finding)];
        let same = |r: &Report| r.origin.pass == finding.pass && r.origin.output == finding.output;
        let report = self.reports.iter().position(same);
        if let Some(at) = report {
            self.reports[at].arose += 1;
        } else if self.reports.len() < MAX_ENTRIES {
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

    /// The histories and kept buffers that this frame leaves bad.
    fn carry(&self, now: &Frame<'_>) -> HashMap<Carrier, Node> {
        let mut carried = HashMap::new();
        for (resource, decl) in (0..).zip(&now.declaration.resources) {
            let carrier = match decl.origin {
                Origin::Imported { key: ImportKey::Next(index), .. } => Carrier::History(index),
                Origin::Imported { key: ImportKey::Kept(index), .. } => Carrier::Kept(index),
                Origin::Imported { .. } | Origin::Transient => continue,
            };
            let (mips, layers) = decl.shape.parts();
            if let Some(node) = self.bad_part(now, resource, decl.versions - 1, Part::ALL.of(mips, layers)) {
                carried.insert(carrier, node);
            }
        }
        carried
    }
}

impl Frame<'_> {
    /// The history or kept buffer behind a resource, and whether the resource holds contents of an earlier frame.
    fn carrier(&self, resource: u32) -> Option<(Carrier, bool)> {
        match self.declaration.resources[resource as usize].origin {
            Origin::Imported { key: ImportKey::Previous(index), .. } => Some((Carrier::History(index), true)),
            Origin::Imported { key: ImportKey::Next(index), .. } => Some((Carrier::History(index), false)),
            Origin::Imported { key: ImportKey::Kept(index), .. } => Some((Carrier::Kept(index), true)),
            Origin::Imported { key: ImportKey::Caller(_), .. } | Origin::Transient => None,
        }
    }
}

fn step(frame: u32, finding: &Finding) -> Link {
    Link::Pass { pass: finding.pass.clone(), output: finding.output.clone(), frames: [frame; 2] }
}

/// A path with one more link. A link that is already on the path twice circulates through histories: the path is then cut at its
/// second occurrence, whose frame range is extended to this frame.
fn extended(path: &Rc<Vec<Link>>, link: Link) -> Rc<Vec<Link>> {
    let second = path.iter().enumerate().filter(|(_, known)| known.is_same(&link)).map(|(at, _)| at).nth(1);
    let mut longer = path.to_vec();
    if let Some(at) = second {
        longer.truncate(at + 1);
        if let (Some(Link::Pass { frames: known, .. }), Link::Pass { frames, .. }) = (longer.last_mut(), &link) {
            known[1] = frames[1];
        }
    } else if longer.len() < MAX_ENTRIES {
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
#[path = "tracker_tests.rs"]
mod tests;
