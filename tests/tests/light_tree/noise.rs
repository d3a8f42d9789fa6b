//! How much noise choices by the tree leave, beside choices by power.
use super::rig::{Job, Numbers, Point, Rig, points_in};
use super::scenes::{empty, lamps, leaving_town, surfaces, town, town_points};
use anyhow::{Result, ensure};
use glam::{DVec3, Vec3};
use magpie_shaders::light_tree::{LightSplit, MOST_SPLIT_LIGHTS};
use magpie_tests::harness::gpu;

/// Means over `samples` choices of what the chosen lights send, over their probabilities; by power, by the tree, and by splitting it. Last the pairs of
/// nodes that were compared.
const ESTIMATES: &str = r#"
void run(uint i) {
    Point p = Points(points).at[i / TRIALS];
    float sum = 0.0;
    uint taken = 0u;
    for (uint k = 0u; taken < samples; k++) {
        uvec4 words = hash4(uvec4(i, k, seed, 7u));
        vec2 u = unit_floats(words).xy;
        if (MODE == 0u) {
            LightChoiceBuffer table = LightChoiceBuffer(lights().near);
            uint entry = choose(table, lights().near_count, words.x, u.y);
            sum += sent(entry, p, u) / table.at[entry].probability;
        } else if (MODE == 1u) {
            uint entry;
            float probability;
            if (choose_for(p, u, entry, probability)) sum += sent(entry, p, u) / probability;
        } else {
            uint entries[MOST_SPLIT_LIGHTS];
            float probabilities[MOST_SPLIT_LIGHTS];
            uint count = choose_several_for(p, u, entries, probabilities);
            for (uint n = 0u; n < count; n++) sum += sent(entries[n], p, u) / probabilities[n];
            taken += max(count, 1u) - 1u;
        }
        taken++;
        if (taken >= samples) Floats(to).at[i] = sum / float(k + 1u);
    }
    atomicAdd(Words(to).at[threads], light_pairs_read / samples);
}
"#;

/// What all lights send, a share of them per thread.
const TRUTH: &str = r#"
void run(uint i) {
    Point p = Points(points).at[i / samples];
    float sum = 0.0;
    for (uint entry = i % samples; entry < lights().near_count; entry += samples) sum += sent(entry, p, vec2(0.5));
    Floats(to).at[i] = sum;
}
"#;

const TRIALS: u32 = 64;

/// Illuminance from all lamps, which have no size, at each point that has any.
fn truth(rig: &mut Rig, points: &mut Vec<Point>) -> Result<Vec<f64>> {
    const SHARES: u32 = 64;
    let kernel = rig.kernel("truth.comp", TRUTH)?;
    let threads = points.len() as u32 * SHARES;
    let job = Job { samples: SHARES, ..Job::new(kernel, threads, threads as usize, points) };
    let sums: Vec<f64> = rig.run(job)?.floats().chunks(SHARES as usize).map(|shares| shares.iter().sum()).collect();
    let mut lit = sums.iter();
    points.retain(|_| lit.next().is_some_and(|sum| *sum > 0.0));
    Ok(sums.into_iter().filter(|sum| *sum > 0.0).collect())
}

#[derive(Clone, Copy, PartialEq)]
enum By {
    Power,
    Tree,
    Splitting(f32),
}

struct Noise {
    /// Root mean square error over the truth of each point.
    relative: f64,
    /// Mean of the estimates over that of the truth.
    bias: f64,
    /// Pairs of nodes compared per light.
    pairs: f64,
}

fn noise(rig: &mut Rig, points: &[Point], truth: &[f64], by: By, samples: u32) -> Result<Noise> {
    let (mode, threshold) = match by {
        By::Power => (0, 0.0),
        By::Tree => (1, 0.0),
        By::Splitting(threshold) => (2, threshold),
    };
    let constants = format!("const uint MODE = {mode}u;\nconst uint TRIALS = {TRIALS}u;\n");
    let kernel = rig.kernel("estimates.comp", &format!("{constants}{ESTIMATES}"))?;
    let threads = points.len() as u32 * TRIALS;
    let split = LightSplit { threshold, most: samples.min(MOST_SPLIT_LIGHTS) };
    let answer =
        rig.run(Job { samples, seed: 12, split, ..Job::new(kernel, threads, threads as usize + 1, points) })?;
    let pairs = f64::from(answer.words[threads as usize]) / f64::from(threads);
    let estimates = &answer.floats()[..threads as usize];
    let mut squares = 0.0;
    for (trials, truth) in estimates.chunks(TRIALS as usize).zip(truth) {
        squares += trials.iter().map(|x| (x / truth - 1.0).powi(2)).sum::<f64>();
    }
    let relative = estimates.chunks(TRIALS as usize).zip(truth).map(|(t, truth)| t.iter().sum::<f64>() / truth);
    let n = f64::from(threads);
    Ok(Noise { relative: (squares / n).sqrt(), bias: relative.sum::<f64>() / n, pairs })
}

