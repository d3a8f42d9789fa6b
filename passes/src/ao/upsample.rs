//! Edge-aware upsampling from half to full resolution.
use crate::contracts::{AoIn, AoOut, GEOMETRY};
use magpie::gpu::Kernel;
use magpie::prelude::*;
use magpie_shaders::ao::{NO_BENT_NORMAL, UpsampleParams};

/// Format of openness.
pub const OPENNESS: Format = Format::R16Float;
/// Format of bent normals.
pub const BENT_NORMAL: Format = Format::Rg16Float;

/// Upsamples `half_size` to full resolution. It holds bent normals and openness if `is_bent`, else openness alone.
pub fn upsample(
    g: &mut FrameGraph,
    view: &View,
    kernel: Kernel,
    i: AoIn,
    half_size: Handle<Image>,
    is_bent: bool,
) -> AoOut {
    let block = view.block;
    g.pass("ao.upsample", Queue::AsyncCompute, |p| {
        let (block, half_size) = (p.read(block), p.sample(half_size));
        let gbuffer = i.gbuffer.read(p, GEOMETRY);
        let like = |format| ImageDesc::like(format, i.gbuffer.depth);
        let (openness, target) = p.create("openness", like(OPENNESS));
        let bent = is_bent.then(|| p.create("bent_normal", like(BENT_NORMAL)));
        let (bent_normal, bent_target) =
            bent.map_or((None, None), |(image, target)| (Some(image.read()), Some(target)));
        let extent = p.extent(i.gbuffer.depth);
        (AoOut { openness: Some(openness.read()), bent_normal }, move |c: &mut Record<'_>| {
            let params = UpsampleParams {
                view: c.id(block),
                gbuffer: gbuffer.images(c),
                half_size: c.id(half_size),
                openness: c.id(target),
                bent_normal: bent_target.map_or(NO_BENT_NORMAL, |t| c.id(t).index()),
            };
            c.dispatch(kernel, &params, extent);
        })
    })
}
