//! Light of emissive meshes: rays without a denoiser, averaged over many frames, against the reference.
use anyhow::{Context, Result, ensure};
use glam::{Affine3A, DVec3, Quat, Vec2, Vec3};
use magpie::gpu::Gpu;
use magpie::scene::{
    Animation, Channel, ColourSpace, Interpolation, Material, Mesh, Node, Property, Sampler, Scene, Sphere, Texture,
    TextureUse,
};
use magpie_passes::{FrameRequest, FrameResult, RenderOptions, Renderer, Slots};
use magpie_tests::against::{Shown, mean, relmse, truth};
use magpie_tests::fixtures::{add, block, camera, material, plane, scene};
use magpie_tests::harness::{builtin, config, gpu, render};
use std::f32::consts::PI;

const STILL: Shown = Shown { size: [40, 22], time: 0.0 };
const RAW: [&str; 3] = ["direct.denoiser=none", "direct.emitter_rays=8", "stages.shadows=off"];

/// A white material whose base colour is exact in 8 bits; everything else in view varies smoothly.
fn white(metalness: f32, roughness: f32) -> Material {
    material([1.0; 3], metalness, (roughness * 255.0).round() / 255.0)
}

/// A floor, matte in front and glossy behind, with a block on it, under a panel that faces down and is itself not visible.
fn panel(textured: bool) -> Scene {
    let mut s = scene("panel", camera([0.0, 2.6, 3.4], [0.0, 0.0, 0.2]));
    let at = |x: f32, y: f32, z: f32| Affine3A::from_translation(Vec3::new(x, y, z));
    add(&mut s, plane(4.0), white(0.0, 0.9), at(0.0, 0.0, 4.0));
    add(&mut s, plane(4.0), white(1.0, 0.4), at(0.0, 0.0, -4.0));
    add(&mut s, block(Vec3::new(0.2, 0.3, 0.2)), white(0.0, 0.5), at(-0.5, 0.3, 0.1));
    let mut shape = plane(0.5);
    let mut emits = Material { emission: Vec3::new(6.0, 5.0, 3.0), ..white(0.0, 1.0) };
    if textured {
        // Bright in one corner, dark elsewhere.
        let rgba = (0..16_u8).flat_map(|i| if i < 2 { [255, 200, 90, 255] } else { [30, 30, 60, 255] }).collect();
        s.textures.push(Texture::new("glow".to_owned(), [4, 4], ColourSpace::Srgb, rgba));
        s.samplers.push(Sampler::default());
        let rows = [Vec3::X, Vec3::Y];
        emits.emission_texture = Some(TextureUse { texture: 0, sampler: 0, uv_set: 0, rows });
        shape.uv0 = shape.positions.iter().map(|p| Vec2::new(p.x + 0.5, p.z + 0.5)).collect();
    }
    let down = Quat::from_rotation_z(0.3) * Quat::from_rotation_x(PI);
    add(&mut s, shape, emits, Affine3A::from_rotation_translation(down, Vec3::new(0.3, 1.2, 0.1)));
    s
}

/// Two emissive spheres of one mesh above the floor.
fn balls() -> Scene {
    let mut s = panel(false);
    s.instances.pop();
    let spheres = [(Vec3::new(-0.5, 1.1, 0.9), 0.15), (Vec3::new(0.7, 0.5, -0.2), 0.1)];
    let spheres = spheres.map(|(centre, radius)| Sphere { centre, radius }).to_vec();
    let mesh = Mesh { name: "balls".to_owned(), spheres, ..Mesh::default() };
    let emits = Material { emission: Vec3::new(9.0, 12.0, 15.0), ..white(0.0, 1.0) };
    add(&mut s, mesh, emits, Affine3A::IDENTITY);
    s
}

/// The panel moves aside and changes its size within a second.
fn moving(scale: [[f32; 3]; 2]) -> Scene {
    let mut s = panel(false);
    let instance = s.instances.last_mut().map(|i| (i.node.insert(0), i.world_from_object));
    let turn = instance.map(|(_, place)| place.matrix3).unwrap_or_default();
    let turn = Quat::from_mat3(&turn.as_mat3());
    s.nodes.push(Node { name: "panel".to_owned(), ..Node::default() });
    let channel = |property, values: &[&[f32]]| Channel {
        node: 0,
        property,
        interpolation: Interpolation::Linear,
        times: vec![0.0, 1.0],
        values: values.concat(),
    };
    let channels = vec![
        channel(Property::Translation, &[&[0.3, 1.2, 0.1], &[-0.6, 0.9, 0.4]]),
        channel(Property::Rotation, &[&turn.to_array(), &turn.to_array()]),
        channel(Property::Scale, &[&scale[0], &scale[1]]),
    ];
    s.animations.push(Animation { name: "aside".to_owned(), duration: 2.0, channels });
    s
}

fn converges(gpu: &Gpu, what: &str, scene: &Scene, shown: Shown) -> Result<()> {
    let truth = truth(gpu, scene, shown, 1024)?;
    let (found, ms) = mean(gpu, scene, &RAW, shown, 64)?;
    let [error, noise] = relmse(&found, &truth);
    let dark = relmse(&vec![DVec3::ZERO; found.len()], &truth)[0];
    println!("{what}: relMSE {error:.2e}, of which {noise:.1e} is noise of the truth; of black {dark:.2}; {ms:.2} ms");
    ensure!(noise < 2e-3 && error - noise < 2e-3 && dark > 0.2, "{what}: {error:.2e}, noise {noise:.1e}");
    let ratio = found.iter().sum::<DVec3>() / truth.mean.iter().sum::<DVec3>();
    println!("{what}: {ratio} of the light");
    ensure!((ratio - 1.0).abs().max_element() < 5e-3, "{what}: {ratio} of the light");
    Ok(())
}

