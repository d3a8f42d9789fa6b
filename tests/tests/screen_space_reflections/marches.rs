//! The march: which pixels it looks at, what it meets, and where.
use super::rig::{Found, LISTED, Rays, Seen, at, floor, looked_at, marched, pillar, upright};
use anyhow::{Result, ensure};
use glam::{Affine3A, DVec2, DVec3, Quat, Vec3};
use magpie::scene::Scene;
use magpie_tests::fixtures::{add, camera, material, plane, scene};
use magpie_tests::harness::{builtin, gpu};
use std::collections::HashSet;

const SIZE: [u32; 2] = [96, 64];

/// No ray looks at a pixel twice, whatever the direction; steps of equal length look at as many pixels as they are told to, in one row or
/// column after the other.
#[test]
fn no_pixel_is_looked_at_twice() -> Result<()> {
    let Some(gpu) = gpu()? else { return Ok(()) };
    let scene = builtin("cornell")?;
    let size = [48, 36];
    for stride in [None, Some(1.0), Some(3.0), Some(8.0)] {
        for jitter in [0.0, 0.7, -1.0] {
            // Nothing is thick, so that rays go on behind things, for as long as they can.
            let rays = Rays { stride, jitter, thickness: 0.0, ..Rays::towards(Vec3::ZERO) };
            let lists = looked_at(&gpu, &scene, size, rays)?;
            let (mut looks, mut longest) = (0, 0);
            for (ray, list) in lists.chunks(LISTED as usize).enumerate() {
                let pixels: Vec<[i32; 2]> =
                    list.iter().take_while(|v| v[2] > 0.0).map(|v| [v[0] as i32, v[1] as i32]).collect();
                let different: HashSet<_> = pixels.iter().collect();
                ensure!(different.len() == pixels.len(), "stride {stride:?}, ray {ray}: {pixels:?}");
                let own = [ray as i32 % size[0] as i32, ray as i32 / size[0] as i32];
                ensure!(!pixels.contains(&own), "stride {stride:?}, ray {ray} looks at its own pixel");
                if let Some(stride) = stride {
                    let apart = |a: &[i32; 2], b: &[i32; 2]| (a[0] - b[0]).abs().max((a[1] - b[1]).abs());
                    let uniform = pixels.windows(2).all(|w| apart(&w[0], &w[1]) == stride as i32);
                    ensure!(uniform, "stride {stride}, ray {ray}: {pixels:?}");
                }
                looks += pixels.len();
                longest = longest.max(pixels.len());
            }
            println!("stride {stride:?}, jitter {jitter}: {looks} looks, at most {longest} of a ray");
            ensure!(looks > 2000 && longest > 3, "stride {stride:?}: {looks} looks, at most {longest}");
        }
    }
    Ok(())
}

/// A floor with a wall behind, a pillar before it on the right, and a board that hides part of a wall beyond.
fn cases() -> Scene {
    let mut s = scene("cases", camera([0.0, 2.0, 7.0], [0.0, 1.0, 0.0]));
    let grey = || material([0.5; 3], 0.0, 0.5);
    floor(&mut s, grey());
    pillar(&mut s, Vec3::new(6.0, 3.0, 0.2), Vec3::new(0.0, 3.0, -4.0), grey());
    pillar(&mut s, Vec3::new(0.5, 1.0, 0.05), Vec3::new(1.2, 1.0, 2.0), grey());
    s
}

/// What the ray that starts at a point of the floor has found.
fn from_floor(seen: &Seen, found: &[Found], point: DVec3) -> Found {
    found[at(seen.project(point), SIZE)]
}

