//! Rays that leave surfaces: a ball that rests on a floor, at every scale and distance from the world's origin, on every way to trace.
//!
//! - **Self-hits**: what leaves a convex body to the outer side of the triangle it stands on never meets that body. No margin: none of
//!   the eight rays of any pixel may, down to a cosine of a thousandth.
//! - **False dark**: pixels that the light reaches, by the closed form of a ball on a floor, and that are dark. Left out are those
//!   whose line to the light comes as near to the ball as four times the offset.
//! - **False light**: pixels whose line to the light passes through the ball, as deep as four times the offset, and that are lit. The
//!   triangles of a ball lie up to 0.0011 of its radius inside of it: as much more is left out there.
//!
//! Starts are made both from the G-buffer and from hits of primary rays; the shadow pass must say what the former say.
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
use magpie::stage::Build;
use magpie_passes::Slots;
use magpie_passes::stages::{GBufferIn, ShadowIn};
use magpie_shaders::{Address, SampledImage, StorageImage};
use magpie_tests::bench::{Bench, Shot};
use magpie_tests::harness::gpu;
use magpie_tests::made::{camera, material, plane, scene, sphere, sun};

const EXTENT: Extent = Extent { width: 160, height: 90 };
/// How far triangles of the ball lie inside of it at most, with 48 rings of 96: `1 - cos(pi / 96)` along and across.
const FACETS: f64 = 1.1e-3;

