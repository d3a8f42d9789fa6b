//! Area lights without occlusion against the reference: the diffuse part is in closed form, highlights are sampled.
use anyhow::{Result, ensure};
use glam::{Affine3A, DVec3, Quat, Vec3};
use magpie::scene::{Light, Material, Mesh, Scene, Sphere};
use magpie_tests::against::{Shown, mean, relmse, truth};
use magpie_tests::fixtures::{add, camera, material, plane, scene};
use magpie_tests::harness::{config, gpu, render};

const SHOWN: Shown = Shown { size: [48, 27], time: 0.0 };
const RADIANCE: Vec3 = Vec3::new(4.0, 3.0, 2.0);

/// A white material with values that are exact in 8 bits.
fn white(metalness: f32, roughness: f32) -> Material {
    material([1.0; 3], metalness, (roughness * 255.0).round() / 255.0)
}

/// A floor of four strips under a light, with roughness increasing from left to right.
fn strips(name: &str, light: Light) -> Scene {
    let mut s = scene(name, camera([0.0, 2.2, 4.2], [0.0, 0.3, 0.0]));
    for (i, roughness) in (0_u8..).zip([0.05, 0.25, 0.5, 0.9]) {
        // Metal in front, plastic behind.
        for (metalness, z) in [(1.0, 3.0), (0.0, -3.0)] {
            let place = Affine3A::from_scale_rotation_translation(
                Vec3::new(0.25, 1.0, 1.5),
                Quat::IDENTITY,
                Vec3::new(f32::from(i) - 1.5, 0.0, 0.5 * z),
            );
            add(&mut s, plane(2.0), white(metalness, roughness), place);
        }
    }
    s.instances.iter_mut().for_each(|i| i.world_from_object.matrix3.z_axis.z = 0.75);
    s.lights.push(light);
    s
}

fn lamps() -> [Scene; 6] {
    let above = DVec3::new(0.1, 1.0, -0.6);
    let half_u = Vec3::X * 1.2;
    let (half_v, radiance) = (Vec3::new(0.0, 0.25, 0.25), RADIANCE);
    let normal = Vec3::new(0.1, -1.0, 0.4).normalize();
    [
        strips("rectangle", Light::Rectangle { centre: above, half_u, half_v, radiance }),
        // The lower half is below the floor.
        strips("horizon", Light::Rectangle { centre: DVec3::new(0.0, 0.0, -1.9), half_u, half_v: Vec3::Y, radiance }),
        strips("disc", Light::Disc { centre: above, normal, radius: 0.6, radiance }),
        strips("sphere", Light::Sphere { centre: DVec3::new(0.2, 0.55, -0.6), radius: 0.5, radiance }),
        strips("sunk", Light::Sphere { centre: DVec3::new(0.2, 0.3, -0.6), radius: 0.5, radiance }),
        strips(
            "sun",
            Light::Directional {
                direction: Vec3::new(0.34, -0.5, 0.9).normalize(),
                illuminance: RADIANCE,
                angular_radius: 0.00465,
            },
        ),
    ]
}

#[test]
fn lamps_look_like_their_shape() -> Result<()> {
    let Some(gpu) = gpu()? else { return Ok(()) };
    for scene in lamps() {
        let truth = truth(&gpu, &scene, SHOWN, 1536)?;
        let found = |area: &str, frames| mean(&gpu, &scene, &["stages.shadows=off", area], SHOWN, frames);
        let mut line = String::new();
        for area in [0, 1, 4, 16] {
            let (found, ms) = found(&format!("direct.area={area}"), 1)?;
            line += &format!("  {area}: {:.1e} {ms:.2} ms", relmse(&found, &truth)[0]);
        }
        let [error, noise] = relmse(&found("direct.area=16", 32)?.0, &truth);
        let [centre, _] = relmse(&found("direct.area=0", 1)?.0, &truth);
        println!("{:<10}{line}; converged {error:.1e}, of which {noise:.1e} is noise of the truth", scene.name);
        ensure!(noise < 1e-3, "{}: the truth is too noisy to tell: {noise:.1e}", scene.name);
        // Fresnel is evaluated for a single direction, which is less accurate where the horizon cuts the light.
        let limit = if scene.name == "sunk" { 2e-3 } else { 5e-4 };
        ensure!(error - noise < limit, "{}: relMSE {error:.1e}, noise of the truth {noise:.1e}", scene.name);
        ensure!(centre > 10.0 * (error - noise), "{}: the centre alone comes to {centre:.1e}", scene.name);
    }
    Ok(())
}