#[test]
fn the_tree_has_a_fraction_of_the_noise_of_power() -> Result<()> {
    let Some(gpu) = gpu()? else { return Ok(()) };
    const LAMPS: u32 = 10_000;
    let mut rig = Rig::new(&gpu, &town(LAMPS))?;
    let mut points = town_points(LAMPS, 96);
    let truth = truth(&mut rig, &mut points)?;
    let power = noise(&mut rig, &points, &truth, By::Power, 16)?;
    let tree = noise(&mut rig, &points, &truth, By::Tree, 16)?;
    println!("{} lamps, {} points, 16 lights each", LAMPS, points.len());
    println!("power: RMSE {:.3} of the truth, mean {:.3}", power.relative, power.bias);
    println!("tree: RMSE {:.3}, mean {:.3}, {:.1} pairs of nodes", tree.relative, tree.bias, tree.pairs);
    println!("tree over power: {:.3}", tree.relative / power.relative);
    let split = noise(&mut rig, &points, &truth, By::Splitting(1.0), 16)?;
    let over = split.relative / power.relative;
    println!(
        "split: RMSE {:.3}, mean {:.3}, {:.1} pairs; over power {over:.3}",
        split.relative, split.bias, split.pairs
    );
    ensure!((split.bias - 1.0).abs() < 0.05, "biased: {}", split.bias);
    ensure!((tree.bias - 1.0).abs() < 0.05, "biased: {}", tree.bias);
    ensure!(tree.relative < 0.5 * power.relative, "{} against {}", tree.relative, power.relative);
    ensure!(over < 0.2, "split {over}");
    Ok(())
}

/// The topology stays that of the first moment. What lamps do that leave their places costs noise, not bias, and a new tree gets it back.
#[test]
fn lamps_that_leave_their_places_cost_noise() -> Result<()> {
    let Some(gpu) = gpu()? else { return Ok(()) };
    let full = std::env::var_os("MAGPIE_FULL").is_some();
    const LAMPS: u32 = 4000;
    let mut rig = Rig::new(&gpu, &leaving_town(LAMPS))?;
    let times = if full { vec![0.0, 0.01, 0.03, 0.1, 0.3, 1.0] } else { vec![0.1] };
    let mut worst = 0.0_f64;
    for time in times {
        // Where the tree was built for time 0.
        rig.go_to(0.0, DVec3::ZERO);
        rig.rebuild()?;
        rig.go_to(time, DVec3::ZERO);
        let mut points = town_points(LAMPS, 64);
        let truth = truth(&mut rig, &mut points)?;
        let power = noise(&mut rig, &points, &truth, By::Power, 16)?;
        let refitted = noise(&mut rig, &points, &truth, By::Tree, 16)?;
        rig.rebuild()?;
        let rebuilt = noise(&mut rig, &points, &truth, By::Tree, 16)?;
        let [a, b, c] = [&refitted, &rebuilt, &power].map(|noise| noise.relative);
        println!("{time} s: RMSE {a:.3} refitted, {b:.3} rebuilt, {c:.3} by power; {:.1} pairs", refitted.pairs);
        ensure!((refitted.bias - 1.0).abs() < 0.1, "{time}: biased, {}", refitted.bias);
        ensure!(b < 0.65 * c, "{time}: rebuilt {b}, by power {c}");
        worst = worst.max(a / c);
    }
    ensure!(worst < 1.5, "a refitted tree is worse than power by far: {worst}");
    Ok(())
}

/// Emissive surfaces and lamps with a size, by their mean illuminance from many samples of a point: unbiased, and less noisy than by power.
#[test]
fn surfaces_are_chosen_well_too() -> Result<()> {
    let Some(gpu) = gpu()? else { return Ok(()) };
    let mut scene = empty("glowing");
    surfaces(&mut scene);
    lamps(&mut scene, 12, Vec3::new(8.0, 3.0, 8.0));
    let mut rig = Rig::new(&gpu, &scene)?;
    let mut points = points_in(Vec3::new(8.0, 0.1, 8.0), 48, &mut Numbers(13));
    points.iter_mut().for_each(|point| (point.normal, point.position[1]) = ([0.0, 1.0, 0.0], 0.01));
    const SAMPLES: u32 = 1024;
    let mean = |rig: &mut Rig, mode: u32, samples: u32| -> Result<Vec<Vec<f64>>> {
        let constants = format!("const uint MODE = {mode}u;\nconst uint TRIALS = {TRIALS}u;\n");
        // The point on the light by numbers of its own.
        let glsl = ESTIMATES.replace("sent(entry, p, u)", "sent(entry, p, unit_floats(words).zw)");
        let kernel = rig.kernel("estimates.comp", &format!("{constants}{glsl}"))?;
        let threads = points.len() as u32 * TRIALS;
        let answer =
            rig.run(Job { samples, seed: mode, ..Job::new(kernel, threads, threads as usize + 1, &points) })?;
        Ok(answer.floats()[..threads as usize].chunks(TRIALS as usize).map(<[f64]>::to_vec).collect())
    };
    let averages = |all: &[Vec<f64>]| -> Vec<f64> {
        all.iter().map(|trials| trials.iter().sum::<f64>() / f64::from(TRIALS)).collect()
    };
    let many = mean(&mut rig, 1, SAMPLES)?;
    let by_tree = averages(&many);
    let by_power = averages(&mean(&mut rig, 0, SAMPLES)?);
    let total = |all: &[f64]| all.iter().sum::<f64>();
    let ratio = total(&by_tree) / total(&by_power);
    let rmse = |mode: u32, rig: &mut Rig| -> Result<f64> {
        let few = mean(rig, mode, 8)?;
        let errors =
            few.iter().zip(&by_tree).flat_map(|(trials, truth)| trials.iter().map(move |x| (x / truth - 1.0).powi(2)));
        Ok((errors.sum::<f64>() / f64::from(points.len() as u32 * TRIALS)).sqrt())
    };
    let (power, tree) = (rmse(0, &mut rig)?, rmse(1, &mut rig)?);
    println!("mean by the tree over that by power: {ratio:.4}; RMSE with 8 lights {tree:.3} and {power:.3}");
    ensure!((ratio - 1.0).abs() < 0.02, "{ratio}");
    ensure!(tree < 0.8 * power, "{tree} against {power}");
    Ok(())
}
