//! Diffuse light found on the screen: nearer to the reference than none and than that of the sky, bounded, and counted once.
use anyhow::{Context, Result, ensure};
use glam::{Affine3A, DVec3, Vec3};
use magpie::gpu::Gpu;
use magpie::scene::{Camera, Light, Material, Scene};
use magpie_passes::reference::{Only, ReferenceOptions};
use magpie_passes::{FrameRequest, RenderOptions, Renderer, Slots};
use magpie_tests::against::{Shown, light_and_block_error, mean_of, truth_of};
use magpie_tests::fixtures::{add, block, camera, material, plane, scene, sun};
use magpie_tests::harness::{builtin, config, gpu};

const SCREEN: [&str; 5] = [
    "stages.gi=screen-space",
    "gi.precision=32",
    "gbuffer.precision=full",
    "stages.reflections=off",
    "post.anti_aliasing=none",
];
const SIZE: [u32; 2] = [96, 72];

/// Frames of a scene.
struct Frames {
    renderer: Renderer,
    camera: Camera,
}

impl Frames {
    /// Each frame is checked for what is not finite.
    fn new(gpu: &Gpu, scene: &Scene, changes: &[&str], size: [u32; 2]) -> Result<Self> {
        Self::with(true, gpu, scene, changes, size)
    }

    fn with(check: bool, gpu: &Gpu, scene: &Scene, changes: &[&str], [width, height]: [u32; 2]) -> Result<Self> {
        let options = RenderOptions { width, height, check, ..RenderOptions::default() };
        let config = config(&[&SCREEN[..], changes].concat())?;
        Ok(Self {
            renderer: Renderer::new(gpu, scene, &Slots::default(), &config, options)?,
            camera: scene.cameras[0].clone(),
        })
    }

    /// The light of the frame after so many others.
    fn light(&mut self, others: u32) -> Result<Vec<DVec3>> {
        let mut image = None;
        for frame in 0..=others {
            let (view, read_back) = (Some(("gi.resolve", "radiance")), frame == others);
            let request = FrameRequest { camera: &self.camera, time: 0.0, view, read_back };
            let result = self.renderer.frame(request)?.context("no frame")?;
            ensure!(result.findings.is_empty(), "{}", result.findings[0]);
            image = result.images;
        }
        let image = image.context("no image")?.linear;
        Ok(image.values().iter().map(|v| Vec3::from_slice(v).as_dvec3()).collect())
    }
}

fn mean(pixels: &[DVec3]) -> DVec3 {
    pixels.iter().sum::<DVec3>() / pixels.len() as f64
}

/// Light and error of blocks of frames 8 and `late`, and the truth.
fn against_truth(gpu: &Gpu, scene: &Scene, late: u32, samples: u32) -> Result<([[f64; 2]; 2], Vec<DVec3>)> {
    let options = ReferenceOptions { only: Only::Gi, ..ReferenceOptions::default() };
    let truth = truth_of(options, gpu, scene, Shown { size: SIZE, time: 0.0 }, samples)?.mean;
    let mut frames = Frames::new(gpu, scene, &[], SIZE)?;
    let early = light_and_block_error(&frames.light(7)?, &truth, SIZE[0]);
    let late = light_and_block_error(&frames.light(late - 9)?, &truth, SIZE[0]);
    Ok(([early, late], truth))
}

/// In a closed room without sky there is light, though less than there should be: what the camera does not see gives none.
#[test]
fn rooms_are_lit() -> Result<()> {
    let Some(gpu) = gpu()? else { return Ok(()) };
    let ([early, late], truth) = against_truth(&gpu, &builtin("cornell")?, 32, 96)?;
    let [_, off] = light_and_block_error(&vec![DVec3::ZERO; truth.len()], &truth, SIZE[0]);
    println!("light and error of blocks: frame 8 {early:.3?}, frame 32 {late:.3?}; without light {off:.3}");
    for [light, blocks] in [early, late] {
        ensure!((0.3..1.0).contains(&light), "light {light}");
        ensure!(blocks < 0.8 * off, "error {blocks}, without light {off}");
    }
    Ok(())
}

