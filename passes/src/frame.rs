//! The whole frame on one screen: read this first.
use crate::contracts::*;
use crate::outputs::Slotted;
use crate::slots::Frame;
use magpie::prelude::*;
use magpie::scene::ResidentError;
use magpie::slot::Needs;

/// What a frame is made for.
#[derive(Clone, Copy, Debug)]
pub struct FrameOut {
    /// Linear radiance before the tone map, RGBA32F.
    pub radiance: Handle<Image>,
    /// What a display shows, RGBA8.
    pub display: Handle<Image>,
}

/// Declares the frame. Data flow is ordinary Rust: outputs of one slot are inputs of the next. `needs` is what all slots ask for together.
///
/// # Errors
/// [`ResidentError`] where the scene could not be brought up to date.
pub fn frame(
    slots: &mut Frame,
    g: &mut FrameGraph,
    view: &View,
    needs: &Needs,
    scene: AccelerationIn,
) -> Result<FrameOut, ResidentError> {
    let scene = slots.acceleration.give(g, view, scene)?;
    slots.rays.give(g, view, RaysIn { scene }); // for looking at, and culled when nobody does
    let gbuffer = slots.gbuffer.give(g, view, GBufferIn { scene });
    let reprojected = slots.reprojection.add(g, view, scene, gbuffer); // culled where no effect reads it
    let shadows = slots.shadows.give(g, view, ShadowIn { scene, gbuffer, reprojected });
    let ao = slots.ao.give(g, view, AoIn { scene, gbuffer, reprojected });
    let direct = slots.direct.give(g, view, DirectIn { scene, gbuffer, reprojected, shadows });
    let (previous_radiance, next) = needs.previous_radiance.then(|| slots.previous_radiance.begin(g)).unzip();
    let direct_radiance = direct.radiance.read();
    let lighting = LightingIn { scene, gbuffer, reprojected, ao, direct: direct_radiance, previous_radiance };
    let gi = slots.gi.give(g, view, lighting);
    let reflections = slots.reflections.give(g, view, lighting);
    let lit = slots.compose.give(g, view, ComposeIn { direct, gi, reflections });
    let radiance = slots.sky.give(g, view, SkyIn { depth: gbuffer.depth, lit }).read();
    next.into_iter().for_each(|next| slots.previous_radiance.keep(g, next, radiance));
    let post = slots.post.give(g, view, PostIn { colour: radiance, seen: Some(Seen { scene, gbuffer }) });
    Ok(FrameOut { radiance: post.radiance, display: post.display })
}
