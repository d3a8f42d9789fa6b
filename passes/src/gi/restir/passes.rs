//! The passes from paths to noisy light.
use super::settings::Options;
use crate::contracts::{Channel, LightingIn, RAY_START};
use crate::gi::MATERIAL;
use crate::parts::hit_shading::HitShading;
use crate::parts::pixel_lists::{PixelList, PixelLists};
use crate::ray_kernels::RayKernels;
use magpie::gpu::Kernel;
use magpie::graph::{BufferToken, HistoryScope};
use magpie::prelude::*;
use magpie::slot::{Build, SlotError};
use magpie_shaders::denoise::NO_IMAGE;
use magpie_shaders::path_reservoirs::*;
use magpie_shaders::{
    Address, GI_RESTIR_SAMPLE_RAY, GI_RESTIR_SHADE_COMP, GI_RESTIR_SHOW_COMP, GI_RESTIR_SPATIAL_RAY,
    GI_RESTIR_TEMPORAL_COMP, GI_RESTIR_TINTED_SAMPLE_RAY, GI_RESTIR_TINTED_SPATIAL_RAY, GI_RESTIR_TINTED_VALIDATE_RAY,
    GI_RESTIR_VALIDATE_RAY,
};

/// What `spatial_1` and so on count: neighbours in the picture, those of them on another surface, Jacobians of samples between pixels, and
/// those of them that are refused.
const COUNTED: [&str; 4] = ["neighbours", "unlike", "jacobians", "refused"];

/// What all passes read.
#[derive(Clone, Copy)]
struct Common<'a> {
    view: &'a View,
    i: LightingIn,
    hits: HitShading,
    regularization: f32,
    /// Of the grid of pixels that are worked on.
    extent: Extent,
}

impl Common<'_> {
    fn each<T>(&self) -> BufferDesc {
        BufferDesc::new(size_of::<T>() as u64 * u64::from(self.extent.width) * u64::from(self.extent.height))
    }
}

/// What the previous frame kept.
#[derive(Clone, Copy)]
struct Kept {
    receivers: Handle<Buffer>,
    reservoirs: Handle<Buffer>,
    /// Set if samples are traced again.
    changes: Option<Handle<Buffer>>,
}

/// What this frame keeps for the next.
struct Next {
    receivers: WriteHandle<Buffer>,
    reservoirs: WriteHandle<Buffer>,
    changes: Option<WriteHandle<Buffer>>,
}

/// What was merged with what the pixels had.
struct Carried {
    reservoirs: Handle<Buffer>,
    changes: Option<Handle<Buffer>>,
}

/// The surfaces and the samples of a frame.
#[derive(Clone, Copy)]
struct Drawn {
    receivers: Handle<Buffer>,
    samples: Handle<Buffer>,
}

/// The passes.
pub struct Passes {
    sample: RayKernels,
    validate: RayKernels,
    spatial: RayKernels,
    temporal: Kernel,
    shade: Kernel,
    show: Kernel,
    lists: PixelLists,
    scope: HistoryScope,
    options: Options,
    format: Format,
}

impl Passes {
    /// Creates the pipelines. `format`: of the light.
    pub fn new(build: &Build<'_>, options: Options, format: Format) -> Result<Self, SlotError> {
        Ok(Self {
            sample: RayKernels::new(build, &GI_RESTIR_SAMPLE_RAY, &GI_RESTIR_TINTED_SAMPLE_RAY)?,
            validate: RayKernels::new(build, &GI_RESTIR_VALIDATE_RAY, &GI_RESTIR_TINTED_VALIDATE_RAY)?,
            spatial: RayKernels::new(build, &GI_RESTIR_SPATIAL_RAY, &GI_RESTIR_TINTED_SPATIAL_RAY)?,
            temporal: build.kernel(&GI_RESTIR_TEMPORAL_COMP)?,
            shade: build.kernel(&GI_RESTIR_SHADE_COMP)?,
            show: build.kernel(&GI_RESTIR_SHOW_COMP)?,
            lists: PixelLists::new(build, "gi")?,
            scope: HistoryScope::new(),
            options,
            format,
        })
    }

