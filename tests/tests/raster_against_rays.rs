//! Primary rays through the pixel centres against the raster G-buffer: what is visible, how far away it is and how it lies.
//!
//! What may differ, and by how much:
//! - **depth** (view depth, relative): 2e-5 for 32-bit rounding on both sides, plus what 1/256 of a pixel makes on a surface that lies so: vertices are snapped to 1/256 of a pixel when they
//!   are drawn, and a ray knows nothing of that.
//! - **geometric normal**: 1e-3 radians. A 16-bit octahedral number is good to 5e-5; the rest is for slivers.
//! - **instance**: not at all.
//!
//! Rays hit both sides of every triangle, the raster drops back faces of materials that are not double sided: the rays of this
//! test go on behind such a face.
//!
//! Alpha-tested surfaces are counted apart. The raster reads alpha at the mip that fits the pixel, rays read the finest. Without
//! mips both read the same, and the same bound holds as for opaque surfaces. With mips the leaves of the courtyard are a few
//! pixels wide in these pictures, nearly every one of their pixels is an outline, and outlines move with the mip: there,
//! only two of three pixels need show the same leaf, and leaves must cover as much of the picture, to a tenth.
use anyhow::{Result, ensure};
use bytemuck::{Pod, Zeroable};
use glam::{DVec3, Vec3};
use magpie::config::Config;
use magpie::graph::{Extent, Format, ImageDesc, Queue, Record};
use magpie::scene::{AlphaMode, Camera, ResidentOptions, ResidentScene, Scene, SharedScene};
use magpie_passes::Slots;
use magpie_passes::stages::GBufferIn;
use magpie_shaders::{Address, StorageImage};
use magpie_tests::bench::{Bench, Ran, Shot};
use magpie_tests::harness::{asset, builtin, gpu};
use magpie_tests::oracle::gbuffer::{Eye, octahedral};

const EXTENT: Extent = Extent { width: 320, height: 180 };

const GLSL: &str = r#"#version 460
#extension GL_GOOGLE_include_directive : require
#include "lib/bindless.glsl"
#include "lib/gbuffer.glsl"
#include "lib/ray.glsl"
layout(push_constant, scalar) uniform Push { uvec2 view_address; uvec2 rays; uint ids; uint geometry; };

void main() {
    ViewBuffer view = ViewBuffer(view_address);
    ivec2 pixel = ivec2(gl_GlobalInvocationID.xy);
    if (!inside(pixel, view.at[0].size)) return;
    SceneBuffer scene = SceneBuffer(view.at[0].scene);
    // One unit of view depth long, so that t is the view depth.
    vec3 ray = pixel_ray(view, pixel);
    float t_min = 1.0 / view.at[0].world_from_clip[2].w;
    uint traced = 0u;
    Hit hit;
    bool found = false;
    while (traced < 64u && !found) {
        traced++;
        if (!trace_closest(scene, make_ray(view.at[0].eye, t_min, ray, 1e30), hit)) break;
        Instance instance = InstanceBuffer(scene.at[0].instances).at[hit.instance];
        uint flags = MaterialBuffer(scene.at[0].materials).at[instance.material].flags;
        found = hit.front || (flags & MATERIAL_DOUBLE_SIDED) != 0u;
        t_min = hit.t;
    }
    count_rays(rays, traced, 0u);
    store_uint(ids, pixel, found ? uvec4(hit.instance + 1u, hit.primitive, 0u, 0u) : uvec4(0u));
    vec3 normal = vec3(0.0);
    if (found) {
        Instance instance = InstanceBuffer(scene.at[0].instances).at[hit.instance];
        Mesh mesh = MeshBuffer(scene.at[0].meshes).at[instance.mesh];
        uvec3 corners = TriangleBuffer(mesh.indices).at[hit.primitive];
        PositionBuffer positions = PositionBuffer(mesh.positions);
        // In the world, not by the inverse transpose as the raster does it.
        vec3 a = transform_vector(instance.world_from_object, positions.at[corners.y] - positions.at[corners.x]);
        vec3 b = transform_vector(instance.world_from_object, positions.at[corners.z] - positions.at[corners.x]);
        normal = safe_normalize(cross(a, b), vec3(0.0)) * handedness(instance.world_from_object);
        normal = hit.front ? normal : -normal;
    }
    store(geometry, pixel, vec4(normal, found ? hit.t : 0.0));
}
"#;

