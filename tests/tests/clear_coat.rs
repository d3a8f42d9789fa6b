//! Clear coats (KHR_materials_clearcoat) in the frame against the reference, by direct light, sky and reflections; and scenes without them.
use anyhow::{Context, Result, ensure};
use glam::{Affine3A, DVec3, Quat, Vec2, Vec3};
use magpie::graph::Extent;
use magpie::scene::{ColourSpace, Light, Material, Mesh, Sampler, Scene, Sphere, Texture, TextureUse};
use magpie_passes::Slots;
use magpie_passes::plan::plan_frame;
use magpie_passes::reference::{Only, ReferenceOptions};
use magpie_shaders::Rays;
use magpie_tests::against::{Shown, light_and_block_error, mean_of, relmse, truth_of};
use magpie_tests::fixtures::{add, camera, environment, material, plane, scene, sun};
use magpie_tests::harness::{config, gpu};
use std::f32::consts::PI;

const SHOWN: Shown = Shown { size: [48, 32], time: 0.0 };

/// A material under a coat.
fn coated(base: Material, clearcoat: f32, clearcoat_roughness: f32) -> Material {
    Material { clearcoat, clearcoat_roughness, ..base }
}

/// Three balls on a plate, all coated: rough paint, rough metal, and a smooth base under a rough coat. A texture takes the coat off one half
/// of the plate, and roughens it towards the other.
fn balls() -> Scene {
    let mut s = scene("coats", camera([0.0, 2.4, 4.4], [0.0, 0.2, 0.0]));
    let mut plate = plane(3.0);
    plate.uv0 = plate.positions.iter().map(|p| Vec2::new(p.x / 6.0 + 0.5, p.z / 6.0 + 0.5)).collect();
    let rgba = (0..4_u8).flat_map(|i| if i % 2 == 0 { [0, 0, 0, 255] } else { [255, 255, 0, 255] }).collect();
    s.textures.push(Texture::new("coat".to_owned(), [2, 2], ColourSpace::Linear, rgba));
    s.samplers.push(Sampler::default());
    let used = Some(TextureUse { texture: 0, sampler: 0, uv_set: 0, rows: [Vec3::X, Vec3::Y] });
    let floor = Material {
        clearcoat_texture: used,
        clearcoat_roughness_texture: used,
        ..coated(material([0.2, 0.2, 0.2], 0.0, 0.8), 1.0, 0.4)
    };
    add(&mut s, plate, floor, Affine3A::IDENTITY);
    let kinds = [
        coated(material([0.6, 0.05, 0.05], 0.0, 0.8), 1.0, 0.2),
        coated(material([0.9, 0.6, 0.2], 1.0, 0.6), 0.8, 0.0),
        coated(material([0.1, 0.2, 0.6], 0.0, 0.2), 1.0, 1.0),
    ];
    for (x, kind) in [-1.3, 0.0, 1.3].into_iter().zip(kinds) {
        let spheres = vec![Sphere { centre: Vec3::ZERO, radius: 0.55 }];
        let ball = Mesh { name: "ball".to_owned(), spheres, ..Mesh::default() };
        add(&mut s, ball, kind, Affine3A::from_translation(Vec3::new(x, 0.56, 0.0)));
    }
    s
}

/// The same materials without their coats.
fn bare(scene: &Scene) -> Scene {
    let mut bare = scene.clone();
    bare.materials.iter_mut().for_each(|m| m.clearcoat = 0.0);
    bare
}