/// Outside it is nearer to the truth than the light of the sky alone.
#[test]
fn light_is_nearer_to_the_truth_than_that_of_the_sky() -> Result<()> {
    let Some(gpu) = gpu()? else { return Ok(()) };
    let mut scene = builtin("courtyard")?;
    let close = scene.cameras.iter().position(|camera| camera.name == "close").context("no camera")?;
    scene.cameras.swap(0, close);
    let ([early, late], truth) = against_truth(&gpu, &scene, 16, 32)?;
    let changes = ["stages.gi=sky", "stages.reflections=off", "stages.shadows=off"];
    let sky = mean_of("gi", &gpu, &scene, &changes, Shown { size: SIZE, time: 0.0 }, 1)?.0;
    let [sky_light, sky_blocks] = light_and_block_error(&sky, &truth, SIZE[0]);
    println!("frame 8 {early:.3?}, frame 16 {late:.3?}; sky [{sky_light:.3}, {sky_blocks:.3}]");
    for [light, blocks] in [early, late] {
        ensure!((0.9..1.1).contains(&light), "light {light}");
        ensure!(blocks < 0.9 * sky_blocks, "error {blocks}, of the sky alone {sky_blocks}");
    }
    Ok(())
}

/// A floor, and along one side of it a wall that the sun shines on.
fn floor_and_wall(colour: [f32; 3]) -> Scene {
    let mut s = scene("wall", camera([2.0, 2.5, 4.0], [0.0, 0.3, 0.0]));
    add(&mut s, plane(2.0), material([0.8; 3], 0.0, 1.0), Affine3A::IDENTITY);
    let wall = Affine3A::from_translation(Vec3::new(-2.1, 1.0, 0.0));
    add(&mut s, block(Vec3::new(0.1, 1.0, 2.0)), material(colour, 0.0, 1.0), wall);
    s.lights.push(sun(Vec3::new(1.0, 0.5, 0.3)));
    s
}

/// Beside a red wall a white floor is red, and less so far from it.
#[test]
fn walls_tint_the_floor() -> Result<()> {
    let Some(gpu) = gpu()? else { return Ok(()) };
    let red = |colour| -> Result<[DVec3; 2]> {
        let light = Frames::new(&gpu, &floor_and_wall(colour), &[], SIZE)?.light(7)?;
        // Pixels of the floor near the wall and far from it.
        let around = |x: usize, y: usize| -> DVec3 {
            let at = (y - 2..=y + 2).flat_map(|y| (x - 2..=x + 2).map(move |x| y * SIZE[0] as usize + x));
            mean(&at.map(|at| light[at]).collect::<Vec<_>>())
        };
        Ok([around(36, 40), around(66, 40)])
    };
    let [near, far] = red([0.8, 0.1, 0.1])?;
    let [white, _] = red([0.8; 3])?;
    println!("near {near:.4}, far {far:.4}; beside a white wall {white:.4}");
    ensure!(near.x > 4.0 * near.y && near.x > 1.5 * far.x, "near {near}, far {far}");
    ensure!((white.x / white.y - 1.0).abs() < 1e-3, "a white wall tints: {white}");
    Ok(())
}

/// In a closed white room, of which the picture shows most, each frame adds a bounce; the light comes to rest within the closed form.
#[test]
fn light_is_bounded() -> Result<()> {
    let Some(gpu) = gpu()? else { return Ok(()) };
    let [eye, target] = [DVec3::splat(0.95), DVec3::splat(-0.6)];
    let mut s = scene("closed", Camera::look_at("corner", eye, target, Vec3::Y, 130_f32.to_radians())?);
    let albedo = 0.8;
    let wall = Material { double_sided: true, specular: 0.0, ..material([albedo; 3], 0.0, 1.0) };
    add(&mut s, block(Vec3::ONE), wall, Affine3A::IDENTITY);
    s.lights.push(Light::Point { position: DVec3::ZERO, intensity: Vec3::ONE, range: None });
    let mut frames = Frames::with(false, &gpu, &s, &["stages.shadows=off", "stages.ao=off"], [48, 36])?;
    let mut means = Vec::new();
    for others in [0, 98, 99] {
        means.push(mean(&frames.light(others)?).x);
    }
    // All of the lamp's power is scattered again and again: 4 pi over the area 24, over pi.
    let albedo = f64::from(albedo);
    let most = 4.0 / 24.0 * albedo * albedo / (1.0 - albedo);
    println!("frames 1, 100 and 200: {means:.4?}, closed form {most:.4}");
    ensure!(means[0] > 0.0 && means[1] > 1.5 * means[0], "no bounces: {means:?}");
    ensure!(means[2] < most && (means[2] / means[1] - 1.0).abs() < 0.1, "not at rest: {means:?}, at most {most}");
    Ok(())
}

