//! Runs small kernels with the light tree of a scene.
use anyhow::{Context, Result};
use bytemuck::{Pod, Zeroable};
use glam::{DVec3, Vec3};
use magpie::gpu::{Buffer, BufferMemory, BufferUse, Gpu, Kernel};
use magpie::graph::{Access, BufferDesc, Domain, Extent, Queue, Record};
use magpie::scene::{Camera, Moment, Policy, ResidentOptions, ResidentScene, Scene, SharedScene};
use magpie::slot::{Build, Needs};
use magpie_passes::contracts::AccelerationIn;
use magpie_passes::parts::light_tree::LightTree;
use magpie_shaders::light_tree::{LightNode, LightSplit};
use magpie_shaders::{Address, Rays};
use magpie_tests::bench::{Bench, results};
use std::sync::Arc;

const HEAD: &str = r#"#version 460
#extension GL_GOOGLE_include_directive : require
#include "lib/bindless.glsl"
#include "lib/light_sampling.glsl"
#include "lib/light_tree.glsl"
layout(local_size_x = 64) in;
struct Point { vec3 position; vec3 normal; uint both_sides; };
layout(buffer_reference, scalar, buffer_reference_align = 4) readonly buffer Points { Point at[]; };
layout(buffer_reference, scalar, buffer_reference_align = 4) buffer Words { uint at[]; };
layout(buffer_reference, scalar, buffer_reference_align = 4) buffer Floats { float at[]; };
layout(push_constant, scalar) uniform Push {
    uvec2 scene_at; uvec2 tree_at; uvec2 lights_at; uvec2 points; uvec2 to; LightSplit split; uint threads; uint samples; uint seed;
};
LightTree tree() { return LightTreeBuffer(tree_at).at[0]; }
LightTables lights() { return LightTablesBuffer(lights_at).at[0]; }
SceneBuffer the_scene() { return SceneBuffer(scene_at); }

// What a light sends to a point, unshadowed, by one sample of it.
float sent(uint entry, Point p, vec2 u) {
    LightChoice choice = LightChoiceBuffer(lights().near).at[entry];
    Incident found;
    bool any = choice.light == CHOICE_EMITTER
        ? sample_emitter(the_scene(), choice, p.position, u, found)
        : sample_sized_light(LightBuffer(the_scene().at[0].lights).at[choice.light], p.position, u, found);
    if (!any) return 0.0;
    float cosine = p.normal == vec3(0.0) ? 1.0 : dot(p.normal, found.direction);
    if (p.both_sides != 0u) cosine = abs(cosine);
    return max(cosine, 0.0) * dot(found.radiance, vec3(0.2126, 0.7152, 0.0722));
}
bool choose_for(Point p, vec2 u, out uint entry, out float probability) {
    return choose_by_tree(the_scene(), tree(), p.position, p.normal, p.both_sides != 0u, u, entry, probability);
}
float probability_for(Point p, uint entry) {
    return tree_probability(the_scene(), tree(), lights(), entry, p.position, p.normal, p.both_sides != 0u);
}
uint choose_several_for(Point p, vec2 u, out uint entries[MOST_SPLIT_LIGHTS], out float probabilities[MOST_SPLIT_LIGHTS]) {
    return choose_by_tree_split(the_scene(), tree(), p.position, p.normal, p.both_sides != 0u, split, u, entries, probabilities);
}
float split_probability_for(Point p, uint entry) {
    return tree_split_probability(the_scene(), tree(), lights(), split, entry, p.position, p.normal, p.both_sides != 0u);
}
void run(uint i);
void main() {
    if (gl_GlobalInvocationID.x < threads) run(gl_GlobalInvocationID.x);
}
"#;

#[repr(C)]
#[derive(Clone, Copy, Pod, Zeroable)]
struct Params {
    scene: Address,
    tree: Address,
    lights: Address,
    points: Address,
    to: Address,
    split: LightSplit,
    threads: u32,
    samples: u32,
    seed: u32,
}

/// A point that is lit.
#[repr(C)]
#[derive(Clone, Copy, Debug, Pod, Zeroable)]
pub struct Point {
    pub position: [f32; 3],
    pub normal: [f32; 3],
    pub both_sides: u32,
}

