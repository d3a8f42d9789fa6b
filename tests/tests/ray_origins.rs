//! Rays that leave surfaces: a ball resting on a floor, at every scale and distance from the world's origin, with every backend.
//!
//! - **Self-hits**: rays that leave a convex body on the outer side of their triangle never hit that body. Without tolerance: none of the
//!   eight rays of any pixel may, down to a cosine of a thousandth.
//! - **False dark**: pixels that are dark although the light reaches them by the closed form of a ball on a floor. Excluded are those whose
//!   line to the light passes the ball within four times the offset.
//! - **False light**: pixels that are lit although their line to the light passes through the ball, deeper than four times the offset. The
//!   triangles of a ball are up to 0.0011 of its radius inside it, which is added to the excluded margin.
//!
//! Origins are computed both from the G-buffer and from hits of primary rays; the shadow pass must agree with the former.
use anyhow::{Context, Result, ensure};
use bytemuck::{Pod, Zeroable};
use glam::{DAffine3, DQuat, DVec3, Vec3};
use magpie::config::Config;
use magpie::gpu::{Gpu, RayKernel};
use magpie::graph::{Extent, Format, ImageDesc, Queue, Record};
use magpie::prelude::Rays;
use magpie::scene::{
    Camera, FloatingOrigin, Instance, Light, Mesh, Moment, ResidentOptions, ResidentScene, Scene, Sphere,
};
use magpie::slot::Build;
use magpie_passes::Slots;
use magpie_passes::contracts::{GBufferIn, ShadowIn};
use magpie_passes::parts::reproject::Reprojection;
use magpie_shaders::{Address, SampledImage, StorageImage};
use magpie_tests::bench::{Bench, Shot};
use magpie_tests::fixtures::{camera, material, mesh, scene, sphere, sun};
use magpie_tests::harness::{builtin, gpu};

const EXTENT: Extent = Extent { width: 160, height: 90 };
/// Greatest distance of the ball's triangles below its surface, with 48 rings of 96: `1 - cos(pi / 96)` in both directions.
const FACETS: f64 = 1.1e-3;

const GLSL: &str = r#"#version 460
#extension GL_GOOGLE_include_directive : require
#include "lib/bindless.glsl"
#include "lib/gbuffer.glsl"
#include "lib/lights.glsl"
#include "lib/ray.glsl"
layout(push_constant, scalar) uniform Push {
    uvec2 view_address; uvec2 scene_address; uvec2 rays; uint ids; uint depth; uint seen; uint hits; uint marks; vec3 light; uint is_lamp; float factor;
};

uint traced_closest = 0u;
uint traced_any = 0u;

// 1 lit, 0 dark, -1 turned away.
float lit(SceneBuffer scene, RayStart start)
{
    vec3 towards = is_lamp != 0u ? normalize(light - start.position) : light;
    if (dot(start.normal, towards) <= 1e-4) return -1.0;
    Ray ray = is_lamp != 0u ? surface_ray_to(start, light) : surface_ray(start, towards, INFINITELY_FAR);
    traced_any++;
    return trace_any(scene, ray) ? 0.0 : 1.0;
}

// Rays to the outer side that meet the instance they left.
float self_hits(SceneBuffer scene, RayStart start, uint instance, ivec2 pixel)
{
    const float COSINES[8] = float[](1e-3, 3e-3, 0.01, 0.03, 0.1, 0.3, 0.7, 1.0);
    vec3 across = normalize(cross(start.normal, abs(start.normal.x) < 0.5 ? vec3(1.0, 0.0, 0.0) : vec3(0.0, 1.0, 0.0)));
    vec3 along = cross(start.normal, across);
    float count = 0.0;
    for (int i = 0; i < 8; i++) {
        float angle = 2.4 * float(i) + 0.7 * float(pixel.x) + 1.9 * float(pixel.y);
        float sine = sqrt(1.0 - COSINES[i] * COSINES[i]);
        vec3 direction = COSINES[i] * start.normal + sine * (cos(angle) * across + sin(angle) * along);
        Hit hit;
        traced_closest++;
        count += trace_closest(scene, surface_ray(start, direction, INFINITELY_FAR), hit) && hit.instance == instance ? 1.0 : 0.0;
    }
    return count;
}