/// The four cases of a single-layer depth image: a hit; too far behind a thing; a thing in front hides what the ray meets; the ray leaves the
/// picture.
#[test]
fn rays_meet_what_the_camera_sees_and_nothing_else() -> Result<()> {
    let Some(gpu) = gpu()? else { return Ok(()) };
    let scene = cases();
    let seen = Seen::new(&scene.cameras[0], SIZE);
    let cast = |rays: Rays, from: DVec3| -> Result<Found> {
        Ok(from_floor(&seen, &marched(&gpu, &scene, SIZE, rays, 1)?[0], from))
    };
    for way in Rays::towards(Vec3::ZERO).ways(2.0) {
        let name = if way.stride.is_some() { "linear" } else { "pyramid" };
        // The wall, from the floor before it: 3.8 m away, at a height of 0.95 m.
        let ray = Rays { direction: Vec3::new(0.0, 0.25, -1.0), ..way };
        let from = DVec3::new(-1.0, 0.0, 0.0);
        let hit = cast(ray, from)?;
        let wanted = seen.project(DVec3::new(-1.0, 0.95, -3.8));
        ensure!(hit.met && hit.place.distance(wanted) < 1.5, "{name}: {hit:?}, wanted {wanted}");

        // Across, 2 m behind the board, and on until the picture ends.
        let across = Rays { direction: Vec3::new(1.0, 0.35, -0.02), ..way };
        let from = DVec3::new(-1.2, 0.0, 0.0);
        let behind = cast(across, from)?;
        ensure!(!behind.met && behind.steps > 3, "{name}: behind the board: {behind:?}");
        // The same ray meets the board, if that is taken to be as thick as it would have to be.
        let thick = cast(Rays { thickness: 3.0, ..across }, from)?;
        ensure!(thick.met, "{name}: through a board that is 3 m thick: {thick:?}");

        // To the wall where the board hides it: the point is on the way from the eye through the board.
        let through = seen.on_plane(seen.project(DVec3::new(1.2, 1.2, 2.05)), DVec3::new(0.0, 0.0, -3.8), DVec3::Z);
        let from = DVec3::new(-1.0, 0.0, -1.0);
        let hidden = cast(Rays { direction: (through - from).as_vec3(), ..way }, from)?;
        ensure!(!hidden.met, "{name}: the wall behind the board: {hidden:?}");

        // To the left, out of the picture.
        let out = cast(Rays { direction: Vec3::new(-1.0, 0.1, 0.0), ..way }, DVec3::new(-1.5, 0.0, 1.0))?;
        ensure!(!out.met && out.steps > 3, "{name}: out of the picture: {out:?}");
    }
    Ok(())
}

/// Rays that end before the wall, rays to the camera and past it, and rays along the view find nothing, and none finds the plane it is on.
#[test]
fn rays_that_meet_nothing_say_so() -> Result<()> {
    let Some(gpu) = gpu()? else { return Ok(()) };
    let scene = cases();
    let seen = Seen::new(&scene.cameras[0], SIZE);
    for way in Rays::towards(Vec3::ZERO).ways(2.0) {
        let from = DVec3::new(-1.0, 0.0, 0.0);
        let wall = Rays { direction: Vec3::new(0.0, 0.25, -1.0), ..way };
        let [near, far] = [3.0, 5.0].map(|distance| {
            marched(&gpu, &scene, SIZE, Rays { distance, ..wall }, 1).map(|found| from_floor(&seen, &found[0], from))
        });
        let (near, far) = (near?, far?);
        ensure!(!near.met && far.met, "{way:?}: 3 m: {near:?}, 5 m: {far:?}");

        let back = (scene.cameras[0].eye() - from).as_vec3();
        for direction in [back, Vec3::new(0.1, 0.2, 1.0), Vec3::Y] {
            let found = &marched(&gpu, &scene, SIZE, Rays { direction, ..way }, 1)?[0];
            let floor = |x: f64| from_floor(&seen, found, DVec3::new(x, 0.0, 0.5));
            ensure!(!floor(-1.0).met && !floor(-1.5).met, "{way:?} towards {direction}: {:?}", floor(-1.0));
        }
    }
    // A bare plane, along which rays go as flat as they can.
    let mut bare = scene_of_plane(0.0);
    bare.cameras[0] = camera([0.0, 0.3, 5.0], [0.0, 0.0, 0.0]);
    for way in Rays::towards(Vec3::ZERO).ways(4.0) {
        for (x, z) in [(1.0, 0.0), (-1.0, -1.0), (0.2, 1.0), (0.0, -1.0), (-0.7, 0.3)] {
            let rays = Rays { direction: Vec3::new(x, 0.02, z), thickness: 1.0, ..way };
            let found = &marched(&gpu, &bare, SIZE, rays, 1)?[0];
            let met = found.iter().filter(|f| f.met).count();
            let marched = found.iter().filter(|f| f.steps > 1).count();
            ensure!(met == 0 && marched > 1000, "{rays:?}: {met} of {marched} meet their own plane");
        }
    }
    Ok(())
}

