//! Shadow rays from the surface of each pixel, or of one pixel out of four, to points of the lights.
use super::choice::Group;
use super::maps::MapOut;
use crate::contracts::{Channel, RAY_START, ShadowIn};
use crate::parts::denoise::{Method, Options, is_adaptive, squares, surfaces};
use crate::parts::upsample::{Upsample, UpsampleIn};
use magpie::graph::HistoryScope;
use magpie::prelude::*;
use magpie::scene::{SceneFacts, ShadowLight};
use magpie::slot::{Build, SettingSpec, Settings, SlotError};
use magpie_shaders::scene::{LIGHT_DIRECTIONAL, LIGHT_POINT, LIGHT_SPOT, Light};
use magpie_shaders::shadows::{GradientParams, NO_MAP, NO_PENUMBRA, NO_SURFACES, TraceParams};
use magpie_shaders::view::NO_LIGHT;
use magpie_shaders::{SHADOWS_GRADIENT_RAY, SHADOWS_TINTED_GRADIENT_RAY, SHADOWS_TINTED_RAY, SHADOWS_TRACE_RAY};

/// Visibility by shadow rays.
pub struct RayTraced {
    trace: RayKernel,
    /// Set at half resolution only.
    upsample: Option<Upsample>,
    /// Rays per pixel to each light that has a size; 0 for one ray to its centre.
    samples: u32,
    /// Finds temporal gradients, if the denoiser uses them.
    gradient: Option<RayKernel>,
    /// The same two kernels for one light in colour, for scenes with surfaces that transmit light; `None` if the setting `tinted` is off.
    tinted: Option<(RayKernel, Option<RayKernel>)>,
    scope: HistoryScope,
    /// A denoiser follows.
    filtered: bool,
}

/// Results of shadow rays.
#[derive(Clone, Copy)]
pub struct Traced {
    /// Visibility of one light in each channel, or of one light in red, green and blue.
    pub visibility: Handle<Image>,
    /// As [`Hints::change`](crate::parts::denoise::Hints::change).
    pub change: Option<Handle<Image>>,
    /// Penumbra width at the hits, as in [`TraceParams::penumbra`], if a denoiser follows.
    pub penumbra: Option<Handle<Image>>,
}

/// The setting `rays`.
pub fn rays() -> SettingSpec {
    SettingSpec::among(
        "rays",
        "",
        "Shadow rays per pixel to each light that has an extent. Higher: less noise (variance is inversely proportional to the number), \
         with time proportional to it.",
        1,
        &[1, 2, 4, 8],
    )
    .sweep_all()
}

/// The other settings of shadow rays.
pub fn settings() -> [SettingSpec; 3] {
    [
        SettingSpec::choice(
            "resolution",
            "`full`: rays from every pixel. `half`: rays from one pixel of four, upsampled along surfaces; a quarter of the rays, but \
             thin shadows and edges lose detail.",
            "full",
            &["full", "half"],
        )
        .sweep_all(),
        SettingSpec::choice(
            "edges",
            "`soft`: rays towards points all over a light, with penumbrae and noise. `hard`: one ray to its centre, as though it were a \
             point.",
            "soft",
            &["soft", "hard"],
        )
        .sweep_all(),
        SettingSpec::switch(
            "tinted",
            "Blended surfaces and thin smooth glass dim and tint light instead of blocking it. This takes several rays and a coloured \
             image for each light; scenes without such surfaces need neither.",
            true,
        ),
    ]
}

/// The smallest format of visibility with this number of channels.
pub fn format(channels: usize) -> Format {
    match channels {
        1 => Format::R8Unorm,
        2 => Format::Rg8Unorm,
        _ => Format::Rgba8Unorm,
    }
}

/// Scene indices of up to four lights, then [`NO_LIGHT`].
pub fn indices(lights: &[ShadowLight]) -> [u32; 4] {
    std::array::from_fn(|k| lights.get(k).map_or(NO_LIGHT, |light| light.light))
}

