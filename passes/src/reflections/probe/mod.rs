//! Reflections by cube probes that are captured while frames are rendered: one that follows the camera, and those that the scene places.
mod places;
mod settings;

pub use settings::settings;

use super::idle_reason;
use crate::contracts::{Channel, GEOMETRY, LightingIn, LightingOut};
use crate::parts::hit_shading::{self, HitShading};
use crate::ray_kernels::RayKernels;
use glam::{DMat3, DVec3};
use magpie::gpu::Kernel;
use magpie::graph::{BufferToken, HistoryScope, Part, PassBuilder, SampleToken};
use magpie::prelude::*;
use magpie::scene::{ReflectionProbe, SceneFacts, Wrap};
use magpie::slot::{Build, ImplementationInfo, Needs, Settings, SlotError};
use magpie_shaders::probe::{
    CaptureParams, MeansParams, PROBE_FACES, PlaceParams, Probe, ProbeFilterParams, ProbeImages, ProbeShadeParams,
    ProbeTable,
};
use magpie_shaders::{
    REFLECTIONS_PROBE_CAPTURE_RAY, REFLECTIONS_PROBE_FILTER_COMP, REFLECTIONS_PROBE_MEANS_COMP,
    REFLECTIONS_PROBE_PLACE_RAY, REFLECTIONS_PROBE_SHADE_COMP, REFLECTIONS_PROBE_TINTED_CAPTURE_RAY, SampledImage,
    SamplerId, StorageImage,
};
use places::{ALL, CAMERA, Places, Work};
use settings::Options;
use std::collections::BTreeMap;

/// Format of what is captured.
const FORMAT: Format = Format::Rgba16Float;
/// Format of the number of captures and the surface.
const COUNT: Format = Format::R32Uint;
/// Where nothing moves, the mean is over so many times as many captures.
const STILL: u32 = 8;
/// Share of the grid's spacing that the camera's probe keeps from surfaces.
const CLEARANCE: f64 = 0.25;
/// Bytes of the offset of a probe.
const OFFSET: u64 = 12;

/// Reflections by probes.
pub struct Probes {
    options: Options,
    capture: RayKernels,
    place: RayKernel,
    means: Kernel,
    filter: Kernel,
    shade: Kernel,
    sampler: SamplerId,
    scope: HistoryScope,
    places: Places,
    /// The scene that the places are of, and the power of its lights in the last frame.
    seen: Option<(u64, Vec<f64>)>,
    /// Frames since the light changed.
    quiet: u32,
}

/// What passes after the captures read.
#[derive(Clone, Copy)]
struct Captured {
    chain: Handle<Image>,
    offsets: Handle<Buffer>,
    table: Handle<Buffer>,
}

/// What a pass declared with [`Captured::read`].
struct CapturedToken {
    chain: SampleToken,
    offsets: BufferToken,
    table: BufferToken,
    sampler: SamplerId,
}

impl Captured {
    fn read(self, p: &mut PassBuilder<'_>, sampler: SamplerId) -> CapturedToken {
        let (chain, offsets, table) = (p.sample(self.chain), p.read(self.offsets), p.read(self.table));
        CapturedToken { chain, offsets, table, sampler }
    }
}

impl CapturedToken {
    /// The block for the parameters of the shader.
    fn params(&self, c: &Record<'_>) -> ProbeImages {
        let table = c.id(self.table);
        ProbeImages {
            table,
            probes: table.offset(size_of::<ProbeTable>() as u64),
            offsets: c.id(self.offsets),
            chain: c.id(self.chain),
            sampler_id: self.sampler,
        }
    }
}

/// The six layers of a probe, from one mip to another.
fn part(place: usize, mip: u32, mips: u32) -> Part {
    Part { mip: mip as u16, mips: mips as u16, layer: (place as u32 * PROBE_FACES) as u16, layers: PROBE_FACES as u16 }
}

