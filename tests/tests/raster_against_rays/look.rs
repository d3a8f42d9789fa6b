//! One picture by raster and by rays.
use anyhow::Result;
use bytemuck::{Pod, Zeroable};
use glam::{DVec3, Vec3};
use magpie::config::Config;
use magpie::graph::{Extent, Format, ImageDesc, Queue, Record};
use magpie::prelude::Rays;
use magpie::scene::{Camera, Policy, SharedScene};
use magpie_passes::Slots;
use magpie_passes::contracts::GBufferIn;
use magpie_shaders::{Address, SampledImage, StorageImage};
use magpie_tests::bench::{Bench, Ran, Shot};
use magpie_tests::oracle::gbuffer::{Eye, octahedral};

pub const EXTENT: Extent = Extent { width: 320, height: 180 };

const GLSL: &str = r#"#version 460
#extension GL_GOOGLE_include_directive : require
#include "lib/bindless.glsl"
#include "lib/alpha.glsl"
#include "lib/gbuffer.glsl"
#include "lib/intersect.glsl"
#include "lib/ray.glsl"
layout(push_constant, scalar) uniform Push {
    uvec2 view_address; uvec2 scene_address; uvec2 rays; uint raster_ids; uint ids; uint geometry; uint margins;
};

// Towards the front: of a triangle not by the inverse transpose, as the raster makes it; of a sphere by way of the world's hit.
vec3 front_normal(Instance instance, Mesh mesh, uint primitive, vec3 position) {
    if ((instance.flags & INSTANCE_SPHERES) != 0u) {
        vec3 outwards = transform_point(instance.object_from_world, position) - SphereBuffer(mesh.positions).at[primitive].xyz;
        return safe_normalize(transform_normal(instance.object_from_world, outwards), vec3(0.0));
    }
    uvec3 corners = TriangleBuffer(mesh.ray_indices).at[primitive];
    PositionBuffer positions = PositionBuffer(mesh.positions);
    vec3 a = transform_vector(instance.world_from_object, positions.at[corners.y] - positions.at[corners.x]);
    vec3 b = transform_vector(instance.world_from_object, positions.at[corners.z] - positions.at[corners.x]);
    return safe_normalize(cross(a, b), vec3(0.0)) * handedness(instance.world_from_object);
}

// How far alpha is from the cut-off where the ray meets the plane of a triangle; 1 where nothing is tested.
float margin(ViewBuffer view, SceneBuffer scene, uint index, uvec2 triangles, uint primitive, vec3 ray) {
    Instance instance = InstanceBuffer(scene.at[0].instances).at[index];
    if ((instance.flags & INSTANCE_ALPHA_TEST) == 0u) return 1.0;
    Mesh mesh = MeshBuffer(scene.at[0].meshes).at[instance.mesh];
    vec3 origin = transform_point(instance.object_from_world, view.at[0].eye);
    TriangleRay object_ray = triangle_ray(origin, transform_vector(instance.object_from_world, ray));
    uvec3 corners = TriangleBuffer(triangles).at[primitive];
    PositionBuffer positions = PositionBuffer(mesh.positions);
    SurfaceHit hit;
    hit_triangle(object_ray, positions.at[corners.x], positions.at[corners.y], positions.at[corners.z], 0.0, 1e30, hit);
    float alpha = alpha_at(scene, index, corners, hit.barycentric, ray, pixel_spread(view) * hit.t);
    float off = abs(alpha - MaterialBuffer(scene.at[0].materials).at[instance.material].alpha_cutoff);
    return off <= 1.0 ? off : 1.0;
}

void main() {
    ViewBuffer view = ViewBuffer(view_address);
    ivec2 pixel = ivec2(RAY_INVOCATION.xy);
    if (!inside(pixel, view.at[0].size)) return;
    SceneBuffer scene = SceneBuffer(scene_address);
    // One unit of view depth long, so that t is the view depth.
    vec3 ray = pixel_ray(view, pixel);
    float t_min = 1.0 / view.at[0].world_from_clip[2].w;
    uint traced = 0u;
    Hit hit;
    bool found = false;
    while (traced < 64u && !found) {
        traced++;
        if (!trace_closest(scene, with_cone(make_ray(view.at[0].eye, t_min, ray, 1e30), 0.0, pixel_spread(view)), hit)) break;
        found = hit.front || (InstanceBuffer(scene.at[0].instances).at[hit.instance].flags & INSTANCE_DOUBLE_SIDED) != 0u;
        t_min = hit.t;
    }
    count_rays(rays, traced, 0u);
    store_uint(ids, pixel, found ? uvec4(hit.instance + 1u, hit.primitive, 0u, 0u) : uvec4(0u));
    vec3 normal = vec3(0.0);
    vec2 off = vec2(1.0);
    if (found) {
        Instance instance = InstanceBuffer(scene.at[0].instances).at[hit.instance];
        Mesh mesh = MeshBuffer(scene.at[0].meshes).at[instance.mesh];
        normal = front_normal(instance, mesh, hit.primitive, view.at[0].eye + hit.t * ray);
        normal = hit.front ? normal : -normal;
        off.y = margin(view, scene, hit.instance, mesh.ray_indices, hit.primitive, ray);
    }
    uvec2 raster = load_uint(raster_ids, pixel).xy;
    if (raster.x != 0u) {
        Instance instance = InstanceBuffer(scene.at[0].instances).at[raster.x - 1u];
        uvec2 triangles = MeshBuffer(scene.at[0].meshes).at[instance.mesh].indices;
        off.x = margin(view, scene, raster.x - 1u, triangles, raster.y, ray);
    }
    store(geometry, pixel, vec4(normal, found ? hit.t : 0.0));
    store(margins, pixel, vec4(off, 0.0, 0.0));
}
"#;

