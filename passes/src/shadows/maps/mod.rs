//! Shadow maps: cascades for directional lights, one pyramid for spot lights, faces of a cube for other local lights. A layer is redrawn
//! only if something in it has changed.
mod cascades;
mod layer;
mod settings;

pub use settings::settings;

use crate::contracts::{GEOMETRY, ShadowIn};
use crate::shadows::ray_traced::format;
use glam::{DVec3, Vec3};
use layer::Layer;
use magpie::gpu::{Blend, Cull, Kernel, RasterDesc, RasterKernel};
use magpie::graph::{Draw, DrawClass, HistoryScope};
use magpie::prelude::*;
use magpie::scene::ShadowLight;
use magpie::slot::{Build, Settings, SlotError};
use magpie_shaders::scene::{
    LIGHT_DIRECTIONAL, LIGHT_DISC, LIGHT_RECTANGLE, LIGHT_SPHERE, LIGHT_SPOT, Light as SharedLight,
};
use magpie_shaders::shadow_map::{ContactParams, MAP_CASCADES, MAP_FACES, MAP_LIGHTS, MapLayer, MapLight, MapParams};
use magpie_shaders::{
    SHADOWS_CONTACT_COMP, SHADOWS_MAP_FRAG, SHADOWS_MAP_LOOK_COMP, SHADOWS_MAP_SPHERE_FRAG, SHADOWS_MAP_SPHERE_VERT,
    SHADOWS_MAP_VERT, SampledImage, StorageImage,
};
use settings::MapOptions;
use std::f32::consts::PI;
use std::hash::{DefaultHasher, Hash, Hasher};

/// Distance of the near plane of a local light, metres. Geometry that touches the light does not occlude it.
const NEAR: f64 = 1e-3;

/// Spot lights with a larger tangent of half their angle use the faces of a cube.
const MAX_SPOT_TANGENT: f32 = 4.0;

/// Visibility by shadow maps.
pub struct MapShadows {
    options: MapOptions,
    opaque: RasterKernel,
    alpha_tested: RasterKernel,
    spheres: RasterKernel,
    look: Kernel,
    contact: Option<Kernel>,
    scope: HistoryScope,
}

/// Results of the shadow maps of up to four lights.
#[derive(Clone, Copy, Debug)]
pub struct MapOut {
    /// Visibility of one light in each channel, 0 to 1.
    pub visibility: Handle<Image>,
    /// `UNSURE_*` bits of [`magpie_shaders::shadow_map`], R32 uint; `None` if they were not requested.
    pub unsure: Option<Handle<Image>>,
}

/// The shadow map of a light.
struct Map {
    light: MapLight,
    image: Handle<Image>,
    layers: Vec<Layer>,
}

impl MapShadows {
    /// Creates the pipelines.
    pub fn new(build: &Build<'_>, settings: &Settings) -> Result<Self, SlotError> {
        let options = MapOptions::new(settings)?;
        let raster = |name, vertex, fragment, constants: &[u32]| {
            let (blend, depth) = (Blend::Opaque, Some(Format::D32Float));
            let desc = RasterDesc { name, vertex, fragment, constants, colours: &[], blend, depth };
            build.raster_kernel(&desc)
        };
        let triangles =
            |name, alpha_test: bool| raster(name, &SHADOWS_MAP_VERT, &SHADOWS_MAP_FRAG, &[alpha_test.into()]);
        let kernel = |shader| build.kernel(shader);
        Ok(Self {
            options,
            opaque: triangles("shadows.map_opaque", false)?,
            alpha_tested: triangles("shadows.map_alpha_tested", true)?,
            spheres: raster("shadows.map_spheres", &SHADOWS_MAP_SPHERE_VERT, &SHADOWS_MAP_SPHERE_FRAG, &[])?,
            look: kernel(&SHADOWS_MAP_LOOK_COMP)?,
            contact: (options.contact > 0.0).then(|| kernel(&SHADOWS_CONTACT_COMP)).transpose()?,
            scope: HistoryScope::new(),
        })
    }

    /// Adds the passes for up to four lights. With `classify` the result includes where the maps are unsure. `name` is appended to the names
    /// of the passes, to tell several groups of lights apart.
    pub fn add(
        &self,
        g: &mut FrameGraph,
        view: &View,
        i: ShadowIn,
        lights: &[ShadowLight],
        classify: bool,
        name: &str,
    ) -> MapOut {
        let mut maps: Vec<Map> = Vec::with_capacity(MAP_LIGHTS as usize);
        for light in lights.iter().take(MAP_LIGHTS as usize) {
            let layers = self.layers(g, view, &light.placed);
            let side = if layers.iter().any(|l| l.is_box) { self.options.sun_side } else { self.options.lamp_side };
            let image = self.map(g, view, i, light.light, side, &layers);
            let light = MapLight {
                light: light.light,
                kind: if light.placed.kind == LIGHT_DIRECTIONAL { MAP_CASCADES } else { MAP_FACES },
                first: maps.iter().map(|m| m.layers.len() as u32).sum(),
                layers: layers.len() as u32,
                size: size(&light.placed),
                facing: match light.placed.kind {
                    LIGHT_SPOT | LIGHT_RECTANGLE | LIGHT_DISC => light.placed.direction,
                    _ => [0.0; 3],
                },
            };
            maps.push(Map { light, image, layers });
        }
        self.look_up(g, view, i, &maps, classify, name)
    }

