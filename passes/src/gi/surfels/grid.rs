//! The pool of surfels and the grid in which they are found.
use super::settings::Options;
use crate::contracts::{Channel, LightCache, LightingIn};
use magpie::gpu::Kernel;
use magpie::graph::{BufferToken, HistoryScope, PassBuilder, WriteHandle};
use magpie::prelude::*;
use magpie::slot::{Build, SlotError};
use magpie_shaders::denoise::NO_IMAGE;
use magpie_shaders::surfels::*;
use magpie_shaders::{
    Address, GI_SURFEL_ALLOCATE_COMP, GI_SURFEL_CHANGE_COMP, GI_SURFEL_CLEAR_COMP, GI_SURFEL_COUNT_COMP,
    GI_SURFEL_FREE_COMP, GI_SURFEL_INSERT_COMP, GI_SURFEL_KEEP_COMP, GI_SURFEL_PLACE_COMP, GI_SURFEL_REFRESH_COMP,
    GI_SURFEL_SHARE_COMP, GI_SURFEL_SORT_COMP, GI_SURFEL_SUM_COMP, GI_SURFEL_WIDEN_COMP,
};
use std::mem::size_of;

/// Radii over distance for which cells hold: below, positions are not precise enough; above, a surfel touches more than eight.
const SIZES: [f32; 2] = [1e-4, 0.19];

/// Names in the statistics of what `surfel_keep.comp` hands out.
const COUNTED: [&str; 7] = ["surfels", "wanted", "spawned", "recycled", "dropped", "uncovered", "visible"];

/// Kernels that keep the pool and build the grid.
pub struct Grid {
    clear: Kernel,
    place: Kernel,
    free: Kernel,
    sum: Kernel,
    count: Kernel,
    allocate: Kernel,
    insert: Kernel,
    sort: Kernel,
    change: Kernel,
    refresh: Kernel,
    share: Kernel,
    widen: Kernel,
    keep: Kernel,
    options: Options,
    scope: HistoryScope,
}

/// All that is known of surfels, which passes change one after another.
pub struct State {
    /// [`Surfel`] table, kept.
    pub pool: WriteHandle<Buffer>,
    /// [`SurfelCounts`], kept.
    pub counts: WriteHandle<Buffer>,
    /// [`PlacedSurfel`] table.
    pub placed: WriteHandle<Buffer>,
    /// Cells, and the number of references behind them.
    pub cells: WriteHandle<Buffer>,
    /// References of the cells.
    pub references: WriteHandle<Buffer>,
    /// [`SurfelGrid`] of these three.
    pub grid: Handle<Buffer>,
    /// Workgroups of an indirect dispatch over the pool.
    pub groups: WriteHandle<Buffer>,
    /// Where paths ask for surfels.
    pub wishes: WriteHandle<Buffer>,
    /// [`SurfelChange`] of cells and blocks.
    pub changes: WriteHandle<Buffer>,
}

/// How many numbers are added up.
pub enum Count {
    /// So many.
    Of(u32),
    /// As the first word of a buffer says.
    At(Handle<Buffer>),
}

/// Tokens of a [`State`] that a pass changes.
#[derive(Clone, Copy)]
pub struct Tokens {
    pub pool: BufferToken,
    pub counts: BufferToken,
    pub look_up: LookUp,
}

/// Tokens of what surfels are found by.
#[derive(Clone, Copy)]
pub struct LookUp {
    placed: BufferToken,
    cells: BufferToken,
    references: BufferToken,
}

impl State {
    /// Declares that a pass changes it.
    pub fn write(self, p: &mut PassBuilder<'_>) -> (Self, Tokens) {
        let (pool, pool_token) = p.write_buffer(self.pool);
        let (counts, counts_token) = p.write_buffer(self.counts);
        let (placed, placed_token) = p.write_buffer(self.placed);
        let (cells, cells_token) = p.write_buffer(self.cells);
        let (references, references_token) = p.write_buffer(self.references);
        let look_up = LookUp { placed: placed_token, cells: cells_token, references: references_token };
        let tokens = Tokens { pool: pool_token, counts: counts_token, look_up };
        (Self { pool, counts, placed, cells, references, ..self }, tokens)
    }

