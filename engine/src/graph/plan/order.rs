//! The order in which passes run.
//!
//! Every order that respects the dependencies gives the same frame. Of the passes that are ready, a greedy list scheduler takes
//! the one that frees most memory (or needs least). With several queues, it schedules passes of other queues first and defers
//! passes that wait for them. Its order is used if it needs less memory than the declared order, or if there are several queues.

use super::{
    super::{access::Queue, declaration::Declaration},
    hazard::Hazards,
};

/// Number of ready passes that are compared. The limit keeps the scheduler linear in wide graphs.
const WINDOW: usize = 48;

/// The passes in `kept`, in the order in which they run.
pub(super) fn order(
    declaration: &Declaration,
    kept: Vec<u32>,
    hazards: &Hazards,
    queues: &[Queue],
    reorder: bool,
) -> Vec<u32> {
    if !reorder || kept.len() < 3 {
        return kept;
    }
    let several_queues = kept.iter().any(|&p| queues[p as usize] != Queue::Graphics);
    let mut transients = Transients::new(declaration, &kept);
    let Some(chosen) = schedule(declaration, &kept, hazards, queues, &mut transients) else {
        return kept; // there was never a choice
    };
    let better = several_queues || transients.peak(declaration, &chosen) < transients.peak(declaration, &kept);
    if better { chosen } else { kept }
}

/// The list scheduler. `None` if there was never a choice, in which case the declared order stands.
fn schedule(
    declaration: &Declaration,
    kept: &[u32],
    hazards: &Hazards,
    queues: &[Queue],
    transients: &mut Transients,
) -> Option<Vec<u32>> {
    // Successors of each pass, and the number of passes that each still waits for.
    let count = declaration.passes.len();
    let (mut waits, mut first) = (vec![0_u32; count], vec![0_u32; count + 1]);
    for &pass in kept {
        waits[pass as usize] = hazards.before(pass).len() as u32;
        hazards.before(pass).iter().for_each(|&b| first[b as usize + 1] += 1);
    }
    for i in 0..count {
        first[i + 1] += first[i];
    }
    let mut next = first.clone();
    let mut after = vec![0_u32; first[count] as usize];
    for &pass in kept {
        for &b in hazards.before(pass) {
            after[next[b as usize] as usize] = pass;
            next[b as usize] += 1;
        }
    }

    // Position at which each pass of another queue was scheduled: passes that wait for a late one are deferred.
    let mut handed_over = vec![0_u32; count];
    let mut order = Vec::with_capacity(kept.len());
    let mut ready: Vec<u32> = kept.iter().copied().filter(|&p| waits[p as usize] == 0).collect();
    let mut had_choice = false;
    while !ready.is_empty() {
        let best = if ready.len() == 1 {
            0
        } else {
            had_choice = true;
            let score = |pass: u32| {
                let class = if queues[pass as usize] != Queue::Graphics {
                    0
                } else {
                    let others = hazards.before(pass).iter().filter(|&&b| queues[b as usize] != Queue::Graphics);
                    // 1 if it waits for no other queue, larger the later the pass that it waits for was scheduled.
                    others.map(|&b| 1 + handed_over[b as usize]).max().unwrap_or(1)
                };
                (class, transients.change(declaration, pass), pass)
            };
            let window = ready.iter().take(WINDOW).enumerate();
            window.min_by_key(|(_, pass)| score(**pass)).map_or(0, |(i, _)| i)
        };
        let pass = ready.remove(best);
        transients.run(declaration, pass);
        order.push(pass);
        if queues[pass as usize] != Queue::Graphics {
            handed_over[pass as usize] = order.len() as u32;
        }
        for &a in &after[first[pass as usize] as usize..first[pass as usize + 1] as usize] {
            waits[a as usize] -= 1;
            if waits[a as usize] == 0 {
                // Sorted, so that equal scores keep the declared order.
                let at = ready.partition_point(|&r| r < a);
                ready.insert(at, a);
            }
        }
    }
    debug_assert_eq!(order.len(), kept.len(), "hazards point from later to earlier passes only");
    had_choice.then_some(order)
}

/// Number of uses of each resource by kept passes.
struct Transients {
    uses: Vec<u32>,
    /// Uses that have not been scheduled yet.
    left: Vec<u32>,
}

impl Transients {
    fn new(declaration: &Declaration, kept: &[u32]) -> Self {
        let mut uses = vec![0; declaration.resources.len()];
        for &pass in kept {
            declaration.uses_of(pass).iter().for_each(|u| uses[u.resource as usize] += 1);
        }
        Self { left: uses.clone(), uses }
    }

