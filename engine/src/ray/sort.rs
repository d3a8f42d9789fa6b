//! Sorts rays so that rays with similar origin and direction are traced together and visit the same nodes.
//!
//! A counting sort over [`SORT_KEYS`] keys, in four small passes that are timed separately. The gain is in the time of the pass
//! that traces; `magpie bench rays` compares the two.
use super::Bounds;
use crate::gpu::{Gpu, GpuError, Kernel};
use crate::graph::{Buffer, BufferDesc, FrameGraph, Handle, Queue, Record};
use magpie_shaders::rays::{SORT_GROUP, SORT_KEYS, SortParams};
use magpie_shaders::{RAYS_SORT_CLEAR_COMP, RAYS_SORT_COUNT_COMP, RAYS_SORT_PLACE_COMP, RAYS_SORT_SCAN_COMP};

/// Sorts rays by direction and origin. Holds the compute pipelines.
#[derive(Clone, Copy, Debug)]
pub struct RaySort {
    clear: Kernel,
    count: Kernel,
    scan: Kernel,
    place: Kernel,
}

impl RaySort {
    /// Creates the pipelines.
    ///
    /// # Errors
    /// Pipeline creation failed.
    pub fn new(gpu: &Gpu) -> Result<Self, GpuError> {
        Ok(Self {
            clear: gpu.kernel(&RAYS_SORT_CLEAR_COMP)?,
            count: gpu.kernel(&RAYS_SORT_COUNT_COMP)?,
            scan: gpu.kernel(&RAYS_SORT_SCAN_COMP)?,
            place: gpu.kernel(&RAYS_SORT_PLACE_COMP)?,
        })
    }

    /// Adds the passes `rays.sort_clear`, `.sort_count`, `.sort_scan` and `.sort_place`. Returns the order: one `u32` per ray,
    /// the index of the ray to trace at that position.
    ///
    /// `rays` is a table of at least `count` [`magpie_shaders::rays::RayTask`]s. `bounds` should contain their origins; origins
    /// outside count as the nearest cell.
    pub fn add(self, g: &mut FrameGraph, rays: Handle<Buffer>, count: u32, bounds: &Bounds) -> Handle<Buffer> {
        let words = |n: u32| BufferDesc::new(4 * u64::from(n.max(1)));
        let extent = (bounds.max - bounds.min).max(glam::Vec3::splat(f32::MIN_POSITIVE));
        let (lower, scale) = (bounds.min.to_array(), (8.0 / extent).to_array());
        let params = SortParams { count, lower, scale, ..Default::default() };
        let groups = |n: u32| [n.div_ceil(SORT_GROUP), 1, 1];
        let Self { clear, count: counting, scan, place } = self;

        let counts = g.pass("rays.sort_clear", Queue::AsyncCompute, |p| {
            let (made, counts) = p.create_buffer("counts", words(SORT_KEYS));
            (made, move |c: &mut Record<'_>| {
                let params = SortParams { counts: c.id(counts), ..params };
                c.dispatch_groups(clear, &params, groups(SORT_KEYS));
            })
        });
        let (counts, keys) = g.pass("rays.sort_count", Queue::AsyncCompute, |p| {
            let rays = p.read(rays);
            let (counted, counts) = p.write_buffer(counts);
            let (made, keys) = p.create_buffer("keys", words(count));
            ((counted, made.read()), move |c: &mut Record<'_>| {
                let params = SortParams { rays: c.id(rays), counts: c.id(counts), keys: c.id(keys), ..params };
                c.dispatch_groups(counting, &params, groups(count));
            })
        });
        let counts = g.pass("rays.sort_scan", Queue::AsyncCompute, |p| {
            let (scanned, counts) = p.write_buffer(counts);
            (scanned, move |c: &mut Record<'_>| {
                c.dispatch_groups(scan, &SortParams { counts: c.id(counts), ..params }, [1; 3]);
            })
        });
        g.pass("rays.sort_place", Queue::AsyncCompute, |p| {
            let keys = p.read(keys);
            let (_, counts) = p.write_buffer(counts);
            let (made, order) = p.create_buffer("order", words(count));
            (made.read(), move |c: &mut Record<'_>| {
                let params = SortParams { counts: c.id(counts), keys: c.id(keys), order: c.id(order), ..params };
                c.dispatch_groups(place, &params, groups(count));
            })
        })
    }
}
