//! Shadow maps against rays, their known errors in numbers, and when they are redrawn.
#[path = "shadow_maps/rig.rs"]
mod rig;

use anyhow::{Result, ensure};
use glam::{DVec3, Vec3};
use magpie::scene::{Light, supply_missing};
use magpie_shaders::shadow_map::{UNSURE_ANY, UNSURE_CONTACT, UNSURE_OUTSIDE, UNSURE_PENUMBRA, UNSURE_RESOLUTION};
use magpie_tests::fixtures::{add, block, material, sun};
use magpie_tests::harness::{builtin, gpu};
use rig::{Rig, at, floor, on_floor, passes, penumbrae, shadows, things, truth, values};

const MAPS: &str = "stages.shadows=shadow-map";

/// Local lights of every kind that illuminate the objects.
fn lamps() -> Vec<(&'static str, Light)> {
    let (position, intensity) = (DVec3::new(1.0, 3.0, 1.5), Vec3::splat(30.0));
    let direction = (-position).as_vec3().normalize();
    let across = direction.any_orthonormal_vector() * 0.1;
    vec![
        ("sun", sun(Vec3::new(0.5, 0.8, 0.4))),
        ("point", Light::Point { position, intensity, range: None }),
        ("spot", Light::Spot { position, direction, intensity, range: None, inner: 0.5, outer: 0.9 }),
        (
            "rectangle",
            Light::Rectangle { centre: position, half_u: across, half_v: direction.cross(across), radiance: intensity },
        ),
        ("disc", Light::Disc { centre: position, normal: direction, radius: 0.1, radiance: intensity }),
        ("sphere", Light::Sphere { centre: position, radius: 0.1, radiance: intensity }),
    ]
}

/// Share of pixels that differ by more than one half, and the lit share of the ground truth.
fn apart(got: &[[f32; 4]], want: &[[f32; 4]], channel: usize) -> (f64, f64) {
    let count = want.len() as f64;
    let differ = got.iter().zip(want).filter(|(g, w)| (g[channel] - w[channel]).abs() > 0.5).count();
    (differ as f64 / count, want.iter().filter(|w| w[channel] > 0.5).count() as f64 / count)
}

#[test]
fn maps_agree_with_hard_rays_for_every_kind_of_light() -> Result<()> {
    let Some(gpu) = gpu()? else { return Ok(()) };
    for (name, light) in lamps() {
        let scene = things(&[light]);
        let want = truth(&gpu, &scene)?;
        for (filter, limit) in [("none", 0.002), ("pcf", 0.002)] {
            let got = shadows(&gpu, &scene, &[MAPS, &format!("shadows.filter={filter}")])?;
            let (differ, lit) = apart(&got, &want, 0);
            println!("{name}, {filter}: {:.3} % of the pixels differ, {:.1} % are lit", 100.0 * differ, 100.0 * lit);
            ensure!(lit > 5.0 * limit && lit < 1.0 - 5.0 * limit, "{name}: the truth says little, {lit}");
            ensure!(differ < limit, "{name}, {filter}: {differ} of the pixels differ");
        }
    }
    Ok(())
}

#[test]
fn four_lights_share_an_image_and_each_has_its_own_map() -> Result<()> {
    let Some(gpu) = gpu()? else { return Ok(()) };
    let lights: Vec<Light> = lamps().into_iter().take(4).map(|(_, light)| light).collect();
    let scene = things(&lights);
    let (want, got) = (truth(&gpu, &scene)?, shadows(&gpu, &scene, &[MAPS, "shadows.filter=pcf"])?);
    for channel in 0..4 {
        let (differ, lit) = apart(&got, &want, channel);
        ensure!(differ < 0.002 && lit > 0.05, "channel {channel}: {differ} differ, {lit} are lit");
    }
    Ok(())
}

