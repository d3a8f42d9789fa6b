//! Motion vectors of a moving camera, and of moving and deforming objects, against projections in double precision.
use anyhow::{Context, Result, ensure};
use glam::{DMat3, DVec3, Vec3};
use magpie::config::Config;
use magpie::frame::{PreviousView, ViewDesc};
use magpie::graph::Extent;
use magpie::graph::execute::Imports;
use magpie::scene::{
    Animator, Camera, FloatingOrigin, Moment, Policy, Pose, ResidentOptions, ResidentScene, Scene, deform,
};
use magpie::slot::Build;
use magpie_passes::contracts::GBufferIn;
use magpie_passes::{FrameRequest, RenderOptions, Renderer, Slots};
use magpie_tests::bench::Bench;
use magpie_tests::harness::{asset, builtin, gpu};
use magpie_tests::oracle::gbuffer::Eye;
use std::collections::BTreeMap;

const EXTENT: Extent = Extent { width: 240, height: 135 };
const WIDE: Extent = Extent { width: 1280, height: 720 };
/// Greatest error of a motion vector, pixels.
const LIMIT: f64 = 1e-3;
/// Jitter of this frame and the previous one; motion vectors must not contain it.
const JITTERS: [[f32; 2]; 2] = [[0.375, -0.4375], [-0.25, 0.125]];

/// Two cameras, the size of a frame, and its jitter now and before.
struct Step<'a> {
    before: &'a Camera,
    now: &'a Camera,
    extent: Extent,
    jitters: [[f32; 2]; 2],
}

impl Step<'_> {
    fn view(&self) -> ViewDesc<'_> {
        let previous = PreviousView { jitter: self.jitters[1], ..PreviousView::new(self.before, self.extent) };
        ViewDesc { frame: 1, jitter: self.jitters[0], previous: Some(previous), ..ViewDesc::new(self.now, self.extent) }
    }

    /// Direction through a pixel's sample position, with an offset in pixels.
    fn ray(&self, eye: &Eye, pixel: usize, beside: [f64; 2]) -> DVec3 {
        let width = self.extent.width as usize;
        let [x, y] = [0, 1].map(|i| f64::from(self.jitters[0][i]) + beside[i]);
        eye.ray((pixel % width) as f64 + 0.5 + x, (pixel / width) as f64 + 0.5 + y)
    }
}

/// Greatest error of the motion vectors, pixels, and the number of pixels that moved by more than one.
fn worst_error(bench: &mut Bench, scene: &Scene, step: &Step<'_>) -> Result<(f64, usize)> {
    let gpu = bench.gpu.clone();
    let resident = ResidentScene::new(&gpu, scene, ResidentOptions::default())?.shared();
    let mut gbuffer =
        Slots::default().gbuffer.from_config(&Build::new(&gpu, magpie::prelude::Rays::Software), &Config::default())?;
    let desc = step.view();
    let wanted = ["gbuffer.draw:motion", "gbuffer.draw:ids"];
    let ran = bench.run(step.extent, &wanted, |g, imports| {
        let mut block = magpie::gpu::Staging::new(&gpu, "view");
        let view = desc.declare(&mut block, &resident.borrow(), g, &mut imports.borrow_mut())?;
        let scene = resident.borrow_mut().declare(g, &mut imports.borrow_mut(), None, &Policy::default())?;
        let motion = gbuffer.add(g, &view, GBufferIn { scene }).motion;
        g.output(motion);
        Ok(())
    })?;
    let ran = ran.clean()?;
    let (motion, ids) = (ran.values(wanted[0])?, ran.values(wanted[1])?);
    Ok(compare(scene, &motion, &ids, step))
}