/// A floor, and a plane that leans towards the camera by an angle, unless that is 0.
fn scene_of_plane(lean: f32) -> Scene {
    let mut s = scene("lean", camera([0.0, 1.5, 6.0], [0.0, 1.0, 0.0]));
    floor(&mut s, material([0.5; 3], 0.0, 0.5));
    if lean != 0.0 {
        let turned = Quat::from_rotation_x(std::f32::consts::FRAC_PI_2 - lean);
        add(
            &mut s,
            plane(12.0),
            material([0.5; 3], 0.0, 0.5),
            Affine3A::from_rotation_translation(turned, Vec3::new(0.0, 0.0, -2.0)),
        );
    }
    s
}

/// Where a ray meets a leaning plane is known. Bisection finds it to below a pixel with steps of eight, and so does the pyramid.
#[test]
fn hits_are_found_to_below_a_pixel() -> Result<()> {
    let Some(gpu) = gpu()? else { return Ok(()) };
    let lean = 0.35_f32;
    let scene = scene_of_plane(lean);
    let seen = Seen::new(&scene.cameras[0], SIZE);
    let normal = (Quat::from_rotation_x(std::f32::consts::FRAC_PI_2 - lean) * Vec3::Y).as_dvec3();
    let direction = Vec3::new(0.35, 0.3, -1.0);
    for (way, most) in Rays::towards(direction).ways(8.0).into_iter().zip([1.0, 1.0]) {
        let found = &marched(&gpu, &scene, SIZE, way, 1)?[0];
        let (mut count, mut missed, mut worst, mut sum) = (0, 0, 0.0_f64, 0.0);
        for y in 0..SIZE[1] {
            for x in 0..SIZE[0] {
                let place = DVec2::new(f64::from(x) + 0.5, f64::from(y) + 0.5);
                let start = seen.on_plane(place, DVec3::ZERO, DVec3::Y);
                // Of the floor only, as far as it is seen, and well before the other plane.
                if (start - scene.cameras[0].eye()).dot(seen.direction(place)) < 0.0 || start.z < -1.6 || start.z > 5.0
                {
                    continue;
                }
                let start = start + DVec3::Y * 0.75 * seen.width_at(start);
                let way = direction.as_dvec3().normalize();
                let end = start + way * ((DVec3::new(0.0, 0.0, -2.0) - start).dot(normal) / way.dot(normal));
                let wanted = seen.project(end);
                let inside = |v: f64, most: u32| v > 9.0 && v < f64::from(most) - 9.0;
                if !inside(wanted.x, SIZE[0]) || !inside(wanted.y, SIZE[1]) {
                    continue;
                }
                let found = found[(y * SIZE[0] + x) as usize];
                count += 1;
                if !found.met {
                    missed += 1;
                    continue;
                }
                worst = worst.max(found.place.distance(wanted));
                sum += found.place.distance(wanted);
            }
        }
        let mean = sum / f64::from(count - missed);
        println!("{:?}: {count} rays, {missed} missed, off by {mean:.3} pixels, at most {worst:.3}", way.stride);
        ensure!(count > 300 && missed * 50 < count, "{count} rays, {missed} missed");
        ensure!(worst < most && mean < 0.5, "off by {mean} pixels, at most {worst}");
    }
    Ok(())
}