#[test]
fn where_maps_are_wrong_they_are_not_sure() -> Result<()> {
    let Some(gpu) = gpu()? else { return Ok(()) };
    for (name, light) in lamps() {
        let scene = things(&[light]);
        let want = truth(&gpu, &scene)?;
        let changes =
            [MAPS, "shadows.filter=pcf", "shadows.doubts=true", "shadows.map_size=512", "shadows.lamp_map_size=256"];
        let mut rig = Rig::new(&gpu, &scene, &changes)?;
        let got = values(&rig.frame(&scene.cameras[0], 0.0)?)?;
        let unsure = rig.view(&scene.cameras[0], ("shadows.map_look", "unsure"))?;
        let bits = |p: usize, reason: u32| unsure[p][0] as u32 & reason != 0;
        let wrong: Vec<usize> = (0..want.len()).filter(|p| (got[*p][0] - want[*p][0]).abs() > 0.25).collect();
        let known = wrong.iter().filter(|p| bits(**p, UNSURE_ANY)).count();
        let share = |reason: u32| (0..want.len()).filter(|p| bits(*p, reason)).count() as f64 / want.len() as f64;
        println!(
            "{name}: {} pixels are wrong, {known} of them unsure; unsure are {:.1} %: penumbra {:.1}, contact {:.1}, resolution {:.1}, outside {:.1}",
            wrong.len(),
            100.0 * share(UNSURE_ANY),
            100.0 * share(UNSURE_PENUMBRA),
            100.0 * share(UNSURE_CONTACT),
            100.0 * share(UNSURE_RESOLUTION),
            100.0 * share(UNSURE_OUTSIDE)
        );
        ensure!(
            wrong.len() > 10 && 20 * (wrong.len() - known) <= wrong.len(),
            "{name}: {known} of {} wrong ones",
            wrong.len()
        );
        ensure!((0.005..0.35).contains(&share(UNSURE_ANY)), "{name}: {} of the pixels are unsure", share(UNSURE_ANY));
    }
    Ok(())
}

#[test]
fn a_lit_plane_has_no_acne_down_to_grazing_light() -> Result<()> {
    let Some(gpu) = gpu()? else { return Ok(()) };
    let mut scene = floor(20.0, Vec3::new(0.0, 3.0, 12.0), Vec3::new(0.0, 0.0, 4.0));
    supply_missing(&mut scene);
    let mut failed = Vec::new();
    for degrees in [90.0_f32, 75.0, 60.0, 45.0, 30.0, 20.0, 10.0, 5.0, 3.0, 2.0, 1.0, 0.5, 0.2, 0.1] {
        let (sine, cosine) = degrees.to_radians().sin_cos();
        scene.lights = vec![sun(Vec3::new(0.8 * cosine, sine, 0.6 * cosine))];
        for filter in ["none", "pcf", "pcss"] {
            if let Light::Directional { angular_radius, .. } = &mut scene.lights[0] {
                *angular_radius =
                    if filter == "pcss" { 0.27_f32.to_radians().min(0.5 * degrees.to_radians()) } else { 0.0 };
            }
            let lit = shadows(&gpu, &scene, &[MAPS, &format!("shadows.filter={filter}")])?;
            let floor = truth(&gpu, &scene)?;
            let seen = floor.iter().filter(|v| v[0] > 0.5).count();
            let dark = lit.iter().zip(&floor).filter(|(l, f)| f[0] > 0.5 && l[0] < 0.99).count();
            println!("{degrees} degrees, {filter}: {dark} of {seen} pixels are dark");
            ensure!(seen > 5000, "{seen} pixels of floor");
            if dark > 0 {
                failed.push((degrees, filter, dark));
            }
        }
    }
    let highest = failed.iter().map(|(degrees, ..)| *degrees).fold(0.0, f32::max);
    ensure!(highest < 1.0, "acne: {failed:?}");
    Ok(())
}