/// Greatest error of the motion vectors, pixels, and the number of pixels that moved by more than one.
fn compare(scene: &Scene, motion: &[[f32; 4]], ids: &[[f32; 4]], step: &Step<'_>) -> (f64, usize) {
    let size = [f64::from(step.extent.width), f64::from(step.extent.height)];
    let (eye_now, eye_before) = (Eye::new(step.now, step.extent), Eye::new(step.before, step.extent));
    let moments = Moments::new(scene, [0.0; 2]);
    let (mut worst, mut moved) = (0.0_f64, 0);
    for (pixel, (motion, ids)) in motion.iter().zip(ids).enumerate() {
        let Some(instance) = (ids[0] as usize).checked_sub(1) else {
            assert_eq!(motion[..2], [0.0, 0.0], "background does not move");
            continue;
        };
        // The motion vector at an offset from the pixel.
        let expected = |[x, y]: [f64; 2]| {
            let ray = step.ray(&eye_now, pixel, [x, y]);
            let world = moments.follow(&eye_now, ray, instance, ids[1] as usize)[1];
            let (here, there) = (eye_now.project(world)?, eye_before.project(world)?);
            Some([0, 1].map(|i| (here[i] - there[i]) * size[i]))
        };
        let Some(wanted) = expected([0.0; 2]) else { continue };
        let error = excess([0, 1].map(|i| f64::from(motion[i]) * size[i]), wanted, expected);
        worst = worst.max(error);
        moved += usize::from(wanted[0].hypot(wanted[1]) > 1.0);
    }
    (worst, moved)
}

/// Error of a motion vector, pixels. On surfaces seen edge on a pixel covers a long distance: the exact vectors a thousandth of a pixel
/// around count as correct too.
fn excess(got: [f64; 2], wanted: [f64; 2], expected: impl Fn([f64; 2]) -> Option<[f64; 2]>) -> f64 {
    let off = |a: [f64; 2], b: [f64; 2]| (a[0] - b[0]).abs().max((a[1] - b[1]).abs());
    // 16-bit floats have a mantissa of ten bits, and devices may round towards zero.
    let rounding = wanted[0].abs().max(wanted[1].abs()) * 0.5_f64.powi(10);
    let error = (off(got, wanted) - rounding).max(0.0);
    if error <= LIMIT {
        return error;
    }
    let beside = [[LIMIT, 0.0], [-LIMIT, 0.0], [0.0, LIMIT], [0.0, -LIMIT]];
    let play = beside.into_iter().filter_map(expected).map(|other| off(other, wanted)).fold(0.0, f64::max);
    error - play
}

fn moved(camera: &Camera, step: Vec3, turn: f32) -> Camera {
    let mut other = camera.clone();
    other.world_from_camera.translation += step.as_dvec3();
    other.world_from_camera.matrix3 *= DMat3::from_rotation_y(turn.into());
    other
}

#[test]
fn motion_is_where_things_were() -> Result<()> {
    let Some(gpu) = gpu()? else { return Ok(()) };
    let mut bench = Bench::new(&gpu)?;
    let mut scenes = vec![builtin("courtyard")?];
    scenes.extend(asset("pica_pica_mini_diorama/scene.gltf")?);
    for scene in &scenes {
        let now = &scene.cameras[0];
        let reach = now.eye().length() as f32 * 0.02;
        for (step, turn) in [(Vec3::X * reach, 0.0), (Vec3::ZERO, 0.03), (Vec3::new(0.3, -0.2, 1.0) * reach, -0.02)] {
            for (extent, jitters) in [(EXTENT, [[0.0; 2]; 2]), (EXTENT, JITTERS), (WIDE, JITTERS)] {
                let before = &moved(now, step, turn);
                let (worst, moving) = worst_error(&mut bench, scene, &Step { before, now, extent, jitters })?;
                let name = &scene.name;
                println!("{name} {extent}: step {step}, turn {turn}: off by {worst:.6} pixels, {moving} moved");
                assert!(moving > 5000, "{name}: only {moving} pixels moved");
                assert!(worst < LIMIT, "{name}: {worst} pixels off");
            }
        }
    }
    Ok(())
}

