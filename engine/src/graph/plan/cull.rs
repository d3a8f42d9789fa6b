//! Culls passes that the frame does not need.
//!
//! A pass is needed if a frame output, an imported resource of the caller or a needed pass depends on what it writes. A weak pass that
//! changes a resource is not needed by later readers of that resource. It is kept if everything that it reads is made anyway.

use super::super::declaration::{Declaration, ImportKey, Origin, ResourceDecl, Use, Writers};

/// A pass that the plan leaves out.
#[derive(Clone, Debug, PartialEq, Eq)]
pub struct Culled {
    /// Index of the pass.
    pub pass: u32,
    /// The reason, in words.
    pub reason: String,
}

/// Splits the passes into those that are kept, in the order of declaration, and those that are culled. With culling off, all are kept.
pub(super) fn cull(declaration: &Declaration, enabled: bool) -> (Vec<u32>, Vec<Culled>) {
    let count = declaration.passes.len() as u32;
    if !enabled {
        return ((0..count).collect(), Vec::new());
    }
    let none = vec![false; declaration.passes.len()];
    let mut search = Search {
        declaration,
        writers: declaration.writers(),
        carried: carried(declaration),
        kept: none.clone(),
        wanted: none.clone(),
        possible: none,
        open: Vec::new(),
    };

    for output in &declaration.outputs {
        if let Some(writer) = search.base_writer(output.resource, output.version) {
            search.keep(writer);
        }
    }
    let mut any_weak = false;
    for pass in 0..count {
        let weak = search.is_weak(pass);
        any_weak |= weak;
        if !weak && search.outlives_frame(pass) {
            search.keep(pass);
        }
    }
    if any_weak {
        // A weak pass reads only what was declared before it, and is wanted only by passes after it: one sweep each way suffices.
        for pass in 0..count {
            search.possible[pass as usize] = search.is_weak(pass) && search.missing_input(pass).is_none();
        }
        for pass in (0..count).rev() {
            if search.possible[pass as usize] && (search.wanted[pass as usize] || search.outlives_frame(pass)) {
                search.keep(pass);
            }
        }
    }

    let mut kept = Vec::with_capacity(declaration.passes.len());
    kept.extend((0..count).filter(|&pass| search.kept[pass as usize]));
    let left_out = (0..count).filter(|&pass| !search.kept[pass as usize]);
    let culled = left_out.map(|pass| Culled { pass, reason: search.reason(pass) }).collect();
    (kept, culled)
}

/// For each half of a history and each kept resource, the resource that goes to the next frame. Keeping any part of it keeps the
/// whole. Empty if there are none.
fn carried(declaration: &Declaration) -> Vec<Option<u32>> {
    let key = |r: &ResourceDecl| match r.origin {
        Origin::Imported { key, .. } => Some(key),
        Origin::Transient => None,
    };
    let is_kept = |r: &ResourceDecl| matches!(key(r), Some(ImportKey::Kept(_)));
    if declaration.histories.is_empty() && !declaration.resources.iter().any(is_kept) {
        return Vec::new();
    }
    let resources = declaration.resources.iter().zip(0..);
    let mut carried: Vec<Option<u32>> = resources.map(|(r, index)| is_kept(r).then_some(index)).collect();
    for history in &declaration.histories {
        carried[history.previous as usize] = Some(history.next);
        carried[history.next as usize] = Some(history.next);
    }
    carried
}

struct Search<'d> {
    declaration: &'d Declaration,
    writers: Writers,
    carried: Vec<Option<u32>>,
    kept: Vec<bool>,
    /// Weak passes that changed something that a kept pass reads.
    wanted: Vec<bool>,
    /// Weak passes whose inputs are all made by kept passes or by other such weak passes.
    possible: Vec<bool>,
    /// Passes known to be needed whose inputs have not been followed yet.
    open: Vec<u32>,
}

impl<'d> Search<'d> {
    fn is_weak(&self, pass: u32) -> bool {
        self.declaration.passes[pass as usize].weak
    }

