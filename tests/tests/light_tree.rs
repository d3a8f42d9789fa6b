//! The light tree on the device: that choices and probabilities agree, that no light is missed that could be seen, that refits hold what has moved,
//! and how much better than by power it chooses.
use anyhow::{Result, ensure};
use glam::{DVec3, Vec3};
use magpie::scene::{Light, Mesh, Scene};
use magpie_shaders::light_tree::{LIGHT_NODE_INDEX, LightNode, LightSplit, MOST_SPLIT_LIGHTS};
use magpie_tests::chi_square::chi_square;
use magpie_tests::harness::gpu;

#[path = "light_tree/effects.rs"]
mod effects;
#[path = "light_tree/noise.rs"]
mod noise;
#[path = "light_tree/rig.rs"]
mod rig;
#[path = "light_tree/scenes.rs"]
mod scenes;
use rig::{Answer, Job, Numbers, Point, Rig, points_in};
use scenes::{BALL_LUMINANCE, empty, everything, surfaces, town, town_points};

/// Sums of the probabilities of all entries at each point, a share of them per thread.
const SUMS: &str = r#"
void run(uint i) {
    Point p = Points(points).at[i / samples];
    float sum = 0.0;
    for (uint entry = i % samples; entry < lights().near_count; entry += samples) sum += probability_for(p, entry);
    Floats(to).at[i] = sum;
}
"#;

fn sums(rig: &mut Rig, points: &[Point]) -> Result<Vec<f64>> {
    const SHARES: u32 = 64;
    let threads = points.len() as u32 * SHARES;
    let kernel = rig.kernel("sums.comp", SUMS)?;
    let job = Job { samples: SHARES, ..Job::new(kernel, threads, threads as usize, points) };
    Ok(rig.run(job)?.floats().chunks(SHARES as usize).map(|shares| shares.iter().sum()).collect())
}

#[test]
fn probabilities_sum_to_1_everywhere() -> Result<()> {
    let Some(gpu) = gpu()? else { return Ok(()) };
    let mut glowing = empty("glowing");
    surfaces(&mut glowing);
    let cases = [
        ("1 lamp", town(1), 8),
        ("10 lamps", town(10), 32),
        ("1,000 lamps", town(1000), 32),
        ("10,000 lamps", town(10_000), 16),
        ("surfaces", glowing, 64),
        ("everything", everything(), 64),
    ];
    for (name, scene, count) in cases {
        let mut rig = Rig::new(&gpu, &scene)?;
        let mut points = town_points(scene.lights.len() as u32, count);
        points.extend(points_in(Vec3::splat(8.0), count, &mut Numbers(1)));
        let sums = sums(&mut rig, &points)?;
        let worst = sums.iter().map(|sum| (sum - 1.0).abs()).fold(0.0, f64::max);
        println!("{name}: sums differ from 1 by at most {worst:.1e}");
        ensure!(sums.iter().all(|sum| (sum - 1.0).abs() < 1e-4), "{name}: {sums:?}");
    }
    Ok(())
}

/// Chooses, counts, and compares with the probability of what was chosen. After the counts: the greatest relative difference, choices without a
/// light, and the pairs of nodes that were compared.
const CHOICES: &str = r#"
void run(uint i) {
    Point p = Points(points).at[i / samples];
    uint count = lights().near_count;
    uint tail = count * (threads / samples);
    uint entry;
    float probability;
    uvec4 words = hash4(uvec4(i, seed, 1u, 2u));
    if (!choose_for(p, unit_floats(words).xy, entry, probability)) {
        atomicAdd(Words(to).at[tail + 1u], 1u);
        return;
    }
    atomicAdd(Words(to).at[tail + 2u], light_pairs_read);
    float known = probability_for(p, entry);
    float off = probability > 0.0 ? abs(known - probability) / probability : 1e30;
    atomicMax(Words(to).at[tail], floatBitsToUint(off));
    if (entry < count) atomicAdd(Words(to).at[count * (i / samples) + entry], 1u);
}
"#;

/// Probabilities of all entries at each point.
const PROBABILITIES: &str = r#"
void run(uint i) {
    Floats(to).at[i] = probability_for(Points(points).at[i / lights().near_count], i % lights().near_count);
}
"#;