void main() {
    ViewBuffer view = ViewBuffer(view_address);
    ivec2 pixel = ivec2(RAY_INVOCATION.xy);
    if (!inside(pixel, view.at[0].size)) return;
    SceneBuffer scene = SceneBuffer(scene_address);
    vec3 eye = view.at[0].eye;
    vec3 along = pixel_ray(view, pixel);
    vec4 from_raster = vec4(0.0, 0.0, 0.0, -1.0);
    vec4 from_rays = from_raster;
    vec4 mark = vec4(0.0);

    uvec2 shown = load_uint(ids, pixel).xy;
    if (shown.x != 0u) {
        vec3 position = world_position(view, pixel, load(depth, pixel).r);
        RayStart start = seen_start(scene, shown, eye, along, position);
        mark.z += float(shown.x);
        mark.w = start.rounding;
        start.rounding *= factor;
        from_raster = vec4(start.position, lit(scene, start));
        mark.x = self_hits(scene, start, shown.x - 1u, pixel);
    }
    Ray ray = make_ray(eye, 1.0 / view.at[0].world_from_clip[2].w, along, INFINITELY_FAR);
    Hit hit;
    traced_closest++;
    if (trace_closest(scene, ray, hit)) {
        RayStart start = hit_start(scene, ray, hit);
        mark.z += 4096.0 * float(hit.instance + 1u);
        mark.w = max(mark.w, start.rounding);
        start.rounding *= factor;
        from_rays = vec4(start.position, lit(scene, start));
        mark.y = self_hits(scene, start, hit.instance, pixel);
    }
    store(seen, pixel, from_raster);
    store(hits, pixel, from_rays);
    store(marks, pixel, mark);
    count_rays(rays, traced_closest, traced_any);
}
"#;

#[repr(C)]
#[derive(Clone, Copy, Pod, Zeroable)]
struct Params {
    view: Address,
    scene: Address,
    rays: Address,
    ids: SampledImage,
    depth: SampledImage,
    seen: StorageImage,
    hits: StorageImage,
    marks: StorageImage,
    light: [f32; 3],
    is_lamp: u32,
    factor: f32,
}

/// Position of the light, relative to the set-up: the ball has radius 1 and rests on the origin, up is y.
#[derive(Clone, Copy, Debug)]
enum Lit {
    /// A directional light at this elevation above the floor, degrees.
    Sun(f64),
    /// A point light at this position.
    Lamp(DVec3),
}

/// A floor and a ball, with their placement in the world.
#[derive(Clone, Copy, Debug)]
struct SetUp {
    scale: f64,
    distance: f64,
    light: Lit,
    /// Whether the ball is a procedural sphere rather than triangles.
    procedural: bool,
    /// Positions of the eye and its target, relative to the set-up.
    view: [DVec3; 2],
    /// Factor of the offsets.
    factor: f32,
    /// Number of strips that the floor is divided into.
    strips: u32,
    /// Factor of the near plane of `Camera::look_at`.
    near: f32,
}

/// A view of the whole set-up.
const WHOLE: [DVec3; 2] = [DVec3::new(1.8, 3.3, 4.7), DVec3::new(0.0, 0.8, 0.0)];
/// A view of the point of contact, so low that the ball hides less than 0.002 of the floor in front of it.
const CONTACT: [DVec3; 2] = [DVec3::new(0.22, 0.03, 0.55), DVec3::ZERO];

impl SetUp {
    fn new(scale: f64, distance: f64) -> Self {
        Self { scale, distance, light: LAMP, procedural: false, view: WHOLE, factor: 1.0, strips: 1, near: 1.0 }
    }

    /// World from the set-up's space. Rotated, so that nothing is axis-aligned.
    fn world(&self) -> DAffine3 {
        let turn = DQuat::from_rotation_y(0.6) * DQuat::from_rotation_x(0.35);
        let place = DVec3::new(0.62, 0.48, -0.62).normalize() * self.distance;
        DAffine3::from_scale_rotation_translation(DVec3::splat(self.scale), turn, place)
    }

