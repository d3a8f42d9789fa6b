//! Simple scenes, and their results of the slot `shadows`.
use anyhow::{Context, Result, ensure};
use glam::{Affine3A, DVec3, Vec3};
use magpie::config::Config;
use magpie::gpu::Gpu;
use magpie::graph::Extent;
use magpie::scene::{Camera, Light, Mesh, Scene, Sphere, supply_missing};
use magpie_passes::{FrameRequest, FrameResult, RenderOptions, Renderer, Slots};
use magpie_tests::fixtures::{add, block, camera, material, mesh, plane, scene};
use magpie_tests::harness::config_without_bounces;
use magpie_tests::oracle::gbuffer::Eye;

pub const SIZE: [u32; 2] = [160, 90];

/// A renderer whose shadows are read back.
pub struct Rig {
    renderer: Renderer,
}

impl Rig {
    pub fn new(gpu: &Gpu, scene: &Scene, changes: &[&str]) -> Result<Self> {
        Self::with(gpu, scene, &config_without_bounces(changes)?)
    }

    pub fn with(gpu: &Gpu, scene: &Scene, config: &Config) -> Result<Self> {
        let options = RenderOptions { width: SIZE[0], height: SIZE[1], check: true, ..RenderOptions::default() };
        let mut renderer = Renderer::new(gpu, scene, &Slots::default(), config, options)?;
        renderer.read_slots(&["shadows"])?;
        Ok(Self { renderer })
    }

    /// An output of a pass.
    pub fn view(&mut self, camera: &Camera, view: (&str, &str)) -> Result<Vec<[f32; 4]>> {
        let request = FrameRequest { camera, time: 0.0, view: Some(view), read_back: true };
        let result = self.renderer.frame(request)?.context("a size of zero")?;
        Ok(result.images.context("no image was read back")?.linear.values())
    }

    pub fn frame(&mut self, camera: &Camera, time: f64) -> Result<FrameResult> {
        let request = FrameRequest { camera, time, view: None, read_back: true };
        let result = self.renderer.frame(request)?.context("a size of zero")?;
        ensure!(result.findings.is_empty(), "{}", result.findings[0]);
        Ok(result)
    }
}

/// Visibility of the first four lights.
pub fn values(result: &FrameResult) -> Result<Vec<[f32; 4]>> {
    let (_, pixels) = result.slots.first().context("no slot was read")?;
    Ok(pixels.as_ref().context("no light has a shadow")?.values())
}

/// Names of the passes that ran.
pub fn passes(result: &FrameResult) -> Vec<String> {
    result.plan.order.iter().map(|pass| result.declaration.pass_name(*pass).to_owned()).collect()
}

/// Visibility in the first frame of a scene with this configuration.
pub fn shadows(gpu: &Gpu, scene: &Scene, changes: &[&str]) -> Result<Vec<[f32; 4]>> {
    values(&Rig::new(gpu, scene, changes)?.frame(&scene.cameras[0], 0.0)?)
}

/// Hard shadows by rays, the ground truth of maps.
pub fn truth(gpu: &Gpu, scene: &Scene) -> Result<Vec<[f32; 4]>> {
    shadows(gpu, scene, &["stages.shadows=ray-traced", "shadows.edges=hard"])
}

pub fn at(x: f32, y: f32, z: f32) -> Affine3A {
    Affine3A::from_translation(Vec3::new(x, y, z))
}

/// A floor with this half side, and a camera.
pub fn floor(half: f32, eye: Vec3, target: Vec3) -> Scene {
    let mut made = scene("shadows", camera(eye.as_dvec3(), target.as_dvec3()));
    add(&mut made, plane(half), material([0.5; 3], 0.0, 1.0), Affine3A::IDENTITY);
    made
}

/// A floor with a block, a slanted block, a ball of triangles and a procedural one.
pub fn things(lights: &[Light]) -> Scene {
    let mut made = floor(8.0, Vec3::new(0.5, 4.0, 7.0), Vec3::new(0.0, 0.3, 0.0));
    let grey = || material([0.5; 3], 0.0, 1.0);
    add(&mut made, block(Vec3::new(0.5, 1.0, 0.5)), grey(), at(-1.2, 1.0, 0.0));
    let slanted = at(1.5, 0.8, -1.0) * Affine3A::from_rotation_z(0.6) * Affine3A::from_rotation_x(0.4);
    add(&mut made, block(Vec3::new(0.7, 0.2, 0.5)), grey(), slanted);
    add(
        &mut made,
        magpie_tests::fixtures::sphere(16),
        grey(),
        at(0.3, 0.5, 1.2) * Affine3A::from_scale(Vec3::splat(0.5)),
    );
    let spheres = vec![Sphere { centre: Vec3::ZERO, radius: 0.4 }];
    add(&mut made, Mesh { name: "ball".to_owned(), spheres, ..Mesh::default() }, grey(), at(2.2, 0.4, 1.0));
    made.lights = lights.to_vec();
    supply_missing(&mut made);
    made
}

