//! Surfels: discs on surfaces that gather diffuse indirect light over frames, from paths that end at other surfels (Halen and others 2021,
//! "Global Illumination Based on Surfels"; Stachowiak 2018, "Stochastic All The Things").
//!
//! What needs nothing of this frame's picture comes first, so that it can run beside the G-buffer: surfels are placed, sorted into the grid, and
//! trace. Then the picture asks for more where it lacks them; those are put into the grid as well, trace, and all light the picture.
mod grid;
mod settings;
mod show;

use super::resolve::Resolve;
use super::{MATERIAL, no_bounces};
use crate::contracts::{Channel, GEOMETRY, LightingIn, LightingOut};
use crate::parts::hit_shading::{self, HitShading};
use crate::parts::pixel_lists::{PixelList, PixelLists};
use crate::parts::upsample::{Upsample, UpsampleIn};
use crate::ray_kernels::RayKernels;
use grid::{Count, Grid, State};
use magpie::gpu::Kernel;
use magpie::prelude::*;
use magpie::scene::SceneFacts;
use magpie::slot::{Build, Needs, Settings, SlotError};
use magpie_shaders::denoise::NO_IMAGE;
use magpie_shaders::surfels::*;
use magpie_shaders::{
    GI_SURFEL_COMMIT_COMP, GI_SURFEL_GATHER_COMP, GI_SURFEL_SHOW_COMP, GI_SURFEL_SPAWN_COMP,
    GI_SURFEL_TINTED_TRACE_RAY, GI_SURFEL_TRACE_RAY, GI_SURFEL_WISHES_COMP,
};
use settings::Options;
pub use settings::{pool_settings, settings};

/// Diffuse indirect light by surfels.
pub struct Surfels {
    spawn: Kernel,
    wishes: Kernel,
    commit: Kernel,
    gather: Kernel,
    show: Kernel,
    trace: RayKernels,
    resolve: Resolve,
    /// Set at half resolution only.
    upsample: Option<Upsample>,
    grid: Grid,
    lists: PixelLists,
    options: Options,
}

/// Where surfels are asked for.
struct Asked {
    /// Numbers and pixels, as in [`SurfelCommitParams::asked`].
    list: Handle<Buffer>,
    tiles: u32,
}

impl Surfels {
    /// Creates the pipelines. `half`: the picture is lit at half resolution.
    pub fn new(build: &Build<'_>, settings: &Settings, half: bool) -> Result<Self, SlotError> {
        let options = Options::read(settings)?;
        Ok(Self {
            spawn: build.kernel(&GI_SURFEL_SPAWN_COMP)?,
            wishes: build.kernel(&GI_SURFEL_WISHES_COMP)?,
            commit: build.kernel(&GI_SURFEL_COMMIT_COMP)?,
            gather: build.kernel(&GI_SURFEL_GATHER_COMP)?,
            show: build.kernel(&GI_SURFEL_SHOW_COMP)?,
            trace: RayKernels::new(build, &GI_SURFEL_TRACE_RAY, &GI_SURFEL_TINTED_TRACE_RAY)?,
            resolve: Resolve::new(build, options.format)?,
            upsample: half.then(|| Upsample::new(build, "gi")).transpose()?,
            grid: Grid::new(build, options)?,
            lists: PixelLists::new(build, "gi")?,
            options,
        })
    }