    fn to_light(self, from: DVec3) -> DVec3 {
        match self.light {
            Lit::Sun(degrees) => {
                let (up, along) = degrees.to_radians().sin_cos();
                DVec3::new(0.6 * along, up, 0.8 * along)
            }
            Lit::Lamp(at) => at - from,
        }
    }

    fn scene(&self) -> Scene {
        let world = self.world();
        let [eye, target] = self.view.map(|p| world.transform_point3(p));
        let mut camera = camera(eye, target);
        camera.near *= self.near;
        let mut s = scene(&format!("{self:?}"), camera);
        let ball = if self.procedural {
            Mesh {
                name: "ball".to_owned(),
                spheres: vec![Sphere { centre: Vec3::ZERO, radius: 1.0 }],
                ..Mesh::default()
            }
        } else {
            sphere(48)
        };
        s.meshes = vec![floor(self.strips), ball];
        s.materials = vec![material([0.5; 3], 0.0, 0.8); 2];
        let up = world * DAffine3::from_translation(DVec3::Y);
        for (mesh, world_from_object) in [(0, world), (1, up)] {
            s.instances.push(Instance { world_from_object, ..Instance::fixed("made", mesh, mesh, Default::default()) });
        }
        s.lights.push(match self.light {
            Lit::Sun(_) => sun(world.transform_vector3(self.to_light(DVec3::ZERO)).normalize().as_vec3()),
            Lit::Lamp(at) => {
                let intensity = Vec3::splat((self.scale * self.scale) as f32);
                Light::Point { position: world.transform_point3(at), intensity, range: None }
            }
        });
        s
    }

    /// Whether light reaches a point of the floor, by the distance of the ball's centre from the line to the light; `None` within the
    /// margin.
    fn reaches_floor(&self, p: DVec3, margin: f64) -> Option<bool> {
        let to_light = self.to_light(p);
        let (to_centre, length) = (DVec3::Y - p, to_light.length());
        let along = to_centre.dot(to_light) / length;
        let beside = to_centre.cross(to_light).length() / length;
        // The light is outside of the ball, so no line ends near it.
        if along < 0.0 || beside > 1.0 + margin {
            return Some(true);
        }
        let facets = if self.procedural { 0.0 } else { FACETS };
        (beside < 1.0 - margin - facets).then_some(false)
    }
}

/// A square of 12 by 12, divided into strips of two triangles.
fn floor(strips: u32) -> Mesh {
    let ends = (0..=strips).map(|i| -6.0 + 12.0 * i as f32 / strips as f32);
    let positions: Vec<Vec3> = ends.flat_map(|x| [Vec3::new(x, 0.0, 6.0), Vec3::new(x, 0.0, -6.0)]).collect();
    let indices = (0..strips).flat_map(|i| [0, 2, 1, 1, 2, 3].map(|k| 2 * i + k)).collect();
    mesh("floor", positions.clone(), vec![Vec3::Y; positions.len()], indices)
}

/// Results of one set-up over all pixels.
#[derive(Clone, Copy, Debug, Default)]
struct Count {
    starts: usize,
    self_hits: usize,
    lit: usize,
    falsely_dark: usize,
    dark: usize,
    falsely_lit: usize,
    /// Greatest offset relative to the ball's radius.
    offset: f64,
}

impl Count {
    fn add(&mut self, other: &Self) {
        self.starts += other.starts;
        self.self_hits += other.self_hits;
        self.lit += other.lit;
        self.falsely_dark += other.falsely_dark;
        self.dark += other.dark;
        self.falsely_lit += other.falsely_lit;
        self.offset = self.offset.max(other.offset);
    }

    fn wrong(&self) -> usize {
        self.self_hits + self.falsely_dark + self.falsely_lit
    }
}

/// One device with one backend.
struct Rig {
    bench: Bench,
    kernel: RayKernel,
    rays: Rays,
}

/// All backends of the device; software exists on every device.
fn rigs(gpu: &Gpu) -> Result<Vec<Rig>> {
    let mut rigs = Vec::new();
    for rays in [Rays::Software, Rays::Query, Rays::Pipeline] {
        if let Err(why) = gpu.check_rays(rays) {
            println!("{rays:?}: left out, {why}");
            continue;
        }
        let bench = Bench::new(gpu)?;
        let kernel = bench.ray_kernel("ray_origins.ray", GLSL, rays)?;
        rigs.push(Rig { bench, kernel, rays });
    }
    Ok(rigs)
}

