//! Surfels go where the points of triangles and spheres go that they are bound to, whatever moves or deforms those.
use anyhow::{Context, Result, ensure};
use glam::{DVec2, DVec3, Vec3};
use magpie::scene::{Animator, FloatingOrigin, Pose, Scene, deform};
use magpie_shaders::surfels::KEYS_WIDTH;
use magpie_tests::gi::{Frames, SURFELS};
use magpie_tests::harness::{builtin, gpu_without_validation};
use magpie_tests::rooms;
use std::collections::BTreeMap;
use std::env;

const FRAME: f64 = 1.0 / 60.0;
/// Greatest distance from where a surfel should be, over its radius.
const LIMIT: f64 = 1e-4;
/// What rounding of corners to 32 bits adds: units in the last place of their greatest coordinate. It is more than the rest for the ground, whose
/// triangles are 120 m wide.
const ROUNDING: f64 = 2.0 * f32::EPSILON as f64;

/// A surfel as the device has it.
struct Surfel {
    position: Vec3,
    radius: f32,
    instance: usize,
    primitive: usize,
    weights: [f32; 2],
}

/// All of a frame.
fn surfels(frames: &mut Frames) -> Result<Vec<Surfel>> {
    let result = frames.frame(Some("gi.show:table"))?;
    let table = result.images.context("no image")?.linear;
    let (values, width) = (table.values(), KEYS_WIDTH as usize);
    ensure!(table.extent.width == KEYS_WIDTH, "the table is {:?}", table.extent);
    let rows = values.chunks(2 * width);
    let of_row = |row: &[[f32; 4]]| -> Vec<Surfel> {
        let (places, bindings) = row.split_at(width);
        let lives = places.iter().zip(bindings).filter(|(_, bound)| bound[0] > 0.0);
        lives
            .map(|(place, bound)| Surfel {
                position: Vec3::from_slice(place),
                radius: place[3],
                instance: bound[0] as usize - 1,
                primitive: bound[1] as usize,
                weights: [bound[2], bound[3]],
            })
            .collect()
    };
    Ok(rows.flat_map(of_row).collect())
}

/// The direction that two numbers stand for in the octahedral map.
fn direction(weights: [f32; 2]) -> DVec3 {
    let p = DVec2::new(f64::from(weights[0]), f64::from(weights[1]));
    let z = 1.0 - p.x.abs() - p.y.abs();
    let sign = |v: f64| if v >= 0.0 { 1.0 } else { -1.0 };
    let folded = if z < 0.0 { DVec2::new((1.0 - p.y.abs()) * sign(p.x), (1.0 - p.x.abs()) * sign(p.y)) } else { p };
    folded.extend(z).normalize()
}

/// A scene at one time, in double precision.
struct Now<'a> {
    scene: &'a Scene,
    pose: Pose,
    deformed: Vec<Option<Vec<Vec3>>>,
}

impl<'a> Now<'a> {
    fn new(scene: &'a Scene, animator: &Animator, time: f64) -> Self {
        let pose = animator.pose(time);
        let deformed = (0..scene.instances.len()).map(|i| {
            let mesh = &scene.meshes[scene.instances[i].mesh as usize];
            animator.deforms(i).then(|| deform(mesh, &pose.joints[i], &pose.weights[i]).positions)
        });
        let deformed = deformed.collect();
        Self { scene, pose, deformed }
    }

    /// Where a surfel should be, by how much rounding may move it, and how what carries it moves.
    fn place(&self, s: &Surfel) -> Result<(DVec3, f64, &'static str)> {
        let instance = self.scene.instances.get(s.instance).context("no such instance")?;
        let mesh = &self.scene.meshes[instance.mesh as usize];
        let world = self.pose.instances[s.instance];
        if let Some(sphere) = mesh.spheres.get(s.primitive) {
            let at = sphere.centre.as_dvec3() + f64::from(sphere.radius) * direction(s.weights);
            return Ok((world.transform_point3(at), ROUNDING * at.abs().max_element(), "spheres"));
        }
        let positions = self.deformed[s.instance].as_ref().unwrap_or(&mesh.positions);
        let corners = mesh.indices.get(3 * s.primitive..3 * s.primitive + 3).context("no such triangle")?;
        let [a, b, c] = [0, 1, 2].map(|k| positions[corners[k] as usize].as_dvec3());
        let [u, v] = s.weights.map(f64::from);
        let greatest = a.abs().max(b.abs()).max(c.abs()).max_element();
        let kind = match () {
            () if instance.skin.is_some() => "skinned",
            () if !mesh.targets.is_empty() => "morphed",
            () if instance.node.is_some() => "rigid",
            () => "still",
        };
        Ok((world.transform_point3(a + u * (b - a) + v * (c - a)), ROUNDING * greatest, kind))
    }
}

/// Of each kind of thing the number of surfels that were looked at, and the greatest distance from where they should be, over the radius.
type Found = BTreeMap<&'static str, (usize, f64)>;

fn follow(scene: &Scene, size: [u32; 2], count: u32, every: u32) -> Result<Found> {
    let Some(gpu) = gpu_without_validation()? else { return Ok(Found::new()) };
    let animator = Animator::new(scene);
    let mut frames = Frames::new(&gpu, scene, SURFELS, &["gi.surfels=16384", "gi.surfel_radius=0.03"], size)?;
    let origin = FloatingOrigin::default().follow(&frames.camera);
    let mut found = Found::new();
    for frame in 1..=count {
        frames.time = FRAME * f64::from(frame);
        if frame % every != 0 {
            frames.light()?;
            continue;
        }
        let now = Now::new(scene, &animator, frames.time);
        let surfels = surfels(&mut frames)?;
        ensure!(surfels.len() > 100, "frame {frame}: only {} surfels", surfels.len());
        for s in &surfels {
            let (place, rounding, kind) =
                now.place(s).with_context(|| format!("frame {frame}, instance {}", s.instance))?;
            let apart = (s.position.as_dvec3() + origin - place).length();
            let off = (apart - rounding).max(0.0) / f64::from(s.radius);
            ensure!(apart.is_finite() && s.radius > 0.0, "{kind}: at {}, radius {}", s.position, s.radius);
            let entry = found.entry(kind).or_default();
            (entry.0, entry.1) = (entry.0 + 1, entry.1.max(off));
        }
    }
    println!("{}: surfels and greatest distance over the radius: {found:?}", scene.name);
    Ok(found)
}

/// While animations play no surfel leaves its place, so none is left in the air where a thing was.
#[test]
fn surfels_go_where_their_surfaces_go() -> Result<()> {
    let (count, every) = if env::var_os("MAGPIE_FULL").is_some() { (600, 30) } else { (60, 15) };
    for (scene, kinds) in [
        (builtin("carousel")?, &["skinned", "morphed", "spheres", "rigid", "still"][..]),
        (rooms::opening_door(), &["rigid", "still"]),
    ] {
        let found = follow(&scene, [96, 72], count, every)?;
        if found.is_empty() {
            return Ok(());
        }
        for kind in kinds {
            let (surfels, off) = found.get(kind).with_context(|| format!("{}: no surfel is {kind}", scene.name))?;
            ensure!(*surfels >= 4, "{}: only {surfels} surfels are {kind}", scene.name);
            ensure!(*off <= LIMIT, "{}: {kind} surfels are off by {off} of their radius", scene.name);
        }
    }
    Ok(())
}