/// A row of posts as thin as a few pixels, which steps of sixteen miss at some distances and find at others: bands, that stay where they are. A
/// start that differs from pixel to pixel and from frame to frame makes noise of them, whose mean over frames is even. The same frame is
/// always the same.
#[test]
fn jitter_turns_bands_into_noise() -> Result<()> {
    let Some(gpu) = gpu()? else { return Ok(()) };
    let mut s = scene("posts", camera([0.0, 2.0, 7.0], [0.0, 1.0, 0.0]));
    floor(&mut s, material([0.5; 3], 0.0, 0.5));
    for post in 0..5 {
        let x = 1.5 * post as f32 - 3.0;
        pillar(&mut s, Vec3::new(0.12, 1.5, 0.12), Vec3::new(x, 1.5, -2.0), material([0.5; 3], 0.0, 0.5));
    }
    let rays = Rays { stride: Some(1.0), thickness: 0.3, ..Rays::towards(Vec3::new(0.8, 0.3, -1.0)) };
    let hits = |rays: Rays, frames: u32| -> Result<Vec<f64>> {
        let all = marched(&gpu, &s, SIZE, rays, frames)?;
        let mut mean = vec![0.0; all[0].len()];
        for frame in &all {
            for (sum, found) in mean.iter_mut().zip(frame) {
                *sum += f64::from(u8::from(found.met)) / f64::from(frames);
            }
        }
        Ok(mean)
    };
    let truth = hits(rays, 1)?;
    let coarse = Rays { stride: Some(16.0), ..rays };
    let moving = Rays { jitter: -1.0, ..coarse };
    // Mean and deviation of how often the posts are found, where steps of one pixel find them.
    let found = |hits: &[f64]| {
        let part: Vec<f64> = hits.iter().zip(&truth).filter(|(_, t)| **t > 0.0).map(|(h, _)| *h).collect();
        let mean = part.iter().sum::<f64>() / part.len() as f64;
        let square = part.iter().map(|h| (h - mean).powi(2)).sum::<f64>() / part.len() as f64;
        (mean, square.sqrt(), part.len())
    };
    let (once, again) = (hits(moving, 1)?, hits(moving, 1)?);
    let (still, over_frames) = (found(&hits(coarse, 32)?), found(&hits(moving, 32)?));
    println!(
        "found, deviation from pixel to pixel, rays: with one start {still:.3?}, over 32 starts {over_frames:.3?}"
    );
    ensure!(once == again && once != hits(coarse, 1)?, "jitter is not that of the frame");
    ensure!(still.2 > 300 && still.0 > 0.2 && over_frames.0 > 0.1, "{still:?}, {over_frames:?}");
    ensure!(over_frames.1 < 0.4 * still.1, "{still:?}, {over_frames:?}");
    Ok(())
}

/// A wall that turns its back to the rays that come from behind it is not taken for what they meet.
#[test]
fn the_other_side_of_a_surface_is_not_known() -> Result<()> {
    let Some(gpu) = gpu()? else { return Ok(()) };
    let mut s = scene("backs", camera([0.0, 2.5, 7.0], [0.0, 0.8, 0.0]));
    floor(&mut s, material([0.5; 3], 0.0, 0.5));
    // Low enough that the floor behind it is seen.
    add(&mut s, plane(0.4), material([0.5; 3], 0.0, 0.5), upright(1.0, 0.4));
    let seen = Seen::new(&s.cameras[0], SIZE);
    for way in Rays::towards(Vec3::new(0.0, 0.15, 1.0)).ways(1.0) {
        let found = &marched(&gpu, &s, SIZE, Rays { thickness: 2.0, ..way }, 1)?[0];
        let behind = from_floor(&seen, found, DVec3::new(0.0, 0.0, -0.7));
        ensure!(!behind.met && behind.steps > 0, "{way:?}: {behind:?}");
        // From before it the same wall is met.
        let way = Rays { direction: Vec3::new(0.0, 0.15, -1.0), ..way };
        let before = from_floor(&seen, &marched(&gpu, &s, SIZE, way, 1)?[0], DVec3::new(0.0, 0.0, 2.0));
        ensure!(before.met, "{way:?}: {before:?}");
    }
    Ok(())
}