/// Object ids as read back.
const FLOOR: u32 = 1;
const BALL: u32 = 2;

/// The point of a pixel, and results of rays from there.
#[derive(Clone, Copy)]
struct Start {
    /// Instance + 1.
    object: u32,
    /// World, metres.
    position: DVec3,
    /// Visibility of the light; none if the surface faces away.
    lit: Option<bool>,
    /// Number of hits, by eight rays to the outer side, on the instance they left.
    self_hits: usize,
    /// Offset, metres.
    offset: f64,
}

/// For each pixel, the origins from the G-buffer and from a primary ray, and the shadow pass's result.
struct Seen {
    starts: [Vec<Option<Start>>; 2],
    shadow: Vec<f32>,
}

impl Rig {
    /// Traces rays from everything that a camera sees, towards a direction, or towards a local light.
    fn look(&mut self, scene: &Scene, light: DVec3, is_lamp: bool, factor: f32) -> Result<Seen> {
        let Self { bench, kernel, rays } = self;
        let (gpu, kernel, rays) = (bench.gpu.clone(), *kernel, *rays);
        let camera: &Camera = &scene.cameras[0];
        let origin = FloatingOrigin::default().follow(camera);
        let options = ResidentOptions { rays, ..ResidentOptions::default() };
        let resident = ResidentScene::new(&gpu, scene, options)?.shared();
        resident.borrow_mut().set_moment(&Moment { origin, cut: true, ..Moment::default() });
        let build = Build::new(&gpu, rays);
        let (slots, config) = (Slots::default(), Config::default());
        let mut gbuffer = slots.gbuffer.from_config(&build, &config)?;
        let mut reprojection = Reprojection::new(&build)?;
        let mut shadows = slots.shadows.from_config(&build, &config)?;
        let shot = Shot { scene: &resident, camera, extent: EXTENT };
        let light = if is_lamp { light - origin } else { light.normalize() }.as_vec3().to_array();
        let is_lamp = u32::from(is_lamp);
        let wanted = ["test.starts:seen", "test.starts:hits", "test.starts:marks", "shadows.trace:visibility"];
        let ran = bench
            .run(EXTENT, &wanted, |g, imports| {
                let (view, handles) = shot.declare(&gpu, g, imports)?;
                let gbuffer = gbuffer.add(g, &view, GBufferIn { scene: handles });
                let reprojected = reprojection.add(g, &view, handles, gbuffer);
                let out = shadows.add(g, &view, ShadowIn { scene: handles, gbuffer, reprojected });
                g.output(out.groups[0].context("the light casts no shadow")?.visibility);
                g.pass("test.starts", Queue::Graphics, |p| {
                    let (view, scene) = (p.read(view.block), handles.trace(p));
                    let (ids, depth) = (p.sample(gbuffer.ids), p.sample(gbuffer.depth));
                    let [(_, seen), (_, hits), (_, marks)] =
                        ["seen", "hits", "marks"].map(|name| p.create(name, ImageDesc::full(Format::Rgba32Float)));
                    ((), move |c: &mut Record<'_>| {
                        let (view, root, rays) = (c.id(view), c.id(scene.root), c.rays());
                        let (ids, depth) = (c.id(ids), c.id(depth));
                        let (seen, hits, marks) = (c.id(seen), c.id(hits), c.id(marks));
                        let params =
                            Params { view, scene: root, rays, ids, depth, seen, hits, marks, light, is_lamp, factor };
                        c.trace(kernel, scene.tlas, &params, EXTENT);
                    })
                });
                Ok(())
            })?
            .clean()?;
        let marks = ran.values(wanted[2])?;
        let starts = |image: Vec<[f32; 4]>, way: usize| {
            let start = |(v, mark): (&[f32; 4], &[f32; 4])| {
                let objects = mark[2] as u32;
                let object = if way == 0 { objects % 4096 } else { objects / 4096 };
                let position = Vec3::new(v[0], v[1], v[2]).as_dvec3() + origin;
                let lit = (v[3] >= 0.0).then_some(v[3] == 1.0);
                let (self_hits, offset) = (mark[way] as usize, f64::from(mark[3]));
                (object != 0).then_some(Start { object, position, lit, self_hits, offset })
            };
            image.iter().zip(&marks).map(start).collect()
        };
        Ok(Seen {
            starts: [starts(ran.values(wanted[0])?, 0), starts(ran.values(wanted[1])?, 1)],
            shadow: ran.values(wanted[3])?.iter().map(|v| v[0]).collect(),
        })
    }

    fn count(&mut self, set_up: &SetUp) -> Result<Count> {
        let world = set_up.world();
        let (light, is_lamp) = match set_up.light {
            Lit::Sun(_) => (world.transform_vector3(set_up.to_light(DVec3::ZERO)), false),
            Lit::Lamp(at) => (world.transform_point3(at), true),
        };
        let seen = self.look(&set_up.scene(), light, is_lamp, set_up.factor)?;
        let back = world.inverse();
        let mut count = Count::default();
        for (way, starts) in seen.starts.iter().enumerate() {
            for (i, start) in starts.iter().enumerate() {
                let Some(start) = start else { continue };
                let offset = start.offset / set_up.scale;
                count.starts += 1;
                count.self_hits += start.self_hits;
                count.offset = count.offset.max(offset);
                let Some(lit) = start.lit else { continue };
                // The shadow pass agrees, except where its shading normal faces away.
                if way == 0 && set_up.factor == 1.0 {
                    let same = (seen.shadow[i] == 1.0) == lit || (start.object == BALL && seen.shadow[i] == 0.0);
                    ensure!(same, "pixel {i} of {set_up:?}: {} in the shadow pass, {lit} here", seen.shadow[i]);
                }
                // The ball is convex: whatever faces the light is lit.
                let floor = start.object == FLOOR;
                let p = back.transform_point3(start.position);
                match if floor { set_up.reaches_floor(p, 4.0 * offset) } else { Some(true) } {
                    Some(true) => {
                        count.lit += 1;
                        count.falsely_dark += usize::from(!lit);
                    }
                    Some(false) => {
                        count.dark += 1;
                        count.falsely_lit += usize::from(lit);
                    }
                    None => {}
                }
            }
        }
        Ok(count)
    }
}