    /// Adds the passes. Returns scattered radiance over the albedo, of half the frame's size at half resolution.
    pub fn add(
        &self,
        g: &mut FrameGraph,
        view: &View,
        i: LightingIn,
        hits: HitShading,
        regularization: f32,
    ) -> Handle<Image> {
        let full = g.extent(i.gbuffer.depth);
        let extent = if self.options.half { full.half() } else { full };
        let common = Common { view, i, hits, regularization, extent };
        let (kept, next) = (self.options.cap > 0).then(|| self.history(g, common)).unzip();
        let (next_receivers, mut next, next_changes) = match next {
            Some(Next { receivers, reservoirs, changes }) => (Some(receivers), Some(reservoirs), changes),
            None => (None, None, None),
        };
        let drawn = self.draw(g, common, next_receivers);
        let mut carried = Carried { reservoirs: drawn.samples, changes: None };
        if let Some(kept) = kept {
            let target = next.take_if(|_| !self.options.keeps_spatial);
            carried = self.carry_on(g, common, drawn, kept, (target, next_changes));
        }
        let mut reservoirs = carried.reservoirs;
        for round in 0..self.options.rounds {
            let target = next.take_if(|_| round + 1 == self.options.rounds);
            reservoirs = self.borrow(g, common, drawn.receivers, reservoirs, round, target);
        }
        let shown = if self.options.keeps_spatial { reservoirs } else { carried.reservoirs };
        self.show(g, common, Carried { reservoirs: shown, ..carried });
        self.shade(g, common, drawn.receivers, reservoirs)
    }

    fn history(&self, g: &mut FrameGraph, common: Common<'_>) -> (Kept, Next) {
        let receivers = g.history_buffer(&self.scope, "receivers", common.each::<PathReceiver>());
        let reservoirs = g.history_buffer(&self.scope, "reservoirs", common.each::<PathReservoir>());
        let Extent { width, height } = common.extent;
        let tiles = u64::from(width.div_ceil(CHANGES_TILE)) * u64::from(height.div_ceil(CHANGES_TILE));
        let desc = BufferDesc::new(size_of::<PathChanges>() as u64 * tiles);
        let changes = (self.options.validate > 0).then(|| g.history_buffer(&self.scope, "changes", desc));
        let (changes, next_changes) = changes.map(|changes| (changes.previous, changes.next)).unzip();
        let kept = Kept { receivers: receivers.previous, reservoirs: reservoirs.previous, changes };
        (kept, Next { receivers: receivers.next, reservoirs: reservoirs.next, changes: next_changes })
    }