    /// Declares that a pass changes what is kept of surfels, and looks them up.
    pub fn write_pool(self, p: &mut PassBuilder<'_>) -> (Self, Tokens) {
        let look_up = self.read(p);
        let (pool, pool_token) = p.write_buffer(self.pool);
        let (counts, counts_token) = p.write_buffer(self.counts);
        (Self { pool, counts, ..self }, Tokens { pool: pool_token, counts: counts_token, look_up })
    }

    /// Declares that a pass looks surfels up.
    pub fn read(&self, p: &mut PassBuilder<'_>) -> LookUp {
        LookUp {
            placed: p.read(self.placed.read()),
            cells: p.read(self.cells.read()),
            references: p.read(self.references.read()),
        }
    }
}

impl State {
    /// What others look surfels up in.
    pub fn cache(&self) -> LightCache {
        let [placed, cells, references] = [&self.placed, &self.cells, &self.references].map(WriteHandle::read);
        LightCache { grid: self.grid, placed, cells, references }
    }
}

/// How the grid is divided in this frame.
#[derive(Clone, Copy)]
pub struct Division {
    /// Radius of surfels over their distance to the eye.
    size: f32,
    /// Number of cells.
    pub cells: u32,
}

impl Division {
    /// Where surfels are found, for the parameters of a shader.
    pub fn grid(self, c: &Record<'_>, tokens: LookUp) -> SurfelGrid {
        SurfelGrid {
            placed: c.id(tokens.placed),
            cells: c.id(tokens.cells),
            references: c.id(tokens.references),
            size: self.size,
            cell_mask: self.cells - 1,
        }
    }
}

impl Grid {
    /// Creates the pipelines.
    pub fn new(build: &Build<'_>, options: Options) -> Result<Self, SlotError> {
        Ok(Self {
            clear: build.kernel(&GI_SURFEL_CLEAR_COMP)?,
            place: build.kernel(&GI_SURFEL_PLACE_COMP)?,
            free: build.kernel(&GI_SURFEL_FREE_COMP)?,
            sum: build.kernel(&GI_SURFEL_SUM_COMP)?,
            count: build.kernel(&GI_SURFEL_COUNT_COMP)?,
            allocate: build.kernel(&GI_SURFEL_ALLOCATE_COMP)?,
            insert: build.kernel(&GI_SURFEL_INSERT_COMP)?,
            sort: build.kernel(&GI_SURFEL_SORT_COMP)?,
            change: build.kernel(&GI_SURFEL_CHANGE_COMP)?,
            refresh: build.kernel(&GI_SURFEL_REFRESH_COMP)?,
            share: build.kernel(&GI_SURFEL_SHARE_COMP)?,
            widen: build.kernel(&GI_SURFEL_WIDEN_COMP)?,
            keep: build.kernel(&GI_SURFEL_KEEP_COMP)?,
            options,
            scope: HistoryScope::new(),
        })
    }

    /// How the grid is divided. It has half as many cells as the pool has places, rounded up to a power of 2.
    pub fn division(&self, view: &View) -> Division {
        let height = 2.0 * (0.5 * view.camera.vertical_fov).tan();
        let size = (self.options.radius * height).clamp(SIZES[0], SIZES[1]);
        Division { size, cells: (self.options.capacity / 2).next_power_of_two() }
    }