    /// Bytes of transients that become alive with a pass, less those that it uses last.
    fn change(&self, declaration: &Declaration, pass: u32) -> i64 {
        let mut bytes = 0;
        for u in declaration.uses_of(pass) {
            let (resource, decl) = (u.resource as usize, &declaration.resources[u.resource as usize]);
            if decl.is_transient() {
                let made = self.left[resource] == self.uses[resource];
                let of_it = declaration.uses_of(pass).iter().filter(|o| o.resource == u.resource).count() as u32;
                let ends = self.left[resource] == of_it;
                bytes += (i64::from(made) - i64::from(ends)) * (decl.bytes() / u64::from(of_it)) as i64;
            }
        }
        bytes
    }

    fn run(&mut self, declaration: &Declaration, pass: u32) {
        declaration.uses_of(pass).iter().for_each(|u| self.left[u.resource as usize] -= 1);
    }

    /// Largest number of bytes alive at one time in this order.
    fn peak(&mut self, declaration: &Declaration, order: &[u32]) -> u64 {
        self.left.clone_from(&self.uses);
        let (mut alive, mut peak) = (0, 0);
        for &pass in order {
            let uses = declaration.uses_of(pass);
            let transient = |resource: u32| {
                let decl = &declaration.resources[resource as usize];
                decl.is_transient().then(|| decl.bytes())
            };
            for u in uses {
                let resource = u.resource as usize;
                if let Some(bytes) = transient(u.resource).filter(|_| self.left[resource] == self.uses[resource]) {
                    alive += bytes;
                }
                self.left[resource] -= 1;
            }
            peak = peak.max(alive);
            for (i, u) in uses.iter().enumerate() {
                let is_last = !uses[i + 1..].iter().any(|o| o.resource == u.resource);
                if self.left[u.resource as usize] == 0 && is_last {
                    alive -= transient(u.resource).unwrap_or(0);
                }
            }
        }
        peak
    }
}

#[cfg(test)]
mod tests {
    use super::super::super::*;
    use super::super::plan_with;

    fn chain(g: &mut FrameGraph, name: &str, input: Option<Handle<Image>>, desc: ImageDesc) -> WriteHandle<Image> {
        g.pass(name, Queue::Graphics, |p| {
            input.map(|i| p.sample(i));
            (p.create("x", desc).0, |_: &mut Record| {})
        })
    }

    #[test]
    fn large_images_are_used_up_before_the_next_is_made() {
        let mut g = FrameGraph::new(Extent::new(64, 64));
        let (large, small) = (ImageDesc::full(Format::Rgba32Float), ImageDesc::half(Format::R8Unorm));
        let large: Vec<_> = ["a", "b", "c"].map(|n| chain(&mut g, n, None, large)).into_iter().collect();
        let small: Vec<_> = ["A", "B", "C"]
            .into_iter()
            .zip(&large)
            .map(|(name, l)| chain(&mut g, name, Some(l.read()), small))
            .collect();
        small.iter().for_each(|s| g.output(s.read()));
        let frame = g.finish().unwrap();
        let plan = plan_with(&frame.declaration, "");
        let names: Vec<&str> = plan.order.iter().map(|&p| frame.declaration.pass_name(p)).collect();
        assert_eq!(names, ["a", "A", "b", "B", "c", "C"]);
        let declared = plan_with(&frame.declaration, "no-reorder");
        assert_eq!(declared.order, [0, 1, 2, 3, 4, 5]);
        assert!(plan.memory.lower_bound * 2 < declared.memory.lower_bound);
    }

    #[test]
    fn other_queues_are_fed_first_and_waited_for_last() {
        let mut g = FrameGraph::new(Extent::new(64, 64));
        let desc = ImageDesc::full(Format::R8Unorm);
        let first = chain(&mut g, "first", None, desc);
        let lit = chain(&mut g, "light", Some(first.read()), desc);
        let shadows = g.pass("shadows", Queue::AsyncCompute, |p| {
            p.sample(first.read());
            (p.create("x", desc).0, |_: &mut Record| {})
        });
        let mixed = g.pass("mix", Queue::Graphics, |p| {
            p.sample(shadows.read());
            p.sample(lit.read());
            (p.create("x", desc).0, |_: &mut Record| {})
        });
        g.output(mixed.read());
        let frame = g.finish().unwrap();
        let names = |words: &str| -> Vec<String> {
            let plan = plan_with(&frame.declaration, words);
            plan.order.iter().map(|&p| frame.declaration.pass_name(p).to_owned()).collect()
        };
        assert_eq!(names("queues=2"), ["first", "shadows", "light", "mix"]);
        assert_eq!(names("queues=1"), ["first", "light", "shadows", "mix"]);
    }
}
