//! What rays find: radiance of the previous frame, confidence, and the blend with the fallback.
use super::rig::{Seen, at, floor, light, pillar, shown, unlit, upright};
use anyhow::{Context, Result, ensure};
use glam::{Affine3A, DVec3, Vec3};
use magpie::gpu::Gpu;
use magpie::scene::{Light, Material, Scene, Sphere};
use magpie_passes::{FrameRequest, RenderOptions, Renderer, Slots};
use magpie_tests::against::{Shown, mean_of};
use magpie_tests::fixtures::{add, camera, environment, material, plane, scene};
use magpie_tests::harness::{builtin, config, gpu};

const SIZE: [u32; 2] = [96, 64];
const BLEND: &str = "reflections.blend";
/// Nothing that changes from frame to frame.
const SHARP: [&str; 2] = ["reflections.denoiser=none", "reflections.precision=32"];

fn mirror() -> Material {
    material([1.0; 3], 1.0, 0.0)
}

/// The slot's image of a frame, by any implementation.
fn slot(gpu: &Gpu, scene: &Scene, changes: &[&str], frames: u32) -> Result<Vec<[f32; 4]>> {
    let mut all = vec!["reflections.precision=32"];
    all.extend(changes);
    let options = RenderOptions { width: SIZE[0], height: SIZE[1], check: true, ..RenderOptions::default() };
    let mut renderer = Renderer::new(gpu, scene, &Slots::default(), &config(&all)?, options)?;
    renderer.read_slots(&["reflections"])?;
    let mut last = None;
    for _ in 0..frames {
        let request = FrameRequest { camera: &scene.cameras[0], time: 0.0, view: None, read_back: true };
        last = renderer.frame(request)?.context("no frame")?.slots.pop();
    }
    Ok(last.and_then(|(_, image)| image).context("no image of `reflections`")?.values())
}

/// The first frame knows no other: it is what `sky` shows, to the last bit. So are later ones wherever confidence is 0, and everything if no
/// surface is smooth enough. Elsewhere they differ.
#[test]
fn without_confidence_it_is_the_sky() -> Result<()> {
    let Some(gpu) = gpu()? else { return Ok(()) };
    let scene = builtin("courtyard")?;
    for ao in ["off", "screen-space"] {
        let ao = format!("stages.ao={ao}");
        let image = |changes: &[&str], frames: u32| {
            let all: Vec<&str> = changes.iter().copied().chain([ao.as_str()]).collect();
            slot(&gpu, &scene, &all, frames)
        };
        let sky = image(&["stages.reflections=sky"], 1)?;
        let lit = sky.iter().filter(|v| light(v) > 0.0).count();
        ensure!(lit > sky.len() / 3, "{lit} pixels reflect the sky");
        for lobe in ["reflections.lobe=stochastic", "reflections.lobe=cone"] {
            let own = ["stages.reflections=screen-space", lobe];
            ensure!(image(&own, 1)? == sky, "{lobe}: the first frame is not the sky's");
            let third = image(&own, 3)?;
            let changed = third.iter().zip(&sky).filter(|(a, b)| a != b).count();
            ensure!(changed > sky.len() / 40, "{lobe}: {changed} pixels differ from the sky");
            let rough = image(&["stages.reflections=screen-space", lobe, "reflections.roughness_limit=0"], 3)?;
            ensure!(rough == sky, "{lobe}: without rays it is not the sky");
        }
        let raw = ["stages.reflections=screen-space", "reflections.denoiser=none"];
        let third = image(&raw, 3)?;
        let confidence =
            shown(&gpu, &scene, &[ao.as_str(), raw[1], SHARP[1]], SIZE, 3, ("reflections.march", "confidence"))?;
        let (mut same, mut found) = (0, 0);
        for ((own, sky), confidence) in third.iter().zip(&sky).zip(&confidence[2]) {
            if confidence[0] == 0.0 {
                ensure!(own == sky, "no confidence, and {own:?} instead of {sky:?}");
                same += 1;
            } else {
                found += 1;
            }
        }
        println!("{ao}: {same} pixels as the sky shows them, {found} others");
        ensure!(same > 500 && found > 100, "{same} pixels as the sky shows them, {found} others");
    }
    Ok(())
}