/// Direct light of a point-like sun, of a lamp with an area, and of an emissive mesh.
#[test]
fn direct_light_is_that_of_the_reference() -> Result<()> {
    let Some(gpu) = gpu()? else { return Ok(()) };
    let (mut sunny, mut lamp, mut panel) = (balls(), balls(), balls());
    // Shadows of a lamp are multiplied with its light as a whole, which is an error of its own: nothing is in the way here.
    lamp.instances.remove(0);
    sunny.lights.push(sun(Vec3::new(-0.4, 0.8, 0.6)));
    let (half_u, half_v) = (Vec3::X * 0.8, Vec3::new(0.0, 0.3, 0.3));
    let radiance = Vec3::new(9.0, 8.0, 7.0);
    lamp.lights.push(Light::Rectangle { centre: DVec3::new(0.3, 1.9, -0.9), half_u, half_v, radiance });
    let mut over_plate = balls();
    over_plate.instances.truncate(1);
    over_plate.lights = lamp.lights.clone();
    let down = Affine3A::from_rotation_translation(Quat::from_rotation_x(PI - 0.6), Vec3::new(0.3, 1.9, -0.9));
    add(&mut panel, plane(0.4), Material { emission: radiance, ..material([0.5; 3], 0.0, 1.0) }, down);
    for (what, scene, samples, frames, shadows) in [
        ("sun", sunny, 64, 1, "shadows.edges=hard"),
        ("lamp and balls", lamp, 1024, 64, "stages.shadows=off"),
        ("lamp and plate", over_plate, 1024, 64, "stages.shadows=off"),
        ("panel", panel, 1024, 64, "stages.shadows=off"),
    ] {
        let options = ReferenceOptions { only: Only::Direct, ..ReferenceOptions::default() };
        let truth = truth_of(options, &gpu, &scene, SHOWN, samples)?;
        let found = |scene: &Scene, precision: &str| -> Result<Vec<DVec3>> {
            let changes = [
                precision,
                shadows,
                "direct.area=16",
                "direct.emitter_rays=8",
                "direct.denoiser=none",
                "direct.precision=32",
            ];
            Ok(mean_of("direct", &gpu, scene, &changes, SHOWN, frames)?.0)
        };
        let with = found(&scene, "gbuffer.precision=full")?;
        let compact = found(&scene, "gbuffer.precision=compact")?;
        let without = found(&bare(&scene), "gbuffer.precision=full")?;
        // What the frame's closed forms for lamps are off where the horizon cuts them, coat or not.
        let own_truth = truth_of(options, &gpu, &bare(&scene), SHOWN, samples)?;
        let [own, own_noise] = relmse(&without, &own_truth);
        let [error, noise] = relmse(&with, &truth);
        let [[compact, _], [without, _]] = [relmse(&compact, &truth), relmse(&without, &truth)];
        let [error, compact, without, own] =
            [error - noise, compact - noise, without - noise, (own - own_noise).max(0.0)];
        let [light, _] = light_and_block_error(&with, &truth.mean, SHOWN.size[0]);
        println!(
            "{what}: relMSE less noise {error:.2e}, compact {compact:.2e}, coats ignored {without:.2e}, of bare surfaces {own:.2e}; {light:.4} of the light"
        );
        ensure!((light - 1.0).abs() < 0.01, "{what}: {light} of the light");
        ensure!(error < 1.5 * own + 0.02 * without, "{what}: {error:.2e}, of bare surfaces {own:.2e}");
        ensure!(compact < error + 0.05 * without, "{what}: {compact:.2e} in the compact G-buffer");
        ensure!(without > 3.0 * error, "{what}: {error:.2e}, coats ignored {without:.2e}");
    }
    Ok(())
}

/// Rays along both lobes find what the reference finds.
#[test]
fn reflections_are_those_of_the_reference() -> Result<()> {
    let Some(gpu) = gpu()? else { return Ok(()) };
    let mut scene = balls();
    scene.environment = Some(environment());
    scene.lights.push(sun(Vec3::new(-0.4, 0.8, 0.6)));
    let changes = [
        "stages.reflections=ray-traced",
        "reflections.denoiser=none",
        "reflections.reuse=false",
        "reflections.bounces=3",
        "reflections.precision=32",
        "gbuffer.precision=full",
        "stages.shadows=off",
        "stages.gi=off",
    ];
    let options = ReferenceOptions { only: Only::Reflections, depth: 4, ..ReferenceOptions::default() };
    let truth = truth_of(options, &gpu, &scene, SHOWN, 512)?;
    let (found, _) = mean_of("reflections", &gpu, &scene, &changes, SHOWN, 192)?;
    let (without, _) = mean_of("reflections", &gpu, &bare(&scene), &changes, SHOWN, 64)?;
    let [light, error] = light_and_block_error(&found, &truth.mean, SHOWN.size[0]);
    let [bare_light, bare_error] = light_and_block_error(&without, &truth.mean, SHOWN.size[0]);
    println!("light {light:.4}, error of blocks {error:.4}; without coats {bare_light:.4}, {bare_error:.4}");
    ensure!((light - 1.0).abs() < 0.02 && error < 0.1, "light {light}, blocks {error}");
    ensure!((bare_light - 1.0).abs() > 0.1 && bare_error > 2.0 * error, "without coats: {bare_light}, {bare_error}");
    Ok(())
}