    fn uses(&self, pass: u32) -> &'d [Use] {
        self.declaration.uses_of(pass)
    }

    /// Whether a pass writes an imported resource of the caller. A history's next half counts only if this frame needs its
    /// previous half; [`Self::keep`] handles that.
    fn outlives_frame(&self, pass: u32) -> bool {
        let held = |u: &Use| match self.declaration.resources[u.resource as usize].origin {
            Origin::Imported { key, .. } => matches!(key, ImportKey::Caller(_)),
            Origin::Transient => false,
        };
        self.uses(pass).iter().any(|u| u.writes.is_some() && held(u))
    }

    /// Keeps a pass and everything that it depends on.
    fn keep(&mut self, pass: u32) {
        let mut open = std::mem::take(&mut self.open);
        open.push(pass);
        while let Some(pass) = open.pop() {
            if std::mem::replace(&mut self.kept[pass as usize], true) {
                continue;
            }
            let weak = self.is_weak(pass);
            for u in self.uses(pass) {
                let Some(version) = u.reads else { continue };
                open.extend(self.base_writer(u.resource, version));
                let carried = self.carried.get(u.resource as usize).copied().flatten();
                if let Some(next) = carried.filter(|_| !weak) {
                    let newest = self.declaration.resources[next as usize].versions - 1;
                    open.extend(self.base_writer(next, newest));
                }
            }
        }
        self.open = open;
    }

    /// The pass that a version depends on: its writer, or the last writer before it that is not a weak change. Marks those weak
    /// passes as wanted.
    fn base_writer(&mut self, resource: u32, version: u32) -> Option<u32> {
        let mut version = version;
        loop {
            let writer = self.writers.get(resource, version)?;
            if !self.is_change(resource, version, writer) {
                return Some(writer);
            }
            self.wanted[writer as usize] = true;
            version -= 1;
        }
    }

    /// Whether this version is a change by a weak pass to contents that would be valid without it.
    fn is_change(&self, resource: u32, version: u32, writer: u32) -> bool {
        let first = u32::from(self.declaration.resources[resource as usize].is_undefined());
        self.is_weak(writer) && version > first
    }

    /// The first input that no kept pass makes, and the pass that would make it.
    fn missing_input(&self, pass: u32) -> Option<(&'d Use, u32)> {
        self.uses(pass).iter().find_map(|u| {
            let mut version = u.reads?;
            let writer = loop {
                let writer = self.writers.get(u.resource, version)?;
                if !self.is_change(u.resource, version, writer) {
                    break writer;
                }
                version -= 1;
            };
            let made = self.kept[writer as usize] || self.possible[writer as usize];
            (!made).then_some((u, writer))
        })
    }

    fn reason(&self, pass: u32) -> String {
        let name = |u: &Use| self.declaration.resource_name(u.resource);
        if self.is_weak(pass)
            && let Some((missing, writer)) = self.missing_input(pass)
        {
            let (missing, writer) = (name(missing), self.declaration.pass_name(writer));
            return format!("it only observes, and `{missing}` is not made: pass `{writer}` is left out");
        }
        let written: Vec<String> =
            self.uses(pass).iter().filter(|u| u.writes.is_some()).map(|u| format!("`{}`", name(u))).collect();
        match written.as_slice() {
            [] => "it writes nothing".to_owned(),
            all => format!("nothing that is kept needs {}", all.join(", ")),
        }
    }
}

#[cfg(test)]
mod tests {
    use super::super::super::*;

    const DESC: fn() -> ImageDesc = || ImageDesc::full(Format::Rgba16Float);

    fn make(g: &mut FrameGraph, name: &str) -> WriteHandle<Image> {
        g.pass(name, Queue::Graphics, |p| (p.create("image", DESC()).0, |_: &mut Record| {}))
    }

    fn from(g: &mut FrameGraph, name: &str, input: Handle<Image>) -> WriteHandle<Image> {
        g.pass(name, Queue::Graphics, |p| {
            p.sample(input);
            (p.create("image", DESC()).0, |_: &mut Record| {})
        })
    }

    fn findings(g: &mut FrameGraph) -> WriteHandle<Buffer> {
        g.import_buffer("findings", BufferDesc::new(64), Access::HostRead, ImportKey::Caller(0))
    }

    fn scan(
        g: &mut FrameGraph,
        name: &str,
        image: Handle<Image>,
        findings: WriteHandle<Buffer>,
    ) -> WriteHandle<Buffer> {
        g.weak_pass(name, Queue::Graphics, |p| {
            p.sample(image);
            (p.write_buffer(findings).0, |_: &mut Record| {})
        })
    }

    fn order(g: FrameGraph) -> (Vec<String>, Vec<(String, String)>) {
        let frame = g.finish().unwrap();
        let plan = super::super::plan_with(&frame.declaration, "");
        let name = |p: u32| frame.declaration.pass_name(p).to_owned();
        let culled = plan.culled.iter().map(|c| (name(c.pass), c.reason.clone())).collect();
        (plan.order.iter().map(|&p| name(p)).collect(), culled)
    }

