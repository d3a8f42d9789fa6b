//! The passes from candidates to noisy light.
use super::settings::{Options, Reuse};
use crate::contracts::{Channel, DirectIn, RAY_START};
use crate::direct::lobes::{Lobes, Noisy};
use crate::ray_kernels::RayKernels;
use magpie::gpu::Kernel;
use magpie::graph::{BufferHistory, HistoryScope};
use magpie::prelude::*;
use magpie::slot::{Build, SlotError};
use magpie_shaders::Address;
use magpie_shaders::resampling::*;
use magpie_shaders::{
    DIRECT_CANDIDATES_RAY, DIRECT_RESERVOIRS_COMP, DIRECT_SAMPLED_RAY, DIRECT_SPATIAL_RAY, DIRECT_TEMPORAL_RAY,
    DIRECT_TINTED_CANDIDATES_RAY, DIRECT_TINTED_SAMPLED_RAY, DIRECT_TINTED_SPATIAL_RAY, DIRECT_TINTED_TEMPORAL_RAY,
    DIRECT_TINTED_VISIBILITY_RAY, DIRECT_VISIBILITY_RAY,
};

/// What shading reads beside what rays start from.
const MATERIAL: &[Channel] = &[Channel::BaseColour, Channel::Material, Channel::Coat];

/// What all passes read.
#[derive(Clone, Copy)]
struct Common<'a> {
    view: &'a View,
    i: DirectIn,
    lights: Handle<Buffer>,
    surfaces: Handle<Buffer>,
}

/// What a frame keeps for the next.
struct Kept {
    reservoirs: BufferHistory,
    surfaces: BufferHistory,
}

/// The passes.
pub struct Passes {
    candidates: RayKernels,
    visibility: RayKernels,
    temporal: RayKernels,
    spatial: RayKernels,
    sampled: RayKernels,
    show: Kernel,
    scope: HistoryScope,
    options: Options,
}

impl Passes {
    /// Creates the pipelines.
    pub fn new(build: &Build<'_>, options: Options) -> Result<Self, SlotError> {
        Ok(Self {
            candidates: RayKernels::new(build, &DIRECT_CANDIDATES_RAY, &DIRECT_TINTED_CANDIDATES_RAY)?,
            visibility: RayKernels::new(build, &DIRECT_VISIBILITY_RAY, &DIRECT_TINTED_VISIBILITY_RAY)?,
            temporal: RayKernels::new(build, &DIRECT_TEMPORAL_RAY, &DIRECT_TINTED_TEMPORAL_RAY)?,
            spatial: RayKernels::new(build, &DIRECT_SPATIAL_RAY, &DIRECT_TINTED_SPATIAL_RAY)?,
            sampled: RayKernels::new(build, &DIRECT_SAMPLED_RAY, &DIRECT_TINTED_SAMPLED_RAY)?,
            show: build.kernel(&DIRECT_RESERVOIRS_COMP)?,
            scope: HistoryScope::new(),
            options,
        })
    }

    /// Adds the passes.
    pub fn add(&self, g: &mut FrameGraph, view: &View, i: DirectIn, lights: Handle<Buffer>, lobes: &Lobes) -> Noisy {
        let kept = self.options.reuse.filter(|reuse| reuse.cap > 0).map(|_| self.kept(g, i));
        let (previous, next) = kept
            .map(|Kept { reservoirs, surfaces }| {
                ((reservoirs.previous, surfaces.previous), (reservoirs.next, surfaces.next))
            })
            .unzip();
        let (next_reservoirs, next_surfaces) = next.unzip();
        let (surfaces, drawn) = self.draw(g, view, i, lights, next_surfaces);
        let common = Common { view, i, lights, surfaces };
        let reservoirs = match self.options.reuse {
            None => drawn.read(),
            Some(reuse) => self.reuse(g, common, reuse, drawn, previous, next_reservoirs),
        };
        self.show(g, view, i, reservoirs);
        self.shade(g, common, reservoirs, lobes)
    }

    fn kept(&self, g: &mut FrameGraph, i: DirectIn) -> Kept {
        let Extent { width, height } = g.extent(i.gbuffer.depth);
        let pixels = u64::from(width) * u64::from(height);
        Kept {
            reservoirs: g.history_buffer(&self.scope, "reservoirs", each::<Reservoir>(pixels)),
            surfaces: g.history_buffer(&self.scope, "surfaces", each::<LitSurface>(pixels)),
        }
    }

