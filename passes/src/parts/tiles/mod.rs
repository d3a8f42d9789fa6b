//! Lists of the tiles of 8x8 pixels that have work, for passes that run only there, by indirect dispatch.
use magpie::gpu::Kernel;
use magpie::graph::{BufferToken, IndirectToken, PassBuilder};
use magpie::prelude::*;
use magpie::slot::{Build, SlotError};
use magpie_shaders::tiles::{TILE_SIDE, TileParams};
use magpie_shaders::{TILES_CLASSIFY_COMP, TILES_CLEAR_COMP};

/// Makes lists for an effect. The passes are called `SLOT.clear_tiles` and `SLOT.classify_tiles`.
pub struct Tiles {
    clear: Kernel,
    classify: Kernel,
    slot: &'static str,
}

/// A list of tiles.
#[derive(Clone, Copy, Debug)]
pub struct TileList {
    /// Workgroups in x, y and z for an indirect dispatch, three `u32`: the number of tiles, 1, 1.
    pub groups: Handle<Buffer>,
    /// The tiles, one `u32` each: column in the lower, row in the upper 16 bits. Their order is undefined.
    pub list: Handle<Buffer>,
}

/// What a pass declared with [`TileList::read`].
#[derive(Clone, Copy, Debug)]
pub struct TileToken {
    /// For [`Record::dispatch_indirect`], with offset 0 and workgroups of 8x8.
    pub groups: IndirectToken,
    /// For the shader: `tile_pixel` of `lib/tiles.glsl`.
    pub list: BufferToken,
}

impl TileList {
    /// Declares that a pass is dispatched over the list.
    pub fn read(self, p: &mut PassBuilder<'_>) -> TileToken {
        TileToken { groups: p.indirect(self.groups), list: p.read(self.list) }
    }
}

impl Tiles {
    /// Describes the pipelines for the effect in `slot`.
    ///
    /// # Errors
    /// None of its own.
    pub fn new(build: &Build<'_>, slot: &'static str) -> Result<Self, SlotError> {
        let (clear, classify) = (build.kernel(&TILES_CLEAR_COMP)?, build.kernel(&TILES_CLASSIFY_COMP)?);
        Ok(Self { clear, classify, slot })
    }

    /// Adds the passes. `work`: an image of one channel; a tile is listed if a pixel of it is not 0.
    pub fn add(&self, g: &mut FrameGraph, work: Handle<Image>) -> TileList {
        let (clear, classify, slot) = (self.clear, self.classify, self.slot);
        let extent = g.extent(work);
        let tiles = extent.width.div_ceil(TILE_SIDE) * extent.height.div_ceil(TILE_SIDE);
        let empty = g.pass(&format!("{slot}.clear_tiles"), Queue::AsyncCompute, |p| {
            let (groups, token) = p.create_buffer("groups", BufferDesc::new(12));
            (groups, move |c: &mut Record<'_>| {
                c.dispatch_groups(clear, &TileParams { groups: c.id(token), ..TileParams::default() }, [1; 3]);
            })
        });
        g.pass(&format!("{slot}.classify_tiles"), Queue::AsyncCompute, |p| {
            let work = p.sample(work);
            let (groups, groups_token) = p.write_buffer(empty);
            let (list, list_token) = p.create_buffer("tiles", BufferDesc::new(4 * u64::from(tiles)));
            (TileList { groups: groups.read(), list: list.read() }, move |c: &mut Record<'_>| {
                let size = [extent.width, extent.height];
                let params = TileParams { groups: c.id(groups_token), list: c.id(list_token), work: c.id(work), size };
                c.dispatch(classify, &params, extent);
            })
        })
    }
}