struct Choices {
    counts: Vec<f64>,
    /// Greatest relative difference between the probability of a choice and that of the light.
    off: f64,
    none: u32,
    pairs: f64,
}

fn choices(rig: &mut Rig, points: &[Point], entries: u32, samples: u32) -> Result<Choices> {
    let threads = points.len() as u32 * samples;
    let tail = points.len() * entries as usize;
    let kernel = rig.kernel("choices.comp", CHOICES)?;
    let Answer { words, .. } = rig.run(Job { samples, seed: 3, ..Job::new(kernel, threads, tail + 3, points) })?;
    Ok(Choices {
        counts: words[..tail].iter().map(|count| f64::from(*count)).collect(),
        off: f64::from(f32::from_bits(words[tail])),
        none: words[tail + 1],
        pairs: f64::from(words[tail + 2]) / f64::from(threads),
    })
}

/// Entries in the table of a scene's lights: local lamps and emissive primitives.
fn entries_of(scene: &Scene) -> u32 {
    let lamps = scene.lights.iter().filter(|light| !matches!(light, Light::Directional { .. })).count();
    let emits = |i: &&magpie::scene::Instance| scene.materials[i.material as usize].emission != Vec3::ZERO;
    let primitives = |mesh: &Mesh| mesh.indices.len() / 3 + mesh.spheres.len();
    let surfaces = scene.instances.iter().filter(emits).map(|i| primitives(&scene.meshes[i.mesh as usize]));
    (lamps + surfaces.sum::<usize>()) as u32
}

#[test]
fn lights_are_chosen_as_often_as_their_probabilities_say() -> Result<()> {
    let Some(gpu) = gpu()? else { return Ok(()) };
    const SAMPLES: u32 = 1 << 16;
    // Three points near each other: one lamp 10^8 times as bright as the other, which is still found as often as it should.
    let mut unlike = empty("unlike");
    for (place, intensity) in [(1.0, 1e4), (3.0, 1.0), (2.0, 1e-4)] {
        let position = DVec3::new(place, 2.0, 0.0);
        unlike.lights.push(Light::Point { position, intensity: Vec3::splat(intensity), range: None });
    }
    for (name, scene, count) in [("town", town(1000), 3), ("everything", everything(), 6), ("unlike", unlike, 2)] {
        let mut rig = Rig::new(&gpu, &scene)?;
        let entries = entries_of(&scene);
        let points = points_in(Vec3::new(5.0, 4.0, 5.0), count, &mut Numbers(4));
        let found = choices(&mut rig, &points, entries, SAMPLES)?;
        ensure!(found.none == 0 && found.off < 1e-5, "{name}: {} without a light, off by {}", found.none, found.off);
        let kernel = rig.kernel("probabilities.comp", PROBABILITIES)?;
        let cells = entries * points.len() as u32;
        let shares = rig.run(Job::new(kernel, cells, cells as usize, &points))?.floats();
        ensure!(shares.iter().all(|share| (0.0..=1.0001).contains(share)), "{name}: no probability");
        let entries = entries as usize;
        for (at, (counts, shares)) in found.counts.chunks(entries).zip(shares.chunks(entries)).enumerate() {
            let expected: Vec<f64> = shares.iter().map(|share| share * f64::from(SAMPLES)).collect();
            let never = counts.iter().zip(shares).filter(|(count, share)| **count > 0.0 && **share == 0.0).count();
            let result = chi_square(counts, &expected);
            println!("{name} {at}: {result:?}, choices and probabilities differ by {:.1e}", found.off);
            ensure!(never == 0, "{name}: {never} were chosen that never should be");
            ensure!(result.deviate < 4.0, "{name}, point {at}: {result:?}");
        }
    }
    Ok(())
}