/// A mirror floor before a wall that goes on beyond the picture on all sides.
fn before_a_wall() -> Scene {
    let mut s = scene("wall", camera([0.0, 1.0, 5.0], [0.0, 0.9, 0.0]));
    floor(&mut s, mirror());
    add(&mut s, plane(20.0), unlit([0.5, 0.5, 0.5]), upright(-3.0, 0.0));
    s.environment = Some(environment());
    s
}

/// Confidence falls to 0 towards the borders of the picture, without a step, and towards the greatest length of rays.
#[test]
fn confidence_fades() -> Result<()> {
    let Some(gpu) = gpu()? else { return Ok(()) };
    let scene = before_a_wall();
    let seen = Seen::new(&scene.cameras[0], SIZE);
    let confidence = |changes: &[&str]| -> Result<Vec<f32>> {
        let all: Vec<&str> = SHARP.into_iter().chain(changes.iter().copied()).collect();
        let image = shown(&gpu, &scene, &all, SIZE, 2, ("reflections.march", "confidence"))?;
        // Over four, and weighted with the sample's share of the lobe, which is that of a mirror here.
        Ok(image[1].iter().map(|v| 4.0 * v[0]).collect())
    };
    let floor_from = at(seen.project(DVec3::new(0.0, 0.0, -2.9)), SIZE) as u32 / SIZE[0] + 1;
    for edge in ["0.1", "0.3"] {
        let found = confidence(&["reflections.lobe=cone", &format!("reflections.edge={edge}")])?;
        let pixel = |x: u32, y: u32| found[(y * SIZE[0] + x) as usize];
        let (mut step, mut least, mut most) = (0.0_f32, 1.0_f32, 0.0_f32);
        for y in floor_from..SIZE[1] - 1 {
            for x in 0..SIZE[0] - 1 {
                let here = pixel(x, y);
                step = step.max((here - pixel(x + 1, y)).abs()).max((here - pixel(x, y + 1)).abs());
                (least, most) = (least.min(here), most.max(here));
            }
        }
        println!("edge {edge}: confidence {least:.3} to {most:.3}, steps of at most {step:.3}");
        // The fade over 10 of 96 columns has a slope of 1.5 / 9.6.
        ensure!(least < 0.02 && most > 0.98 && step < 0.25, "edge {edge}: {least} to {most}, steps of {step}");
    }
    // A point 4 m before the wall is confident of it up to a length of four thirds of that.
    let point = at(seen.project(DVec3::new(0.0, 0.0, 1.0)), SIZE);
    let of = |distance: &str| -> Result<f32> {
        Ok(confidence(&["reflections.lobe=cone", &format!("reflections.distance={distance}")])?[point])
    };
    let [gone, fading, whole] = ["3.5", "4.9", "40"].map(of);
    let (gone, fading, whole) = (gone?, fading?, whole?);
    println!("rays of at most 3.5 m: {gone:.3}, 4.9 m: {fading:.3}, 40 m: {whole:.3}");
    ensure!(gone == 0.0 && fading > 0.05 && fading < 0.95 * whole && whole > 0.9, "{gone}, {fading}, {whole}");
    Ok(())
}

/// A mirror shows the radiance that the wall had one frame ago, where the wall is seen in the mirror direction.
#[test]
fn a_mirror_shows_what_the_previous_frame_saw() -> Result<()> {
    let Some(gpu) = gpu()? else { return Ok(()) };
    let mut scene = before_a_wall();
    pillar(&mut scene, Vec3::new(0.4, 2.0, 0.02), Vec3::new(0.6, 0.5, -2.9), unlit([0.9, 0.1, 0.1]));
    let seen = Seen::new(&scene.cameras[0], SIZE);
    for march in ["pyramid", "linear"] {
        let march = format!("reflections.march={march}");
        for lobe in ["reflections.lobe=cone", "reflections.lobe=stochastic"] {
            let all: Vec<&str> = SHARP.into_iter().chain([march.as_str(), "reflections.stride=1", lobe]).collect();
            let image = &shown(&gpu, &scene, &all, SIZE, 2, (BLEND, "radiance"))?[1];
            let mut compared = 0;
            for y in SIZE[1] / 2..SIZE[1] {
                for x in 20..SIZE[0] - 20 {
                    let place = glam::DVec2::new(f64::from(x) + 0.5, f64::from(y) + 0.5);
                    let start = seen.on_plane(place, DVec3::ZERO, DVec3::Y);
                    if start.z < -2.0 || start.z > 3.0 {
                        continue;
                    }
                    let eye = scene.cameras[0].eye();
                    let way = (start - eye) * DVec3::new(1.0, -1.0, 1.0);
                    let hit = start + way * ((-2.88 - start.z) / way.z);
                    let there = seen.project(hit);
                    // Away from the edges of the red board, and where confidence is whole.
                    let off = (hit.x - 0.6).abs() - 0.4;
                    if off.abs() < 0.15
                        || (hit.y - 0.5).abs() > 1.8
                        || there.y < 12.0
                        || there.x < 12.0
                        || there.x > 84.0
                    {
                        continue;
                    }
                    let wanted = if off < 0.0 { [0.9, 0.1, 0.1] } else { [0.5; 3] };
                    let found = image[(y * SIZE[0] + x) as usize];
                    let apart = (0..3).map(|c| (f64::from(found[c]) - wanted[c]).abs()).fold(0.0, f64::max);
                    ensure!(apart < 0.03, "{march}, {lobe}, pixel {x}, {y}: {found:?}, wanted {wanted:?}");
                    compared += 1;
                }
            }
            ensure!(compared > 300, "{march}, {lobe}: {compared} pixels");
        }
    }
    Ok(())
}