    /// The layers of a light's map.
    fn layers(&self, g: &FrameGraph, view: &View, light: &SharedLight) -> Vec<Layer> {
        let position = Vec3::from(light.position).as_dvec3() + view.origin;
        let forward = Vec3::from(light.direction).as_dvec3().try_normalize().unwrap_or(DVec3::NEG_Y);
        match light.kind {
            LIGHT_DIRECTIONAL => {
                let aspect = f64::from(g.full().width) / f64::from(g.full().height);
                let scene = layer::coarse_box(view.placed.iter().map(|p| &p.bounds), view.origin);
                let scene = scene.unwrap_or([view.camera.eye(); 2]);
                cascades::cascades(&view.camera, aspect, scene, forward, &self.options.division)
            }
            LIGHT_SPOT => {
                // cone_offset is -cos(outer) * cone_scale.
                let cosine = -light.cone_offset / light.cone_scale;
                let tangent = (1.0 - cosine * cosine).max(0.0).sqrt() / cosine;
                if cosine > 0.0 && tangent < MAX_SPOT_TANGENT {
                    // The map is wider than the cone, so that the filter's texels at its edge are in the map.
                    let side = f64::from(self.options.lamp_side);
                    let margin = 1.0 + 2.0 * f64::from(self.options.kernel + 2.0) / side;
                    vec![layer::face(position, forward, f64::from(tangent.max(1e-3)) * margin, NEAR)]
                } else {
                    layer::faces(position, Some(forward), NEAR)
                }
            }
            LIGHT_RECTANGLE | LIGHT_DISC => layer::faces(position, Some(forward), NEAR),
            // Nothing is inside of a spherical light, so the near plane is at its radius.
            LIGHT_SPHERE => layer::faces(position, None, f64::from(light.radius).max(NEAR)),
            _ => layer::faces(position, None, NEAR),
        }
    }