/// For each light that sends anything to a point by some sample: whether its probability is above 0, by itself and with splitting.
const SEEN: &str = r#"
void run(uint i) {
    uint count = lights().near_count;
    Point p = Points(points).at[i / count];
    uint entry = i % count;
    float greatest = 0.0;
    for (uint k = 0u; k < samples; k++) {
        greatest = max(greatest, sent(entry, p, unit_floats(hash4(uvec4(i, k, seed, 5u))).xy));
    }
    if (!(greatest > 0.0)) return;
    atomicAdd(Words(to).at[0], 1u);
    float alone = probability_for(p, entry);
    float among = split_probability_for(p, entry);
    if (alone > 0.0 && among > 0.0) return;
    atomicAdd(Words(to).at[1], 1u);
    atomicMax(Words(to).at[2], floatBitsToUint(greatest));
    Words(to).at[3] = entry;
}
"#;

#[test]
fn whatever_can_be_seen_has_a_probability() -> Result<()> {
    let Some(gpu) = gpu()? else { return Ok(()) };
    let scene = everything();
    let mut rig = Rig::new(&gpu, &scene)?;
    let entries = entries_of(&scene);
    let mut numbers = Numbers(9);
    let mut points = points_in(Vec3::splat(9.0), 500, &mut numbers);
    // Points that face away from a lamp by a hair, and in the plane of a surface.
    for light in &scene.lights {
        let Light::Point { position, .. } = light else { continue };
        let towards = (position.as_vec3() - Vec3::new(points[0].position[0], 0.0, 0.0)).normalize();
        let normal = towards.any_orthonormal_vector();
        for turn in [-1e-4, 1e-6, 1e-4_f32] {
            let normal = (normal + turn * towards).normalize();
            points.push(Point {
                position: [points[0].position[0], 0.0, 0.0],
                normal: normal.to_array(),
                both_sides: 0,
            });
        }
    }
    for time in [0.0, 0.7] {
        rig.go_to(time, DVec3::new(3.0, -1.0, 2.0));
        let kernel = rig.kernel("seen.comp", SEEN)?;
        let split = LightSplit { threshold: 0.0, most: MOST_SPLIT_LIGHTS };
        let threads = entries * points.len() as u32;
        let job = Job { samples: 12, split, seed: time as u32, ..Job::new(kernel, threads, 4, &points) };
        let words = rig.run(job)?.words;
        let greatest = f32::from_bits(words[2]);
        println!("{} of {threads} pairs see each other, {} have no probability", words[0], words[1]);
        ensure!(words[0] > 10_000, "too few pairs to tell: {}", words[0]);
        ensure!(words[1] == 0, "{} are missed, such as entry {} with {greatest}", words[1], words[3]);
    }
    Ok(())
}

/// Lights of all of one kind, where numbers may leave their range.
fn hard_cases() -> Vec<(&'static str, Scene)> {
    let point = |x: f64, y: f64, z: f64, intensity: f32| Light::Point {
        position: DVec3::new(x, y, z),
        intensity: Vec3::splat(intensity),
        range: None,
    };
    let case = |name, lights: Vec<Light>| {
        let mut made = empty(name);
        made.lights = lights;
        (name, made)
    };
    let numbers = &mut Numbers(10);
    let mut together = vec![point(0.0, 1.0, 0.0, 1.0); 100];
    together.extend((0..100).map(|_| Light::Spot {
        position: DVec3::Y,
        direction: numbers.direction(),
        intensity: Vec3::ONE,
        range: Some(1e-3),
        inner: 0.0,
        outer: 1e-4,
    }));
    let flat = |size: f32| Light::Rectangle {
        centre: DVec3::new(0.0, 1.0, 0.0),
        half_u: Vec3::X * size,
        half_v: Vec3::Z * size,
        radiance: Vec3::splat(3.0),
    };
    vec![
        case("all in one point", together),
        case("none with any power", vec![point(1.0, 1.0, 0.0, 0.0); 5]),
        case("one of many with power", (0..99).map(|i| point(f64::from(i), 1.0, 0.0, f32::from(i == 40))).collect()),
        case("10^8 beside 1", vec![point(0.0, 1.0, 0.0, 1e8), point(1.0, 1.0, 0.0, 1.0), point(0.5, 1.0, 0.0, 1.0)]),
        case("10^35 beside 10^-35", vec![point(0.0, 1.0, 0.0, 1e35), point(1.0, 1.0, 0.0, 1e-35)]),
        case(
            "10^9 metres away",
            vec![point(1e9, 1.0, 0.0, 1.0), point(0.0, 1.0, 0.0, 1.0), point(0.0, -1e9, 0.0, 1.0)],
        ),
        case("no size and a great size", vec![flat(0.0), flat(1e-20), flat(1.0), flat(1e6)]),
    ]
}