/// A scene on the device with its light tree.
pub struct Rig {
    pub bench: Bench,
    pub scene: SharedScene,
    part: LightTree,
    camera: Camera,
}

/// One run of a kernel.
#[derive(Clone, Copy)]
pub struct Job<'a> {
    pub kernel: Kernel,
    pub threads: u32,
    /// Words of the result.
    pub words: usize,
    pub points: &'a [Point],
    pub samples: u32,
    pub seed: u32,
    pub split: LightSplit,
    /// Whether the tree is refitted where it is out of date.
    pub refit: bool,
}

impl<'a> Job<'a> {
    pub fn new(kernel: Kernel, threads: u32, words: usize, points: &'a [Point]) -> Self {
        let split = LightSplit { threshold: 0.0, most: 1 };
        Self { kernel, threads, words, points, samples: 1, seed: 0, split, refit: true }
    }
}

/// What a kernel wrote, and the passes of its frame.
pub struct Answer {
    pub words: Vec<u32>,
    pub passes: Vec<String>,
    /// How long each of them took on the device, milliseconds.
    pub times: Vec<f64>,
}

impl Answer {
    pub fn floats(&self) -> Vec<f64> {
        self.words.iter().map(|word| f64::from(f32::from_bits(*word))).collect()
    }
}

impl Rig {
    pub fn new(gpu: &Gpu, scene: &Scene) -> Result<Self> {
        let mut resident = ResidentScene::new(gpu, scene, ResidentOptions::default())?;
        resident.want_lights(gpu, &Needs { light_tree: true, ..Needs::default() })?;
        Ok(Self {
            bench: Bench::new(gpu)?,
            part: LightTree::new(&Build::new(gpu, Rays::Software))?,
            scene: resident.shared(),
            camera: scene.cameras[0].clone(),
        })
    }

    /// The kernel with this function `void run(uint i)`.
    pub fn kernel(&self, name: &str, glsl: &str) -> Result<Kernel> {
        self.bench.kernel(name, &format!("{HEAD}{glsl}"))
    }

    pub fn go_to(&self, time: f64, origin: DVec3) {
        self.scene.borrow_mut().set_moment(&Moment { time, origin, cut: false });
    }

    /// Builds the tree anew for the moment in which the scene is.
    pub fn rebuild(&self) -> Result<()> {
        let mut scene = self.scene.borrow_mut();
        scene.want_lights(&self.bench.gpu, &Needs::default())?;
        Ok(scene.want_lights(&self.bench.gpu, &Needs { light_tree: true, ..Needs::default() })?)
    }