#[repr(C)]
#[derive(Clone, Copy, Pod, Zeroable)]
struct Params {
    view: Address,
    rays: Address,
    ids: StorageImage,
    geometry: StorageImage,
}

/// What one pixel shows, `instance` 0 for nothing.
#[derive(Clone, Copy, Default)]
struct Seen {
    instance: u32,
    triangle: u32,
    /// View depth, metres.
    depth: f64,
    /// Of the triangle, towards the viewer.
    normal: DVec3,
}

/// Both answers for every pixel.
struct Both {
    raster: Vec<Seen>,
    rays: Vec<Seen>,
    closest: u64,
}

fn look(bench: &mut Bench, scene: &SharedScene, camera: &Camera) -> Result<Both> {
    let kernel = bench.ray_kernel("raster_against_rays.ray", GLSL, magpie::prelude::Rays::Software)?;
    let gpu = bench.gpu.clone();
    let mut gbuffer = Slots::default()
        .gbuffer
        .from_config(&magpie::stage::Build { gpu: &gpu, rays: magpie::prelude::Rays::Software }, &Config::default())?;
    let shot = Shot { scene, camera, extent: EXTENT };
    let wanted =
        ["gbuffer.draw:depth", "gbuffer.draw:normal", "gbuffer.draw:ids", "test.rays:ids", "test.rays:geometry"];
    let ran: Ran = bench
        .run(EXTENT, &wanted, |g, imports| {
            let (view, handles) = shot.declare(&gpu, g, imports)?;
            gbuffer.add(g, &view, GBufferIn { scene: handles });
            g.pass("test.rays", Queue::Graphics, |p| {
                let (block, tlas) = (p.read(view.block), handles.trace(p));
                p.read(handles.indices);
                let (_, ids) = p.create("ids", ImageDesc::full(Format::Rg32Uint));
                let (_, geometry) = p.create("geometry", ImageDesc::full(Format::Rgba32Float));
                ((), move |c: &mut Record<'_>| {
                    let params = Params { view: c.id(block), rays: c.rays(), ids: c.id(ids), geometry: c.id(geometry) };
                    c.trace(kernel, tlas, &params, EXTENT);
                })
            });
            Ok(())
        })?
        .clean()?;
    let eye = Eye::new(camera, EXTENT);
    let (depth, normal) = (ran.values(wanted[0])?, ran.values(wanted[1])?);
    let raster = ran.values(wanted[2])?.into_iter().zip(depth).zip(normal).map(|((id, d), n)| Seen {
        instance: id[0] as u32,
        triangle: id[1] as u32,
        depth: eye.view_depth(d[0]),
        normal: octahedral(n[2], n[3]),
    });
    let geometry = ran.values(wanted[4])?;
    let rays = ran.values(wanted[3])?.into_iter().zip(geometry).map(|(id, g)| Seen {
        instance: id[0] as u32,
        triangle: id[1] as u32,
        depth: f64::from(g[3]),
        normal: Vec3::new(g[0], g[1], g[2]).as_dvec3(),
    });
    Ok(Both { raster: raster.collect(), rays: rays.collect(), closest: ran.rays("test.rays")?[0] })
}

/// Depth of the plane of a pixel's surface as it is seen one pixel on in x and in y, over the depth at the pixel.
fn slope(eye: &Eye, seen: &Seen, x: f64, y: f64) -> [f64; 2] {
    let here = seen.normal.dot(eye.ray(x, y));
    [(1.0, 0.0), (0.0, 1.0)].map(|(dx, dy)| (seen.normal.dot(eye.ray(x + dx, y + dy) - eye.ray(x, y)) / here).abs())
}

const ROUNDING: f64 = 2e-5;
const SNAP: f64 = 1.0 / 256.0;
const NORMAL: f64 = 1e-3;