/// Every number that the functions give, where the lights themselves are, and around them.
const NUMBERS: &str = r#"
void run(uint i) {
    Point p = Points(points).at[i / samples];
    vec2 u = unit_floats(hash4(uvec4(i, seed, 3u, 4u))).xy;
    if (i % samples == 0u) u = vec2(0.0);
    if (i % samples == 1u) u = vec2(1.0 - 1.0 / 16777216.0);
    uint entries[MOST_SPLIT_LIGHTS + 1u];
    float probabilities[MOST_SPLIT_LIGHTS + 1u];
    uint several[MOST_SPLIT_LIGHTS];
    float several_probabilities[MOST_SPLIT_LIGHTS];
    uint count = choose_several_for(p, u, several, several_probabilities);
    uint bad = count > split.most ? 1u : 0u;
    for (uint k = 0u; k < count; k++) {
        float known = split_probability_for(p, several[k]);
        float probability = several_probabilities[k];
        bool fine = several[k] < lights().near_count && probability > 0.0 && probability <= 1.0 && abs(known - probability) <= 1e-5 * probability;
        if (!fine) bad++;
    }
    uint entry;
    float probability;
    if (choose_for(p, u, entry, probability)) {
        float known = probability_for(p, entry);
        bool fine = entry < lights().near_count && probability > 0.0 && probability <= 1.0 && abs(known - probability) <= 1e-5 * probability;
        if (!fine) bad++;
    } else {
        atomicAdd(Words(to).at[1], 1u);
    }
    atomicAdd(Words(to).at[0], bad);
    atomicAdd(Words(to).at[2], count);
}
"#;

#[test]
fn numbers_stay_in_range_in_hard_cases() -> Result<()> {
    let Some(gpu) = gpu()? else { return Ok(()) };
    for (name, scene) in hard_cases() {
        let mut rig = Rig::new(&gpu, &scene)?;
        let mut points = points_in(Vec3::splat(2.0), 30, &mut Numbers(11));
        for light in scene.lights.iter().take(20) {
            let (Light::Point { position, .. }
            | Light::Spot { position, .. }
            | Light::Rectangle { centre: position, .. }) = light
            else {
                continue;
            };
            for normal in [Vec3::Y, Vec3::NEG_Y, Vec3::ZERO] {
                points.push(Point {
                    position: position.as_vec3().to_array(),
                    normal: normal.to_array(),
                    both_sides: 0,
                });
            }
        }
        let sums = sums(&mut rig, &points)?;
        let shines = name != "none with any power";
        let wanted = f64::from(u8::from(shines));
        ensure!(sums.iter().all(|sum| (sum - wanted).abs() < 1e-4), "{name}: {sums:?}");
        const SAMPLES: u32 = 40;
        let threads = points.len() as u32 * SAMPLES;
        let kernel = rig.kernel("numbers.comp", NUMBERS)?;
        for split in [LightSplit { threshold: 0.0, most: 16 }, LightSplit { threshold: 0.5, most: 3 }] {
            let answer = rig.run(Job { samples: SAMPLES, split, ..Job::new(kernel, threads, 3, &points) })?;
            let [bad, none, several] = [0, 1, 2].map(|i| answer.words[i]);
            ensure!(bad == 0, "{name}: {bad} of {threads} answers are out of range");
            ensure!(none == if shines { 0 } else { threads }, "{name}: {none} without a light");
            ensure!((several > 0) == shines, "{name}: {several} by splitting");
        }
    }
    Ok(())
}

fn inside(inner: &LightNode, outer: &LightNode) -> bool {
    (0..3).all(|axis| outer.min[axis] <= inner.min[axis] && inner.max[axis] <= outer.max[axis])
}