impl RayTraced {
    /// Creates the pipelines.
    pub fn new(build: &Build<'_>, settings: &Settings) -> Result<Self, SlotError> {
        let half = settings.choice("resolution")? == "half";
        let upsample = half.then(|| Upsample::new(build, "shadows")).transpose()?;
        let samples = if settings.choice("edges")? == "hard" { 0 } else { settings.u32("rays")? };
        let adaptive = is_adaptive(settings)? && samples > 0 && !half;
        let gradient = adaptive.then(|| build.ray_kernel(&SHADOWS_GRADIENT_RAY)).transpose()?;
        let tinted = if settings.switch("tinted")? {
            let gradient = adaptive.then(|| build.ray_kernel(&SHADOWS_TINTED_GRADIENT_RAY)).transpose()?;
            Some((build.ray_kernel(&SHADOWS_TINTED_RAY)?, gradient))
        } else {
            None
        };
        Ok(Self {
            trace: build.ray_kernel(&SHADOWS_TRACE_RAY)?,
            upsample,
            samples,
            gradient,
            tinted,
            scope: HistoryScope::new(),
            filtered: Options::read(settings)?.method != Method::None,
        })
    }

    /// Whether any of these lights has a size and is sampled at random points. Visibility of points has no noise.
    pub fn is_noisy(&self, lights: &[ShadowLight]) -> bool {
        let has_size = |light: &Light| match light.kind {
            LIGHT_POINT | LIGHT_SPOT => false,
            LIGHT_DIRECTIONAL => light.radius > 0.0,
            _ => true,
        };
        self.samples > 0 && lights.iter().any(|light| has_size(&light.placed))
    }

    /// Whether the output is the unfiltered rays of each pixel: no denoiser and no upsampling follows.
    pub fn gives_raw(&self) -> bool {
        !self.filtered && self.upsample.is_none()
    }

    /// Whether visibility is in colour: the setting `tinted` is on, and the scene has surfaces that transmit light.
    pub fn is_tinted(&self, facts: &SceneFacts) -> bool {
        self.tinted.is_some() && facts.lets_light_through
    }

    /// A bit for each channel whose light has moved since the previous frame.
    pub fn moved(&self, group: &Group) -> u32 {
        let bits = |channel: usize| if group.coloured { 0b111 } else { 1 << channel };
        let moved = group.lights.iter().enumerate().filter(|(_, light)| light.moved);
        moved.map(|(channel, _)| bits(channel)).fold(0, |all, bits| all | bits)
    }

