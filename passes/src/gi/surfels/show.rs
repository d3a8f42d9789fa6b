//! Pictures of the surfels for people, made only where `--view` asks for one.
use super::grid::{Division, State};
use crate::contracts::{GEOMETRY, LightingIn};
use magpie::gpu::Kernel;
use magpie::prelude::*;
use magpie_shaders::denoise::NO_IMAGE;
use magpie_shaders::surfels::{KEYS_WIDTH, SURFEL_COUNTERS, SurfelShowParams};

/// Adds `gi.show`: colours of surfels, their state, their place in the grid, and counters.
pub fn show(
    g: &mut FrameGraph,
    view: &View,
    i: LightingIn,
    state: &State,
    division: Division,
    capacity: u32,
    kernel: Kernel,
) {
    let block = view.block;
    g.pass("gi.show", Queue::AsyncCompute, |p| {
        let block = p.read(block);
        let gbuffer = i.gbuffer.read(p, GEOMETRY);
        let (pool, counts) = (p.read(state.pool.read()), p.read(state.counts.read()));
        let tokens = state.read(p);
        let full = ImageDesc::like(Format::Rgba32Float, i.gbuffer.depth);
        let images = ["discs", "state", "place"].map(|name| p.create(name, full).1);
        let row = ImageDesc::fixed(Format::R32Float, Extent::new(SURFEL_COUNTERS, 1));
        let counters = p.create("counters", row).1;
        let rows = Extent::new(KEYS_WIDTH, 2 * capacity.div_ceil(KEYS_WIDTH));
        let table = ImageDesc::fixed(Format::Rgba32Float, rows);
        let table = p.is_watched("table").then(|| p.create("table", table).1);
        let extent = p.extent(i.gbuffer.depth);
        ((), move |c: &mut Record<'_>| {
            let [discs, state, place] = images.map(|token| c.id(token));
            let params = SurfelShowParams {
                view: c.id(block),
                pool: c.id(pool),
                grid: division.grid(c, tokens),
                counts: c.id(counts),
                gbuffer: gbuffer.images(c),
                discs,
                state,
                place,
                counters: c.id(counters),
                table: table.map_or(NO_IMAGE, |table| c.id(table).index()),
                capacity,
            };
            c.dispatch(kernel, &params, extent);
        })
    });
}