#[test]
fn rays_converge_to_the_reference() -> Result<()> {
    let Some(gpu) = gpu()? else { return Ok(()) };
    converges(&gpu, "triangles", &panel(false), STILL)?;
    converges(&gpu, "a texture", &panel(true), STILL)?;
    converges(&gpu, "spheres", &balls(), STILL)
}

/// Selection probabilities are those of the rest pose, pdfs those of the current pose.
#[test]
fn what_moves_is_unbiased() -> Result<()> {
    let Some(gpu) = gpu()? else { return Ok(()) };
    let scene = moving([[1.0; 3], [2.0, 1.0, 0.5]]);
    let moved = Shown { time: 1.0, ..STILL };
    converges(&gpu, "moved", &scene, moved)?;
    // Its rest pose has no area.
    converges(&gpu, "grown from nothing", &moving([[0.0; 3], [1.0; 3]]), moved)?;
    let apart = relmse(&mean(&gpu, &scene, &RAW, STILL, 8)?.0, &truth(&gpu, &scene, moved, 64)?)[0];
    ensure!(apart > 0.05, "nothing has moved: {apart}");
    Ok(())
}

#[test]
fn the_denoiser_helps() -> Result<()> {
    let Some(gpu) = gpu()? else { return Ok(()) };
    let shown = Shown { size: [96, 54], ..STILL };
    for (what, scene) in [("triangles", panel(true)), ("spheres", balls())] {
        let truth = truth(&gpu, &scene, shown, 256)?;
        let error = |frames: u32, denoiser: &str| -> Result<f64> {
            let changes = ["direct.emitter_rays=1", "stages.shadows=off", denoiser];
            let last = last_frame(&gpu, &scene, &changes, shown.size, frames)?;
            Ok(relmse(&last, &truth)[0])
        };
        let raw = error(1, "direct.denoiser=none")?;
        let (first, eighth) = (error(1, "direct.denoiser=svgf")?, error(8, "direct.denoiser=svgf")?);
        println!("{what}: relMSE of a ray {raw:.3}, denoised {first:.3}, in the eighth frame {eighth:.4}");
        ensure!(first < 0.5 * raw && eighth < 0.5 * first, "{what}: {raw}, {first}, {eighth}");
    }
    Ok(())
}

/// The slot's radiance in the last of some frames.
fn last_frame(gpu: &Gpu, scene: &Scene, changes: &[&str], size: [u32; 2], frames: u32) -> Result<Vec<DVec3>> {
    let result = render(gpu, scene, &config(changes)?, size, frames, Some(("direct.shade", "radiance")))?;
    let image = result.images.context("no image")?.linear;
    Ok(image.values().iter().map(|v| Vec3::new(v[0], v[1], v[2]).as_dvec3()).collect())
}

/// Names of the slot's passes, and bytes of the scene.
fn plan(gpu: &Gpu, scene: &Scene, changes: &[&str]) -> Result<(Vec<String>, u64)> {
    let result = render(gpu, scene, &config(changes)?, [32, 18], 1, None)?;
    Ok(of(&result))
}

fn of(result: &FrameResult) -> (Vec<String>, u64) {
    let names = result.sample.passes.iter().map(|p| p.name.to_string()).filter(|n| n.starts_with("direct."));
    (names.collect(), result.sample.memory.scene_bytes)
}

#[test]
fn where_nothing_emits_there_is_nothing() -> Result<()> {
    let Some(gpu) = gpu()? else { return Ok(()) };
    let alone = vec!["direct.shade".to_owned()];
    // The emissive panel of the box depicts a light, which is sampled itself.
    let cornell = builtin("cornell")?;
    let (passes, bytes) = plan(&gpu, &cornell, &[])?;
    let (none, without) = plan(&gpu, &cornell, &["direct.emitter_rays=0"])?;
    ensure!(passes == alone && none == alone && bytes == without, "{passes:?}, {bytes} and {without} bytes");

    let scene = balls();
    let (passes, bytes) = plan(&gpu, &scene, &[])?;
    let (none, without) = plan(&gpu, &scene, &["direct.emitter_rays=0"])?;
    ensure!(
        passes.iter().any(|p| p == "direct.emitters") && passes.iter().any(|p| p == "direct.level_0"),
        "{passes:?}"
    );
    ensure!(none == alone && bytes > without, "{none:?}, {bytes} and {without} bytes");

    // The emitter table is created and dropped with the setting.
    let options = RenderOptions { width: 32, height: 18, check: true, ..RenderOptions::default() };
    let off = config(&["direct.emitter_rays=0"])?;
    let mut renderer = Renderer::new(&gpu, &scene, &Slots::default(), &off, options)?;
    for (config, wanted) in [(config(&[])?, bytes), (off, without)] {
        renderer.configure(&config)?;
        let request = FrameRequest { camera: &scene.cameras[0], time: 0.0, view: None, read_back: false };
        let result = renderer.frame(request)?.context("no frame")?;
        ensure!(of(&result).1 == wanted && result.findings.is_empty(), "{} and not {wanted} bytes", of(&result).1);
    }
    Ok(())
}