/// Why the two answers for a pixel differ.
fn difference(eye: &Eye, raster: &Seen, ray: &Seen, x: f64, y: f64) -> Option<&'static str> {
    if raster.instance != ray.instance {
        return Some("instance");
    }
    if raster.instance == 0 {
        return None;
    }
    if !(raster.normal.cross(ray.normal).length() <= NORMAL && raster.normal.dot(ray.normal) > 0.0) {
        return Some("normal");
    }
    let slope = slope(eye, ray, x, y);
    let bound = ROUNDING + SNAP * (slope[0] + slope[1]);
    let same_depth = (raster.depth / ray.depth - 1.0).abs() <= bound; // false for a NaN
    if !same_depth {
        return Some("depth");
    }
    None
}

/// Whether a pixel touches an edge of what is seen: within one pixel, in either answer, there is another instance, a crease
/// of more than 5 degrees, or a surface that is not where the plane of this one would be, by more than 1 % of the depth.
fn at_edge(eye: &Eye, both: &Both, x: i64, y: i64) -> bool {
    let (width, height) = (i64::from(EXTENT.width), i64::from(EXTENT.height));
    [&both.raster, &both.rays].into_iter().any(|image| {
        let centre = &image[(y * width + x) as usize];
        (-1..=1).flat_map(|dy| (-1..=1).map(move |dx| (x + dx, y + dy))).any(|(nx, ny)| {
            if !(0..width).contains(&nx) || !(0..height).contains(&ny) {
                return false;
            }
            let other = &image[(ny * width + nx) as usize];
            if other.instance != centre.instance {
                return true;
            }
            if centre.instance == 0 {
                return false;
            }
            let ray = |x: i64, y: i64| eye.ray(x as f64 + 0.5, y as f64 + 0.5);
            let expected = centre.depth * centre.normal.dot(ray(x, y)) / centre.normal.dot(ray(nx, ny));
            let same_plane = (other.depth / expected - 1.0).abs() < 0.01; // false for a NaN
            centre.normal.dot(other.normal) < 5_f64.to_radians().cos() || !same_plane
        })
    })
}

/// Whether both answers are triangles of one instance with an edge in common: the pixel's centre lies on that edge.
fn adjacent(scene: &Scene, a: &Seen, b: &Seen) -> bool {
    if a.instance != b.instance || a.instance == 0 {
        return false;
    }
    let mesh = &scene.meshes[scene.instances[a.instance as usize - 1].mesh as usize];
    let corners = |triangle: u32| [0, 1, 2].map(|k| mesh.positions[mesh.indices[3 * triangle as usize + k] as usize]);
    let (a, b) = (corners(a.triangle), corners(b.triangle));
    a.iter().filter(|p| b.contains(p)).count() == 2
}

/// How many pixels there are, how many disagree, and how many of these lie on no edge.
#[derive(Clone, Copy, Debug, Default)]
struct Count {
    pixels: u32,
    instance: u32,
    depth: u32,
    normal: u32,
    triangle: u32,
    inside: u32,
}

impl Count {
    fn disagree(&self) -> u32 {
        self.instance + self.depth + self.normal
    }

    fn agreement(&self) -> f64 {
        1.0 - f64::from(self.disagree()) / f64::from(self.pixels.max(1))
    }
}