/// The eye moves by more than a cell of the floating origin's grid per frame, a thousand kilometres from the world's origin.
#[test]
fn motion_stays_right_where_the_origin_steps() -> Result<()> {
    let Some(gpu) = gpu()? else { return Ok(()) };
    let mut scene = builtin("courtyard")?;
    let place = DVec3::new(7e5, 1e4, -7e5);
    for instance in &mut scene.instances {
        instance.world_from_object.translation += place;
    }
    let camera = &mut scene.cameras[0];
    camera.world_from_camera.translation += place;
    // A near plane with grid cells of a quarter of a metre.
    camera.near = 6e-5;
    let step = DVec3::new(0.3, -0.02, 0.41);
    let cameras: Vec<Camera> = (0..3).map(|i| moved(&scene.cameras[0], (f64::from(i) * step).as_vec3(), 0.0)).collect();
    let origins: Vec<DVec3> = {
        let mut origin = FloatingOrigin::default();
        cameras.iter().map(|c| origin.follow(c)).collect()
    };
    assert!(origins[0] != origins[1] && origins[1] != origins[2], "{origins:?}");
    let see = |output: &str| -> Result<Vec<[f32; 4]>> {
        let options = RenderOptions { width: EXTENT.width, height: EXTENT.height, check: true, ..Default::default() };
        let mut renderer = Renderer::new(&gpu, &scene, &Slots::default(), &Config::default(), options)?;
        let mut last = None;
        for camera in &cameras {
            let view = Some(("gbuffer.draw", output));
            let result = renderer.frame(FrameRequest { camera, time: 0.0, view, read_back: true })?;
            last = result.and_then(|r| r.images);
        }
        Ok(last.context("no image")?.linear.values())
    };
    let (motion, ids) = (see("motion")?, see("ids")?);
    let step = Step { before: &cameras[1], now: &cameras[2], extent: EXTENT, jitters: [[0.0; 2]; 2] };
    let (worst, moved) = compare(&scene, &motion, &ids, &step);
    println!("where the origin steps: worst error {worst:.6} pixels, {moved} pixels moved");
    assert!(worst < LIMIT && moved > 10_000, "worst error {worst} pixels, {moved} moved");
    Ok(())
}

/// Kind of an instance, for statistics.
fn kind(scene: &Scene, instance: usize, moving: bool) -> &'static str {
    let mesh = &scene.meshes[scene.instances[instance].mesh as usize];
    match () {
        () if scene.instances[instance].skin.is_some() => "skinned",
        () if !mesh.targets.is_empty() => "morphed",
        () if !mesh.spheres.is_empty() => "spheres",
        () if moving => "rigid",
        () => "still",
    }
}

/// A scene at two times, in double precision.
struct Moments<'a> {
    scene: &'a Scene,
    /// Positions of each instance before and now, if it deforms.
    deformed: [Vec<Option<Vec<Vec3>>>; 2],
    poses: [Pose; 2],
}

impl<'a> Moments<'a> {
    fn new(scene: &'a Scene, times: [f64; 2]) -> Self {
        let animator = Animator::new(scene);
        let poses = times.map(|t| animator.pose(t));
        let deformed = [0, 1].map(|at: usize| {
            let positions = |i: usize| {
                let pose: &Pose = &poses[at];
                let mesh = &scene.meshes[scene.instances[i].mesh as usize];
                animator.deforms(i).then(|| deform(mesh, &pose.joints[i], &pose.weights[i]).positions)
            };
            (0..scene.instances.len()).map(positions).collect()
        });
        Self { scene, deformed, poses }
    }

    /// The surface point that a ray hits in a primitive, now and one frame ago.
    fn follow(&self, eye: &Eye, ray: DVec3, instance: usize, primitive: usize) -> [DVec3; 2] {
        let [before, now] = [0, 1].map(|at| self.poses[at].instances[instance]);
        let (from, along) = (now.inverse().transform_point3(eye.position), now.inverse().transform_vector3(ray));
        let mesh = &self.scene.meshes[self.scene.instances[instance].mesh as usize];
        let points = if let Some(sphere) = mesh.spheres.get(primitive) {
            let (f, radius) = (from - sphere.centre.as_dvec3(), f64::from(sphere.radius));
            let (a, b, c) = (along.length_squared(), f.dot(along), f.length_squared() - radius * radius);
            // The nearer intersection; at the silhouette, the point nearest to the sphere.
            let t = (-b - (b * b - a * c).max(0.0).sqrt()) / a;
            [from + t * along; 2]
        } else {
            let corners = |at: usize| {
                let positions = self.deformed[at][instance].as_ref().unwrap_or(&mesh.positions);
                [0, 1, 2].map(|k| positions[mesh.indices[3 * primitive + k] as usize].as_dvec3())
            };
            let [a, b, c] = corners(1);
            // Möller and Trumbore 1997.
            let (e1, e2, to) = (b - a, c - a, from - a);
            let (p, q) = (along.cross(e2), to.cross(e1));
            let (u, v) = (to.dot(p) / e1.dot(p), along.dot(q) / e1.dot(p));
            [corners(0), [a, b, c]].map(|[a, b, c]| a * (1.0 - u - v) + b * u + c * v)
        };
        [before.transform_point3(points[0]), now.transform_point3(points[1])]
    }
}