    /// Adds the passes for a group of lights. With `maps`, their visibility is used where they are sure, and rays elsewhere.
    pub fn add(
        &self,
        g: &mut FrameGraph,
        view: &View,
        i: ShadowIn,
        group: &Group,
        maps: Option<MapOut>,
        name: &str,
    ) -> Traced {
        let lights = &group.lights[..];
        let tinted = self.tinted.filter(|_| group.coloured);
        let (kernel, gradient) = tinted.unwrap_or((self.trace, self.gradient));
        // Temporal gradients compare rays with rays, so they do not apply to visibility by maps.
        let has_gradient = self.is_noisy(lights) && maps.is_none();
        let (change, next) = match gradient.filter(|_| has_gradient) {
            Some(kernel) => {
                let changes = self.changes(g, view, kernel, i, group, name);
                (Some(changes.change), Some((changes.visibility, changes.surfaces)))
            }
            None => (None, None),
        };
        // Maps have visibility at full resolution, so nothing is upsampled.
        let upsample = self.upsample.as_ref().filter(|_| maps.is_none());
        let (samples, block) = (self.samples, view.block);
        let step = if upsample.is_some() { 2 } else { 1 };
        let (count, lights, format) = (lights.len() as u32, indices(lights), format(group.channels()));
        let filtered = self.filtered && self.is_noisy(&group.lights);
        let (traced, penumbra) = g.pass(&format!("shadows.trace{name}"), Queue::AsyncCompute, |p| {
            let (block, scene) = (p.read(block), i.scene.trace(p));
            let gbuffer = i.gbuffer.read(p, RAY_START);
            let maps = maps.and_then(|m| Some((p.sample(m.visibility), p.sample(m.unsure?))));
            let desc = if step == 1 { ImageDesc::like(format, i.gbuffer.depth) } else { ImageDesc::half(format) };
            let (visibility, target, surfaces) = match next {
                Some((visibility, surfaces)) => {
                    let (visibility, target) = p.write(visibility);
                    (visibility, target, Some(p.write(surfaces).1))
                }
                None => {
                    let (visibility, target) = p.create("visibility", desc);
                    (visibility, target, None)
                }
            };
            let (penumbra, penumbra_target) = filtered.then(|| p.create("penumbra", desc)).unzip();
            let extent = p.extent_of(desc);
            let out = (visibility.read(), penumbra.map(|p| p.read()));
            (out, move |c: &mut Record<'_>| {
                let params = TraceParams {
                    view: c.id(block),
                    scene: c.id(scene.root),
                    rays: c.rays(),
                    gbuffer: gbuffer.images(c),
                    visibility: c.id(target),
                    penumbra: penumbra_target.map_or(NO_PENUMBRA, |t| c.id(t).index()),
                    surfaces: surfaces.map_or(NO_SURFACES, |t| c.id(t).index()),
                    map_visibility: maps.map_or(NO_MAP, |(visibility, _)| c.id(visibility).index()),
                    unsure: maps.map_or(NO_MAP, |(_, unsure)| c.id(unsure).index()),
                    step,
                    samples,
                    count,
                    lights,
                };
                c.trace(kernel, scene.tlas, &params, extent);
            })
        });
        let visibility = match upsample {
            Some(upsample) => {
                let value = ("visibility", g.desc(traced).format);
                let gbuffer = i.gbuffer;
                let i = UpsampleIn { half_size: traced, gbuffer, value, direction: None, background: 0.0 };
                upsample.add(g, view, i, name).value
            }
            None => traced,
        };
        Traced { visibility, change, penumbra }
    }

    /// Adds the pass that finds temporal gradients: it traces rays of the previous frame again, from the current positions of its surfaces.
    fn changes(
        &self,
        g: &mut FrameGraph,
        view: &View,
        kernel: RayKernel,
        i: ShadowIn,
        group: &Group,
        name: &str,
    ) -> Changes {
        let (samples, block) = (self.samples, view.block);
        let (count, lights) = (group.lights.len() as u32, indices(&group.lights));
        let format = format(group.channels());
        let desc = ImageDesc::like(format, i.gbuffer.depth);
        let visibility = g.history(&self.scope, format!("visibility{name}"), desc);
        let frame = g.extent(i.gbuffer.depth);
        let extent = squares(frame);
        let surfaces = g.history(&self.scope, format!("gradient_surfaces{name}"), surfaces(frame));
        let valid = visibility.valid && surfaces.valid;
        let change = g.pass(&format!("shadows.gradient{name}"), Queue::AsyncCompute, |p| {
            let (block, scene) = (p.read(block), i.scene.trace(p));
            let gbuffer = i.gbuffer.read(p, &[Channel::Motion]);
            let (visibility, previous) = (p.sample(visibility.previous), p.sample(surfaces.previous));
            let (change, target) = p.create("change", ImageDesc::fixed(format, extent));
            (change.read(), move |c: &mut Record<'_>| {
                let params = GradientParams {
                    view: c.id(block),
                    scene: c.id(scene.root),
                    rays: c.rays(),
                    gbuffer: gbuffer.images(c),
                    previous: c.id(previous),
                    previous_visibility: c.id(visibility),
                    change: c.id(target),
                    valid: valid.into(),
                    samples,
                    count,
                    lights,
                };
                c.trace(kernel, scene.tlas, &params, extent);
            })
        });
        Changes { change, visibility: visibility.next, surfaces: surfaces.next }
    }
}

/// Temporal gradients, and the images that `shadows.trace` writes for those of the next frame.
struct Changes {
    /// As [`Traced::change`].
    change: Handle<Image>,
    visibility: WriteHandle<Image>,
    /// The surface of one pixel out of nine.
    surfaces: WriteHandle<Image>,
}