/// Counts opaque pixels, and those where either answer is an alpha-tested surface; and how many pixels show such a surface by
/// raster, over how many by rays.
fn compare(scene: &Scene, camera: &Camera, both: &Both, label: &str) -> ([Count; 2], f64) {
    let eye = Eye::new(camera, EXTENT);
    let tested = |seen: &Seen| {
        let instance = (seen.instance as usize).checked_sub(1).and_then(|i| scene.instances.get(i));
        instance.is_some_and(|i| scene.materials[i.material as usize].alpha != AlphaMode::Opaque)
    };
    let mut counts = [Count::default(); 2];
    let (mut shown, mut leaves) = (0, [0_u32; 2]);
    for y in 0..EXTENT.height {
        for x in 0..EXTENT.width {
            let at = (y * EXTENT.width + x) as usize;
            let (raster, ray) = (&both.raster[at], &both.rays[at]);
            let count = &mut counts[usize::from(tested(raster) || tested(ray))];
            count.pixels += 1;
            leaves = [leaves[0] + u32::from(tested(raster)), leaves[1] + u32::from(tested(ray))];
            count.triangle += u32::from(raster.instance == ray.instance && raster.triangle != ray.triangle);
            let Some(why) = difference(&eye, raster, ray, f64::from(x) + 0.5, f64::from(y) + 0.5) else { continue };
            match why {
                "instance" => count.instance += 1,
                "depth" => count.depth += 1,
                _ => count.normal += 1,
            }
            if !at_edge(&eye, both, x.into(), y.into()) && !adjacent(scene, raster, ray) {
                count.inside += 1;
                shown += 1;
                if shown <= 8 {
                    println!(
                        "{label} ({x}, {y}) {why}: raster {} {} {} {}, ray {} {} {} {}",
                        raster.instance,
                        raster.triangle,
                        raster.depth,
                        raster.normal,
                        ray.instance,
                        ray.triangle,
                        ray.depth,
                        ray.normal
                    );
                }
            }
        }
    }
    for (count, kind) in counts.iter().zip(["opaque", "alpha-tested"]) {
        println!("{label}, {kind}: {:.4} % agree; {count:?}", 100.0 * count.agreement());
    }
    println!("{label}: pixels that show an alpha-tested surface: raster {}, rays {}", leaves[0], leaves[1]);
    (counts, f64::from(leaves[0]) / f64::from(leaves[1]))
}

fn check(count: &Count, least: f64, what: &str) -> Result<()> {
    ensure!(
        count.agreement() >= least,
        "{what}: {:.5} of the pixels agree, wanted {least}: {count:?}",
        count.agreement()
    );
    Ok(())
}

#[test]
fn diorama() -> Result<()> {
    let Some(gpu) = gpu()? else { return Ok(()) };
    let Some(scene) = asset("pica_pica_mini_diorama/scene.gltf")? else { return Ok(()) };
    let mut bench = Bench::new(&gpu)?;
    let resident = ResidentScene::new(&gpu, &scene, ResidentOptions::default())?.shared();
    for camera in &scene.cameras {
        let both = look(&mut bench, &resident, camera)?;
        let seen = both.rays.iter().filter(|s| s.instance > 0).count();
        ensure!(seen > both.rays.len() / 4, "only {seen} pixels show anything");
        ensure!(both.closest >= both.rays.len() as u64, "{} rays were counted", both.closest);
        let ([opaque, tested], _) = compare(&scene, camera, &both, &format!("diorama, {}", camera.name));
        check(&opaque, 0.999, "diorama")?;
        check(&tested, 0.999, "diorama, alpha-tested")?;
        ensure!(
            opaque.inside + tested.inside == 0,
            "{} pixels disagree away from any edge",
            opaque.inside + tested.inside
        );
    }
    Ok(())
}

#[test]
fn courtyard() -> Result<()> {
    let Some(gpu) = gpu()? else { return Ok(()) };
    let mut scene = builtin("courtyard")?;
    let mut bench = Bench::new(&gpu)?;
    for mips in [true, false] {
        for sampler in &mut scene.samplers {
            sampler.mips = mips;
        }
        let resident = ResidentScene::new(&gpu, &scene, ResidentOptions::default())?.shared();
        for camera in &scene.cameras {
            let both = look(&mut bench, &resident, camera)?;
            let label = format!("courtyard, {}, {}", camera.name, if mips { "mips" } else { "no mips" });
            let ([opaque, tested], cover) = compare(&scene, camera, &both, &label);
            ensure!(tested.pixels > 5000, "only {} pixels show leaves", tested.pixels);
            check(&opaque, 0.999, &label)?;
            check(&tested, if mips { 2.0 / 3.0 } else { 0.999 }, &label)?;
            ensure!((cover - 1.0).abs() < 0.1, "{label}: leaves cover {cover} times as much as by rays");
            ensure!(opaque.inside == 0, "{label}: {} opaque pixels disagree away from any edge", opaque.inside);
        }
    }
    Ok(())
}
