//! Plans of declarations that were seen before.
//!
//! A declaration is a few flat lists of plain values, and comparing them costs less than hashing them would: declarations are
//! compared as they are, the newest first, and no accident can give a frame the plan of another.

use std::sync::Arc;

use super::{
    super::{
        declaration::Declaration,
        error::GraphErrors,
        pass::{FrameGraph, RecordFn},
        plan::{Plan, plan},
        switches::{Queues, Switches},
    },
    bind::{Bound, Device, Pool},
};
use crate::gpu::GpuError;

/// Plans that are kept: the frame itself, and its variants with an image read back or looked at.
const MOST: usize = 8;

/// A planned declaration, with its objects if it has been bound.
pub(super) struct Entry {
    switches: Switches,
    pub declaration: Arc<Declaration>,
    pub plan: Arc<Plan>,
    pub bound: Option<Bound>,
}

impl Entry {
    /// The objects, once there are some.
    pub fn bound(&self) -> Result<&Bound, GpuError> {
        let missing = || GpuError::Call { call: "bind", code: "the plan was not bound".to_owned() };
        self.bound.as_ref().ok_or_else(missing)
    }
}

/// The newest last.
#[derive(Default)]
pub(super) struct Cache(Vec<Entry>);

/// The plan, what passes record, and the declaration's lists where they are free again.
type Planned = (Entry, Vec<Option<RecordFn>>, Option<Declaration>);

impl Cache {
    /// The plan of a frame: a known one, or a new one. The entry is taken out while its frame runs.
    pub fn plan(
        &mut self,
        graph: FrameGraph,
        switches: Switches,
        mut device: Device<'_>,
    ) -> Result<Planned, GraphErrors> {
        if !graph.errors.is_empty() {
            return Err(graph.finish().err().unwrap_or(GraphErrors(Vec::new())));
        }
        let same = |e: &Entry| e.switches == switches && *e.declaration == graph.declaration;
        if switches.cache
            && let Some(at) = self.0.iter().rposition(same)
        {
            return Ok((self.0.remove(at), graph.records, Some(graph.declaration)));
        }
        let frame = graph.finish()?;
        let queues = device.queues();
        let plan = Arc::new(plan(&frame.declaration, &switches, queues, &mut device));
        let declaration = Arc::new(frame.declaration);
        Ok((Entry { switches, declaration, plan, bound: None }, frame.records, None))
    }

    /// Keeps an entry for the next frame of its kind. Objects are kept only where that costs no memory.
    pub fn put_back(&mut self, mut entry: Entry, switches: Switches, pool: &Pool) {
        if !switches.cache {
            self.0.clear();
            return;
        }
        if let Some(bound) = &mut entry.bound {
            bound.release_imports();
        }
        if self.0.len() == MOST {
            self.0.remove(0);
        }
        self.0.push(entry);
        for entry in &mut self.0 {
            entry.bound.take_if(|bound| !bound.is_of(pool));
        }
    }
}

impl Device<'_> {
    fn queues(&self) -> Queues {
        self.gpu.queues()
    }
}
