//! The three set-ups of Varjus 2023 ("Hardware accelerated ray tracing in real-time rendering"), chapter 6: triangles per mesh, instances
//! that all rays miss, moving instances.
use super::make::camera_at;
use super::scenes::NOT_COMPACTED;
use super::{
    Case, Change, Contender, Placed, Quantity, Random, RayBenchError, Run, Shape, Target, World, WorldOptions,
    WorldReport, extent_of, primary, rotation, rough_sphere, rounded_cube, sphere,
};
use glam::{Affine3A, IVec3, Quat, Vec3};
use magpie_shaders::Rays;
use std::collections::HashMap;

/// A change of the options, and its label suffix.
type Variant = (&'static str, fn(WorldOptions) -> WorldOptions);

/// Label suffix for fast builds.
const FAST_BUILD: &str = ", fast build";
/// Variant name for the engine's default build options.
const DEFAULT: &str = "primary";
/// Full vertical angle of view of all cameras, radians.
const FOV: f32 = std::f32::consts::FRAC_PI_3;
/// Bounding radius of the rounded cube, metres.
const CUBE_RADIUS: f32 = 1.6;

/// Columns and rows of spheres: 1152.
const GRID: (u32, u32) = (48, 24);
/// Distance between neighbours, metres.
const GRID_STEP: f32 = 2.2;

/// Side of the space around the camera, metres.
const SPACE: f32 = 1000.0;
/// Positions along each axis for regular placement.
const PLACES: i32 = 40;

/// Half extent of the box in which instances move, metres.
const BOX: Vec3 = Vec3::new(60.0, 30.0, 30.0);
/// Distance that an instance moves per step, in its diameters.
const SPEED: f32 = 0.5;

impl Run<'_> {
    /// The hardware backends of the tracer.
    fn driver_ways(&self) -> Vec<Rays> {
        self.tracer.ways().into_iter().filter(|w| *w != Rays::Software).collect()
    }

    fn world(&mut self, shapes: &[Shape], placed: &[Placed], options: WorldOptions) -> Result<World, RayBenchError> {
        let gpu = self.tracer.gpu().clone();
        World::new(&gpu, &mut self.tracer.executor, shapes, placed, options)
    }

    /// The worlds for these backends: one for software, one that the hardware backends share.
    fn worlds(
        &mut self,
        shapes: &[Shape],
        placed: &[Placed],
        change: impl Fn(WorldOptions) -> WorldOptions,
    ) -> Result<Vec<World>, RayBenchError> {
        let ways = self.tracer.ways();
        let driver = self.driver_ways().first().copied();
        let needed = ways.contains(&Rays::Software).then_some(Rays::Software).into_iter().chain(driver);
        needed.map(|rays| self.world(shapes, placed, change(WorldOptions::new(rays)))).collect()
    }

    /// Every backend with the world that it needs.
    fn contenders<'a>(&self, worlds: &'a [World], note: &'static str) -> Vec<Contender<'a>> {
        let ways = self.tracer.ways();
        let of = |rays: Rays| {
            let world = worlds.iter().find(|w| (w.rays() == Rays::Software) == (rays == Rays::Software))?;
            Some(Contender { rays, target: Target::World(world), note })
        };
        ways.into_iter().filter_map(of).collect()
    }

    /// Build time, memory and ray rate by triangles of a mesh, with 1152 instances of it.
    pub fn triangles(&mut self) -> Result<(), RayBenchError> {
        let steps: &[u32] = if self.effort.quick { &[10, 24, 54] } else { &[10, 16, 24, 36, 54, 80, 110] };
        let (columns, rows) = GRID;
        let placed: Vec<Placed> = (0..columns * rows)
            .map(|i| {
                let across = (i % columns) as f32 - (columns - 1) as f32 / 2.0;
                let up = (i / columns) as f32 - (rows - 1) as f32 / 2.0;
                Placed::new(0, Affine3A::from_translation(Vec3::new(across, up, 0.0) * GRID_STEP))
            })
            .collect();
        // The grid fills the height of the view.
        let far = rows as f32 * GRID_STEP / 2.0 / (FOV / 2.0).tan();
        let rays = primary(&camera_at(Vec3::Z * far, FOV), extent_of(self.effort.setup_size));
        for &n in steps {
            for (subject, shape) in [("sphere", sphere(n)), ("rough sphere", rough_sphere(n, u64::from(n)))] {
                let count = shape.indices.len() / 3;
                (self.progress)(&format!("1152 instances of a {subject} of {count} triangles"));
                let case = Case::new("triangles", subject, count as f64, DEFAULT);
                let shapes = [shape];
                let options: [Variant; 3] = [
                    ("", |o| o),
                    (NOT_COMPACTED, |o| WorldOptions { compaction: false, ..o }),
                    (FAST_BUILD, |o| WorldOptions { fast_build: true, ..o }),
                ];
                let mut kept = Vec::new();
                for (note, change) in options {
                    let driver_only = !note.is_empty();
                    let mut worlds = Vec::new();
                    let mut reports: HashMap<bool, Vec<WorldReport>> = HashMap::new();
                    for _ in 0..self.effort.builds {
                        worlds = if driver_only {
                            let driver = self.driver_ways().first().copied();
                            let options = driver.map(|rays| change(WorldOptions::new(rays)));
                            options.into_iter().map(|o| self.world(&shapes, &placed, o)).collect::<Result<_, _>>()?
                        } else {
                            self.worlds(&shapes, &placed, change)?
                        };
                        for world in &worlds {
                            reports.entry(world.rays() == Rays::Software).or_default().push(world.report());
                        }
                    }
                    for (software, reports) in reports {
                        let variant = format!("build{note}");
                        self.bottom(&Case { variant, ..case.clone() }, software, &reports);
                    }
                    kept.push((note, worlds));
                }
                let mut contenders = Vec::new();
                for (note, worlds) in &kept {
                    let mut these = self.contenders(worlds, note);
                    // The variants only concern the driver's build, so one hardware backend is enough for them.
                    these.truncate(if note.is_empty() { usize::MAX } else { 1 });
                    contenders.extend(these);
                }
                self.race(&case, &contenders, &rays, self.effort.setup_repeats)?;
            }
        }
        Ok(())
    }

    fn bottom(&mut self, case: &Case, software: bool, reports: &[WorldReport]) {
        let by = if software { "software" } else { "driver" };
        let values = |value: fn(&WorldReport) -> f64| reports.iter().map(value).collect::<Vec<_>>();
        self.report.add(case, by, Quantity::BuildBottom, values(|r| r.bottom_ns as f64 * 1e-6), 0);
        self.report.add(case, by, Quantity::BottomBytes, values(|r| r.bottom_bytes as f64), 0);
        if !software {
            self.report.add(case, by, Quantity::ScratchBytes, values(|r| r.scratch_bytes as f64), 0);
            if reports.iter().any(|r| r.compact_ns > 0) {
                self.report.add(case, by, Quantity::Compact, values(|r| r.compact_ns as f64 * 1e-6), 0);
            }
        }
    }

    /// Instances around the camera but outside its view: in a grid, and at random.
    pub fn instances(&mut self) -> Result<(), RayBenchError> {
        let most = if self.effort.quick { 1000 } else { 20_000 };
        let counts: &[usize] =
            if self.effort.quick { &[1, 30, 1000] } else { &[1, 10, 100, 500, 1000, 2000, 5000, 10_000, 20_000] };
        let rays = primary(&camera_at(Vec3::ZERO, FOV), extent_of(self.effort.setup_size));
        let shapes = [rounded_cube()];
        for (subject, points) in [("regular", regular(most)), ("irregular", irregular(most))] {
            let mut random = Random::new(7);
            let placed: Vec<Placed> = points.into_iter().map(|p| turned(p, rotation(&mut random))).collect();
            for &count in counts {
                (self.progress)(&format!("{count} {subject} instances that every ray misses"));
                let case = Case::new("instances", subject, count as f64, DEFAULT);
                let placed = &placed[..count.min(placed.len())];
                let mut worlds = self.worlds(&shapes, placed, |o| o)?;
                for world in &mut worlds {
                    self.top(&case, world, placed)?;
                }
                let contenders = self.contenders(&worlds, "");
                self.race(&case, &contenders, &rays, self.effort.setup_repeats)?;
                let table = self.tracer.upload(&rays)?;
                for contender in &contenders {
                    let answers = self.tracer.closest(contender.rays, contender.target, &table)?;
                    let hits = answers.iter().filter(|a| a.instance != u32::MAX).count();
                    if hits > 0 {
                        let case = format!("{count} {subject} instances");
                        return Err(RayBenchError::Met { case, rays: contender.rays.name(), hits });
                    }
                }
            }
        }
        Ok(())
    }

    /// Times and bytes of a world's top level.
    fn top(&mut self, case: &Case, world: &mut World, placed: &[Placed]) -> Result<(), RayBenchError> {
        let mut times = vec![world.report().top_ns as f64 * 1e-6];
        for _ in 1..self.effort.builds {
            let taken = world.follow(&mut self.tracer.executor, placed, Change::Rebuild)?;
            times.extend(taken.map(|ns| ns as f64 * 1e-6));
        }
        let case = Case { variant: "build".to_owned(), ..case.clone() };
        let by = world.builder();
        self.report.add(&case, by, Quantity::BuildTop, times, 0);
        self.report.add(&case, by, Quantity::TopBytes, vec![world.report().top_bytes as f64], 0);
        Ok(())
    }

    /// Instances that move in a box: a top level that is refitted each step, compared with one that is rebuilt.
    pub fn moving(&mut self) -> Result<(), RayBenchError> {
        let all: &[(usize, f32)] =
            if self.effort.quick { &[(500, 1.0)] } else { &[(500, 1.0), (500, 0.5), (1000, 1.0), (2000, 1.0)] };
        let stops: &[f32] =
            if self.effort.quick { &[0.0, 1.0, 5.0] } else { &[0.0, 0.5, 1.0, 2.0, 5.0, 10.0, 20.0, 50.0] };
        let far = BOX.z + BOX.y / (FOV / 2.0).tan();
        let rays = primary(&camera_at(Vec3::Z * far, FOV), extent_of(self.effort.setup_size));
        for &(count, share) in all {
            let part = if share < 1.0 { format!(", {:.0} % move", share * 100.0) } else { String::new() };
            let subject = format!("{count} instances{part}");
            let mut crowd = Crowd::new(count, share);
            let shapes = [rounded_cube()];
            let mut refitted = self.worlds(&shapes, &crowd.placed(), |o| WorldOptions { refit: true, ..o })?;
            let mut rebuilt = self.worlds(&shapes, &crowd.placed(), |o| o)?;
            let mut path = 0.0;
            for &stop in stops {
                (self.progress)(&format!("{subject}, moved by {stop} diameters"));
                let mut refits: HashMap<&'static str, Vec<f64>> = HashMap::new();
                while path + 1e-3 < stop {
                    path += SPEED * share;
                    crowd.step();
                    let placed = crowd.placed();
                    for world in &mut refitted {
                        let taken = world.follow(&mut self.tracer.executor, &placed, Change::Refit)?;
                        let times = refits.entry(world.builder()).or_default();
                        times.extend(taken.map(|ns| ns as f64 * 1e-6));
                    }
                }
                let placed = crowd.placed();
                let case = |variant: &str| Case::new("moving", subject.as_str(), f64::from(stop), variant);
                for world in &mut rebuilt {
                    let mut times = Vec::new();
                    for _ in 0..self.effort.builds {
                        let taken = world.follow(&mut self.tracer.executor, &placed, Change::Rebuild)?;
                        times.extend(taken.map(|ns| ns as f64 * 1e-6));
                    }
                    self.report.add(&case("rebuilt"), world.builder(), Quantity::BuildTop, times, 0);
                }
                for (by, times) in refits {
                    self.report.add(&case("refitted"), by, Quantity::RefitTop, times, 0);
                }
                let mut contenders = self.contenders(&rebuilt, ", rebuilt");
                contenders.extend(self.contenders(&refitted, ", refitted"));
                self.race(&case(DEFAULT), &contenders, &rays, self.effort.setup_repeats)?;
            }
        }
        Ok(())
    }
}

