//! Lamps by cells of the view: which of them are near each cell, and what is left of the light of the others at its corners.
use crate::contracts::{Channel, DirectIn};
use magpie::gpu::Kernel;
use magpie::graph::{BufferDesc, BufferToken, PassBuilder};
use magpie::prelude::*;
use magpie::scene::SceneFacts;
use magpie::slot::{Build, SettingSpec, Settings, SlotError};
use magpie_shaders::clusters::{
    ClusterParams, CornerLight, DEPTH_BLOCK, DepthRangeParams, LampCell, LampGrid, LampReachParams, LampTables,
};
use magpie_shaders::{
    Address, DIRECT_CLUSTERS_COMP, DIRECT_DEPTH_RANGE_COMP, DIRECT_FAR_LAMPS_COMP, DIRECT_LAMP_REACH_COMP,
};

/// Settings of the cells.
pub fn settings() -> [SettingSpec; 3] {
    let near = "Lamps that a place among them gets light from one by one, in the mean; what is left of the others is interpolated. Higher: \
                sharper light of lamps, with time in proportion. All are, where there are hardly more.";
    let cells = "Cells across the picture and from near to far; down the picture as many as are as high as wide. Higher: light of far \
                 lamps is more exact, and fewer lamps are in the list of a cell that do not reach all of it; with time and bytes that grow \
                 with the third power.";
    let lobe = "Roughness below which surfaces show far lamps in their specular lobe one by one, by the light tree. 0: none; highlights of far \
                lamps run together.";
    [
        SettingSpec::float("lobe", "", lobe, 0.5, 0.0..=1.0).sweep([0.0, 0.5, 1.0]),
        SettingSpec::integer("near", "lamps", near, 16, 1..=32).sweep([4, 16, 32]),
        SettingSpec::among("cells", "", cells, 16, &[8, 16, 32]).sweep_all(),
    ]
}

/// The passes that make them.
pub struct Clustering {
    depths: Kernel,
    reach: Kernel,
    clusters: Kernel,
    far: Kernel,
    /// Roughness up to which far lamps are looked up in the lobe.
    lobe: f32,
    near: u32,
    across: u32,
}

/// What they make.
#[derive(Clone, Copy)]
pub struct Clusters {
    grid: Handle<Buffer>,
    reaches: Handle<Buffer>,
    lists: Handle<Buffer>,
    corners: Handle<Buffer>,
    /// Tables and tree of lights, where surfaces are so smooth that far lamps are looked up.
    by_tree: Option<(Handle<Buffer>, Handle<Buffer>)>,
}

impl Clusters {
    /// Declares that a pass looks lamps up. Returns the token of the [`LampGrid`], which has the addresses of all else.
    pub fn read(self, p: &mut PassBuilder<'_>) -> BufferToken {
        let tree = self.by_tree.map_or([self.grid; 2], |(lights, tree)| [lights, tree]);
        for buffer in [self.reaches, self.lists, self.corners].into_iter().chain(tree) {
            p.read(buffer);
        }
        p.read(self.grid)
    }
}

impl Clustering {
    /// Creates the pipelines.
    pub fn new(build: &Build<'_>, settings: &Settings) -> Result<Self, SlotError> {
        Ok(Self {
            depths: build.kernel(&DIRECT_DEPTH_RANGE_COMP)?,
            reach: build.kernel(&DIRECT_LAMP_REACH_COMP)?,
            clusters: build.kernel(&DIRECT_CLUSTERS_COMP)?,
            far: build.kernel(&DIRECT_FAR_LAMPS_COMP)?,
            lobe: settings.f32("lobe")?,
            near: settings.u32("near")?,
            across: settings.u32("cells")?,
        })
    }

    /// Lamps that are near a place, in the mean. As few are near everywhere.
    pub const fn near(&self) -> u32 {
        self.near
    }

    /// Whether some surface shows far lamps in its lobe.
    pub fn looks_up(&self, facts: &SceneFacts) -> bool {
        self.lobe > 0.0 && facts.specular > 0.0 && facts.has_smooth(self.lobe)
    }

