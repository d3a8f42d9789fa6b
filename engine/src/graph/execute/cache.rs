//! Cache of plans, by declaration.
//!
//! A declaration is a few flat lists of plain values, which are cheaper to compare than to hash. So declarations are compared
//! exactly, newest first, and a hash collision cannot give a frame the wrong plan.

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

/// Number of plans that are kept: enough for a frame and its variants in which images are read back or viewed.
const MAX_ENTRIES: usize = 8;

/// A planned declaration, with its objects if it has been bound.
pub(super) struct Entry {
    switches: Switches,
    pub declaration: Arc<Declaration>,
    pub plan: Arc<Plan>,
    pub bound: Option<Bound>,
}

impl Entry {
    /// The bound objects; an error before the first [`Pool::bind`].
    pub fn bound(&self) -> Result<&Bound, GpuError> {
        let missing = || GpuError::Call { call: "bind", code: "the plan was not bound".to_owned() };
        self.bound.as_ref().ok_or_else(missing)
    }
}

/// The cached plans, newest last.
#[derive(Default)]
pub(super) struct Cache(Vec<Entry>);

/// The plan, the closures that record the passes, and the lists of the declaration if they can be reused.
type Planned = (Entry, Vec<Option<RecordFn>>, Option<Declaration>);

impl Cache {
    /// The plan of a frame, from the cache or new. The entry is taken out of the cache while its frame runs.
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

    /// Puts an entry back. Its objects are kept only if the memory that they are bound to still exists.
    pub fn put_back(&mut self, mut entry: Entry, switches: Switches, pool: &Pool) {
        if !switches.cache {
            self.0.clear();
            return;
        }
        if let Some(bound) = &mut entry.bound {
            bound.release_imports();
        }
        if self.0.len() == MAX_ENTRIES {
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