    /// The map of a light of this index in the scene, with `side` texels on a side. Adds a pass for each layer that has to be redrawn.
    fn map(
        &self,
        g: &mut FrameGraph,
        view: &View,
        i: ShadowIn,
        light: u32,
        side: u32,
        layers: &[Layer],
    ) -> Handle<Image> {
        let drawn: Vec<Vec<Draw>> = layers.iter().map(|layer| draws(view, layer)).collect();
        let keys: Vec<u64> = layers.iter().zip(&drawn).map(|(layer, draws)| key(view, layer, draws)).collect();
        let desc = ImageDesc::fixed(Format::D32Float, Extent::new(side, side));
        let kept = g.kept_layers(&self.scope, format!("map_{light}"), desc, &keys);
        let mut image = kept.image;
        let (opaque, alpha_tested, spheres) = (self.opaque, self.alpha_tested, self.spheres);
        for at in kept.stale {
            let (layer, draws) = (layers[at as usize], drawn[at as usize].clone());
            let params = layer.draw_params(view.origin, side);
            image = g.pass(&format!("shadows.map_{light}_{at}"), Queue::Graphics, |p| {
                let (scene, indices) = (i.scene.read(p), p.index(i.scene.indices));
                let (image, _) = p.depth_layer(image, at, 0.0);
                (image, move |c: &mut Record<'_>| {
                    let params = magpie_shaders::shadow_map::MapDrawParams { scene: c.id(scene), ..params };
                    let (triangles, sphere_draws) =
                        draws.split_at(draws.partition_point(|d| d.class != DrawClass::Procedural));
                    let (opaque_draws, alpha_tested_draws) =
                        triangles.split_at(triangles.partition_point(|d| d.class == DrawClass::Opaque));
                    c.draw(opaque, &params, indices, opaque_draws);
                    c.draw(alpha_tested, &params, indices, alpha_tested_draws);
                    c.draw(spheres, &params, indices, sphere_draws);
                })
            });
        }
        image.read()
    }

    /// Adds the lookup of every pixel in the maps, and contact shadows.
    fn look_up(
        &self,
        g: &mut FrameGraph,
        view: &View,
        i: ShadowIn,
        maps: &[Map],
        classify: bool,
        name: &str,
    ) -> MapOut {
        let lights: Vec<MapLight> = maps.iter().map(|m| m.light).collect();
        let layers: Vec<MapLayer> = maps.iter().flat_map(|m| &m.layers).map(|l| l.shared(view.origin)).collect();
        let first = size_of_val(&*lights) as u64;
        let bytes = first + size_of_val(&*layers) as u64;
        let tables = g.pass(&format!("shadows.map_tables{name}"), Queue::Graphics, |p| {
            let (tables, to) = p.fill_buffer("tables", BufferDesc::new(bytes));
            (tables.read(), move |c: &mut Record<'_>| {
                c.fill_buffer(to, 0, &lights);
                c.fill_buffer(to, first, &layers);
            })
        });

        let (kernel, block, options, count) = (self.look, view.block, self.options, maps.len());
        let out = g.pass(&format!("shadows.map_look{name}"), Queue::AsyncCompute, |p| {
            let (block, scene, tables) = (p.read(block), i.scene.read(p), p.read(tables));
            let gbuffer = i.gbuffer.read(p, GEOMETRY);
            let images: Vec<_> = maps.iter().map(|m| p.sample(m.image)).collect();
            let (visibility, target) = p.create("visibility", ImageDesc::like(format(count), i.gbuffer.depth));
            let unsure = (classify || options.always_classify)
                .then(|| p.create("unsure", ImageDesc::like(Format::R32Uint, i.gbuffer.depth)));
            let (unsure, mask) = unsure.map_or((None, None), |(image, token)| (Some(image.read()), Some(token)));
            let extent = p.extent(i.gbuffer.depth);
            ((visibility, unsure), move |c: &mut Record<'_>| {
                let tables = c.id(tables);
                let params = MapParams {
                    view: c.id(block),
                    scene: c.id(scene),
                    not_finite: c.not_finite(),
                    lights: tables,
                    layers: tables.offset(first),
                    maps: std::array::from_fn(|k| images.get(k).map_or(SampledImage::default(), |m| c.id(*m))),
                    light_count: count as u32,
                    gbuffer: gbuffer.images(c),
                    visibility: c.id(target),
                    unsure: mask.map_or(StorageImage::default(), |m| c.id(m)),
                    filter_kind: options.filter,
                    kernel: options.kernel,
                    taps: options.taps,
                    rotate: options.rotate.into(),
                    blend: options.blend,
                    coarse: options.coarse,
                };
                c.dispatch(kernel, &params, extent);
            })
        });
        let (mut visibility, unsure) = out;
        if let Some(kernel) = self.contact {
            visibility = g.pass(&format!("shadows.contact{name}"), Queue::AsyncCompute, |p| {
                let (block, scene, tables) = (p.read(block), i.scene.read(p), p.read(tables));
                let gbuffer = i.gbuffer.read(p, GEOMETRY);
                let (visibility, target) = p.write(visibility);
                let extent = p.extent(i.gbuffer.depth);
                (visibility, move |c: &mut Record<'_>| {
                    let params = ContactParams {
                        view: c.id(block),
                        scene: c.id(scene),
                        lights: c.id(tables),
                        light_count: count as u32,
                        gbuffer: gbuffer.images(c),
                        visibility: c.id(target),
                        reach: options.contact,
                        steps: options.contact_steps,
                    };
                    c.dispatch(kernel, &params, extent);
                })
            });
        }
        MapOut { visibility: visibility.read(), unsure }
    }
}

/// The draws of the instances that may be in a layer. Both sides of every triangle cast shadows, as with rays.
fn draws(view: &View, layer: &Layer) -> Vec<Draw> {
    let may_be_inside =
        |d: &&Draw| view.placed.get(d.instance as usize).is_none_or(|p| layer.meets(&p.bounds, view.origin));
    let both_sides = |d: &Draw| if d.class == DrawClass::Procedural { *d } else { Draw { cull: Cull::None, ..*d } };
    view.draws.all().iter().filter(may_be_inside).map(both_sides).collect()
}

/// A hash of everything on which the contents of a layer depend.
fn key(view: &View, layer: &Layer, draws: &[Draw]) -> u64 {
    let mut hasher = DefaultHasher::new();
    view.scene.hash(&mut hasher);
    layer.hash(&mut hasher);
    for draw in draws {
        (draw.instance, view.placed.get(draw.instance as usize).map(|p| p.changed)).hash(&mut hasher);
    }
    hasher.finish()
}

/// As in [`MapLight::size`]: tangent of the angular radius of a directional light; radius of a disc of equal area for a local light, metres.
fn size(light: &SharedLight) -> f32 {
    match light.kind {
        LIGHT_DIRECTIONAL => light.radius.tan(),
        LIGHT_DISC | LIGHT_SPHERE => light.radius,
        LIGHT_RECTANGLE => {
            let area = 4.0 * Vec3::from(light.half_u).cross(light.half_v.into()).length();
            (area / PI).sqrt()
        }
        _ => 0.0,
    }
}