/// A block on a floor in slanted light: width of the lit gap at its foot (peter-panning), in texels on the floor.
#[test]
fn shadows_begin_at_the_foot_of_what_casts_them() -> Result<()> {
    let Some(gpu) = gpu()? else { return Ok(()) };
    for degrees in [60.0_f32, 45.0, 30.0, 15.0] {
        let mut scene = floor(8.0, Vec3::new(0.3, 1.2, 0.0), Vec3::new(0.3, 0.0, 0.0));
        add(&mut scene, block(Vec3::new(0.5, 0.5, 4.0)), material([0.5; 3], 0.0, 1.0), at(-0.5, 0.5, 0.0));
        scene.lights = vec![sun(Vec3::new(-degrees.to_radians().cos(), degrees.to_radians().sin(), 0.0))];
        supply_missing(&mut scene);
        let want = truth(&gpu, &scene)?;
        for size in [512, 2048] {
            let got = shadows(&gpu, &scene, &[MAPS, "shadows.filter=none", &format!("shadows.map_size={size}")])?;
            let place = |p: &usize| on_floor(&scene.cameras[0], *p).x;
            // Half of the shadow, without its far edge.
            let half = 0.5 / f64::from(degrees.to_radians().tan());
            let ground = |p: &usize| (0.0..half.min(0.6)).contains(&place(p));
            let leaks = (0..got.len()).filter(ground).filter(|p| want[*p][0] < 0.5 && got[*p][0] > 0.5);
            let gap = leaks.map(|p| place(&p)).fold(0.0, f64::max);
            ensure!((0..got.len()).filter(ground).any(|p| want[p][0] < 0.5), "no shadow");
            // One map for the whole scene, 16 m wide along x and more across it.
            let texel = 17.0 / f64::from(size) / f64::from(degrees.to_radians().sin());
            println!("{degrees} degrees, {size} texels: lit up to {:.4} m, {:.2} texels", gap, gap / texel);
            ensure!(gap < 2.0 * texel, "{degrees} degrees, {size}: {gap} m are lit, a texel is {texel} m");
        }
    }
    Ok(())
}

/// A slab on a floor: how much of its contact shadow is found if it is lower than a texel is wide.
#[test]
fn what_is_lower_than_a_texel_loses_its_shadow() -> Result<()> {
    let Some(gpu) = gpu()? else { return Ok(()) };
    // One map for the whole scene, which is 16 m wide, in cells of a grid of 2 m.
    let texel = 17.0 / 512.0;
    for texels in [0.25_f32, 0.5, 1.0, 2.0, 4.0] {
        let height = texels * texel;
        let mut scene = floor(8.0, Vec3::new(0.0, 1.0, 1.0), Vec3::ZERO);
        add(
            &mut scene,
            block(Vec3::new(0.3, 0.5 * height, 4.0)),
            material([0.5; 3], 0.0, 1.0),
            at(-0.3, 0.5 * height, 0.0),
        );
        scene.lights = vec![sun(Vec3::new(-1.0, 0.5, 0.0))];
        supply_missing(&mut scene);
        let want = truth(&gpu, &scene)?;
        let got = shadows(&gpu, &scene, &[MAPS, "shadows.filter=none", "shadows.map_size=512"])?;
        let ground = |p: &usize| (0.0..2.0 * f64::from(height)).contains(&on_floor(&scene.cameras[0], *p).x);
        let dark: Vec<usize> = (0..got.len()).filter(ground).filter(|p| want[*p][0] < 0.5).collect();
        let found = dark.iter().filter(|p| got[**p][0] < 0.5).count();
        println!("a slab of {texels} texels: {found} of {} dark pixels are found", dark.len());
        ensure!(dark.len() > 20, "{} dark pixels", dark.len());
        ensure!(texels < 4.0 || 10 * found > 8 * dark.len(), "{texels} texels: {found} of {}", dark.len());
    }
    Ok(())
}

#[test]
fn a_thin_wall_leaks_no_more_than_a_texel() -> Result<()> {
    let Some(gpu) = gpu()? else { return Ok(()) };
    // The sun is behind a wall one millimetre thick.
    let mut scene = floor(8.0, Vec3::new(0.0, 2.0, 5.0), Vec3::new(0.0, 0.5, 0.0));
    add(&mut scene, block(Vec3::new(4.0, 1.0, 0.0005)), material([0.5; 3], 0.0, 1.0), at(0.0, 1.0, 0.0));
    scene.lights = vec![sun(Vec3::new(0.2, 0.35, -1.0))];
    supply_missing(&mut scene);
    let want = truth(&gpu, &scene)?;
    for filter in ["none", "pcf"] {
        let got = shadows(&gpu, &scene, &[MAPS, &format!("shadows.filter={filter}")])?;
        let dark = want.iter().filter(|w| w[0] < 0.5).count();
        let leaks = got.iter().zip(&want).filter(|(g, w)| w[0] < 0.5 && g[0] > 0.5).count();
        println!("{filter}: {leaks} of {dark} dark pixels are lit");
        ensure!(dark > 3000 && leaks * 200 < dark, "{leaks} of {dark} dark pixels are lit");
    }
    Ok(())
}