    /// Adds the passes.
    pub fn add(&self, g: &mut FrameGraph, view: &View, i: DirectIn) -> Clusters {
        let extent = g.extent(i.gbuffer.depth);
        let down = (self.across * extent.height).div_ceil(extent.width).clamp(1, 4 * self.across);
        let cells = [self.across, down, self.across];
        let each = |size: usize, count: u32| BufferDesc::new(size as u64 * u64::from(count));
        let (block, near, lobe) = (view.block, self.near, self.lobe);
        let by_tree = i.scene.lights.zip(i.scene.light_tree).filter(|_| self.looks_up(&view.facts));

        let (kernel, blocks) = (self.depths, [extent.width, extent.height].map(|side| side.div_ceil(DEPTH_BLOCK)));
        let block_count = blocks[0] * blocks[1];
        let depths = g.pass("direct.depths", Queue::AsyncCompute, |p| {
            let gbuffer = i.gbuffer.read(p, &[Channel::Depth]);
            let (depths, target) = p.create_buffer("blocks", each(8, block_count));
            (depths.read(), move |c: &mut Record<'_>| {
                let params = DepthRangeParams {
                    depth: gbuffer.images(c).depth,
                    blocks: c.id(target),
                    size: [extent.width, extent.height],
                };
                c.dispatch_groups(kernel, &params, [blocks[0], blocks[1], 1]);
            })
        });

        let (kernel, lights) = (self.reach, view.facts.lights.len() as u32);
        let corners = cells.map(|count| count + 1);
        let [cell_count, corner_count] = [cells, corners].map(|counts| counts.iter().product::<u32>());
        let (grid, reaches, lists, far) = g.pass("direct.reach", Queue::AsyncCompute, |p| {
            let (block, scene, depths) = (p.read(block), i.scene.read(p), p.read(depths));
            let by_tree = by_tree.map(|(lights, tree)| (p.read(lights), p.read(tree)));
            let (grid, grid_token) = p.create_buffer("grid", each(size_of::<LampGrid>(), 1));
            let (reaches, reaches_token) = p.create_buffer("reaches", each(16, lights));
            let (lists, lists_token) = p.create_buffer("lists", each(size_of::<LampCell>(), cell_count));
            let (far, far_token) = p.create_buffer("corners", each(size_of::<CornerLight>(), corner_count));
            ((grid.read(), reaches.read(), lists, far), move |c: &mut Record<'_>| {
                let params = LampReachParams {
                    view: c.id(block),
                    scene: c.id(scene),
                    blocks: c.id(depths),
                    block_count,
                    near: near as f32,
                    grid: c.id(grid_token),
                    tables: LampTables {
                        cells,
                        reaches: c.id(reaches_token),
                        lists: c.id(lists_token),
                        corners: c.id(far_token),
                        lights: by_tree.map_or(Address::default(), |(lights, _)| c.id(lights)),
                        tree: by_tree.map_or(Address::default(), |(_, tree)| c.id(tree)),
                        lobe: if by_tree.is_some() { lobe } else { 0.0 },
                    },
                };
                c.dispatch_groups(kernel, &params, [1, 1, 1]);
            })
        });

        let kernel = self.clusters;
        let lists = g.pass("direct.clusters", Queue::AsyncCompute, |p| {
            let (block, scene, grid) = (p.read(block), i.scene.read(p), p.read(grid));
            p.read(reaches);
            let (lists, _) = p.write_buffer(lists);
            (lists.read(), move |c: &mut Record<'_>| {
                let params = ClusterParams { view: c.id(block), scene: c.id(scene), grid: c.id(grid) };
                c.dispatch_groups(kernel, &params, cells);
            })
        });
        let kernel = self.far;
        let corners = g.pass("direct.far_lamps", Queue::AsyncCompute, |p| {
            let (block, scene, grid) = (p.read(block), i.scene.read(p), p.read(grid));
            p.read(reaches);
            p.read(lists);
            let (far, _) = p.write_buffer(far);
            (far.read(), move |c: &mut Record<'_>| {
                let params = ClusterParams { view: c.id(block), scene: c.id(scene), grid: c.id(grid) };
                c.dispatch_groups(kernel, &params, corners);
            })
        });
        Clusters { grid, reaches, lists, corners, by_tree }
    }
}