/// While the camera moves, the previous frame is looked up where the camera saw the wall then: a mirror shows stripes of the wall where they are
/// now, not where they were.
#[test]
fn a_mirror_follows_the_camera() -> Result<()> {
    let Some(gpu) = gpu()? else { return Ok(()) };
    let mut scene = before_a_wall();
    for stripe in 0..9 {
        let x = 0.8 * stripe as f32 - 3.2;
        pillar(&mut scene, Vec3::new(0.2, 3.0, 0.02), Vec3::new(x, 0.5, -2.9), unlit([0.9, 0.1, 0.1]));
    }
    for march in ["reflections.march=pyramid", "reflections.march=linear"] {
        let changes = [
            "stages.reflections=screen-space",
            "stages.gi=off",
            "stages.ao=off",
            "reflections.lobe=cone",
            SHARP[1],
            march,
        ];
        let options = RenderOptions { width: SIZE[0], height: SIZE[1], check: true, ..RenderOptions::default() };
        let mut renderer = Renderer::new(&gpu, &scene, &Slots::default(), &config(&changes)?, options)?;
        let (mut compared, mut wrong) = (0, 0);
        for frame in 0..6 {
            // About 4 pixels of the wall each frame.
            let x = 0.15 * f64::from(frame) - 0.4;
            let moved = camera([x, 1.0 + 0.03 * f64::from(frame), 5.0], [x, 0.9, 0.0]);
            let request = FrameRequest { camera: &moved, time: 0.0, view: Some((BLEND, "radiance")), read_back: true };
            let result = renderer.frame(request)?.context("no frame")?;
            ensure!(result.findings.is_empty(), "{}", result.findings[0]);
            let image = result.images.context("no picture")?.linear.values();
            if frame == 0 {
                continue;
            }
            let seen = Seen::new(&moved, SIZE);
            for y in 40..SIZE[1] {
                for x in 0..SIZE[0] {
                    let place = glam::DVec2::new(f64::from(x) + 0.5, f64::from(y) + 0.5);
                    let start = seen.on_plane(place, DVec3::ZERO, DVec3::Y);
                    let way = (start - moved.eye()) * DVec3::new(1.0, -1.0, 1.0);
                    let hit = start + way * ((-2.88 - start.z) / way.z);
                    let there = seen.project(hit);
                    let across = (hit.x + 3.2).rem_euclid(0.8);
                    let off = across.min(0.8 - across) - 0.2;
                    if start.z < -2.5
                        || hit.x.abs() > 2.0
                        || off.abs() < 0.08
                        || there.y < 12.0
                        || !(14.0..82.0).contains(&there.x)
                    {
                        continue;
                    }
                    let green = if off < 0.0 { 0.1 } else { 0.5 };
                    compared += 1;
                    wrong += usize::from((image[(y * SIZE[0] + x) as usize][1] - green).abs() > 0.06);
                }
            }
        }
        println!("{march}: {wrong} of {compared} pixels show another stripe than is there");
        ensure!(compared > 2000 && wrong * 50 < compared, "{march}: {wrong} of {compared}");
    }
    Ok(())
}