/// Where a pixel's ray meets the floor.
pub fn on_floor(camera: &Camera, pixel: usize) -> DVec3 {
    let eye = Eye::new(camera, Extent::new(SIZE[0], SIZE[1]));
    let ray = eye.pixel_ray(pixel);
    eye.position - ray * (eye.position.y / ray.y)
}

/// A disc light above the edge of a sheet at five heights: width of the penumbra on the floor, over the expected one. The visible area of
/// the disc goes from 10 to 90 % over 1.3745 times its radius, projected through the edge.
pub fn penumbrae(visibility: impl Fn(&Scene) -> Result<Vec<[f32; 4]>>) -> Result<Vec<f64>> {
    let (height, radius) = (4.0, 0.4);
    let mut ratios = Vec::new();
    for edge in [0.4, 0.8, 1.2, 1.6, 2.0] {
        let mut scene = floor(6.0, Vec3::new(0.0, 0.0, 0.0), Vec3::Y);
        // From below the sheet, so that it does not hide the floor.
        scene.cameras[0] = Camera { near: 1e-3, ..camera(DVec3::new(0.9, 0.38, 1.6), DVec3::new(0.05, 0.0, 0.0)) };
        let sheet = mesh(
            "sheet",
            [[-6.0, 6.0], [0.0, 6.0], [0.0, -6.0], [-6.0, -6.0]].map(|[x, z]| Vec3::new(x, edge, z)).to_vec(),
            vec![Vec3::Y; 4],
            vec![0, 1, 2, 0, 2, 3],
        );
        add(&mut scene, sheet, material([0.5; 3], 0.0, 1.0), at(0.0, 0.0, 0.0));
        let (centre, normal) = (DVec3::new(0.0, f64::from(height), 0.0), Vec3::NEG_Y);
        scene.lights = vec![Light::Disc { centre, normal, radius, radiance: Vec3::splat(5.0) }];
        supply_missing(&mut scene);
        let got = visibility(&scene)?;
        // Means over slices of the floor along the edge.
        let want = f64::from(1.3745 * radius * edge / (height - edge));
        let (slice, mut sums) = (want / 12.0, vec![(0.0, 0.0); 96]);
        for (p, value) in got.iter().enumerate() {
            let place = on_floor(&scene.cameras[0], p);
            let at = (place.x / slice + 48.0).floor();
            if place.z.abs() < 1.0 && (0.0..96.0).contains(&at) && on_floor_is_seen(&scene.cameras[0], p, edge) {
                let sum: &mut (f64, f64) = &mut sums[at as usize];
                *sum = (sum.0 + f64::from(value[0]), sum.1 + 1.0);
            }
        }
        let means: Vec<(f64, f64)> = sums
            .iter()
            .zip(-48..)
            .filter(|(s, _)| s.1 > 0.0)
            .map(|(s, i)| (slice * (f64::from(i) + 0.5), s.0 / s.1))
            .collect();
        let crossing = |level: f64| {
            let pair = means.windows(2).find(|w| w[0].1 <= level && w[1].1 > level);
            pair.map(|w| w[0].0 + (level - w[0].1) / (w[1].1 - w[0].1) * (w[1].0 - w[0].0))
        };
        let (from, to) = (crossing(0.1).context("never dark")?, crossing(0.9).context("never lit")?);
        let (width, ratio) = (to - from, (to - from) / want);
        println!("edge at {edge} m: {width:.4} m wide, {want:.4} by the area of the disc, ratio {ratio:.3}");
        ratios.push(ratio);
    }
    Ok(ratios)
}

/// Whether a pixel shows the floor rather than the sheet, which is at the left and above.
fn on_floor_is_seen(camera: &Camera, pixel: usize, edge: f32) -> bool {
    let (eye, place) = (camera.eye(), on_floor(camera, pixel));
    eye.y < f64::from(edge) && place.y.abs() < 1e-6 && place.distance(eye) < 8.0
}