#[repr(C)]
#[derive(Clone, Copy, Pod, Zeroable)]
struct Params {
    view: Address,
    scene: Address,
    rays: Address,
    raster_ids: SampledImage,
    ids: StorageImage,
    geometry: StorageImage,
    margins: StorageImage,
}

/// The surface of a pixel; `instance` is 0 for background.
#[derive(Clone, Copy, Default)]
pub struct Seen {
    pub instance: u32,
    pub primitive: u32,
    /// View depth, metres.
    pub depth: f64,
    /// Geometric normal, towards the viewer.
    pub normal: DVec3,
    /// Absolute difference of alpha from the cutoff; 1 without an alpha test.
    pub margin: f32,
}

/// Both answers for every pixel.
pub struct Both {
    pub raster: Vec<Seen>,
    pub rays: Vec<Seen>,
    /// Number of closest-hit rays.
    pub closest: u64,
    /// GPU time of the rays, if measured.
    pub nanoseconds: Option<u64>,
}

/// Rasterises and traces one picture.
pub fn look(bench: &mut Bench, scene: &SharedScene, camera: &Camera, rays: Rays, policy: &Policy) -> Result<Both> {
    let kernel = bench.ray_kernel("raster_against_rays.ray", GLSL, rays)?;
    let gpu = bench.gpu.clone();
    let build = magpie::slot::Build::new(&gpu, rays);
    let mut gbuffer = Slots::default().gbuffer.from_config(&build, &Config::default())?;
    let shot = Shot { scene, camera, extent: EXTENT };
    let wanted = [
        "gbuffer.draw:depth",
        "gbuffer.draw:geometric_normal",
        "gbuffer.draw:ids",
        "test.rays:ids",
        "test.rays:geometry",
        "test.rays:margins",
    ];
    let ran: Ran = bench
        .run(EXTENT, &wanted, |g, imports| {
            let view = shot.view(&gpu, g, imports)?;
            let handles = scene.borrow_mut().declare(g, &mut imports.borrow_mut(), Some(camera), policy)?;
            let raster = gbuffer.add(g, &view, GBufferIn { scene: handles });
            g.pass("test.rays", Queue::Graphics, |p| {
                let (block, scene, raster_ids) = (p.read(view.block), handles.trace(p), p.sample(raster.ids));
                let (_, ids) = p.create("ids", ImageDesc::full(Format::Rg32Uint));
                let (_, geometry) = p.create("geometry", ImageDesc::full(Format::Rgba32Float));
                let (_, margins) = p.create("margins", ImageDesc::full(Format::Rg32Float));
                ((), move |c: &mut Record<'_>| {
                    let params = Params {
                        view: c.id(block),
                        scene: c.id(scene.root),
                        rays: c.rays(),
                        raster_ids: c.id(raster_ids),
                        ids: c.id(ids),
                        geometry: c.id(geometry),
                        margins: c.id(margins),
                    };
                    c.trace(kernel, scene.tlas, &params, EXTENT);
                })
            });
            Ok(())
        })?
        .clean()?;
    let eye = Eye::new(camera, EXTENT);
    let [depth, normal, raster_ids, ids, geometry, margins] = wanted.map(|w| ran.values(w));
    let (depth, normal, raster_ids, ids) = (depth?, normal?, raster_ids?, ids?);
    let (geometry, margins) = (geometry?, margins?);
    let raster = (0..depth.len()).map(|i| Seen {
        instance: raster_ids[i][0] as u32,
        primitive: raster_ids[i][1] as u32,
        depth: eye.view_depth(depth[i][0]),
        normal: octahedral(normal[i][0], normal[i][1]),
        margin: margins[i][0],
    });
    let traced = (0..depth.len()).map(|i| Seen {
        instance: ids[i][0] as u32,
        primitive: ids[i][1] as u32,
        depth: f64::from(geometry[i][3]),
        normal: Vec3::new(geometry[i][0], geometry[i][1], geometry[i][2]).as_dvec3(),
        margin: margins[i][1],
    });
    let pass = ran.executed.sample.passes.iter().find(|p| p.name == "test.rays");
    Ok(Both {
        raster: raster.collect(),
        rays: traced.collect(),
        closest: ran.rays("test.rays")?[0],
        nanoseconds: pass.and_then(|p| p.gpu_ns),
    })
}