/// Whether two nodes are the same but for rounding.
fn alike(a: &LightNode, b: &LightNode) -> bool {
    let near = |a: f32, b: f32, scale: f32| (a - b).abs() <= 1e-4 * scale + 1e-5 * a.abs().max(b.abs());
    if a.intensity == 0.0 || b.intensity == 0.0 {
        return a.intensity == b.intensity && a.child == b.child;
    }
    let cones = a.cos_normals < -0.999 && b.cos_normals < -0.999
        || near(a.cos_normals, b.cos_normals, 1.0) && Vec3::from(a.axis).dot(b.axis.into()) > 0.9999;
    (0..3).all(|k| near(a.min[k], b.min[k], 0.1) && near(a.max[k], b.max[k], 0.1))
        && near(a.intensity, b.intensity, 0.0)
        && near(a.reach, b.reach, 0.0)
        && near(a.spread, b.spread, 1.0)
        && near(a.cos_emission, b.cos_emission, 0.01)
        && (a.count, a.child) == (b.count, b.child)
        && cones
}

/// By what the areas of a ball grow on average that is halved along one axis: half the volume times the root mean square of 1, 2 and 1.
const BALL_GROWTH: f32 = 0.5 * std::f32::consts::SQRT_2;

/// Area of a mesh that has moved so far towards its target.
fn area(mesh: &Mesh, weight: f32) -> f32 {
    let target = &mesh.targets[0].positions;
    let at = |i: u32| mesh.positions[i as usize] + weight * target[i as usize];
    let double = |t: &[u32]| (at(t[1]) - at(t[0])).cross(at(t[2]) - at(t[0])).length();
    mesh.indices.chunks(3).map(|t| 0.5 * double(t)).sum()
}

#[test]
fn a_refit_holds_what_has_moved() -> Result<()> {
    let Some(gpu) = gpu()? else { return Ok(()) };
    let scene = everything();
    let mut rig = Rig::new(&gpu, &scene)?;
    let (at_rest, _) = rig.nodes(true)?;
    rig.go_to(0.7, DVec3::new(2.0, 0.0, -1.0));
    let (moved, passes) = rig.nodes(true)?;
    ensure!(passes.contains(&"light_tree.meshes".to_owned()) && passes.contains(&"light_tree.lamps".to_owned()));
    ensure!(at_rest.len() == moved.len() && !alike(&at_rest[0], &moved[0]), "nothing has moved");
    // Every node holds its children, and adds up.
    let kind = |node: &LightNode| node.child >> 30;
    let first = |node: &LightNode| (node.child & LIGHT_NODE_INDEX) as usize;
    let mut inner = 0;
    for node in moved.iter().filter(|node| kind(node) == 0) {
        let children = [moved[first(node)], moved[first(node) + 1]];
        let shining: Vec<&LightNode> = children.iter().filter(|child| child.intensity > 0.0).collect();
        ensure!(shining.iter().all(|child| inside(child, node) && child.reach <= node.reach), "{node:?} {children:?}");
        ensure!(shining.iter().all(|child| child.cos_normals >= node.cos_normals - 1e-6), "{node:?} {children:?}");
        let sum: f32 = children.iter().map(|child| child.intensity).sum();
        ensure!((sum - node.intensity).abs() <= 1e-6 * sum, "{node:?} {children:?}");
        ensure!(node.count == children.iter().map(|child| child.count).sum::<u32>(), "{node:?} {children:?}");
        inner += 1;
    }
    ensure!(2 * inner + 1 >= moved.len() / 2, "{inner} inner nodes");
    // The root equals that of a tree built for this moment, but for the mesh that deforms, which is built in its pose at rest; and a refit of
    // that tree changes no node of the others.
    rig.rebuild()?;
    let (fresh, passes) = rig.nodes(false)?;
    ensure!(!passes.iter().any(|pass| pass.starts_with("light_tree.")), "{passes:?}");
    let (a, b) = (&moved[0], &fresh[0]);
    let near = |a: [f32; 3], b: [f32; 3]| Vec3::from(a).abs_diff_eq(b.into(), 1e-4);
    ensure!(near(a.min, b.min) && near(a.max, b.max) && a.count == b.count, "{a:?} {b:?}");
    let ball = &scene.meshes[scene.instances[scene.instances.len() - 1].mesh as usize];
    let more = BALL_GROWTH * BALL_LUMINANCE * (area(ball, 0.7) - area(ball, 0.0));
    ensure!(more > 0.2 * b.intensity, "the ball hardly grows: {more}");
    ensure!((a.intensity - b.intensity - more).abs() < 1e-3 * b.intensity, "{a:?} {b:?} {more}");
    let (again, _) = rig.nodes(true)?;
    let deforming = 2 * ball.indices.len() / 3 - 1;
    let rigid = fresh.len() - deforming;
    let differ: Vec<usize> = (1..rigid).filter(|i| !alike(&fresh[*i], &again[*i])).collect();
    let names = differ.iter().take(3).map(|i| format!("{:?}\n{:?}", fresh[*i], again[*i])).collect::<Vec<_>>();
    println!("{} nodes, {} of which differ from the host's", fresh.len(), differ.len());
    // The nodes above the ball that deforms.
    ensure!(differ.len() <= 12, "{} nodes differ:\n{}", differ.len(), names.join("\n"));
    Ok(())
}

