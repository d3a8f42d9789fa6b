//! Lists of the pixels that have work, for passes that run only there, by indirect dispatch or trace.
use magpie::gpu::Kernel;
use magpie::graph::{BufferToken, IndirectToken, PassBuilder, WriteHandle};
use magpie::prelude::*;
use magpie::slot::{Build, SlotError};
use magpie_shaders::pixel_lists::{GREATEST_KEY, LIST_HEAD, ListParams};
use magpie_shaders::{
    Address, PIXEL_LISTS_CLEAR_COMP, PIXEL_LISTS_COUNT_COMP, PIXEL_LISTS_LIMIT_COMP, PIXEL_LISTS_LIST_COMP,
};

/// Makes lists for an effect. The passes are called `SLOT.clear_NAME`, `SLOT.count_NAME`, `SLOT.limit_NAME` and `SLOT.list_NAME`; the second
/// and third are there for lists with a limit only.
pub struct PixelLists {
    clear: Kernel,
    count: Kernel,
    limit: Kernel,
    list: Kernel,
    slot: &'static str,
}

/// A list of pixels.
#[derive(Clone, Copy, Debug)]
pub struct PixelList(Handle<Buffer>);

/// An empty list. A pass fills it by `append_pixel` of `lib/pixel_list.glsl`.
#[derive(Debug)]
pub struct EmptyList(WriteHandle<Buffer>);

/// What a pass declared with [`PixelList::read`].
#[derive(Clone, Copy, Debug)]
pub struct PixelListToken {
    /// For [`Record::dispatch_indirect`] and [`Record::trace_indirect`], with offset 0 and workgroups of 8x8.
    pub threads: IndirectToken,
    /// For the shader: `listed_pixel` of `lib/pixel_list.glsl`.
    pub list: BufferToken,
}

impl PixelList {
    /// Declares that a pass runs over the list.
    pub fn read(self, p: &mut PassBuilder<'_>) -> PixelListToken {
        PixelListToken { threads: p.indirect(self.0), list: p.read(self.0) }
    }
}

impl EmptyList {
    /// Declares that a pass fills the list. The token is for `append_pixel`.
    pub fn fill(self, p: &mut PassBuilder<'_>) -> (PixelList, BufferToken) {
        let (list, token) = p.write_buffer(self.0);
        (PixelList(list.read()), token)
    }
}

impl PixelLists {
    /// Describes the pipelines for the effect in `slot`.
    ///
    /// # Errors
    /// None of its own.
    pub fn new(build: &Build<'_>, slot: &'static str) -> Result<Self, SlotError> {
        Ok(Self {
            clear: build.kernel(&PIXEL_LISTS_CLEAR_COMP)?,
            count: build.kernel(&PIXEL_LISTS_COUNT_COMP)?,
            limit: build.kernel(&PIXEL_LISTS_LIMIT_COMP)?,
            list: build.kernel(&PIXEL_LISTS_LIST_COMP)?,
            slot,
        })
    }

    /// Adds an empty list with room for all pixels of `extent`.
    pub fn empty(&self, g: &mut FrameGraph, name: &str, extent: Extent) -> EmptyList {
        EmptyList(self.clear(g, name, extent, false).0)
    }

    fn clear(
        &self,
        g: &mut FrameGraph,
        name: &str,
        extent: Extent,
        is_limited: bool,
    ) -> (WriteHandle<Buffer>, Option<WriteHandle<Buffer>>) {
        let kernel = self.clear;
        let bytes = u64::from(LIST_HEAD) + 4 * u64::from(extent.width) * u64::from(extent.height);
        g.pass(&format!("{}.clear_{name}", self.slot), Queue::AsyncCompute, |p| {
            let (list, list_token) = p.create_buffer("list", BufferDesc::new(bytes));
            let (histogram, histogram_token) = is_limited
                .then(|| p.create_buffer("histogram", BufferDesc::new(4 * u64::from(GREATEST_KEY + 1))))
                .unzip();
            ((list, histogram), move |c: &mut Record<'_>| {
                let params = ListParams {
                    list: c.id(list_token),
                    histogram: histogram_token.map_or(Address::default(), |token| c.id(token)),
                    is_limited: is_limited.into(),
                    ..ListParams::default()
                };
                c.dispatch_groups(kernel, &params, [1; 3]);
            })
        })
    }

    /// Adds the list of the pixels of `keys` whose red is not 0: one channel of 8 bits unorm. With `most` it has at most so many, and those with
    /// lesser keys come first; of a key it has all or none.
    pub fn add(&self, g: &mut FrameGraph, name: &str, keys: Handle<Image>, most: Option<u32>) -> PixelList {
        let (count, limit, kernel) = (self.count, self.limit, self.list);
        let pass = |step: &str| format!("{}.{step}_{name}", self.slot);
        let extent = g.extent(keys);
        let size = [extent.width, extent.height];
        let (mut list, histogram) = self.clear(g, name, extent, most.is_some());
        if let (Some(most), Some(histogram)) = (most, histogram) {
            let counted = g.pass(&pass("count"), Queue::AsyncCompute, |p| {
                let keys = p.sample(keys);
                let (histogram, token) = p.write_buffer(histogram);
                (histogram.read(), move |c: &mut Record<'_>| {
                    let params = ListParams { histogram: c.id(token), keys: c.id(keys), size, ..ListParams::default() };
                    c.dispatch(count, &params, extent);
                })
            });
            list = g.pass(&pass("limit"), Queue::AsyncCompute, |p| {
                let histogram = p.read(counted);
                let (list, token) = p.write_buffer(list);
                (list, move |c: &mut Record<'_>| {
                    let params =
                        ListParams { list: c.id(token), histogram: c.id(histogram), most, ..ListParams::default() };
                    c.dispatch_groups(limit, &params, [1; 3]);
                })
            });
        }
        g.pass(&pass("list"), Queue::AsyncCompute, |p| {
            let keys = p.sample(keys);
            let (list, token) = p.write_buffer(list);
            (PixelList(list.read()), move |c: &mut Record<'_>| {
                let params = ListParams { list: c.id(token), keys: c.id(keys), size, ..ListParams::default() };
                c.dispatch(kernel, &params, extent);
            })
        })
    }
}