/// A corridor between two mirrors, with a lamp at its end that only shows its colour.
fn corridor() -> Scene {
    let mut s = scene("corridor", camera([0.0, 1.0, 9.0], [0.0, 1.0, 0.0]));
    for side in [-0.55, 0.55] {
        pillar(&mut s, Vec3::new(0.05, 3.0, 6.0), Vec3::new(side, 1.0, 2.0), material([0.98; 3], 1.0, 0.0));
    }
    pillar(&mut s, Vec3::new(0.12, 0.4, 0.12), Vec3::new(0.15, 1.0, 0.5), unlit([1.0, 0.7, 0.2]));
    s
}

/// The light of each frame between the mirrors, and the brightest value.
fn bounces(gpu: &Gpu, scene: &Scene, changes: &[&str], frames: u32) -> Result<(Vec<f64>, f32)> {
    let hard = ["shadows.edges=hard", "direct.area=0", "reflections.lobe=cone", "reflections.edge=0.02"];
    let all: Vec<&str> = hard.into_iter().chain(SHARP).chain(changes.iter().copied()).collect();
    let frames = shown(gpu, scene, &all, SIZE, frames, (BLEND, "radiance"))?;
    let most = frames.iter().flatten().map(|v| v[0]).fold(0.0, f32::max);
    Ok((frames.iter().map(|frame| frame.iter().map(light).sum()).collect(), most))
}

/// Each frame adds a reflection of the frame before: a lamp between two mirrors is seen once more in the third frame than in the second, and in
/// a box of metal new light comes for some frames. Then nothing changes any more, for 200 frames, and no reflection is brighter than the lamp.
#[test]
fn facing_mirrors_show_one_more_bounce_each_frame() -> Result<()> {
    let Some(gpu) = gpu()? else { return Ok(()) };
    let (lamp, most) = bounces(&gpu, &corridor(), &[], 200)?;
    println!("light of a lamp between mirrors: {:.2?}, in the last frame {:.3}", &lamp[..6], lamp[199]);
    ensure!(lamp[0] == 0.0 && lamp[1] > 20.0 && lamp[2] > 1.5 * lamp[1], "{:?}", &lamp[..4]);
    ensure!(most <= 1.001, "a reflection of {most}, of a lamp of 1");
    ensure!((lamp[199] / lamp[20] - 1.0).abs() < 1e-3, "{} after 20 frames, {} after 200", lamp[20], lamp[199]);

    let mut room = builtin("cornell")?;
    for material in &mut room.materials {
        (material.roughness, material.metalness) = (0.4, 1.0);
    }
    let (metal, _) = bounces(&gpu, &room, &[], 200)?;
    println!("light of a box of metal: {:.2?}, in the last frame {:.3}", &metal[..8], metal[199]);
    let more = (1..6).filter(|&n| metal[n] > 1.001 * metal[n - 1]).count();
    ensure!(metal[0] == 0.0 && more >= 4, "{more} of five frames have more light: {:?}", &metal[..8]);
    // A geometric series: what is still to come is bounded by the last additions.
    let ratio = (metal[4] - metal[3]) / (metal[3] - metal[2]);
    ensure!(ratio > 0.0 && ratio < 0.9, "additions grow by {ratio}");
    let late = metal[100..].iter().fold(0.0_f64, |most, sum| most.max((sum / metal[199] - 1.0).abs()));
    ensure!(late < 2e-3 && metal[199] < 3.0 * metal[1], "the light changes by {late} after 100 frames: {}", metal[199]);
    Ok(())
}