#[test]
fn nothing_runs_where_nothing_moves() -> Result<()> {
    let Some(gpu) = gpu()? else { return Ok(()) };
    let mut rig = Rig::new(&gpu, &everything())?;
    let kernel = rig.kernel(
        "root.comp",
        "void run(uint i) { LightNodeBufferWrite(to).at[0] = LightNodeBuffer(tree().nodes).at[0]; }",
    )?;
    let frame = |rig: &mut Rig| -> Result<(Vec<String>, LightNode)> {
        let answer = rig.run(Job::new(kernel, 1, 16, &[]))?;
        let passes = answer.passes.into_iter().filter(|pass| pass.starts_with("light_tree.")).collect();
        Ok((passes, bytemuck::pod_read_unaligned(bytemuck::cast_slice(&answer.words[..16]))))
    };
    let all = ["light_tree.meshes", "light_tree.lamps"];
    rig.go_to(0.0, DVec3::ZERO);
    ensure!(frame(&mut rig)?.0 == all, "the first frame");
    let (passes, root) = frame(&mut rig)?;
    ensure!(passes.is_empty(), "{passes:?}");
    // A lamp is dimmed to nothing and comes back.
    rig.scene.borrow_mut().scale_light(0, 0.0);
    let (passes, dark) = frame(&mut rig)?;
    ensure!(passes == all[1..] && dark.count + 1 == root.count && dark.intensity < root.intensity, "{passes:?}");
    ensure!(frame(&mut rig)?.0.is_empty(), "it stays dark");
    rig.scene.borrow_mut().scale_light(0, 1.0);
    let (passes, again) = frame(&mut rig)?;
    ensure!(passes == all[1..] && again == root, "{passes:?}");
    rig.go_to(0.0, DVec3::Y);
    ensure!(frame(&mut rig)?.0 == all[1..], "the origin is another");
    rig.go_to(0.5, DVec3::Y);
    ensure!(frame(&mut rig)?.0 == all, "everything moves");
    rig.go_to(0.5, DVec3::Y);
    ensure!(frame(&mut rig)?.0.is_empty(), "time stands still");
    Ok(())
}

#[test]
fn the_cost_of_a_choice_grows_as_the_depth_does() -> Result<()> {
    let Some(gpu) = gpu()? else { return Ok(()) };
    let mut pairs = Vec::new();
    for lamps in [10, 100, 1000, 10_000] {
        let mut rig = Rig::new(&gpu, &town(lamps))?;
        let found = choices(&mut rig, &town_points(lamps, 64), lamps, 64)?;
        println!("{lamps} lamps: {:.1} pairs of nodes per choice", found.pairs);
        pairs.push(found.pairs);
    }
    // Ten times as many lamps are log2(10), 3.3, levels more.
    for pair in pairs.windows(2) {
        ensure!((1.0..5.0).contains(&(pair[1] - pair[0])), "{pairs:?}");
    }
    Ok(())
}