    /// Draws candidates. Returns the surfaces and the reservoirs.
    fn draw(
        &self,
        g: &mut FrameGraph,
        view: &View,
        i: DirectIn,
        lights: Handle<Buffer>,
        next: Option<WriteHandle<Buffer>>,
    ) -> (Handle<Buffer>, WriteHandle<Buffer>) {
        let (kernel, options, block) = (self.candidates.of(view), self.options, view.block);
        let tree = i.scene.light_tree.filter(|_| options.source == SOURCE_TREE);
        g.pass("direct.candidates", Queue::AsyncCompute, |p| {
            let (block, scene, lights) = (p.read(block), i.scene.trace(p), p.read(lights));
            let tree = tree.map(|tree| p.read(tree));
            let gbuffer = i.gbuffer.read(p, &[RAY_START, MATERIAL].concat());
            let extent = p.extent(i.gbuffer.depth);
            let pixels = u64::from(extent.width) * u64::from(extent.height);
            let (surfaces, surfaces_token) = match next {
                Some(next) => p.write_buffer(next),
                None => p.create_buffer("surfaces", each::<LitSurface>(pixels)),
            };
            let (reservoirs, reservoirs_token) = p.create_buffer("reservoirs", each::<Reservoir>(pixels));
            ((surfaces.read(), reservoirs), move |c: &mut Record<'_>| {
                let params = CandidateParams {
                    view: c.id(block),
                    scene: c.id(scene.root),
                    rays: c.rays(),
                    not_finite: c.not_finite(),
                    lights: c.id(lights),
                    tree: tree.map_or(Address::default(), |tree| c.id(tree)),
                    gbuffer: gbuffer.images(c),
                    surfaces: c.id(surfaces_token),
                    reservoirs: c.id(reservoirs_token),
                    near_candidates: options.candidates,
                    far_candidates: if options.directional { options.candidates.div_ceil(4) } else { 0 },
                    source: options.source,
                    widest_alpha: options.widest_alpha,
                };
                c.trace(kernel, scene.tlas, &params, extent);
            })
        })
    }

    /// Reuses samples. `next` is where the next frame finds the reservoirs.
    fn reuse(
        &self,
        g: &mut FrameGraph,
        common: Common<'_>,
        reuse: Reuse,
        drawn: WriteHandle<Buffer>,
        previous: Option<(Handle<Buffer>, Handle<Buffer>)>,
        mut next: Option<WriteHandle<Buffer>>,
    ) -> Handle<Buffer> {
        let mut reservoirs = self.test(g, common, drawn);
        if previous.is_some() {
            let target = next.take_if(|_| reuse.rounds == 0);
            reservoirs = self.resample(g, common, reuse, reservoirs, Lenders::Previous(previous), target);
        }
        for round in 0..reuse.rounds {
            let target = next.take_if(|_| round + 1 == reuse.rounds);
            reservoirs = self.resample(g, common, reuse, reservoirs, Lenders::Neighbours(round), target);
        }
        reservoirs
    }

    /// Drops hidden samples.
    fn test(&self, g: &mut FrameGraph, common: Common<'_>, reservoirs: WriteHandle<Buffer>) -> Handle<Buffer> {
        let Common { view, i, lights, surfaces } = common;
        let (kernel, block) = (self.visibility.of(view), view.block);
        g.pass("direct.visibility", Queue::AsyncCompute, |p| {
            let (block, scene, lights) = (p.read(block), i.scene.trace(p), p.read(lights));
            let surfaces = p.read(surfaces);
            let (tested, token) = p.write_buffer(reservoirs);
            let extent = p.extent(i.gbuffer.depth);
            (tested.read(), move |c: &mut Record<'_>| {
                let params = VisibilityParams {
                    view: c.id(block),
                    scene: c.id(scene.root),
                    rays: c.rays(),
                    lights: c.id(lights),
                    surfaces: c.id(surfaces),
                    reservoirs: c.id(token),
                };
                c.trace(kernel, scene.tlas, &params, extent);
            })
        })
    }

    /// Merges reservoirs with others, into `target` or a buffer of its own.
    fn resample(
        &self,
        g: &mut FrameGraph,
        common: Common<'_>,
        reuse: Reuse,
        reservoirs: Handle<Buffer>,
        from: Lenders,
        target: Option<WriteHandle<Buffer>>,
    ) -> Handle<Buffer> {
        let Common { view, i, lights, surfaces } = common;
        let block = view.block;
        let (kernel, name, round, previous) = match from {
            Lenders::Previous(previous) => (self.temporal.of(view), "direct.temporal".to_owned(), 0, previous),
            Lenders::Neighbours(round) => (self.spatial.of(view), format!("direct.spatial_{}", round + 1), round, None),
        };
        g.pass(&name, Queue::AsyncCompute, |p| {
            let (block, scene, lights) = (p.read(block), i.scene.trace(p), p.read(lights));
            let (surfaces, reservoirs) = (p.read(surfaces), p.read(reservoirs));
            let before = previous.map(|(reservoirs, surfaces)| {
                let motion = i.gbuffer.read(p, &[Channel::Motion]);
                (p.read(reservoirs), p.read(surfaces), motion, p.sample(i.reprojected.taps))
            });
            let extent = p.extent(i.gbuffer.depth);
            let pixels = u64::from(extent.width) * u64::from(extent.height);
            let (resampled, token) = match target {
                Some(target) => p.write_buffer(target),
                None => p.create_buffer("reservoirs", each::<Reservoir>(pixels)),
            };
            (resampled.read(), move |c: &mut Record<'_>| {
                let mut params = ResampleParams {
                    view: c.id(block),
                    scene: c.id(scene.root),
                    rays: c.rays(),
                    not_finite: c.not_finite(),
                    lights: c.id(lights),
                    surfaces: c.id(surfaces),
                    reservoirs: c.id(reservoirs),
                    resampled: c.id(token),
                    weights: reuse.weights,
                    cap: reuse.cap,
                    neighbours: reuse.neighbours,
                    radius: reuse.radius,
                    round,
                    tests_all: u32::from(reuse.tests_all),
                    ..ResampleParams::default()
                };
                if let Some((reservoirs, surfaces, motion, taps)) = before {
                    params.previous = c.id(reservoirs);
                    params.previous_surfaces = c.id(surfaces);
                    params.motion = motion.images(c).motion;
                    params.taps = c.id(taps);
                }
                c.trace(kernel, scene.tlas, &params, extent);
            })
        })
    }

    fn shade(&self, g: &mut FrameGraph, common: Common<'_>, reservoirs: Handle<Buffer>, lobes: &Lobes) -> Noisy {
        let Common { view, i, lights, surfaces } = common;
        let (kernel, block) = (self.sampled.of(view), view.block);
        g.pass("direct.sampled", Queue::AsyncCompute, |p| {
            let (block, scene, lights) = (p.read(block), i.scene.trace(p), p.read(lights));
            let (surfaces, reservoirs) = (p.read(surfaces), p.read(reservoirs));
            let gbuffer = i.gbuffer.read(p, &[&[Channel::Depth, Channel::Normal], MATERIAL].concat());
            let (noisy, targets) = lobes.create(p, &view.facts, i);
            let extent = p.extent(i.gbuffer.depth);
            (noisy, move |c: &mut Record<'_>| {
                let params = SampledLightParams {
                    view: c.id(block),
                    scene: c.id(scene.root),
                    rays: c.rays(),
                    lights: c.id(lights),
                    gbuffer: gbuffer.images(c),
                    surfaces: c.id(surfaces),
                    reservoirs: c.id(reservoirs),
                    lobes: targets.images(c),
                };
                c.trace(kernel, scene.tlas, &params, extent);
            })
        })
    }

    /// Adds a pass that shows what reservoirs hold; culled unless it is asked for.
    fn show(&self, g: &mut FrameGraph, view: &View, i: DirectIn, reservoirs: Handle<Buffer>) {
        let (kernel, block) = (self.show, view.block);
        g.pass("direct.reservoirs", Queue::Graphics, |p| {
            let (block, reservoirs) = (p.read(block), p.read(reservoirs));
            let mut image = |name, format| p.create(name, ImageDesc::like(format, i.gbuffer.depth)).1;
            let light = image("light", Format::Rgba8Unorm);
            let [weight, confidence, age] = ["weight", "confidence", "age"].map(|name| image(name, Format::R32Float));
            let extent = p.extent(i.gbuffer.depth);
            ((), move |c: &mut Record<'_>| {
                let params = ShowReservoirsParams {
                    view: c.id(block),
                    reservoirs: c.id(reservoirs),
                    light: c.id(light),
                    weight: c.id(weight),
                    confidence: c.id(confidence),
                    age: c.id(age),
                };
                c.dispatch(kernel, &params, extent);
            })
        });
    }
}

/// Whose reservoirs are merged.
enum Lenders {
    /// Those of the previous frame, and its surfaces.
    Previous(Option<(Handle<Buffer>, Handle<Buffer>)>),
    /// Those of pixels around, in this round.
    Neighbours(u32),
}

fn each<T>(pixels: u64) -> BufferDesc {
    BufferDesc::new(size_of::<T>() as u64 * pixels)
}