#[test]
fn the_penumbra_of_pcss_has_about_the_analytic_width() -> Result<()> {
    let Some(gpu) = gpu()? else { return Ok(()) };
    let widths = penumbrae(|scene| shadows(&gpu, scene, &[MAPS, "shadows.taps=64"]))?;
    ensure!(widths.iter().all(|r| (0.9..1.1).contains(r)), "{widths:?}");
    Ok(())
}

#[test]
fn a_map_is_drawn_anew_only_where_something_moved() -> Result<()> {
    let Some(gpu) = gpu()? else { return Ok(()) };
    let scene = builtin("carousel")?;
    let mut rig = Rig::new(&gpu, &scene, &[MAPS, "shadows.map_size=512", "shadows.lamp_map_size=256"])?;
    let drawn = |names: &[String]| {
        names.iter().filter(|n| n.starts_with("shadows.map_") && n.ends_with(char::is_numeric)).count()
    };
    let mut frame = |time: f64| -> Result<(usize, Vec<[f32; 4]>)> {
        let result = rig.frame(&scene.cameras[0], time)?;
        Ok((drawn(&passes(&result)), values(&result)?))
    };
    let ((first, before), (second, same), (third, after)) = (frame(0.0)?, frame(0.0)?, frame(0.5)?);
    ensure!(first > 1 && second == 0 && third > 0, "{first}, {second}, {third} layers were drawn");
    ensure!(before == same, "a map that was kept is not the one that was drawn");
    ensure!(before != after, "nothing moved");
    // Maps that were kept equal those of a new renderer.
    let mut fresh = Rig::new(&gpu, &scene, &[MAPS, "shadows.map_size=512", "shadows.lamp_map_size=256"])?;
    ensure!(values(&fresh.frame(&scene.cameras[0], 0.5)?)? == after, "a map was kept that should not have been");
    Ok(())
}

#[test]
fn cascades_are_drawn_anew_only_every_few_steps_of_the_camera() -> Result<()> {
    let Some(gpu) = gpu()? else { return Ok(()) };
    let scene = builtin("courtyard")?;
    let mut rig = Rig::new(&gpu, &scene, &[MAPS, "shadows.map_size=512", "shadows.per_light=point=none"])?;
    let (mut drawn, mut still) = (0, 0);
    for step in 0..12 {
        let mut camera = scene.cameras[0].clone();
        camera.world_from_camera.translation.x += 0.02 * f64::from(step);
        let names = passes(&rig.frame(&camera, 0.0)?);
        let layers = names.iter().filter(|n| n.starts_with("shadows.map_0_")).count();
        drawn += layers;
        still += usize::from(layers == 0);
    }
    println!("{drawn} layers in 12 frames, none in {still} of them");
    ensure!((1..12).contains(&drawn) && still >= 6, "{drawn} layers in 12 frames, none in {still} of them");
    Ok(())
}

#[test]
fn lights_without_shadows_and_marches_without_length_have_no_pass() -> Result<()> {
    let Some(gpu) = gpu()? else { return Ok(()) };
    let scene = things(&[sun(Vec3::new(0.5, 0.8, 0.4)), lamps().remove(1).1]);
    let names = |changes: &[&str]| -> Result<Vec<String>> {
        Ok(passes(&Rig::new(&gpu, &scene, changes)?.frame(&scene.cameras[0], 0.0)?))
    };
    let is = |names: &[String], part: &str| names.iter().any(|n| n.starts_with(part));
    let both = names(&[MAPS])?;
    ensure!(is(&both, "shadows.map_0_") && is(&both, "shadows.map_1_") && is(&both, "shadows.map_look"), "{both:?}");
    ensure!(!is(&both, "shadows.contact") && !is(&both, "shadows.trace"), "{both:?}");
    let one = names(&[MAPS, "shadows.per_light=point=none", "shadows.contact=0.2"])?;
    ensure!(is(&one, "shadows.map_0_") && !is(&one, "shadows.map_1_") && is(&one, "shadows.contact"), "{one:?}");
    let mixed = names(&[MAPS, "shadows.per_light=point=rays"])?;
    ensure!(!is(&mixed, "shadows.map_1_") && is(&mixed, "shadows.trace"), "{mixed:?}");
    let none = names(&[MAPS, "shadows.per_light=point=none sun=none"]);
    ensure!(none.is_err() || !is(&none?, "shadows."), "passes of lights without shadows");
    Ok(())
}