    #[test]
    fn keeps_what_outputs_need_and_says_why_the_rest_goes() {
        let mut g = FrameGraph::new(Extent::new(8, 8));
        let a = make(&mut g, "a");
        let b = from(&mut g, "b", a.read());
        let c = from(&mut g, "c", a.read());
        let _ = from(&mut g, "d", c.read());
        g.pass("e", Queue::Graphics, |p| (p.sample(b.read()), |_: &mut Record| {}));
        g.output(b.read());
        let (kept, culled) = order(g);
        assert_eq!(kept, ["a", "b"]);
        let culled: Vec<_> = culled.iter().map(|(p, r)| (p.as_str(), r.as_str())).collect();
        assert_eq!(
            culled,
            [
                ("c", "nothing that is kept needs `c:image`"),
                ("d", "nothing that is kept needs `d:image`"),
                ("e", "it writes nothing"),
            ]
        );
    }

    #[test]
    fn an_older_version_does_not_need_a_newer_one() {
        let mut g = FrameGraph::new(Extent::new(8, 8));
        let a = make(&mut g, "a");
        g.output(a.read());
        let _ = g.pass("b", Queue::Graphics, |p| (p.write(a).0, |_: &mut Record| {}));
        assert_eq!(order(g).0, ["a"]);
    }

    #[test]
    fn a_newer_version_needs_the_older_one() {
        let mut g = FrameGraph::new(Extent::new(8, 8));
        let a = make(&mut g, "a");
        let b = g.pass("b", Queue::Graphics, |p| (p.write(a).0, |_: &mut Record| {}));
        g.output(b.read());
        assert_eq!(order(g).0, ["a", "b"]);
    }

    #[test]
    fn writing_an_import_is_needed_by_itself() {
        let mut g = FrameGraph::new(Extent::new(8, 8));
        let a = make(&mut g, "a");
        let readback = g.import_buffer("readback", BufferDesc::new(512), Access::HostRead, ImportKey::Caller(7));
        let readback = g.pass("b", Queue::Graphics, |p| {
            p.copy_from(a.read());
            (p.copy_to(readback).0, |_: &mut Record| {})
        });
        assert!(matches!(
            g.declaration().resources[readback.read().id() as usize].origin,
            Origin::Imported { key: ImportKey::Caller(7), .. }
        ));
        assert_eq!(order(g).0, ["a", "b"]);
    }

    #[test]
    fn weak_passes_see_what_is_there_and_keep_nothing() {
        let mut g = FrameGraph::new(Extent::new(8, 8));
        let findings = findings(&mut g);
        let a = make(&mut g, "a");
        let findings = scan(&mut g, "scan a", a.read(), findings);
        let b = make(&mut g, "b");
        let findings = scan(&mut g, "scan b", b.read(), findings);
        let c = from(&mut g, "c", a.read());
        let findings = scan(&mut g, "scan c", c.read(), findings);
        g.output(findings.read());
        g.output(c.read());
        let (kept, culled) = order(g);
        assert_eq!(kept, ["a", "scan a", "c", "scan c"]);
        assert_eq!(culled[1].0, "scan b");
        assert_eq!(culled[1].1, "it only observes, and `b:image` is not made: pass `b` is left out");
    }

    #[test]
    fn weak_chains_live_and_die_together() {
        for alive in [true, false] {
            let mut g = FrameGraph::new(Extent::new(8, 8));
            let findings = findings(&mut g);
            let a = make(&mut g, "a");
            let sum = g.weak_pass("sum", Queue::Graphics, |p| {
                p.sample(a.read());
                (p.create("sum", DESC()).0, |_: &mut Record| {})
            });
            let _ = scan(&mut g, "scan", sum.read(), findings);
            if alive {
                g.output(a.read());
                assert_eq!(order(g).0, ["a", "sum", "scan"]);
            } else {
                assert_eq!(order(g).0, Vec::<String>::new());
            }
        }
    }

    #[test]
    fn the_first_contents_of_an_import_are_no_mere_change() {
        for (state, kept) in [
            (ImageState::UNDEFINED, vec!["a", "fill", "b"]),
            (ImageState::last(Access::Sample, Domain::Compute), vec!["b"]),
        ] {
            let mut g = FrameGraph::new(Extent::new(8, 8));
            let a = make(&mut g, "a");
            let import = g.import_image("import", DESC(), state, ImportKey::Caller(0));
            let import = g.weak_pass("fill", Queue::Graphics, |p| {
                p.sample(a.read());
                (p.write(import).0, |_: &mut Record| {})
            });
            let b = from(&mut g, "b", import.read());
            g.output(b.read());
            assert_eq!(order(g).0, kept);
        }
    }

    #[test]
    fn a_weak_pass_that_is_needed_is_like_any_other() {
        let mut g = FrameGraph::new(Extent::new(8, 8));
        let a = make(&mut g, "a");
        let b = g.weak_pass("b", Queue::Graphics, |p| {
            p.sample(a.read());
            (p.create("image", DESC()).0, |_: &mut Record| {})
        });
        let c = from(&mut g, "c", b.read());
        g.output(c.read());
        assert_eq!(order(g).0, ["a", "b", "c"]);
    }
}