fn turned(position: Vec3, rotation: Quat) -> Placed {
    Placed::new(0, Affine3A::from_rotation_translation(rotation, position))
}

/// Whether a bounding sphere at `p` may be visible from the camera in the middle.
fn in_view(p: Vec3) -> bool {
    let up = (FOV / 2.0).tan();
    // Side planes of a view twice as wide as high, with normals that point inside.
    let planes = [
        Vec3::new(-1.0, 0.0, -2.0 * up),
        Vec3::new(1.0, 0.0, -2.0 * up),
        Vec3::new(0.0, -1.0, -up),
        Vec3::new(0.0, 1.0, -up),
    ];
    planes.iter().all(|n| n.normalize().dot(p) > -CUBE_RADIUS)
}

/// Grid points in random order.
fn regular(count: usize) -> Vec<Vec3> {
    let step = SPACE / PLACES as f32;
    let centre = Vec3::splat((PLACES - 1) as f32 / 2.0);
    let mut points: Vec<Vec3> = (0..PLACES.pow(3))
        .map(|i| IVec3::new(i % PLACES, i / PLACES % PLACES, i / PLACES / PLACES).as_vec3())
        .map(|p| (p - centre) * step)
        .filter(|p| !in_view(*p))
        .collect();
    // Fisher-Yates shuffle, in the form of Durstenfeld 1964.
    let mut random = Random::new(3);
    for last in (1..points.len()).rev() {
        points.swap(last, (random.bits() % (last as u64 + 1)) as usize);
    }
    points.truncate(count);
    points
}