    /// Traces the samples of a frame.
    fn draw(&self, g: &mut FrameGraph, common: Common<'_>, next: Option<WriteHandle<Buffer>>) -> Drawn {
        let Common { view, i, hits, regularization, extent } = common;
        let (kernel, block) = (self.sample.of(view), view.block);
        let Options { validate, modes, .. } = self.options;
        g.pass("gi.sample", Queue::AsyncCompute, |p| {
            let (block, scene, hits) = (p.read(block), i.scene.trace(p), hits.read(p));
            let gbuffer = i.gbuffer.read(p, &[RAY_START, MATERIAL].concat());
            let (receivers, receivers_token) = match next {
                Some(next) => p.write_buffer(next),
                None => p.create_buffer("receivers", common.each::<PathReceiver>()),
            };
            let (samples, samples_token) = p.create_buffer("samples", common.each::<PathReservoir>());
            (Drawn { receivers: receivers.read(), samples: samples.read() }, move |c: &mut Record<'_>| {
                let params = PathSampleParams {
                    view: c.id(block),
                    scene: c.id(scene.root),
                    rays: c.rays(),
                    not_finite: c.not_finite(),
                    gbuffer: gbuffer.images(c),
                    hits: hits.params(c),
                    receivers: c.id(receivers_token),
                    samples: c.id(samples_token),
                    validate,
                    modes,
                    regularization,
                };
                c.trace(kernel, scene.tlas, &params, extent);
            })
        })
    }

    /// Merges samples with what their pixels had, into `target` or a buffer of its own.
    fn carry_on(
        &self,
        g: &mut FrameGraph,
        common: Common<'_>,
        drawn: Drawn,
        kept: Kept,
        (target, changes): (Option<WriteHandle<Buffer>>, Option<WriteHandle<Buffer>>),
    ) -> Carried {
        let Common { view, i, extent, .. } = common;
        let Options { cap, life, validate, modes, stretch, .. } = self.options;
        let (kernel, block) = (self.temporal, view.block);
        let list = (validate > 0).then(|| self.lists.empty(g, "due", extent));
        let (resampled, due) = g.pass("gi.temporal", Queue::AsyncCompute, |p| {
            let (block, taps) = (p.read(block), p.sample(i.reprojected.taps));
            let motion = i.gbuffer.read(p, &[Channel::Motion]);
            let (receivers, samples) = (p.read(drawn.receivers), p.read(drawn.samples));
            let (previous_receivers, previous) = (p.read(kept.receivers), p.read(kept.reservoirs));
            let previous_changes = kept.changes.map(|changes| p.read(changes));
            let (resampled, token) = match target {
                Some(target) => p.write_buffer(target),
                None => p.create_buffer("reservoirs", common.each::<PathReservoir>()),
            };
            let (list, list_token) = list.map(|list| list.fill(p)).unzip();
            let (changes, changes_token) = changes.map(|changes| p.write_buffer(changes)).unzip();
            ((resampled, list.zip(changes)), move |c: &mut Record<'_>| {
                let address =
                    |c: &Record<'_>, token: Option<BufferToken>| token.map_or(Address::default(), |t| c.id(t));
                let params = PathTemporalParams {
                    view: c.id(block),
                    not_finite: c.not_finite(),
                    receivers: c.id(receivers),
                    previous_receivers: c.id(previous_receivers),
                    samples: c.id(samples),
                    previous: c.id(previous),
                    resampled: c.id(token),
                    list: address(c, list_token),
                    previous_changes: address(c, previous_changes),
                    changes: address(c, changes_token),
                    motion: motion.images(c).motion,
                    taps: c.id(taps),
                    cap,
                    validate,
                    life,
                    modes,
                    stretch,
                };
                c.dispatch(kernel, &params, extent);
            })
        });
        match due {
            Some((list, changes)) => self.validate(g, common, drawn, list, (resampled, changes)),
            None => Carried { reservoirs: resampled.read(), changes: None },
        }
    }

    /// Traces listed samples again, and merges them.
    fn validate(
        &self,
        g: &mut FrameGraph,
        common: Common<'_>,
        drawn: Drawn,
        list: PixelList,
        (resampled, changes): (WriteHandle<Buffer>, WriteHandle<Buffer>),
    ) -> Carried {
        let Common { view, i, hits, regularization, .. } = common;
        let Options { cap, modes, stretch, .. } = self.options;
        let (kernel, block) = (self.validate.of(view), view.block);
        g.pass("gi.validate", Queue::AsyncCompute, |p| {
            let (block, scene, hits, list) = (p.read(block), i.scene.trace(p), hits.read(p), list.read(p));
            let (receivers, samples) = (p.read(drawn.receivers), p.read(drawn.samples));
            let (resampled, token) = p.write_buffer(resampled);
            let (changes, changes_token) = p.write_buffer(changes);
            (Carried { reservoirs: resampled.read(), changes: Some(changes.read()) }, move |c: &mut Record<'_>| {
                let params = ValidateParams {
                    view: c.id(block),
                    scene: c.id(scene.root),
                    rays: c.rays(),
                    not_finite: c.not_finite(),
                    hits: hits.params(c),
                    receivers: c.id(receivers),
                    samples: c.id(samples),
                    resampled: c.id(token),
                    list: c.id(list.list),
                    changes: c.id(changes_token),
                    cap,
                    modes,
                    stretch,
                    regularization,
                };
                c.trace_indirect(kernel, scene.tlas, &params, list.threads, 0);
            })
        })
    }

    /// Merges reservoirs with those of pixels around, into `target` or a buffer of its own.
    fn borrow(
        &self,
        g: &mut FrameGraph,
        common: Common<'_>,
        receivers: Handle<Buffer>,
        reservoirs: Handle<Buffer>,
        round: u32,
        target: Option<WriteHandle<Buffer>>,
    ) -> Handle<Buffer> {
        let Common { view, i, extent, .. } = common;
        let Options { cap, neighbours, reach, modes, stretch, .. } = self.options;
        let (kernel, block) = (self.spatial.of(view), view.block);
        g.pass(&format!("gi.spatial_{}", round + 1), Queue::AsyncCompute, |p| {
            let (block, scene) = (p.read(block), i.scene.trace(p));
            let (receivers, reservoirs) = (p.read(receivers), p.read(reservoirs));
            let (resampled, token) = match target {
                Some(target) => p.write_buffer(target),
                None => p.create_buffer("reservoirs", common.each::<PathReservoir>()),
            };
            let asked = ImageDesc::fixed(Format::Rgba32Float, extent);
            let asked = p.is_watched("asked").then(|| p.create("asked", asked).1);
            (resampled.read(), move |c: &mut Record<'_>| {
                let counted = c.counts(&COUNTED);
                let params = PathSpatialParams {
                    view: c.id(block),
                    scene: c.id(scene.root),
                    rays: c.rays(),
                    not_finite: c.not_finite(),
                    around: counted,
                    jacobians: counted.offset(8),
                    receivers: c.id(receivers),
                    reservoirs: c.id(reservoirs),
                    resampled: c.id(token),
                    asked: asked.map_or(NO_IMAGE, |token| c.id(token).index()),
                    cap: cap.max(1),
                    neighbours,
                    reach,
                    round,
                    modes,
                    stretch,
                };
                c.trace(kernel, scene.tlas, &params, extent);
            })
        })
    }

    fn shade(
        &self,
        g: &mut FrameGraph,
        common: Common<'_>,
        receivers: Handle<Buffer>,
        reservoirs: Handle<Buffer>,
    ) -> Handle<Image> {
        let Common { view, i, extent, .. } = common;
        let (kernel, block, format, modes) = (self.shade, view.block, self.format, self.options.modes);
        let desc = if self.options.half { ImageDesc::half(format) } else { ImageDesc::like(format, i.gbuffer.depth) };
        g.pass("gi.shade", Queue::AsyncCompute, |p| {
            let block = p.read(block);
            let gbuffer = i.gbuffer.read(p, &[&[Channel::Depth, Channel::Normal], MATERIAL].concat());
            let (receivers, reservoirs) = (p.read(receivers), p.read(reservoirs));
            let (radiance, target) = p.create("radiance", desc);
            (radiance.read(), move |c: &mut Record<'_>| {
                let params = PathShadeParams {
                    view: c.id(block),
                    gbuffer: gbuffer.images(c),
                    receivers: c.id(receivers),
                    reservoirs: c.id(reservoirs),
                    radiance: c.id(target),
                    modes,
                    greatest: format.greatest(),
                };
                c.dispatch(kernel, &params, extent);
            })
        })
    }

    /// Adds a pass that shows what the next frame goes on from; culled unless it is asked for.
    fn show(&self, g: &mut FrameGraph, common: Common<'_>, carried: Carried) {
        let Common { view, extent, .. } = common;
        let (kernel, block, modes) = (self.show, view.block, self.options.modes);
        g.pass("gi.reservoirs", Queue::AsyncCompute, |p| {
            let (block, reservoirs) = (p.read(block), p.read(carried.reservoirs));
            let changes = carried.changes.map(|changes| p.read(changes));
            let mut image = |name, format| p.create(name, ImageDesc::fixed(format, extent)).1;
            let [radiance, changed] = ["radiance", "changed"].map(|name| image(name, Format::Rgba32Float));
            let [weight, confidence, age, traced] =
                ["weight", "confidence", "age", "traced"].map(|name| image(name, Format::R32Float));
            ((), move |c: &mut Record<'_>| {
                let params = PathShowParams {
                    view: c.id(block),
                    reservoirs: c.id(reservoirs),
                    changes: changes.map_or(Address::default(), |token| c.id(token)),
                    radiance: c.id(radiance),
                    weight: c.id(weight),
                    confidence: c.id(confidence),
                    age: c.id(age),
                    traced: c.id(traced),
                    changed: c.id(changed),
                    modes,
                };
                c.dispatch(kernel, &params, extent);
            })
        });
    }
}