/// Light that emissive surfaces send to a pixel is direct light. Unlit ones are nowhere else, so their colour counts.
#[test]
fn emission_counts_once() -> Result<()> {
    let Some(gpu) = gpu()? else { return Ok(()) };
    let light = |panel: Material| -> Result<f64> {
        let mut s = scene("panel", camera([0.0, 1.5, 4.0], [0.0, 0.3, 0.0]));
        add(&mut s, plane(2.0), material([0.8; 3], 0.0, 1.0), Affine3A::IDENTITY);
        let at = Affine3A::from_translation(Vec3::new(0.0, 0.8, -1.0));
        add(&mut s, block(Vec3::new(0.8, 0.3, 0.1)), panel, at);
        Ok(mean(&Frames::new(&gpu, &s, &["gi.reuse=false"], SIZE)?.light(0)?).element_sum())
    };
    let black = material([0.0; 3], 1.0, 1.0);
    let shining = light(Material { emission: Vec3::splat(5.0), ..black.clone() })?;
    let unlit = light(Material { unlit: true, ..material([0.9; 3], 0.0, 1.0) })?;
    println!("emissive {shining:.2e}, unlit {unlit:.4}");
    ensure!(unlit > 0.01, "nothing comes from an unlit panel: {unlit}");
    ensure!(shining < 1e-3 * unlit, "emission counts twice: {shining}");
    Ok(())
}

/// Half resolution is near full resolution.
#[test]
fn half_resolution_is_near() -> Result<()> {
    let Some(gpu) = gpu()? else { return Ok(()) };
    let scene = builtin("cornell")?;
    let full = Frames::new(&gpu, &scene, &[], SIZE)?.light(15)?;
    let half = Frames::new(&gpu, &scene, &["gi.resolution=half"], SIZE)?.light(15)?;
    let [light, blocks] = light_and_block_error(&half, &full, SIZE[0]);
    println!("half over full: light {light:.3}, error of blocks {blocks:.3}");
    ensure!((light - 1.0).abs() < 0.05 && blocks < 0.15, "light {light}, error {blocks}");
    Ok(())
}

/// No setting, no first frame and no cut of the camera gives what is not finite; frames before the cut leave nothing behind.
#[test]
fn values_are_finite() -> Result<()> {
    let Some(gpu) = gpu()? else { return Ok(()) };
    let scene = builtin("courtyard")?;
    let cases: [&[&str]; 3] = [
        &["post.anti_aliasing=taa"],
        &["gi.resolution=half", "gi.thickness=0", "gi.range=0.001", "gi.noise=still", "gi.denoiser=bilateral"],
        &["gi.thickness=1000", "gi.range=1e6", "gi.slices=1", "gi.steps=1", "gi.denoiser=none", "gi.precision=16"],
    ];
    for changes in cases {
        let mut frames = Frames::new(&gpu, &scene, changes, [64, 48])?;
        frames.light(1)?;
        // Through the ground, and out to the sky.
        frames.camera = camera([0.3, 0.02, 3.0], [0.0, 0.0, 0.0]);
        frames.light(1)?;
        frames.camera = camera([0.0, 40.0, 0.0], [0.0, 80.0, 1.0]);
        ensure!(mean(&frames.light(1)?) == DVec3::ZERO, "{changes:?}: there is light where no surface is");
    }
    Ok(())
}