/// Random points far enough apart that instances do not overlap.
fn irregular(count: usize) -> Vec<Vec3> {
    let (mut random, mut points) = (Random::new(5), Vec::with_capacity(count));
    let cell = |p: Vec3| (p / (2.0 * CUBE_RADIUS)).floor().as_ivec3();
    let mut taken: HashMap<IVec3, Vec<Vec3>> = HashMap::new();
    while points.len() < count {
        let p = random.point(Vec3::splat(-SPACE / 2.0), Vec3::splat(SPACE / 2.0));
        let near = (0..27).map(|i| cell(p) + IVec3::new(i % 3, i / 3 % 3, i / 9) - IVec3::ONE);
        let free = near.filter_map(|c| taken.get(&c)).flatten().all(|q| q.distance(p) >= 2.0 * CUBE_RADIUS);
        if free && !in_view(p) {
            taken.entry(cell(p)).or_default().push(p);
            points.push(p);
        }
    }
    points
}

/// Instances that move in straight lines and bounce off the walls of the box.
struct Crowd {
    members: Vec<(Vec3, Quat, Vec3)>,
}

impl Crowd {
    /// `count` instances, of which a share moves.
    fn new(count: usize, share: f32) -> Self {
        let mut random = Random::new(11);
        let moving = (count as f32 * share).round() as usize;
        let member = |i: usize| {
            let (position, turn) = (random.point(-BOX, BOX), rotation(&mut random));
            let step = random.direction() * SPEED * 2.0 * CUBE_RADIUS;
            (position, turn, if i < moving { step } else { Vec3::ZERO })
        };
        Self { members: (0..count).map(member).collect() }
    }