/// Under an even sky the frame's specular and diffuse parts are the reference's, which sees nothing else: a single ball.
#[test]
fn an_even_sky_is_reflected_exactly() -> Result<()> {
    let Some(gpu) = gpu()? else { return Ok(()) };
    for roughness in [0.0, 0.5, 1.0] {
        let mut s = scene("coat", camera([0.0, 0.0, 3.0], [0.0; 3]));
        let spheres = vec![Sphere { centre: Vec3::ZERO, radius: 1.0 }];
        let ball = Mesh { name: "ball".to_owned(), spheres, ..Mesh::default() };
        add(&mut s, ball, coated(material([0.7, 0.3, 0.1], 0.0, 0.6), 1.0, roughness), Affine3A::IDENTITY);
        let even = vec![Vec3::ONE; 8].into();
        s.environment = Some(magpie::scene::Environment {
            name: "even".to_owned(),
            width: 4,
            height: 2,
            radiance: even,
            scale: 1.0,
            turn: 0.0,
        });
        let shown = Shown { size: [16, 16], time: 0.0 };
        let changes = ["stages.ao=off", "gbuffer.precision=full", "reflections.precision=32", "gi.precision=32"];
        for (slot, only) in [("reflections", Only::Reflections), ("gi", Only::Gi)] {
            let (found, _) = mean_of(slot, &gpu, &s, &changes, shown, 1)?;
            let truth = truth_of(ReferenceOptions { only, ..Default::default() }, &gpu, &s, shown, 1024)?;
            let share = found.iter().sum::<DVec3>() / truth.mean.iter().sum::<DVec3>();
            println!("roughness {roughness}, {slot}: {share:.4} of the reference's light");
            ensure!((share - DVec3::ONE).abs().max_element() < 0.01, "roughness {roughness}, {slot}: {share}");
        }
    }
    Ok(())
}

/// What no material asks for costs nothing: only scenes with coats have the channel, of two bytes per pixel, or eight.
#[test]
fn scenes_without_coats_have_no_channel() -> Result<()> {
    let (width, height) = (64, 32);
    let bytes = |scene: &Scene, precision: &str| -> Result<Option<u64>> {
        let (slots, config) = (Slots::default(), config(&[precision])?);
        let extent = Extent::new(width, height);
        let plan = plan_frame(scene, &scene.cameras[0], &slots, &config, Rays::Software, extent)?;
        let named = |name: &str| {
            let all = 0..plan.declaration.resources.len() as u32;
            let found = all.clone().find(|id| plan.declaration.resource_name(*id) == name);
            found.map(|id| plan.declaration.resources[id as usize].bytes())
        };
        named("gbuffer.draw:material").context("no G-buffer")?;
        Ok(named("gbuffer.draw:coat"))
    };
    let pixels = u64::from(width * height);
    for (precision, per_pixel) in [("gbuffer.precision=compact", 2), ("gbuffer.precision=full", 8)] {
        let scene = balls();
        let (with, without) = (bytes(&scene, precision)?, bytes(&bare(&scene), precision)?);
        ensure!(with == Some(per_pixel * pixels) && without.is_none(), "{precision}: {with:?}, {without:?}");
    }
    Ok(())
}