const GLSL: &str = r#"#version 460
#extension GL_GOOGLE_include_directive : require
#include "lib/bindless.glsl"
#include "lib/gbuffer.glsl"
#include "lib/lights.glsl"
#include "lib/ray.glsl"
layout(push_constant, scalar) uniform Push {
    uvec2 view_address; uvec2 rays; uint ids; uint depth; uint seen; uint hits; uint marks; vec3 light; uint is_lamp; float factor;
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
    SceneBuffer scene = SceneBuffer(view.at[0].scene);
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
        mark.z += 4.0 * float(hit.instance + 1u);
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

/// Where the light is, in the set-up's own space: the ball has radius 1 and rests on the origin, up is y.
#[derive(Clone, Copy, Debug)]
enum Lit {
    /// By a sun so many degrees above the floor.
    Sun(f64),
    /// By a lamp.
    Lamp(DVec3),
}

/// A floor and a ball, somewhere.
#[derive(Clone, Copy, Debug)]
struct SetUp {
    scale: f64,
    distance: f64,
    light: Lit,
    /// The ball is one sphere rather than triangles. The raster may not know it; rays do.
    procedural: bool,
    /// The eye, in the set-up's space, and what it looks at.
    view: [DVec3; 2],
    /// Offsets are so many times what they are.
    factor: f32,
}

/// From where the whole is seen.
const WHOLE: [DVec3; 2] = [DVec3::new(1.8, 3.3, 4.7), DVec3::new(0.0, 0.8, 0.0)];
/// From where the point of contact is seen.
const CONTACT: [DVec3; 2] = [DVec3::new(0.22, 0.12, 0.55), DVec3::ZERO];

impl SetUp {
    fn new(scale: f64, distance: f64, light: Lit) -> Self {
        Self { scale, distance, light, procedural: false, view: WHOLE, factor: 1.0 }
    }

    /// World from the set-up's space. Turned, so that nothing lies along an axis.
    fn world(&self) -> DAffine3 {
        let turn = DQuat::from_rotation_y(0.6) * DQuat::from_rotation_x(0.35);
        let place = DVec3::new(0.62, 0.48, -0.62).normalize() * self.distance;
        DAffine3::from_scale_rotation_translation(DVec3::splat(self.scale), turn, place)
    }

    fn to_light(&self, from: DVec3) -> DVec3 {
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
        let mut s = scene(&format!("{self:?}"), camera(eye, target));
        let ball = if self.procedural {
            Mesh {
                name: "ball".to_owned(),
                spheres: vec![Sphere { centre: Vec3::ZERO, radius: 1.0 }],
                ..Mesh::default()
            }
        } else {
            sphere(48)
        };
        s.meshes = vec![plane(6.0), ball];
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

    /// Whether light reaches a point of the floor, `None` where that is not for sure: by the distance of the ball's centre from the
    /// line to the light.
    fn reaches_floor(&self, p: DVec3, margin: f64) -> Option<bool> {
        let to_light = self.to_light(p);
        let (to_centre, length) = (DVec3::Y - p, to_light.length());
        let along = to_centre.dot(to_light) / length;
        let beside = to_centre.cross(to_light).length() / length;
        // A lamp beyond the ball's reach: no line ends near it.
        if along < 0.0 || beside > 1.0 + margin {
            return Some(true);
        }
        let facets = if self.procedural { 0.0 } else { FACETS };
        (beside < 1.0 - margin - facets).then_some(false)
    }
}

/// What came of one set-up, over all its pixels.
#[derive(Clone, Copy, Debug, Default)]
struct Count {
    starts: usize,
    self_hits: usize,
    lit: usize,
    falsely_dark: usize,
    dark: usize,
    falsely_lit: usize,
    /// The greatest offset, over the ball's radius.
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

/// One device and one way to trace.
struct Rig {
    bench: Bench,
    kernel: RayKernel,
    rays: Rays,
}

/// Every way to trace that the device has; the software way is one on every device.
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

/// Objects as the marks have them.
const FLOOR: u32 = 1;
const BALL: u32 = 2;

impl Rig {
    fn count(&mut self, set_up: &SetUp) -> Result<Count> {
        self.count_in(set_up, &set_up.scene())
    }

    fn count_in(&mut self, set_up: &SetUp, scene: &Scene) -> Result<Count> {
        let Self { bench, kernel, rays } = self;
        let (gpu, kernel, rays) = (bench.gpu.clone(), *kernel, *rays);
        let camera: &Camera = &scene.cameras[0];
        let origin = FloatingOrigin::default().follow(camera);
        let options = ResidentOptions { rays, ..ResidentOptions::default() };
        let resident = ResidentScene::new(&gpu, scene, options)?.shared();
        resident.borrow_mut().go(&Moment { origin, cut: true, ..Moment::default() });
        let build = Build { gpu: &gpu, rays };
        let (slots, config) = (Slots::default(), Config::default());
        let mut gbuffer = slots.gbuffer.from_config(&build, &config)?;
        let mut shadows = slots.shadows.from_config(&build, &config)?;
        let shot = Shot { scene: &resident, camera, extent: EXTENT };
        let world = set_up.world();
        let (light, is_lamp) = match set_up.light {
            Lit::Sun(_) => (world.transform_vector3(set_up.to_light(DVec3::ZERO)).normalize(), 0),
            Lit::Lamp(at) => (world.transform_point3(at) - origin, 1),
        };
        let (light, factor) = (light.as_vec3().to_array(), set_up.factor);
        let wanted = ["test.starts:seen", "test.starts:hits", "test.starts:marks", "shadows.trace:visibility"];
        let ran = bench
            .run(EXTENT, &wanted, |g, imports| {
                let (view, handles) = shot.declare(&gpu, g, imports)?;
                let gbuffer = gbuffer.add(g, &view, GBufferIn { scene: handles });
                let out = shadows.add(g, &view, ShadowIn { scene: handles, gbuffer });
                g.output(out.visibility.context("the light casts no shadow")?);
                g.pass("test.starts", Queue::Graphics, |p| {
                    let (block, tlas) = (p.read(view.block), handles.trace(p));
                    let (ids, depth) = (p.sample(gbuffer.ids), p.sample(gbuffer.depth));
                    let [(_, seen), (_, hits), (_, marks)] =
                        ["seen", "hits", "marks"].map(|name| p.create(name, ImageDesc::full(Format::Rgba32Float)));
                    ((), move |c: &mut Record<'_>| {
                        let params = Params {
                            view: c.id(block),
                            rays: c.rays(),
                            ids: c.id(ids),
                            depth: c.id(depth),
                            seen: c.id(seen),
                            hits: c.id(hits),
                            marks: c.id(marks),
                            light,
                            is_lamp,
                            factor,
                        };
                        c.trace(kernel, tlas, &params, EXTENT);
                    })
                });
                Ok(())
            })?
            .clean()?;
        let images = [ran.values(wanted[0])?, ran.values(wanted[1])?];
        let (marks, shadow) = (ran.values(wanted[2])?, ran.values(wanted[3])?);
        let back = world.inverse();
        let mut count = Count::default();
        for (i, mark) in marks.iter().enumerate() {
            let code = mark[2] as u32;
            count.offset = count.offset.max(f64::from(mark[3]) / set_up.scale);
            for (way, object) in [code % 4, code / 4].into_iter().enumerate().filter(|(_, object)| *object != 0) {
                ensure!(object == FLOOR || object == BALL, "pixel {i} shows object {object}");
                let [x, y, z, visible] = images[way][i].map(f64::from);
                let p = back.transform_point3(DVec3::new(x, y, z) + origin);
                count.starts += 1;
                count.self_hits += mark[way] as usize;
                if visible < 0.0 {
                    continue;
                }
                // What the shadow pass says is the same, but where its shading normal turns away.
                if way == 0 && factor == 1.0 {
                    let same = f64::from(shadow[i][0]) == visible || (object == BALL && shadow[i][0] == 0.0);
                    ensure!(same, "pixel {i} of {set_up:?}: {} in the shadow pass, {visible} here", shadow[i][0]);
                }
                let margin = 4.0 * f64::from(mark[3]) / set_up.scale;
                // The ball is convex: what faces the light is lit.
                match if object == BALL { Some(true) } else { set_up.reaches_floor(p, margin) } {
                    Some(true) => {
                        count.lit += 1;
                        count.falsely_dark += usize::from(visible == 0.0);
                    }
                    Some(false) => {
                        count.dark += 1;
                        count.falsely_lit += usize::from(visible == 1.0);
                    }
                    None => {}
                }
            }
        }
        Ok(count)
    }
}

const LAMP: Lit = Lit::Lamp(DVec3::new(1.7, 2.9, -0.9));

#[test]
fn nothing_shadows_itself_at_any_scale_and_distance() -> Result<()> {
    let Some(gpu) = gpu()? else { return Ok(()) };
    let mut wrong = 0;
    for rig in &mut rigs(&gpu)? {
        for scale in [1e-3, 1.0, 1e2, 1e4] {
            for distance in [1.0, 1e3, 1e6] {
                let mut all = Count::default();
                for light in [Lit::Sun(55.0), Lit::Sun(1.0), LAMP] {
                    for procedural in [false, true] {
                        let set_up = SetUp { procedural, ..SetUp::new(scale, distance, light) };
                        let count = rig.count(&set_up)?;
                        if count.wrong() > 0 {
                            println!("{set_up:?}: {count:?}");
                        }
                        all.add(&count);
                    }
                }
                println!("{:?}, scale {scale:e}, {distance:e} m from the origin: {all:?}", rig.rays);
                ensure!(all.starts > 30_000 && all.lit > 15_000 && all.dark > 500, "too little is seen: {all:?}");
                wrong += all.wrong();
            }
        }
    }
    ensure!(wrong == 0, "{wrong} rays met what they should not, or missed what they should");
    Ok(())
}