/// Name of a pass: that of the first of its kind in the frame is short.
fn named(name: &str, at: usize) -> String {
    if at == 0 { format!("reflections.{name}") } else { format!("reflections.{name}_{at}") }
}

impl Probes {
    /// Creates the pipelines.
    pub fn new(build: &Build<'_>, settings: &Settings) -> Result<Self, SlotError> {
        Ok(Self {
            options: Options::read(settings)?,
            capture: RayKernels::new(build, &REFLECTIONS_PROBE_CAPTURE_RAY, &REFLECTIONS_PROBE_TINTED_CAPTURE_RAY)?,
            place: build.ray_kernel(&REFLECTIONS_PROBE_PLACE_RAY)?,
            means: build.kernel(&REFLECTIONS_PROBE_MEANS_COMP)?,
            filter: build.kernel(&REFLECTIONS_PROBE_FILTER_COMP)?,
            shade: build.kernel(&REFLECTIONS_PROBE_SHADE_COMP)?,
            sampler: build.trilinear([Wrap::Clamp; 2])?,
            scope: HistoryScope::new(),
            places: Places::default(),
            seen: None,
            quiet: 0,
        })
    }

    /// With the default settings.
    pub fn with_defaults(build: &Build<'_>) -> Result<Self, SlotError> {
        let (name, about) = ("probe".to_owned(), String::new());
        let info = ImplementationInfo { name, about, settings: settings() };
        Self::new(build, &Settings::new("reflections", &info, &BTreeMap::new())?)
    }

    /// Goes on to the places of this frame. Returns the number of captures in a mean, and whether captures end there.
    fn follow(&mut self, view: &View) -> (u32, bool) {
        let powers: Vec<f64> = view.facts.lights.iter().map(|light| light.power).collect();
        self.quiet = self.quiet.saturating_add(1);
        match &mut self.seen {
            Some((scene, known)) if *scene == view.scene && view.frame > 0 => {
                if *known != powers {
                    *known = powers;
                    self.quiet = 0;
                    self.places.disturb();
                }
            }
            _ => {
                self.places = Places::new(view.facts.probes.iter().map(capture_centre));
                (self.seen, self.quiet) = (Some((view.scene, powers)), u32::MAX);
            }
        }
        self.places.follow(view.camera.eye(), self.options.spacing);
        let round = (self.places.all.len() as u32 * PROBE_FACES).div_ceil(self.options.faces);
        let is_still =
            view.facts.moving == 0.0 && !view.facts.lights_move && self.quiet > 2 * self.options.average * round;
        let length = if is_still { (STILL * self.options.average).min(255) } else { self.options.average };
        (length, is_still)
    }

    /// Adds the captures and the filter of the probes that have some in this frame.
    fn capture(&mut self, g: &mut FrameGraph, view: &View, i: LightingIn, hits: HitShading) -> Captured {
        let options = self.options;
        let (length, is_still) = self.follow(view);
        let limit = if is_still { length } else { u32::MAX };
        let were_complete: Vec<bool> = self.places.all.iter().map(places::Place::is_complete).collect();
        let mut work = self.places.plan(options.faces, limit);
        let keys: Vec<u64> = self.places.keys(&work);
        let extent = Extent::new(options.side, options.side);
        let desc = ImageDesc { mips: options.mips() + 1, ..ImageDesc::fixed(FORMAT, extent) };
        let radiance = g.kept_layers(&self.scope, "probes", desc, &keys);
        let counts = g.kept_layers(&self.scope, "counts", ImageDesc::fixed(COUNT, extent), &keys);
        let bytes = OFFSET * self.places.all.len() as u64;
        let offsets = g.kept_buffer(&self.scope, "offsets", BufferDesc::new(bytes));
        self.places.settle(&mut work, &[radiance.stale, counts.stale].concat());

        let mut kept = Kept { chain: radiance.image, counts: counts.image, offsets: offsets.buffer };
        let used = work.iter().enumerate().filter(|(_, work)| work.faces != 0);
        for (nth, (at, work)) in used.enumerate() {
            let is_new = work.fresh != 0 && self.places.all[at].captures.iter().sum::<u32>() == work.faces.count_ones();
            if at < CAMERA && is_new {
                kept.offsets = self.place(g, view, i, at, kept.offsets, nth);
            }
            let mode = if !options.indirect {
                0
            } else if were_complete[at] && work.fresh != ALL {
                2
            } else {
                1
            };
            kept = self.capture_faces(g, view, i, hits, at, *work, Averaged { length, mode }, kept, nth);
            // Lobes cover several faces: a probe is filtered once all are captured.
            if self.places.all[at].is_complete() {
                let faces = if were_complete[at] { work.faces } else { ALL };
                kept.chain = self.filter_faces(g, at, faces, kept.chain, nth);
            }
        }
        let table = self.table(g, view);
        Captured { chain: kept.chain.read(), offsets: kept.offsets.read(), table }
    }