const LAMP: Lit = Lit::Lamp(DVec3::new(1.7, 2.9, -0.9));
const LIGHTS: [Lit; 3] = [Lit::Sun(55.0), Lit::Sun(1.0), LAMP];

impl Rig {
    /// Counts for every light, with a ball of triangles and with a sphere.
    fn count_all(&mut self, set_up: &SetUp, name: &str) -> Result<Count> {
        let mut all = Count::default();
        for light in LIGHTS {
            for procedural in [false, true] {
                let set_up = SetUp { light, procedural, ..*set_up };
                let count = self.count(&set_up)?;
                if count.wrong() > 0 && set_up.factor == 1.0 {
                    println!("{set_up:?}: {count:?}");
                }
                all.add(&count);
            }
        }
        println!("{:?}, {name}: {all:?}", self.rays);
        ensure!(all.starts > 90_000 && all.lit > 40_000 && all.dark > 3000, "too little is seen: {all:?}");
        Ok(all)
    }

    fn check(&mut self, set_up: &SetUp, name: &str) -> Result<()> {
        let all = self.count_all(set_up, name)?;
        ensure!(all.wrong() == 0, "{:?}, {name}: {all:?}", self.rays);
        // The bound stated in docs/ray-origins.md.
        ensure!(all.offset < 1e-4, "{:?}, {name}: offset by {:e} of the ball's radius", self.rays, all.offset);
        Ok(())
    }
}

#[test]
fn nothing_shadows_itself_at_any_scale_and_distance() -> Result<()> {
    let Some(gpu) = gpu()? else { return Ok(()) };
    for rig in &mut rigs(&gpu)? {
        for scale in [1e-3, 1.0, 1e2, 1e4] {
            for distance in [1.0, 1e3, 1e6] {
                let name = format!("scale {scale:e}, {distance:e} m from the origin");
                rig.check(&SetUp::new(scale, distance), &name)?;
            }
        }
    }
    Ok(())
}