    pub fn run(&mut self, job: Job<'_>) -> Result<Answer> {
        let gpu = self.bench.gpu.clone();
        let upload = |name: &str, data: &[u8]| -> Result<Arc<Buffer>> {
            let bytes = data.len().max(4) as u64;
            let mut buffer = Buffer::new(&gpu, name, bytes, BufferMemory::Upload, BufferUse::Storage)?;
            buffer.write(0, data)?;
            Ok(Arc::new(buffer))
        };
        let bytes = (4 * job.words) as u64;
        let points = upload("points", bytemuck::cast_slice(job.points))?;
        let zeros = upload("zeros", &vec![0; 4 * job.words])?;
        let (mut read, scene, camera, part) = (None, self.scene.clone(), self.camera.clone(), &self.part);
        let ran = self.bench.run(Extent::new(1, 1), &[], |g, imports| {
            let handles = scene.borrow_mut().declare(g, &mut imports.borrow_mut(), None, &Policy::default())?;
            let tree = if job.refit {
                let source = AccelerationIn::Resident { scene: scene.clone(), imports: imports.clone(), camera };
                part.add(g, &source, handles).light_tree
            } else {
                let update = scene.borrow_mut().declare_light_tree(g, &mut imports.borrow_mut());
                update.map(|update| update.tree.read())
            };
            let (tree, lights) = (tree.context("no tree")?, handles.lights.context("no tables")?);
            let key = imports.borrow_mut().buffer(&points);
            let points = g.import_buffer("points", BufferDesc::new(points.bytes()), Access::BufferRead, key).read();
            let key = imports.borrow_mut().buffer(&zeros);
            let zeros = g.import_buffer("zeros", BufferDesc::new(bytes), Access::CopyRead, key).read();
            let (target, buffer) = results(&gpu, g, imports, "results", bytes)?;
            let target = g.pass("test.clear", Queue::Transfer, |p| {
                let from = p.copy_from(zeros);
                let (target, to) = p.copy_to(target);
                (target, move |c: &mut Record<'_>| c.copy_buffer(from, 0, to, 0, bytes))
            });
            let target = g.pass("test.run", Queue::Graphics, |p| {
                let root = handles.read(p);
                let [tree, lights, points] = [tree, lights, points].map(|buffer| p.read(buffer));
                let (target, to) = p.write_buffer(target);
                (target, move |c: &mut Record<'_>| {
                    let params = Params {
                        scene: c.id(root),
                        tree: c.id(tree),
                        lights: c.id(lights),
                        points: c.id(points),
                        to: c.id(to),
                        split: job.split,
                        threads: job.threads,
                        samples: job.samples,
                        seed: job.seed,
                    };
                    c.dispatch_groups(job.kernel, &params, [job.threads.div_ceil(64), 1, 1]);
                })
            });
            g.leave(target.read(), Access::HostRead, Domain::Compute);
            read = Some(buffer);
            Ok(())
        })?;
        let read = read.context("nothing ran")?;
        let passes = ran.executed.sample.passes.iter().map(|pass| pass.name.clone()).collect();
        let times = ran.executed.sample.passes.iter().map(|pass| pass.gpu_ns.unwrap_or(0) as f64 * 1e-6).collect();
        Ok(Answer { words: bytemuck::pod_collect_to_vec(&read.contents()[..bytes as usize]), passes, times })
    }

    /// Every node, and the passes that ran for it.
    pub fn nodes(&mut self, refit: bool) -> Result<(Vec<LightNode>, Vec<String>)> {
        let count = "void run(uint i) { Words(to).at[0] = tree().node_count; }";
        let count = Job { refit: false, ..Job::new(self.kernel("count.comp", count)?, 1, 1, &[]) };
        // Brings nothing up to date, so that it is still to be done.
        let count = self.run(count)?.words[0];
        self.scene.borrow_mut().forget();
        let copy = "void run(uint i) { LightNodeBufferWrite(to).at[i] = LightNodeBuffer(tree().nodes).at[i]; }";
        let kernel = self.kernel("nodes.comp", copy)?;
        let words = count as usize * size_of::<LightNode>() / 4;
        let answer = self.run(Job { refit, ..Job::new(kernel, count, words, &[]) })?;
        Ok((bytemuck::pod_collect_to_vec(&answer.words), answer.passes))
    }
}

/// Random numbers in [0, 1).
pub struct Numbers(pub u64);

impl Numbers {
    pub fn next(&mut self) -> f32 {
        self.0 = self.0.wrapping_mul(6_364_136_223_846_793_005).wrapping_add(1_442_695_040_888_963_407);
        (self.0 >> 40) as f32 / (1 << 24) as f32
    }

    /// In the cube from -1 to 1.
    pub fn point(&mut self) -> Vec3 {
        Vec3::new(self.next(), self.next(), self.next()) * 2.0 - 1.0
    }

    pub fn direction(&mut self) -> Vec3 {
        loop {
            let point = self.point();
            if (0.01..1.0).contains(&point.length()) {
                return point.normalize();
            }
        }
    }
}

/// Points in a box of these half extents: on surfaces of any direction, some of which light goes through, and in air.
pub fn points_in(extent: Vec3, count: usize, numbers: &mut Numbers) -> Vec<Point> {
    (0..count)
        .map(|i| {
            let normal = if i % 8 == 7 { Vec3::ZERO } else { numbers.direction() };
            let position = numbers.point() * extent;
            Point { position: position.to_array(), normal: normal.to_array(), both_sides: u32::from(i % 8 == 6) }
        })
        .collect()
}