    /// Adds the kept pool and empty cells.
    pub fn begin(&self, g: &mut FrameGraph, view: &View) -> State {
        let capacity = u64::from(self.options.capacity);
        let bytes = |each: usize, count: u64| BufferDesc::new(each as u64 * count);
        let pool = g.kept_buffer(&self.scope, "surfels", bytes(size_of::<Surfel>(), capacity)).buffer;
        let counts = g.kept_buffer(&self.scope, "counts", bytes(size_of::<SurfelCounts>(), 1)).buffer;
        let (kernel, division) = (self.clear, self.division(view));
        let cells = division.cells;
        g.pass("gi.begin", Queue::AsyncCompute, |p| {
            let (counts, counts_token) = p.write_buffer(counts);
            let (placed, placed_token) = p.create_buffer("placed", bytes(size_of::<PlacedSurfel>(), capacity));
            let (references, references_token) =
                p.create_buffer("references", bytes(4, capacity * u64::from(CELLS_OF_SURFEL)));
            let (cells_buffer, cells_token) = p.create_buffer("cells", bytes(8, u64::from(cells) + 1));
            let (groups, groups_token) = p.create_buffer("groups", bytes(4, 3));
            let wish_bytes = 4 * u64::from(cells) + size_of::<SurfelBinding>() as u64 * capacity;
            let (wishes, wishes_token) = p.create_buffer("wishes", BufferDesc::new(wish_bytes));
            let (grid, grid_token) = p.create_buffer("grid", bytes(size_of::<SurfelGrid>(), 1));
            let (changes, changes_token) =
                p.create_buffer("changes", bytes(size_of::<SurfelChange>(), u64::from(2 * CHANGE_TESTS * cells)));
            let grid = grid.read();
            let state = State { pool, counts, placed, cells: cells_buffer, references, grid, groups, wishes, changes };
            let look_up = LookUp { placed: placed_token, cells: cells_token, references: references_token };
            (state, move |c: &mut Record<'_>| {
                let params = SurfelPoolParams {
                    grid: division.grid(c, look_up),
                    cache: c.id(grid_token),
                    changes: c.id(changes_token),
                    counts: c.id(counts_token),
                    groups: c.id(groups_token),
                    wishes: c.id(wishes_token),
                    begins: 1,
                    ..SurfelPoolParams::default()
                };
                c.dispatch_groups(kernel, &params, [(cells + 1).div_ceil(SURFEL_GROUP), 1, 1]);
            })
        })
    }

    /// Adds what places surfels, recycles them, lists free places, and says which surfels trace: their keys for a pixel list.
    pub fn place(
        &self,
        g: &mut FrameGraph,
        view: &View,
        i: LightingIn,
        state: State,
    ) -> (State, Handle<Buffer>, Handle<Image>) {
        let Options { capacity, life, .. } = self.options;
        let (place, list, block) = (self.place, self.free, view.block);
        let groups = capacity.div_ceil(SURFEL_GROUP);
        let division = self.division(view);
        let keys = Extent::new(KEYS_WIDTH, capacity.div_ceil(KEYS_WIDTH));
        let (state, free, keys) = g.pass("gi.place", Queue::AsyncCompute, |p| {
            let (block, scene) = (p.read(block), i.scene.read(p));
            let searched = p.read(state.groups.read());
            let (state, tokens) = state.write(p);
            let (changes, changes_token) = p.write_buffer(state.changes);
            let state = State { changes, ..state };
            let (free, free_token) =
                p.create_buffer("free", BufferDesc::new(4 * (u64::from(groups) + 1 + u64::from(capacity))));
            let (keys, keys_token) = p.create("keys", ImageDesc::fixed(Format::R8Unorm, keys));
            ((state, free, keys.read()), move |c: &mut Record<'_>| {
                let params = SurfelPoolParams {
                    view: c.id(block),
                    scene: c.id(scene),
                    pool: c.id(tokens.pool),
                    grid: division.grid(c, tokens.look_up),
                    counts: c.id(tokens.counts),
                    groups: c.id(searched),
                    free: c.id(free_token),
                    capacity,
                    life,
                    keys: c.id(keys_token),
                    changes: c.id(changes_token),
                    not_finite: c.not_finite(),
                    ..SurfelPoolParams::default()
                };
                c.dispatch_groups(place, &params, [groups, 1, 1]);
            })
        });
        let free = self.sum(g, "gi.sum_free", free, Count::At(state.groups.read()));
        let (state, free) = g.pass("gi.list_free", Queue::AsyncCompute, |p| {
            let threads = p.indirect(state.groups.read());
            let (state, tokens) = state.write(p);
            let (free, free_token) = p.write_buffer(free);
            ((state, free.read()), move |c: &mut Record<'_>| {
                let params = SurfelPoolParams {
                    pool: c.id(tokens.pool),
                    free: c.id(free_token),
                    capacity,
                    ..SurfelPoolParams::default()
                };
                c.dispatch_indirect(list, &params, threads, 0);
            })
        });
        (state, free, keys)
    }

    /// Adds the lists of the cells. With `again` the grid was built before in this frame, and surfels were spawned since.
    pub fn build(&self, g: &mut FrameGraph, view: &View, mut state: State, again: bool) -> State {
        let suffix = if again { "_again" } else { "" };
        if again {
            state = self.clear_again(g, view, state);
        }
        let cells = Some(self.division(view).cells);
        let steps = [
            ("count", self.count, None),
            ("allocate", self.allocate, cells),
            ("insert", self.insert, None),
            ("sort", self.sort, cells),
        ];
        for (name, kernel, cells) in steps {
            state = self.step(g, view, &format!("gi.{name}{suffix}"), kernel, state, cells);
        }
        state
    }

    fn clear_again(&self, g: &mut FrameGraph, view: &View, state: State) -> State {
        let (kernel, cells) = (self.clear, self.division(view).cells);
        g.pass("gi.clear_again", Queue::AsyncCompute, |p| {
            let (cells_buffer, cells_token) = p.write_buffer(state.cells);
            let (groups, groups_token) = p.write_buffer(state.groups);
            let counts = p.read(state.counts.read());
            (State { cells: cells_buffer, groups, ..state }, move |c: &mut Record<'_>| {
                let params = SurfelPoolParams {
                    grid: SurfelGrid { cells: c.id(cells_token), cell_mask: cells - 1, ..SurfelGrid::default() },
                    counts: c.id(counts),
                    groups: c.id(groups_token),
                    ..SurfelPoolParams::default()
                };
                c.dispatch_groups(kernel, &params, [(cells + 1).div_ceil(SURFEL_GROUP), 1, 1]);
            })
        })
    }

    /// Adds what lets means begin anew where the light has changed.
    pub fn refresh(&self, g: &mut FrameGraph, view: &View, state: State) -> State {
        let (capacity, division, block) = (self.options.capacity, self.division(view), view.block);
        let finds_changes = self.options.estimator == RUNNING_MEAN;
        let mut state = state;
        for (name, kernel) in [("gi.change", self.change), ("gi.refresh", self.refresh)] {
            if name == "gi.change" && !finds_changes {
                continue;
            }
            state = g.pass(name, Queue::AsyncCompute, |p| {
                let (block, surfels) = (p.read(block), p.indirect(state.groups.read()));
                let (state, tokens) = state.write(p);
                let (changes, changes_token) = p.write_buffer(state.changes);
                (State { changes, ..state }, move |c: &mut Record<'_>| {
                    let params = SurfelPoolParams {
                        view: c.id(block),
                        pool: c.id(tokens.pool),
                        grid: division.grid(c, tokens.look_up),
                        changes: if finds_changes { c.id(changes_token) } else { Address::default() },
                        counts: c.id(tokens.counts),
                        capacity,
                        ..SurfelPoolParams::default()
                    };
                    c.dispatch_indirect(kernel, &params, surfels, 0);
                })
            });
        }
        state
    }

    /// Adds what brings the light of this frame's paths to where it is looked up.
    pub fn share(&self, g: &mut FrameGraph, view: &View, i: LightingIn, state: State) -> State {
        let (kernel, capacity, division, block) = (self.share, self.options.capacity, self.division(view), view.block);
        let paths = self.options.most_old(view.facts.lets_light_through).max(1);
        let guided = self.options.guided;
        let mut state = g.pass("gi.share", Queue::AsyncCompute, |p| {
            let (block, surfels) = (p.read(block), p.indirect(state.groups.read()));
            let gbuffer = i.gbuffer.read(p, &[Channel::Depth]);
            let openness = i.ao.openness.map(|image| p.sample(image));
            let (state, tokens) = state.write(p);
            (state, move |c: &mut Record<'_>| {
                let params = SurfelShareParams {
                    view: c.id(block),
                    pool: c.id(tokens.pool),
                    grid: division.grid(c, tokens.look_up),
                    counts: c.id(tokens.counts),
                    capacity,
                    paths,
                    depth: gbuffer.images(c).depth,
                    openness: openness.map_or(NO_IMAGE, |token| c.id(token).index()),
                    guided: u32::from(guided),
                };
                c.dispatch_indirect(kernel, &params, surfels, 0);
            })
        });
        for (turn, name) in ["gi.widen", "gi.widen_again"].into_iter().enumerate() {
            state = self.widen(g, view, state, name, turn as u32);
        }
        self.keep(g, view, state)
    }

    /// Adds what averages that light over wider surroundings where samples are few, the first or the second time.
    fn widen(&self, g: &mut FrameGraph, view: &View, state: State, name: &str, turn: u32) -> State {
        let (kernel, capacity, division, block) = (self.widen, self.options.capacity, self.division(view), view.block);
        g.pass(name, Queue::AsyncCompute, |p| {
            let (block, surfels) = (p.read(block), p.indirect(state.groups.read()));
            let (state, tokens) = state.write(p);
            (state, move |c: &mut Record<'_>| {
                let params = SurfelWidenParams {
                    view: c.id(block),
                    pool: c.id(tokens.pool),
                    grid: division.grid(c, tokens.look_up),
                    capacity,
                    turn,
                };
                c.dispatch_indirect(kernel, &params, surfels, 0);
            })
        })
    }

    /// Adds what keeps that light for the next frame.
    fn keep(&self, g: &mut FrameGraph, view: &View, state: State) -> State {
        let (kernel, capacity, division) = (self.keep, self.options.capacity, self.division(view));
        g.pass("gi.keep", Queue::AsyncCompute, |p| {
            let surfels = p.indirect(state.groups.read());
            let (state, tokens) = state.write_pool(p);
            (state, move |c: &mut Record<'_>| {
                let params = SurfelKeepParams {
                    pool: c.id(tokens.pool),
                    grid: division.grid(c, tokens.look_up),
                    counts: c.id(tokens.counts),
                    counted: c.counts(&COUNTED),
                    capacity,
                };
                c.dispatch_indirect(kernel, &params, surfels, 0);
            })
        })
    }

    /// Adds a pass over all cells or, without, over all surfels.
    fn step(
        &self,
        g: &mut FrameGraph,
        view: &View,
        name: &str,
        kernel: Kernel,
        state: State,
        cells: Option<u32>,
    ) -> State {
        let (capacity, division, block) = (self.options.capacity, self.division(view), view.block);
        g.pass(name, Queue::AsyncCompute, |p| {
            let block = p.read(block);
            let surfels = cells.is_none().then(|| p.indirect(state.groups.read()));
            let (state, tokens) = state.write(p);
            (state, move |c: &mut Record<'_>| {
                let params = SurfelPoolParams {
                    view: c.id(block),
                    pool: c.id(tokens.pool),
                    grid: division.grid(c, tokens.look_up),
                    counts: c.id(tokens.counts),
                    capacity,
                    ..SurfelPoolParams::default()
                };
                match surfels {
                    Some(groups) => c.dispatch_indirect(kernel, &params, groups, 0),
                    None => c.dispatch_groups(kernel, &params, [division.cells.div_ceil(SURFEL_GROUP), 1, 1]),
                }
            })
        })
    }

    /// Adds a pass that replaces numbers by the sum of those before.
    pub fn sum(
        &self,
        g: &mut FrameGraph,
        name: &str,
        numbers: WriteHandle<Buffer>,
        count: Count,
    ) -> WriteHandle<Buffer> {
        let kernel = self.sum;
        g.pass(name, Queue::AsyncCompute, |p| {
            let (count, count_at) = match count {
                Count::Of(count) => (count, None),
                Count::At(buffer) => (0, Some(p.read(buffer))),
            };
            let (numbers, token) = p.write_buffer(numbers);
            (numbers, move |c: &mut Record<'_>| {
                let count_at = count_at.map_or(Address::default(), |token| c.id(token));
                c.dispatch_groups(kernel, &SurfelSumParams { numbers: c.id(token), count_at, count }, [1; 3]);
            })
        })
    }
}