    /// Moves a probe of the camera out of walls.
    fn place(
        &self,
        g: &mut FrameGraph,
        view: &View,
        i: LightingIn,
        at: usize,
        offsets: WriteHandle<Buffer>,
        nth: usize,
    ) -> WriteHandle<Buffer> {
        let (kernel, clearance) = (self.place, (CLEARANCE * self.options.spacing) as f32);
        let centre = (self.places.all[at].centre - view.origin).as_vec3().to_array();
        let eye = (view.camera.eye() - view.origin).as_vec3().to_array();
        g.pass(&named("place_probe", nth), Queue::AsyncCompute, |p| {
            let scene = i.scene.trace(p);
            let (offsets, token) = p.write_buffer(offsets);
            (offsets, move |c: &mut Record<'_>| {
                let params = PlaceParams {
                    scene: c.id(scene.root),
                    rays: c.rays(),
                    offset: c.id(token).offset(OFFSET * at as u64),
                    centre,
                    eye,
                    clearance,
                };
                c.trace(kernel, scene.tlas, &params, Extent::new(1, 1));
            })
        })
    }

    /// Captures faces of a probe.
    #[allow(clippy::too_many_arguments, reason = "one pass")]
    fn capture_faces(
        &self,
        g: &mut FrameGraph,
        view: &View,
        i: LightingIn,
        hits: HitShading,
        at: usize,
        work: Work,
        averaged: Averaged,
        kept: Kept,
        nth: usize,
    ) -> Kept {
        let kernel = self.capture.of(view);
        let (block, side, mips, sampler, key) =
            (view.block, self.options.side, self.options.mips(), self.sampler, view.frame);
        let centre = (self.places.all[at].centre - view.origin).as_vec3().to_array();
        g.pass(&named("capture_probe", nth), Queue::AsyncCompute, |p| {
            let (block, scene, hits) = (p.read(block), i.scene.trace(p), hits.read(p));
            let offsets = p.read(kept.offsets.read());
            let filtered = p.sample_part(kept.chain.read(), part(at, 1, mips));
            let (chain, target) = p.write_part(kept.chain, part(at, 0, 1));
            let (counts, count_target) = p.write_part(kept.counts, part(at, 0, 1));
            let extent = Extent::new(side, side * work.faces.count_ones());
            (Kept { chain, counts, offsets: kept.offsets }, move |c: &mut Record<'_>| {
                let params = CaptureParams {
                    view: c.id(block),
                    scene: c.id(scene.root),
                    rays: c.rays(),
                    not_finite: c.not_finite(),
                    lights: hits.params(c).lights,
                    offset: c.id(offsets).offset(OFFSET * at as u64),
                    centre,
                    side,
                    radiance: c.id(target),
                    counts: c.id(count_target),
                    filtered: c.id(filtered),
                    sampler_id: sampler,
                    faces: work.faces,
                    fresh: work.fresh,
                    most: averaged.length,
                    indirect: averaged.mode,
                    key,
                };
                c.trace(kernel, scene.tlas, &params, extent);
            })
        })
    }

    /// Makes the blurred mips of faces of a probe.
    fn filter_faces(
        &self,
        g: &mut FrameGraph,
        at: usize,
        faces: u32,
        chain: WriteHandle<Image>,
        nth: usize,
    ) -> WriteHandle<Image> {
        let Options { side, samples, filtered, .. } = self.options;
        let (means_kernel, filter_kernel, sampler) = (self.means, self.filter, self.sampler);
        let (count, mean_mips) = (self.options.mips(), side.ilog2().min(6));
        let means = g.pass(&named("mean_probe", nth), Queue::AsyncCompute, |p| {
            let source = p.sample_part(chain.read(), part(at, 0, 1));
            let desc = ImageDesc {
                mips: mean_mips + 1,
                layers: PROBE_FACES,
                ..ImageDesc::fixed(FORMAT, Extent::new(side, side))
            };
            let (mut means, token) = p.create_part("means", desc, Part::mip(0));
            let mut tokens = vec![token];
            for mip in 1..=mean_mips {
                let (next, token) = p.write_part(means, Part::mip(mip));
                means = next;
                tokens.push(token);
            }
            (means.read(), move |c: &mut Record<'_>| {
                let id = |mip: usize| tokens.get(mip).map_or(StorageImage::default(), |token| c.id(*token));
                let mips = std::array::from_fn(id);
                let params = MeansParams { radiance: c.id(source), side, mips, count: mean_mips + 1 };
                let groups = (side / 64).max(1);
                c.dispatch_groups(means_kernel, &params, [groups, groups * PROBE_FACES, 1]);
            })
        });
        g.pass(&named("filter_probe", nth), Queue::AsyncCompute, |p| {
            let means = p.sample(means);
            let (mut chain, mut tokens) = (chain, Vec::new());
            for mip in 1..=count {
                let (next, token) = p.write_part(chain, part(at, mip, 1));
                chain = next;
                tokens.push(token);
            }
            let texels: u32 = (1..=count).map(|mip| (side >> mip).pow(2)).sum::<u32>() * faces.count_ones();
            let width = 128;
            (chain, move |c: &mut Record<'_>| {
                let id = |mip: usize| tokens.get(mip).map_or(StorageImage::default(), |token| c.id(*token));
                let params = ProbeFilterParams {
                    not_finite: c.not_finite(),
                    means: c.id(means),
                    sampler_id: sampler,
                    mips: std::array::from_fn(id),
                    count,
                    side,
                    mean_mips,
                    samples,
                    filtered: filtered.into(),
                    faces,
                    width,
                };
                c.dispatch(filter_kernel, &params, Extent::new(width, texels.div_ceil(width)));
            })
        })
    }

    /// The table of the probes that are looked up.
    fn table(&self, g: &mut FrameGraph, view: &View) -> Handle<Buffer> {
        let options = self.options;
        let weights = self.places.camera_weights();
        let entry = |(at, place): (usize, &places::Place)| {
            let weight = weights.get(at).copied().unwrap_or(1.0);
            let shown = place.is_used && weight > 0.0;
            let common = Probe {
                centre: (place.centre - view.origin).as_vec3().to_array(),
                layer: at as u32 * PROBE_FACES,
                offset: at as u32,
                weight,
                fade: -1.0,
                ..Probe::default()
            };
            let of_box = |centre: DVec3, rotation: DMat3, half_size: [f32; 3]| {
                let (rows, centre) = (rotation.as_mat3(), (centre - view.origin).as_vec3());
                // Rows of the inverse of a rotation are its columns.
                let row = |axis: glam::Vec3| axis.extend(-axis.dot(centre)).to_array();
                let box_from_world = [row(rows.x_axis), row(rows.y_axis), row(rows.z_axis)];
                Probe { box_from_world, half_size, ..common }
            };
            shown.then(|| match (at.checked_sub(CAMERA).and_then(|k| view.facts.probes.get(k)), view.facts.bounds) {
                (Some(placed), _) => {
                    let of = placed.world_from_box;
                    let made = of_box(of.translation, of.matrix3, placed.half_size.to_array());
                    Probe { fade: placed.fade, ..made }
                }
                (None, Some(bounds)) => {
                    let [min, max] = bounds.map(DVec3::from_array);
                    let half_size = (0.5 * (max - min)).as_vec3().max(glam::Vec3::splat(1e-3));
                    of_box(0.5 * (min + max), DMat3::IDENTITY, half_size.to_array())
                }
                (None, None) => common,
            })
        };
        let probes: Vec<Probe> = self.places.all.iter().enumerate().filter_map(entry).collect();
        let table = ProbeTable {
            count: probes.len() as u32,
            side: options.side,
            mips: options.mips(),
            correction: options.correction,
            narrowing: options.narrowing,
            steps: options.steps,
            reach: options.reach,
        };
        let first = size_of::<ProbeTable>() as u64;
        g.pass("reflections.probe_table", Queue::Graphics, |p| {
            let (buffer, to) = p.fill_buffer("table", BufferDesc::new(first + size_of_val(&*probes) as u64));
            (buffer.read(), move |c: &mut Record<'_>| {
                c.fill_buffer(to, 0, &[table]);
                c.fill_buffer(to, first, &probes);
            })
        })
    }

    /// Looks the probes up for every pixel.
    fn shade(&self, g: &mut FrameGraph, view: &View, i: LightingIn, captured: Captured) -> Handle<Image> {
        let (kernel, options, block, sampler) = (self.shade, self.options, view.block, self.sampler);
        g.pass("reflections.probe", Queue::AsyncCompute, |p| {
            let (block, probes) = (p.read(block), captured.read(p, sampler));
            let gbuffer =
                i.gbuffer.read(p, &[GEOMETRY, &[Channel::BaseColour, Channel::Material, Channel::Coat]].concat());
            let openness = i.ao.openness.map(|h| p.sample(h));
            let (radiance, target) = p.create("radiance", ImageDesc::like(options.format, i.gbuffer.depth));
            let extent = p.extent(i.gbuffer.depth);
            (radiance.read(), move |c: &mut Record<'_>| {
                let params = ProbeShadeParams {
                    view: c.id(block),
                    not_finite: c.not_finite(),
                    gbuffer: gbuffer.images(c),
                    probes: probes.params(c),
                    openness: openness.map_or(SampledImage::NONE, |t| c.id(t)),
                    direction: options.direction,
                    occlusion: options.occlusion.into(),
                    radiance: c.id(target),
                    greatest: options.format.greatest(),
                };
                c.dispatch(kernel, &params, extent);
            })
        })
    }
}

/// How captures are averaged, and which indirect light their hits have.
#[derive(Clone, Copy)]
struct Averaged {
    length: u32,
    mode: u32,
}

/// What goes from frame to frame.
struct Kept {
    chain: WriteHandle<Image>,
    counts: WriteHandle<Image>,
    offsets: WriteHandle<Buffer>,
}

/// Where a probe of the scene captures.
fn capture_centre(probe: &ReflectionProbe) -> DVec3 {
    probe.world_from_box.transform_point3(probe.centre.as_dvec3())
}

impl Effect for Probes {
    type In = LightingIn;
    type Out = LightingOut;

    fn needs(&self, facts: &SceneFacts) -> Needs {
        if let Some(reason) = idle_reason(facts) {
            return Needs::idle(reason);
        }
        hit_shading::needs(facts)
    }

    fn add(&mut self, g: &mut FrameGraph, view: &View, i: LightingIn) -> LightingOut {
        let is_idle = self.needs(&view.facts).idle.is_some();
        let Some(hits) = HitShading::new(&i, false).filter(|_| !is_idle) else { return LightingOut::default() };
        let captured = self.capture(g, view, i, hits);
        LightingOut::radiance(self.shade(g, view, i, captured))
    }
}
