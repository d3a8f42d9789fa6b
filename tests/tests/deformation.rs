//! Vertices deformed on the device against double precision (`magpie::scene::deform`).
use anyhow::{Context, Result, ensure};
use bytemuck::{Pod, Zeroable};
use glam::Vec3;
use magpie::graph::{Access, BufferDesc, Domain, Extent, Queue, Record};
use magpie::scene::{Animator, Moment, Policy, ResidentOptions, ResidentScene, deform};
use magpie_shaders::Address;
use magpie_tests::bench::{Bench, results};
use magpie_tests::harness::{builtin, gpu};

const GLSL: &str = r#"#version 460
#extension GL_GOOGLE_include_directive : require
#include "lib/bindless.glsl"
#include "shared/scene.glsl"
layout(local_size_x = 64) in;
struct Vertex { vec3 position; vec3 previous; vec3 normal; vec4 tangent; };
layout(buffer_reference, scalar, buffer_reference_align = 4) buffer Vertices { Vertex at[]; };
layout(push_constant, scalar) uniform Push { uvec2 scene; uvec2 to; uint instance; uint count; };
void main() {
    uint i = gl_GlobalInvocationID.x;
    if (i >= count) return;
    Scene tables = SceneBuffer(scene).at[0];
    Mesh mesh = MeshBuffer(tables.meshes).at[InstanceBuffer(tables.instances).at[instance].mesh];
    VertexAttributes attributes = VertexAttributesBuffer(mesh.attributes).at[i];
    vec3 position = PositionBuffer(mesh.positions).at[i];
    vec3 previous = PositionBuffer(mesh.previous_positions).at[i];
    Vertices(to).at[i] = Vertex(position, previous, attributes.normal, attributes.tangent);
}
"#;

#[repr(C)]
#[derive(Clone, Copy, Pod, Zeroable)]
struct Params {
    scene: Address,
    to: Address,
    instance: u32,
    count: u32,
}

#[repr(C)]
#[derive(Clone, Copy, Pod, Zeroable)]
struct Vertex {
    position: [f32; 3],
    previous: [f32; 3],
    normal: [f32; 3],
    tangent: [f32; 4],
}

#[test]
fn the_device_deforms_as_the_host_does() -> Result<()> {
    let Some(gpu) = gpu()? else { return Ok(()) };
    let mut bench = Bench::new(&gpu)?;
    let kernel = bench.kernel("vertices.comp", GLSL)?;
    let scene = builtin("carousel")?;
    let animator = Animator::new(&scene);
    let resident = ResidentScene::new(&gpu, &scene, ResidentOptions::default())?.shared();
    let instances: Vec<usize> = (0..scene.instances.len()).filter(|i| animator.deforms(*i)).collect();
    ensure!(instances.len() >= 3, "the stem, the blob and the flag deform");
    let mut before: Vec<Vec<[f32; 3]>> = vec![Vec::new(); instances.len()];
    for (frame, time) in [0.0, 0.4, 1.1, 2.6, 3.9].into_iter().enumerate() {
        resident.borrow_mut().set_moment(&Moment { time, ..Moment::default() });
        let mut read = Vec::new();
        bench.run(Extent::new(1, 1), &[], |g, imports| {
            let handles = resident.borrow_mut().declare(g, &mut imports.borrow_mut(), None, &Policy::default())?;
            for &instance in &instances {
                let count = scene.meshes[scene.instances[instance].mesh as usize].positions.len() as u32;
                let bytes = u64::from(count) * size_of::<Vertex>() as u64;
                let vertices = g.pass(&format!("test.vertices.{instance}"), Queue::Graphics, |p| {
                    let scene = handles.read(p);
                    let (vertices, to) = p.create_buffer("vertices", BufferDesc::new(bytes));
                    (vertices.read(), move |c: &mut Record<'_>| {
                        let params = Params { scene: c.id(scene), to: c.id(to), instance: instance as u32, count };
                        c.dispatch_groups(kernel, &params, [count.div_ceil(64), 1, 1]);
                    })
                });
                let (target, buffer) = results(&gpu, g, imports, &format!("read back.{instance}"), bytes)?;
                let target = g.pass(&format!("test.copy.{instance}"), Queue::Transfer, |p| {
                    let from = p.copy_from(vertices);
                    let (target, to) = p.copy_to(target);
                    (target, move |c: &mut Record<'_>| c.copy_buffer(from, 0, to, 0, bytes))
                });
                g.leave(target.read(), Access::HostRead, Domain::Copy);
                read.push((buffer, bytes));
            }
            Ok(())
        })?;
        let pose = animator.pose(time);
        for (slot, ((buffer, bytes), &instance)) in read.iter().zip(&instances).enumerate() {
            let mesh = &scene.meshes[scene.instances[instance].mesh as usize];
            let wanted = deform(mesh, &pose.joints[instance], &pose.weights[instance]);
            let got: Vec<Vertex> = bytemuck::pod_collect_to_vec(&buffer.contents()[..*bytes as usize]);
            let [min, max] = mesh.bounds().context("an empty mesh")?;
            let size = f64::from((max - min).length());
            let mut worst = [0.0_f64; 3];
            let mut moved = 0.0_f32;
            for (i, vertex) in got.iter().enumerate() {
                let tangent = wanted.tangents[i];
                let off = |got: [f32; 3], wanted: Vec3| (Vec3::from(got) - wanted).as_dvec3().length();
                let at = [
                    off(vertex.position, wanted.positions[i]) / size,
                    off(vertex.normal, wanted.normals[i]),
                    off([vertex.tangent[0], vertex.tangent[1], vertex.tangent[2]], tangent.truncate()),
                ];
                ensure!(at.iter().all(|d| d.is_finite()), "vertex {i} of {}: {at:?}", mesh.name);
                worst = [0, 1, 2].map(|k| worst[k].max(at[k]));
                ensure!(vertex.tangent[3] == tangent.w, "vertex {i} of {}: the bitangent is turned", mesh.name);
                // The first frame of this test follows the one that created the scene, at the same time.
                if let Some(previous) = before[slot].get(i) {
                    ensure!(vertex.previous == *previous, "vertex {i} of {} was elsewhere", mesh.name);
                }
                moved = moved.max((Vec3::from(vertex.position) - mesh.positions[i]).length());
            }
            println!(
                "frame {frame}, {}: position {:.1e} of its size, normal {:.1e}, tangent {:.1e}",
                mesh.name, worst[0], worst[1], worst[2]
            );
            ensure!(worst[0] <= 1e-6, "{}: positions off by {} of its size", mesh.name, worst[0]);
            ensure!(worst[1] <= 1e-5 && worst[2] <= 1e-5, "{}: directions off by {worst:?}", mesh.name);
            ensure!(frame == 0 || moved > 0.01, "{}: nothing moved", mesh.name);
            before[slot] = got.iter().map(|v| v.position).collect();
        }
    }
    Ok(())
}