/// Surfaces on and inside the light, lights that are edge-on, tiny or huge: all results are finite.
#[test]
fn nothing_is_not_finite() -> Result<()> {
    let Some(gpu) = gpu()? else { return Ok(()) };
    let radiance = RADIANCE;
    let at = DVec3::new(0.0, 0.0, 0.3);
    let rectangle = |centre, half_u, half_v| Light::Rectangle { centre, half_u, half_v, radiance };
    let lights = [
        ("flat on the floor", rectangle(at, Vec3::X, Vec3::Z)),
        ("edge on", rectangle(at, Vec3::X, Vec3::Y)),
        ("next to nothing", rectangle(at + DVec3::Y * 0.01, Vec3::X * 1e-7, Vec3::Z * 1e-7)),
        ("a thread", rectangle(at + DVec3::Y * 0.5, Vec3::X, Vec3::Z * 1e-9)),
        ("as large as the world", rectangle(at + DVec3::Y, Vec3::X * 1e6, Vec3::Z * 1e6)),
        ("a disc on the floor", Light::Disc { centre: at, normal: Vec3::Y, radius: 1.0, radiance }),
        ("around everything", Light::Sphere { centre: at, radius: 100.0, radiance }),
        ("half sunk", Light::Sphere { centre: at, radius: 1.0, radiance }),
        ("a speck", Light::Sphere { centre: at, radius: 1e-9, radiance }),
        ("a speck above", Light::Sphere { centre: at + DVec3::Y * 1e-3, radius: 1e-9, radiance }),
        ("half the sky", Light::Directional { direction: Vec3::NEG_Y, illuminance: radiance, angular_radius: 1.5 }),
        ("nothing", rectangle(at + DVec3::Y, Vec3::ZERO, Vec3::ZERO)),
    ];
    for (what, light) in lights {
        let scene = strips(what, light);
        render(&gpu, &scene, &config(&["shadows.edges=hard"])?, [48, 27], 2, Some(("direct.shade", "radiance")))?;
    }
    // Points of the lit surface are on the light itself.
    let mut scene = strips("on it", Light::Sphere { centre: at + DVec3::Y, radius: 0.5, radiance });
    let spheres = vec![Sphere { centre: Vec3::new(0.0, 1.0, 0.3), radius: 0.5 }];
    let ball = Mesh { name: "ball".to_owned(), spheres, ..Mesh::default() };
    add(&mut scene, ball, white(0.0, 0.0), Affine3A::IDENTITY);
    render(&gpu, &scene, &config(&[])?, [48, 27], 2, Some(("direct.shade", "radiance")))?;
    Ok(())
}

/// Distant lights on rough surfaces are treated as points at their centre, at the cost of a point light.
#[test]
fn what_is_skipped_is_not_seen() -> Result<()> {
    let Some(gpu) = gpu()? else { return Ok(()) };
    // Just below both limits: four times as wide as the sun, a 15th of the lobe. From directly above no half vector is further than 45
    // degrees from the view direction.
    let direction = Vec3::NEG_Y;
    let mut scene = strips("skipped", Light::Directional { direction, illuminance: RADIANCE, angular_radius: 0.0199 });
    scene.materials.iter_mut().for_each(|m| m.roughness = 172.0 / 255.0);
    let found = |area: &str| mean(&gpu, &scene, &["stages.shadows=off", area], SHOWN, 1).map(|(found, _)| found);
    let centre = found("direct.area=0")?;
    ensure!(centre == found("direct.area=16")?, "points were taken");
    let [error, noise] = relmse(&centre, &truth(&gpu, &scene, SHOWN, 2048)?);
    println!("skipped: relMSE {error:.1e}, of which {noise:.1e} is noise of the truth");
    ensure!(error - noise < 1e-6 && noise < 1e-5, "{error:.1e}, noise of the truth {noise:.1e}");
    Ok(())
}