/// A lamp over a glossy floor. `direct` samples its surface and gives the highlight, so the reflection must not show its emission again.
#[test]
fn a_lamp_has_one_highlight() -> Result<()> {
    let Some(gpu) = gpu()? else { return Ok(()) };
    let emission = Vec3::splat(40.0);
    let lamp = |of: Material| {
        let mut s = scene("lamp", camera([0.0, 1.0, 5.0], [0.0, 0.6, 0.0]));
        floor(&mut s, material([0.9; 3], 1.0, 0.15));
        let ball = Sphere { centre: Vec3::new(0.0, 0.9, 0.0), radius: 0.3 };
        let balls = magpie::scene::Mesh { name: "ball".to_owned(), spheres: vec![ball], ..Default::default() };
        add(&mut s, balls, of, Affine3A::IDENTITY);
        s
    };
    let emitter = lamp(Material { emission, ..material([0.5; 3], 0.0, 1.0) });
    let shining = lamp(Material { base_colour: emission.extend(1.0), ..unlit([1.0; 3]) });
    let of = |scene: &Scene, slot: &str, reflections: &str, frames: u32| -> Result<f64> {
        let changes = [
            reflections,
            "reflections.roughness_limit=0.5",
            "stages.gi=off",
            "stages.ao=off",
            "reflections.denoiser=none",
            "direct.denoiser=none",
        ];
        let changes = &changes[..if reflections.ends_with("off") { 1 } else { 5 }];
        let (found, _) = mean_of(slot, &gpu, scene, changes, Shown { size: SIZE, time: 0.0 }, frames)?;
        // Below the lamp, where the floor reflects it.
        let seen = Seen::new(&scene.cameras[0], SIZE);
        let highlight = at(seen.project(DVec3::new(0.0, -0.9, 0.0)), SIZE);
        let around = |i: &usize| (i % 96).abs_diff(highlight % 96) < 5 && (i / 96).abs_diff(highlight / 96) < 5;
        Ok((0..found.len()).filter(around).map(|i| found[i].element_sum()).sum::<f64>() / 81.0)
    };
    let screen = "stages.reflections=screen-space";
    let direct = of(&emitter, "direct", screen, 24)?;
    let reflected = of(&emitter, "reflections", screen, 24)?;
    let shown = of(&shining, "reflections", screen, 24)?;
    println!(
        "around the highlight: direct light {direct:.2}, reflected on the screen {reflected:.4}; an unlit ball {shown:.2}"
    );
    ensure!(direct > 20.0 && reflected < 0.02 * direct, "direct {direct}, reflected {reflected}");
    // One that lights nothing is seen as a reflection instead.
    ensure!(shown > 0.3 * direct, "an unlit ball {shown}, direct light of one that emits {direct}");
    Ok(())
}

/// A wall that a bright light from the side fills, in a mirror: the highlight's light is not view-dependent there, so the picture in the mirror
/// is the wall's light to within a few percent of the reference's.
#[test]
fn light_of_a_wall_agrees_with_the_reference() -> Result<()> {
    use magpie_passes::reference::{Only, ReferenceOptions};
    use magpie_tests::against::{light_and_block_error, truth_of};
    let Some(gpu) = gpu()? else { return Ok(()) };
    let mut s = scene("lit", camera([0.0, 1.2, 5.0], [0.0, 0.7, 0.0]));
    add(&mut s, plane(3.0), material([0.9; 3], 1.0, 0.2), Affine3A::IDENTITY);
    add(&mut s, plane(3.0), material([0.8, 0.3, 0.2], 0.0, 1.0), upright(-2.0, 0.0));
    s.lights.push(Light::Directional {
        direction: Vec3::new(-0.2, -0.5, -1.0).normalize(),
        illuminance: Vec3::splat(4.0),
        angular_radius: 0.0,
    });
    s.light_nodes.resize(1, None);
    let shown = Shown { size: SIZE, time: 0.0 };
    let options = ReferenceOptions { only: Only::Reflections, depth: 2, ..ReferenceOptions::default() };
    let truth = truth_of(options, &gpu, &s, shown, 64)?;
    let changes = [
        "stages.reflections=screen-space",
        "stages.gi=off",
        "stages.ao=off",
        "reflections.denoiser=none",
        "reflections.edge=0.02",
    ];
    let (found, _) = mean_of("reflections", &gpu, &s, &changes, shown, 48)?;
    let seen = Seen::new(&s.cameras[0], SIZE);
    // The middle of the floor, whose lobes stay within the picture.
    let inner = |i: usize| {
        let place = glam::DVec2::new((i % 96) as f64 + 0.5, (i / 96) as f64 + 0.5);
        let p = seen.on_plane(place, DVec3::ZERO, DVec3::Y);
        p.x.abs() < 1.2 && p.z > -1.8 && p.z < 0.5 && (p - s.cameras[0].eye()).dot(seen.direction(place)) > 0.0
    };
    let part = |values: &[DVec3]| -> Vec<DVec3> {
        values.iter().enumerate().map(|(i, v)| if inner(i) { *v } else { DVec3::ZERO }).collect()
    };
    let [ratio, error] = light_and_block_error(&part(&found), &part(&truth.mean), SIZE[0]);
    println!("light {ratio:.4} of the reference's, error of blocks {error:.4}");
    ensure!((ratio - 1.0).abs() < 0.04 && error < 0.25, "light {ratio}, blocks {error}");
    Ok(())
}