    /// Adds the paths of listed surfels, which meet `bounces` surfaces where no surfels know the light.
    fn trace(
        &self,
        g: &mut FrameGraph,
        view: &View,
        i: LightingIn,
        (list, name, bounces): (PixelList, &str, u32),
        state: State,
    ) -> State {
        let Some(hits) = HitShading::new(&i, false) else { return state };
        let Options { regularization, estimator, feedback, .. } = self.options;
        let hits = hits.with_cache(feedback.then(|| state.cache()));
        let emitters = u32::from(view.facts.emissive_instances > 0);
        let (kernel, block) = (self.trace.of(view), view.block);
        g.pass(name, Queue::AsyncCompute, |p| {
            let (block, scene, hits, list) = (p.read(block), i.scene.trace(p), hits.read(p), list.read(p));
            let (state, tokens) = state.write_pool(p);
            let (grid, changes) = (p.read(state.grid), p.read(state.changes.read()));
            let (wishes, wishes_token) = p.write_buffer(state.wishes);
            (State { wishes, ..state }, move |c: &mut Record<'_>| {
                let params = SurfelTraceParams {
                    view: c.id(block),
                    scene: c.id(scene.root),
                    rays: c.rays(),
                    hits: hits.params(c),
                    pool: c.id(tokens.pool),
                    grid: c.id(grid),
                    changes: c.id(changes),
                    counts: c.id(tokens.counts),
                    list: c.id(list.list),
                    wishes: c.id(wishes_token),
                    bounces,
                    regularization,
                    estimator,
                    emitters,
                };
                c.trace_indirect(kernel, scene.tlas, &params, list.threads, 0);
            })
        })
    }

    /// Adds what asks for surfels where the picture lacks them, and counts where paths have.
    fn ask(&self, g: &mut FrameGraph, view: &View, i: LightingIn, state: State) -> (State, Asked) {
        let (spawn, wishes, block, coverage) = (self.spawn, self.wishes, view.block, self.options.coverage);
        let division = self.grid.division(view);
        let Extent { width, height } = g.extent(i.gbuffer.depth);
        let stride = self.options.stride(height);
        let groups = [width.div_ceil(SPAWN_TILE * stride), height.div_ceil(SPAWN_TILE * stride), 1];
        let tiles = groups[0] * groups[1];
        let cells = division.cells.div_ceil(SURFEL_GROUP);
        let (state, asked) = g.pass("gi.spawn", Queue::AsyncCompute, |p| {
            let block = p.read(block);
            let gbuffer = i.gbuffer.read(p, &[GEOMETRY, &[Channel::BaseColour, Channel::Material]].concat());
            let (state, tokens) = state.write(p);
            let words = tiles * (1 + TILE_SPAWNS) + cells + 1;
            let (asked, asked_token) = p.create_buffer("asked", BufferDesc::new(4 * u64::from(words)));
            ((state, asked), move |c: &mut Record<'_>| {
                let params = SurfelSpawnParams {
                    view: c.id(block),
                    pool: c.id(tokens.pool),
                    grid: division.grid(c, tokens.look_up),
                    counts: c.id(tokens.counts),
                    gbuffer: gbuffer.images(c),
                    asked: c.id(asked_token),
                    coverage,
                    stride,
                    ..SurfelSpawnParams::default()
                };
                c.dispatch_groups(spawn, &params, groups);
            })
        });
        let asked = g.pass("gi.wishes", Queue::AsyncCompute, |p| {
            let tokens = state.read(p);
            let asked_for = p.read(state.wishes.read());
            let (asked, asked_token) = p.write_buffer(asked);
            (asked, move |c: &mut Record<'_>| {
                let params = SurfelSpawnParams {
                    grid: division.grid(c, tokens),
                    wishes: c.id(asked_for),
                    asked: c.id(asked_token),
                    tiles,
                    ..SurfelSpawnParams::default()
                };
                c.dispatch_groups(wishes, &params, [cells, 1, 1]);
            })
        });
        let list = self.grid.sum(g, "gi.sum_asked", asked, Count::Of(tiles + cells)).read();
        (state, Asked { list, tiles })
    }

    /// Adds those surfels to the pool, as far as there is room, and lists them.
    fn commit(
        &self,
        g: &mut FrameGraph,
        view: &View,
        i: LightingIn,
        state: State,
        asked: &Asked,
        free: Handle<Buffer>,
    ) -> (State, PixelList) {
        let (kernel, block, budget) = (self.commit, view.block, self.options.budget);
        let rays_of_new = self.options.rays_of_new(view.facts.lets_light_through);
        let division = self.grid.division(view);
        let Asked { list: asked, tiles } = *asked;
        let groups = (tiles * TILE_SPAWNS).div_ceil(SURFEL_GROUP) + division.cells.div_ceil(SURFEL_GROUP);
        let capacity = self.options.capacity;
        let list = self.lists.empty(g, "new", Extent::new(KEYS_WIDTH, capacity.div_ceil(KEYS_WIDTH)));
        g.pass("gi.commit", Queue::AsyncCompute, |p| {
            let (block, scene) = (p.read(block), i.scene.read(p));
            let gbuffer = i.gbuffer.read(p, &[Channel::Depth, Channel::Ids]);
            let (asked, free, wishes) = (p.read(asked), p.read(free), p.read(state.wishes.read()));
            let searched = p.read(state.groups.read());
            let (state, tokens) = state.write(p);
            let (list, list_token) = list.fill(p);
            ((state, list), move |c: &mut Record<'_>| {
                let images = gbuffer.images(c);
                let params = SurfelCommitParams {
                    view: c.id(block),
                    scene: c.id(scene),
                    pool: c.id(tokens.pool),
                    grid: division.grid(c, tokens.look_up),
                    counts: c.id(tokens.counts),
                    asked: c.id(asked),
                    wishes: c.id(wishes),
                    free: c.id(free),
                    groups: c.id(searched),
                    list: c.id(list_token),
                    budget,
                    rays_of_new,
                    tiles,
                    capacity,
                    depth: images.depth,
                    ids: images.ids,
                };
                c.dispatch_groups(kernel, &params, [groups, 1, 1]);
            })
        })
    }

    /// Adds the light of surfels on the picture: radiance, or at half resolution irradiance over pi.
    fn gather(&self, g: &mut FrameGraph, view: &View, i: LightingIn, state: &State) -> Handle<Image> {
        let (kernel, block, format) = (self.gather, view.block, self.options.format);
        let division = self.grid.division(view);
        let (step, desc) = if self.upsample.is_some() {
            (2, ImageDesc::half(format))
        } else {
            (1, ImageDesc::like(format, i.gbuffer.depth))
        };
        g.pass("gi.gather", Queue::AsyncCompute, |p| {
            let block = p.read(block);
            let gbuffer = i.gbuffer.read(p, &[GEOMETRY, MATERIAL].concat());
            let openness = i.ao.openness.map(|image| p.sample(image));
            let tokens = state.read(p);
            let (radiance, target) = p.create(if step == 1 { "radiance" } else { "irradiance" }, desc);
            let extent = p.extent_of(desc);
            (radiance.read(), move |c: &mut Record<'_>| {
                let params = SurfelGatherParams {
                    view: c.id(block),
                    grid: division.grid(c, tokens),
                    gbuffer: gbuffer.images(c),
                    openness: openness.map_or(NO_IMAGE, |token| c.id(token).index()),
                    radiance: c.id(target),
                    greatest: format.greatest(),
                    step,
                };
                c.dispatch(kernel, &params, extent);
            })
        })
    }

    /// The light of surfels on the picture at its full size.
    fn light(&self, g: &mut FrameGraph, view: &View, i: LightingIn, state: &State) -> Handle<Image> {
        let gathered = self.gather(g, view, i, state);
        let Some(upsample) = &self.upsample else { return gathered };
        let of_half = UpsampleIn {
            half_size: gathered,
            gbuffer: i.gbuffer,
            value: ("irradiance", self.options.format),
            direction: None,
            background: 0.0,
        };
        let irradiance = upsample.add(g, view, of_half, "").value;
        self.resolve.add(g, view, i, irradiance, None)
    }

    /// Adds a frame of the surfels: they move with what they are bound to, trace, and come and go.
    pub fn update(&self, g: &mut FrameGraph, view: &View, i: LightingIn) -> State {
        // What the last frame left: beside the G-buffer, where a queue is free.
        let state = self.grid.begin(g, view);
        let (state, free, keys) = self.grid.place(g, view, i, state);
        let state = self.grid.build(g, view, state, false);
        let tinted = view.facts.lets_light_through;
        let list = self.lists.add(g, "surfels", keys, Some(self.options.most_old(tinted)));
        let state = self.trace(g, view, i, (list, "gi.trace", self.options.bounces), state);
        // What this frame's picture and paths ask for.
        let (state, asked) = self.ask(g, view, i, state);
        let (state, list) = self.commit(g, view, i, state, &asked, free);
        let state = self.grid.build(g, view, state, true);
        let state = self.trace(g, view, i, (list, "gi.trace_new", self.options.first_bounces(tinted)), state);
        let state = self.grid.refresh(g, view, state);
        let state = self.grid.share(g, view, i, state);
        show::show(g, view, i, &state, self.grid.division(view), self.options.capacity, self.show);
        state
    }
}

impl Effect for Surfels {
    type In = LightingIn;
    type Out = LightingOut;

    fn needs(&self, facts: &SceneFacts) -> Needs {
        no_bounces(facts).map_or_else(|| hit_shading::needs(facts), Needs::idle)
    }

    fn add(&mut self, g: &mut FrameGraph, view: &View, i: LightingIn) -> LightingOut {
        let is_idle = self.needs(&view.facts).idle.is_some();
        if is_idle || i.scene.lights.is_none() {
            return LightingOut::default();
        }
        let state = self.update(g, view, i);
        LightingOut::radiance(self.light(g, view, i, &state)).with_cache(state.cache())
    }
}