#[test]
fn no_light_leaks_where_the_ball_touches_the_floor() -> Result<()> {
    let Some(gpu) = gpu()? else { return Ok(()) };
    for rig in &mut rigs(&gpu)? {
        for (scale, distance) in [(1e-3, 1e6), (1.0, 1.0), (1e4, 1e3)] {
            let set_up = SetUp { view: CONTACT, ..SetUp::new(scale, distance) };
            rig.check(&set_up, &format!("contact, scale {scale:e}, {distance:e} m from the origin"))?;
        }
    }
    Ok(())
}

#[test]
fn neither_the_shape_of_triangles_nor_the_near_plane_matters() -> Result<()> {
    let Some(gpu) = gpu()? else { return Ok(()) };
    for rig in &mut rigs(&gpu)? {
        // Triangles a hundred and ten thousand times as long as wide.
        for strips in [100, 10_000] {
            rig.check(&SetUp { strips, ..SetUp::new(1.0, 1e3) }, &format!("{strips} strips"))?;
        }
        // Depth has hardly any significant digits left, but origins do not depend on it.
        for near in [1e-3, 1e-9] {
            rig.check(&SetUp { near, ..SetUp::new(1.0, 1e3) }, &format!("near plane times {near:e}"))?;
        }
    }
    Ok(())
}

#[test]
fn the_offset_is_needed_and_not_too_large() -> Result<()> {
    let Some(gpu) = gpu()? else { return Ok(()) };
    for rig in &mut rigs(&gpu)? {
        let mut with = |view, factor: f32| {
            rig.count_all(&SetUp { view, factor, ..SetUp::new(1.0, 1e3) }, &format!("offset times {factor}"))
        };
        // Without an offset a third of the rays and a fifth of the pixels fail; 3 % of it are not enough either.
        let none = with(WHOLE, 0.0)?;
        ensure!(none.self_hits * 10 > none.starts && none.falsely_dark * 10 > none.lit, "{none:?}");
        let little = with(WHOLE, 0.01)?;
        ensure!(little.self_hits > 1000 && little.falsely_dark > 100, "{little:?}");
        // A hundred times the offset moves the floor's origins into the ball, which darkens the contact and leaks light elsewhere.
        let much = with(CONTACT, 100.0)?;
        ensure!(much.self_hits == 0 && much.falsely_dark > 50, "{much:?}");
        let much = with(WHOLE, 100.0)?;
        ensure!(much.self_hits == 0 && much.falsely_dark > 10 && much.falsely_lit > 0, "{much:?}");
    }
    Ok(())
}

/// A scene of thin leaves, grass and touching stones: a quarter of the offset gives the same sun shadows, so the offset hides no detail.
#[test]
fn a_smaller_offset_shows_no_more_in_the_courtyard() -> Result<()> {
    let Some(gpu) = gpu()? else { return Ok(()) };
    let scene = builtin("courtyard")?;
    let to_sun = scene.lights.iter().find_map(|l| match l {
        Light::Directional { direction, .. } => Some(-direction.as_dvec3()),
        _ => None,
    });
    let to_sun = to_sun.context("the courtyard has a sun")?;
    for rig in &mut rigs(&gpu)? {
        let mut look = |factor| rig.look(&scene, to_sun, false, factor);
        let (whole, quarter, none) = (look(1.0)?, look(0.25)?, look(0.0)?);
        let lit = |seen: &Seen| -> Vec<_> { seen.starts.iter().flatten().map(|s| s.and_then(|s| s.lit)).collect() };
        let changed = |other: &Seen| lit(&whole).iter().zip(lit(other)).filter(|(a, b)| **a != *b).count();
        let (quarter, none) = (changed(&quarter), changed(&none));
        println!("{:?}: {quarter} shadows change with a quarter of the offset, {none} without it", rig.rays);
        ensure!(quarter == 0 && none > 100, "{quarter} shadows change with a quarter of the offset, {none} without it");
    }
    Ok(())
}