    fn step(&mut self) {
        for (position, _, step) in &mut self.members {
            *position += *step;
            for axis in 0..3 {
                let beyond = position[axis].abs() - BOX[axis];
                if beyond > 0.0 {
                    position[axis] -= 2.0 * beyond * position[axis].signum();
                    step[axis] = -step[axis];
                }
            }
        }
    }

    fn placed(&self) -> Vec<Placed> {
        self.members.iter().map(|&(position, turn, _)| turned(position, turn)).collect()
    }
}

#[cfg(test)]
mod tests {
    use super::*;

    #[test]
    fn nothing_stands_in_view_or_in_another() {
        let points = irregular(2000);
        assert!(points.iter().all(|p| !in_view(*p) && p.abs().max_element() <= SPACE / 2.0));
        for (i, p) in points.iter().enumerate() {
            assert!(points[i + 1..].iter().all(|q| q.distance(*p) >= 2.0 * CUBE_RADIUS));
        }
        assert!(regular(20_000).len() == 20_000 && regular(20_000).iter().all(|p| !in_view(*p)));
        assert!(in_view(Vec3::new(0.0, 0.0, -10.0)) && !in_view(Vec3::Z * 10.0) && !in_view(Vec3::Y * 10.0));
    }

    #[test]
    fn the_crowd_stays_in_its_box_and_moves_as_far_as_it_says() {
        let mut crowd = Crowd::new(100, 0.5);
        let before = crowd.placed();
        for _ in 0..500 {
            crowd.step();
            assert!(crowd.members.iter().all(|(p, ..)| p.abs().cmple(BOX + 1e-3).all()));
        }
        let after = crowd.placed();
        let place = |p: &Placed| p.world_from_object.translation;
        let moved = after.iter().zip(&before).filter(|(a, b)| place(a) != place(b));
        assert_eq!(moved.count(), 50);
        assert!(crowd.members.iter().all(|(.., s)| *s == Vec3::ZERO || (s.length() - 1.6).abs() < 1e-3));
    }
}
