//! Declares the whole frame. Read this first.
use crate::contracts::*;
use crate::outputs::Slotted;
use crate::slots::Frame;
use magpie::prelude::*;
use magpie::scene::ResidentError;
use magpie::slot::Needs;

/// The results of a frame.
#[derive(Clone, Copy, Debug)]
pub struct FrameOut {
    /// Linear radiance before exposure and tone curve, RGBA32F or RGBA16F.
    pub radiance: Handle<Image>,
    /// Display values, RGBA8 or RGBA16, sRGB-encoded.
    pub display: Handle<Image>,
    /// Reversed depth, D32F, in the size of the frame.
    pub depth: Handle<Image>,
}

/// Declares the frame. The outputs of one slot are passed to the next as ordinary values. `needs` are the merged needs of all slots.
///
/// # Errors
/// [`ResidentError`] if the scene could not be updated on the device.
pub fn frame(
    slots: &mut Frame,
    g: &mut FrameGraph,
    view: &View,
    needs: &Needs,
    scene: AccelerationIn,
) -> Result<FrameOut, ResidentError> {
    let with_tree = needs.light_tree.then(|| scene.clone());
    let mut scene = slots.acceleration.give(g, view, scene)?;
    with_tree.into_iter().for_each(|source| scene = slots.light_tree.add(g, &source, scene));
    slots.rays.give(g, view, RaysIn { scene }); // for inspection only; culled unless its output is read
    let gbuffer = slots.gbuffer.give(g, view, GBufferIn { scene });
    let reprojected = slots.reprojection.add(g, view, scene, gbuffer); // culled if no effect reads it
    let shadows = slots.shadows.give(g, view, ShadowIn { scene, gbuffer, reprojected });
    let ao = slots.ao.give(g, view, AoIn { scene, gbuffer, reprojected });
    let direct = slots.direct.give(g, view, DirectIn { scene, gbuffer, reprojected, shadows });
    let (previous_radiance, next) = needs.previous_radiance.then(|| slots.previous_radiance.begin(g)).unzip();
    let direct_radiance = direct.radiance.read();
    let lighting =
        LightingIn { scene, gbuffer, reprojected, ao, direct: direct_radiance, previous_radiance, cache: None };
    let gi = slots.gi.give(g, view, lighting);
    let reflections = slots.reflections.give(g, view, LightingIn { cache: gi.cache, ..lighting });
    let lit = slots.compose.give(g, view, ComposeIn { direct, gi, reflections });
    let radiance = slots.sky.give(g, view, SkyIn { depth: gbuffer.depth, lit }).read();
    next.into_iter().for_each(|next| slots.previous_radiance.keep(g, next, radiance));
    let post = slots.post.give(g, view, PostIn { colour: radiance, seen: Some(Seen { scene, gbuffer }) });
    Ok(FrameOut { radiance: post.radiance, display: post.display, depth: gbuffer.depth })
}