/// By kind of instance: number of pixels, number of those that moved by more than half a pixel, and greatest error in pixels.
type Followed = BTreeMap<&'static str, (usize, usize, f64)>;

#[test]
fn what_moves_and_deforms_is_where_it_was() -> Result<()> {
    let Some(gpu) = gpu()? else { return Ok(()) };
    let mut bench = Bench::new(&gpu)?;
    let scene = builtin("carousel")?;
    let camera = &scene.cameras[0];
    let resident = ResidentScene::new(&gpu, &scene, ResidentOptions::default())?.shared();
    let build = Build::new(&gpu, magpie::prelude::Rays::Software);
    let mut gbuffer = Slots::default().gbuffer.from_config(&build, &Config::default())?;
    let wanted = ["gbuffer.draw:motion", "gbuffer.draw:ids", "gbuffer.draw:depth"];
    let mut followed = Followed::new();
    for (times, extent) in [([0.0, 0.05], EXTENT), ([0.7, 0.75], EXTENT), ([1.9, 1.95], WIDE), ([3.28, 3.3], EXTENT)] {
        let step = Step { before: camera, now: camera, extent, jitters: JITTERS };
        let (size, eye) = ([f64::from(extent.width), f64::from(extent.height)], Eye::new(camera, extent));
        let moments = Moments::new(&scene, times);
        resident.borrow_mut().set_moment(&Moment { time: times[0], cut: true, ..Moment::default() });
        let (mut g, mut imports) = (bench.executor.begin(Extent::new(1, 1)), Imports::default());
        resident.borrow_mut().declare(&mut g, &mut imports, None, &Policy::default())?;
        bench.executor.run(g, &imports)?;
        resident.borrow_mut().set_moment(&Moment { time: times[1], ..Moment::default() });
        let desc = step.view();
        let ran = bench.run(extent, &wanted, |g, imports| {
            let mut block = magpie::gpu::Staging::new(&gpu, "view");
            let view = desc.declare(&mut block, &resident.borrow(), g, &mut imports.borrow_mut())?;
            let scene = resident.borrow_mut().declare(g, &mut imports.borrow_mut(), None, &Policy::default())?;
            let motion = gbuffer.add(g, &view, GBufferIn { scene }).motion;
            g.output(motion);
            Ok(())
        })?;
        let ran = ran.clean()?;
        let (motion, ids) = (ran.values(wanted[0])?, ran.values(wanted[1])?);
        for (pixel, (motion, id)) in motion.iter().zip(&ids).enumerate() {
            let Some(instance) = (id[0] as usize).checked_sub(1) else { continue };
            let expected = |beside: [f64; 2]| {
                let ray = step.ray(&eye, pixel, beside);
                let [before, now] = moments.follow(&eye, ray, instance, id[1] as usize);
                let (here, there) = (eye.project(now)?, eye.project(before)?);
                Some([0, 1].map(|i| (here[i] - there[i]) * size[i]))
            };
            let Some(wanted) = expected([0.0; 2]) else { continue };
            let got = [0, 1].map(|i| f64::from(motion[i]) * size[i]);
            let error = excess(got, wanted, expected);
            let moving = moments.poses[0].instances[instance] != moments.poses[1].instances[instance];
            let count = followed.entry(kind(&scene, instance, moving)).or_default();
            count.0 += 1;
            count.1 += usize::from(wanted[0].hypot(wanted[1]) > 0.5);
            count.2 = count.2.max(error);
            ensure!(error.is_finite(), "pixel {pixel}: motion {motion:?}, wanted {wanted:?}");
        }
    }
    for (kind, (pixels, moved, worst)) in &followed {
        println!("{kind}: {pixels} pixels, {moved} moved, off by at most {worst:.6} pixels");
        ensure!(*worst <= LIMIT, "{kind}: {worst} pixels off");
        ensure!(*kind == "still" || *moved > 100, "{kind}: only {moved} pixels moved");
    }
    ensure!(followed.len() == 5, "not every kind is seen: {followed:?}");
    Ok(())
}
