//! Every sampler of `shaders/lib` against its pdf: a million samples on the device in bins, compared with the integral of the pdf over each
//! bin (Pearson's χ² test); and the integral over everything, which is 1 less the share of invalid samples.
use anyhow::{Result, ensure};
use bytemuck::{Pod, Zeroable};
use magpie::gpu::{Buffer, BufferMemory, BufferUse};
use magpie::graph::{Access, BufferDesc, Domain, Extent, Queue, Record};
use magpie::scene::light_tables::{LightWeights, Tables};
use magpie_shaders::Address;
use magpie_tests::bench::{Bench, results};
use magpie_tests::chi_square::chi_square;
use magpie_tests::harness::{builtin, gpu};
use std::sync::Arc;

/// Bins on each side, and points on each side of a bin at which the pdf is evaluated.
const BINS: u32 = 16;
const POINTS: u32 = 112;
const SAMPLES: u32 = 1 << 20;

/// Directions are binned around an axis, finer near it: by `t = c / (c + width)`, where `c` is 1 less the cosine, and by the angle around.
/// For lobes with long tails three quarters of the bins are logarithmic, up to a right angle, where some of them end.
const FRAME: &str = r#"#version 460
#extension GL_GOOGLE_include_directive : require
#include "lib/bindless.glsl"
#include "lib/random.glsl"
#include "lib/light_sampling.glsl"
layout(local_size_x = 64) in;
layout(buffer_reference, scalar, buffer_reference_align = 4) buffer Words { uint at[]; };
layout(buffer_reference, scalar, buffer_reference_align = 4) buffer Floats { float at[]; };
layout(push_constant, scalar) uniform Push { uvec2 counts; uvec2 densities; uvec2 tables; uint samples; uint bins; uint points; };
"#;

const MAIN: &str = r#"
const float SHARP = 2.0 / (2.0 + WIDTH);
const float SLOW = log(1.0 + 1.0 / WIDTH) / 0.75;
float t_of(float c) {
    if (!TAIL) return c / (c + WIDTH) / SHARP;
    return c < 1.0 ? log(1.0 + c / WIDTH) / SLOW : 0.75 + 0.25 * (c - 1.0);
}
// And how much c changes with t.
float c_of(float t, out float slope) {
    if (!TAIL) {
        float left = 1.0 - t * SHARP;
        slope = SHARP * WIDTH / (left * left);
        return WIDTH * t * SHARP / left;
    }
    slope = t < 0.75 ? WIDTH * SLOW * exp(t * SLOW) : 4.0;
    return t < 0.75 ? WIDTH * (exp(t * SLOW) - 1.0) : 1.0 + 4.0 * (t - 0.75);
}
vec3 direction_of(vec2 at, out float slope) {
    float c = c_of(at.x, slope);
    return frame_of(AXIS) * around_z(2.0 * PI * at.y, sqrt(max(c * (2.0 - c), 0.0)), 1.0 - c);
}
void main() {
    uint i = gl_GlobalInvocationID.x;
    uint side = bins;
    if (i < samples) {
        Random random = random_of(i, 17u, 4u);
        uvec4 words = random_words(random);
        vec3 d;
        uint bin = side * side;
        if (sample_it(unit_floats(words), random_words(random), d)) {
            vec3 local = d * frame_of(AXIS);
            vec3 apart = d - AXIS;
            float c = 0.5 * dot(apart, apart);
            float around = atan(local.y, local.x) / (2.0 * PI);
            vec2 at = vec2(t_of(c), around < 0.0 ? around + 1.0 : around);
            uvec2 cell = min(uvec2(at * float(side)), uvec2(side - 1u));
            bin = cell.y * side + cell.x;
        }
        atomicAdd(Words(counts).at[bin], 1u);
    }
    if (i < side * side) {
        // The mean over the bin of density times solid angle.
        float sum = 0.0;
        for (uint y = 0u; y < points; y++) {
            float row = 0.0;
            for (uint x = 0u; x < points; x++) {
                vec2 inner = (vec2(x, y) + 0.5) / float(points);
                vec2 at = (vec2(i % side, i / side) + inner) / float(side);
                float slope;
                vec3 d = direction_of(at, slope);
                row += pdf_of(d) * slope * 2.0 * PI;
            }
            sum += row;
        }
        Floats(densities).at[i] = sum / float(side * side * points * points);
    }
}
"#;

#[repr(C)]
#[derive(Clone, Copy, Pod, Zeroable)]
struct Params {
    counts: Address,
    densities: Address,
    tables: Address,
    samples: u32,
    bins: u32,
    points: u32,
}

/// Runs a kernel; returns the counts, with invalid samples last, and the bins' probabilities.
fn run(bench: &mut Bench, name: &str, glsl: &str, bins: u32, tables: Option<&Tables>) -> Result<(Vec<f64>, Vec<f64>)> {
    let kernel = bench.kernel(name, glsl)?;
    let (gpu, cells) = (bench.gpu.clone(), bins * bins);
    let bytes = |n: u32| u64::from(n) * 4;
    let length = tables.map_or(4, Tables::bytes);
    let mut table = Buffer::new(&gpu, "tables", length, BufferMemory::Upload, BufferUse::Storage)?;
    let address = table.address();
    table.write(0, &tables.map_or(vec![0; 4], |t| t.placed(address)))?;
    let table = Arc::new(table);
    let mut zeros = Buffer::new(&gpu, "zeros", bytes(cells + 1), BufferMemory::Upload, BufferUse::Storage)?;
    zeros.write(0, &vec![0; bytes(cells + 1) as usize])?;
    let zeros = Arc::new(zeros);
    let mut read = None;
    bench.run(Extent::new(1, 1), &[], |g, imports| {
        let key = imports.borrow_mut().buffer(&table);
        let tables = g.import_buffer("tables", BufferDesc::new(length), Access::BufferRead, key).read();
        let key = imports.borrow_mut().buffer(&zeros);
        let zeros = g.import_buffer("zeros", BufferDesc::new(bytes(cells + 1)), Access::CopyRead, key).read();
        let (counts, counts_buffer) = results(&gpu, g, imports, "counts", bytes(cells + 1))?;
        let (densities, densities_buffer) = results(&gpu, g, imports, "densities", bytes(cells))?;
        let counts = g.pass("test.clear", Queue::Transfer, |p| {
            let from = p.copy_from(zeros);
            let (counts, to) = p.copy_to(counts);
            (counts, move |c: &mut Record<'_>| c.copy_buffer(from, 0, to, 0, bytes(cells + 1)))
        });
        let (counts, densities) = g.pass("test.sample", Queue::Graphics, |p| {
            let tables = p.read(tables);
            let (counts, count_target) = p.write_buffer(counts);
            let (densities, density_target) = p.write_buffer(densities);
            ((counts, densities), move |c: &mut Record<'_>| {
                let (counts, densities, tables) = (c.id(count_target), c.id(density_target), c.id(tables));
                let params = Params { counts, densities, tables, samples: SAMPLES, bins, points: POINTS };
                c.dispatch_groups(kernel, &params, [SAMPLES.max(cells).div_ceil(64), 1, 1]);
            })
        });
        g.leave(counts.read(), Access::HostRead, Domain::Compute);
        g.leave(densities.read(), Access::HostRead, Domain::Compute);
        read = Some((counts_buffer, densities_buffer));
        Ok(())
    })?;
    let (counts, densities) = read.ok_or_else(|| anyhow::anyhow!("nothing ran"))?;
    let words: &[u32] = bytemuck::cast_slice(&counts.contents()[..bytes(cells + 1) as usize]);
    let floats: &[f32] = bytemuck::cast_slice(&densities.contents()[..bytes(cells) as usize]);
    Ok((words.iter().map(|w| f64::from(*w)).collect(), floats.iter().map(|f| f64::from(*f)).collect()))
}

/// Compares samples with the pdf.
fn check(name: &str, counts: &[f64], shares: &[f64]) -> Result<()> {
    let (lost, counts) = (counts[counts.len() - 1], &counts[..counts.len() - 1]);
    let integral: f64 = shares.iter().sum();
    let lost = lost / f64::from(SAMPLES);
    let expected: Vec<f64> = shares.iter().map(|s| s * f64::from(SAMPLES)).collect();
    let result = chi_square(counts, &expected);
    println!(
        "{name:<44} integral {integral:.5}, lost {lost:.5}, chi square {:8.1} of {:3} ({:+.2})",
        result.statistic, result.freedom, result.deviate
    );
    ensure!(shares.iter().all(|s| s.is_finite() && *s >= 0.0), "{name}: a density is not a number above 0");
    ensure!((integral + lost - 1.0).abs() < 2e-3, "{name}: the density integrates to {integral}, and {lost} is lost");
    ensure!(result.freedom >= 8.0, "{name}: only {} bins have anything", result.freedom);
    ensure!(result.deviate < 4.0, "{name}: {result:?}");
    Ok(())
}

/// A sampler of directions: its sample and pdf functions, the axis of the bins, and their width.
struct Case {
    name: String,
    code: String,
    axis: String,
    width: f32,
    tail: bool,
}

fn case(name: &str, axis: &str, width: f32, sample: &str, pdf: &str) -> Case {
    let code =
        format!("bool sample_it(vec4 u, uvec4 words, out vec3 d) {{ {sample} }}\nfloat pdf_of(vec3 d) {{ {pdf} }}\n");
    Case { name: name.to_owned(), code, axis: axis.to_owned(), width, tail: false }
}

/// The same for a lobe that extends to the horizon.
fn lobe(name: &str, axis: &str, width: f32, sample: &str, pdf: &str) -> Case {
    Case { tail: true, ..case(name, axis, width, sample, pdf) }
}

fn all(cases: &[Case], tables: Option<&Tables>) -> Result<()> {
    let Some(gpu) = gpu()? else { return Ok(()) };
    let mut bench = Bench::new(&gpu)?;
    for Case { name, code, axis, width, tail } in cases {
        let constants = format!(
            "const vec3 AXIS = normalize({axis});\nconst float WIDTH = {width:?};\nconst bool TAIL = {tail};\n"
        );
        let (counts, shares) =
            run(&mut bench, "sampler.comp", &format!("{FRAME}{constants}{code}{MAIN}"), BINS, tables)?;
        check(name, &counts, &shares)?;
    }
    Ok(())
}

#[test]
fn plain_shapes() -> Result<()> {
    let cone = |width: f32| {
        case(
            &format!("cone, 1 - cos = {width}"),
            "vec3(0.0, 0.0, 1.0)",
            width,
            &format!("d = sample_cone(u.xy, {width:?}); return true;"),
            &format!("return 0.5 * dot(d - AXIS, d - AXIS) < {width:?} ? cone_pdf({width:?}) : 0.0;"),
        )
    };
    all(
        &[
            case(
                "cosine",
                "vec3(0.0, 0.0, 1.0)",
                1.0,
                "d = sample_cosine(u.xy); return true;",
                "return max(d.z, 0.0) / PI;",
            ),
            case("sphere", "vec3(0.3, 0.5, -0.2)", 1.0, "d = sample_sphere(u.xy); return true;", "return 0.25 / PI;"),
            cone(0.5),
            cone(1.08e-5),
        ],
        None,
    )
}

#[test]
fn visible_normals() -> Result<()> {
    let mut cases = Vec::new();
    for alpha in [0.002, 0.05, 0.3, 1.0] {
        for cosine in [1.0_f32, 0.6, 0.1, 0.01] {
            let v = format!("vec3({:?}, 0.0, {cosine:?})", (1.0 - cosine * cosine).sqrt());
            cases.push(lobe(
                &format!("visible normals, alpha {alpha}, cosine {cosine}"),
                "vec3(0.0, 0.0, 1.0)",
                (alpha * alpha) as f32,
                &format!("d = sample_visible_normal({v}, {alpha:?}, u.xy); return true;"),
                &format!("return visible_normal_pdf({v}, d, {alpha:?});"),
            ));
        }
    }
    all(&cases, None)
}

#[test]
fn surface_models() -> Result<()> {
    let opaque = |metal: f32, rough: f32| format!("opaque_bsdf(vec3(0.7, 0.5, 0.3), {metal:?}, {rough:?})");
    let glass = |eta: f32, thin: bool, rough: f32| {
        format!(
            "Bsdf(vec3(0.9), 0.0, Fresnel(vec3(0.04), 1.0, vec3(0.04), 0.9974), {:?}, 1.0, {eta:?}, {thin}, 0.0, 1.0, NO_LESS, NO_SPLIT_SUM, NO_SPLIT_SUM)",
            rough * rough
        )
    };
    let models = [
        ("matte", opaque(0.0, 0.9), "LOBE_ALL"),
        ("plastic", opaque(0.0, 0.3), "LOBE_ALL"),
        ("plastic, specular lobe", opaque(0.0, 0.3), "LOBE_SPECULAR"),
        ("plastic, diffuse lobe", opaque(0.0, 0.3), "LOBE_DIFFUSE"),
        ("metal", opaque(1.0, 0.5), "LOBE_ALL"),
        ("half metal", opaque(0.5, 0.4), "LOBE_ALL"),
        (
            "coated",
            "Bsdf(vec3(0.7), 0.0, Fresnel(vec3(0.04), 1.0, vec3(0.04), 0.9974), 0.4, 0.0, 1.5, false, 1.0, 0.05, NO_LESS, NO_SPLIT_SUM, NO_SPLIT_SUM)"
                .to_owned(),
            "LOBE_ALL",
        ),
        ("glass from outside", glass(1.5, false, 0.5), "LOBE_ALL"),
        ("glass from inside", glass(1.0 / 1.5, false, 0.5), "LOBE_ALL"),
        ("thin glass", glass(1.5, true, 0.5), "LOBE_ALL"),
        (
            "half glass, what goes through",
            "Bsdf(vec3(0.9), 0.0, Fresnel(vec3(0.04), 1.0, vec3(0.04), 0.9974), 0.3, 0.5, 1.5, false, 0.0, 1.0, NO_LESS, NO_SPLIT_SUM, NO_SPLIT_SUM)"
                .to_owned(),
            "LOBE_TRANSMISSION",
        ),
    ];
    let mut cases = Vec::new();
    for (name, bsdf, lobes) in &models {
        for cosine in [0.95_f32, 0.3] {
            let v = format!("vec3({:?}, 0.0, {cosine:?})", (1.0 - cosine * cosine).sqrt());
            cases.push(lobe(
                &format!("{name}, cosine {cosine}"),
                "vec3(-0.4, 0.1, 0.8)",
                0.5,
                &format!("Bsdf b = {bsdf}; return bsdf_sample(b, {v}, {lobes}, u.x, u.yz, d);"),
                &format!("Bsdf b = {bsdf}; return bsdf_pdf(b, {v}, d, {lobes});"),
            ));
        }
    }
    all(&cases, None)
}

#[test]
fn lights_with_a_size() -> Result<()> {
    let light = |kind: &str, radius: f32| {
        format!(
            "Light light; light.kind = {kind}; light.position = vec3(0.5, 2.0, 0.3); light.direction = normalize(vec3(0.1, -1.0, -0.2)); \
             light.intensity = vec3(1.0); light.radius = {radius:?}; light.range = 0.0; \
             light.half_u = vec3(0.8, 0.08, 0.0); light.half_v = 0.6 * normalize(cross(light.half_u, light.direction)) * sign(1.0);"
        )
    };
    let lights = [
        ("rectangle", light("LIGHT_RECTANGLE", 0.0), 0.1),
        ("disc", light("LIGHT_DISC", 0.9), 0.1),
        ("sphere", light("LIGHT_SPHERE", 0.9), 0.1),
        ("small sphere", light("LIGHT_SPHERE", 0.01), 1.5e-5),
        ("sun", light("LIGHT_DIRECTIONAL", 0.00465), 1e-5),
        ("wide sun", light("LIGHT_DIRECTIONAL", 0.6), 0.2),
    ];
    let cases: Vec<Case> = lights
        .iter()
        .map(|(name, light, width)| {
            let axis = if name.contains("sun") { "vec3(-0.1, 1.0, 0.2)" } else { "vec3(0.5, 2.0, 0.3)" };
            case(
                name,
                axis,
                *width,
                &format!("{light} Incident found; bool ok = sample_sized_light(light, vec3(0.0), u.xy, found); d = found.direction; return ok;"),
                &format!("{light} float far; vec3 radiance; float pdf; return meet_light(light, vec3(0.0), d, far, radiance, pdf) ? pdf : 0.0;"),
            )
        })
        .collect();
    all(&cases, None)
}

/// The courtyard's sky, by cells of its table.
#[test]
fn the_sky() -> Result<()> {
    let scenes = [("sky", builtin("courtyard")?), ("environment map", magpie_tests::oracle::scenes::environment_map())];
    let sample = "LightTables t = LightTablesBuffer(tables).at[0]; \
        uint cell = choose(LightChoiceBuffer(t.sky), t.sky_cells.x * t.sky_cells.y, words.x, u.z); \
        d = sky_direction((vec2(cell % t.sky_cells.x, cell / t.sky_cells.x) + u.xy) / vec2(t.sky_cells)); return true;";
    let pdf = "return sky_pdf(LightTablesBuffer(tables).at[0], d);";
    for (name, scene) in scenes {
        all(&[case(name, "vec3(0.0, 1.0, 0.0)", 2.0, sample, pdf)], Some(&LightWeights::new(&scene, 0.0).tables()))?;
    }
    Ok(())
}

/// Points on triangles and discs: bins of known area.
#[test]
fn points() -> Result<()> {
    let Some(gpu) = gpu()? else { return Ok(()) };
    let mut bench = Bench::new(&gpu)?;
    let main = |bin: &str| {
        format!(
            "{FRAME} void main() {{ uint i = gl_GlobalInvocationID.x; if (i >= samples) return; \
             Random random = random_of(i, 3u, 9u); vec4 u = random4(random); uint bin; {bin} atomicAdd(Words(counts).at[bin], 1u); }}"
        )
    };
    // Cells of a grid over a triangle, half of the unit square; the diagonal halves some cells.
    let triangle = main(
        "vec2 w = sample_triangle(u.xy); uvec2 cell = min(uvec2(w * 16.0), uvec2(15u)); bin = cell.y * 16u + cell.x;",
    );
    let shares: Vec<f64> = (0..BINS * BINS)
        .map(|i| match (i % BINS + i / BINS).cmp(&(BINS - 1)) {
            std::cmp::Ordering::Less => 2.0 / f64::from(BINS * BINS),
            std::cmp::Ordering::Equal => 1.0 / f64::from(BINS * BINS),
            std::cmp::Ordering::Greater => 0.0,
        })
        .collect();
    let (counts, _) = run(&mut bench, "triangle.comp", &triangle, BINS, None)?;
    check("triangle", &counts, &shares)?;
    // Rings of equal area, divided into sectors.
    let disc = main(
        "vec2 p = sample_disc(u.xy); float a = atan(p.y, p.x) / (2.0 * PI); vec2 at = vec2(dot(p, p), a < 0.0 ? a + 1.0 : a); \
         uvec2 cell = min(uvec2(at * 16.0), uvec2(15u)); bin = cell.y * 16u + cell.x;",
    );
    let (counts, _) = run(&mut bench, "disc.comp", &disc, BINS, None)?;
    check("disc", &counts, &[1.0 / f64::from(BINS * BINS); (BINS * BINS) as usize])
}

/// Choice of a light, with a probability proportional to power.
#[test]
fn the_choice_of_a_light() -> Result<()> {
    let Some(gpu) = gpu()? else { return Ok(()) };
    let mut scene = builtin("cornell")?;
    let lamp = scene.lights[0].clone();
    for i in 1..40 {
        let mut light = lamp.clone();
        if let magpie::scene::Light::Rectangle { radiance, .. } = &mut light {
            *radiance *= (i as f32 * 0.37).sin().powi(2) + 0.001;
        }
        scene.lights.push(light);
    }
    let mut powers: Vec<f64> = Vec::new();
    for light in &scene.lights {
        let magpie::scene::Light::Rectangle { radiance, .. } = light else { continue };
        powers.push(f64::from(radiance.dot(glam::Vec3::new(0.2126, 0.7152, 0.0722))));
    }
    let sum: f64 = powers.iter().sum();
    let mut shares = vec![0.0; (BINS * BINS) as usize];
    powers.iter().enumerate().for_each(|(i, p)| shares[i] = p / sum);
    let main = format!(
        "{FRAME} void main() {{ uint i = gl_GlobalInvocationID.x; if (i >= samples) return; Random random = random_of(i, 5u, 2u); \
         uvec4 words = random_words(random); LightTables t = LightTablesBuffer(tables).at[0]; \
         uint chosen = choose(LightChoiceBuffer(t.near), t.near_count, words.x, unit_floats(words).y); \
         atomicAdd(Words(counts).at[LightChoiceBuffer(t.near).at[chosen].light], 1u); }}"
    );
    let mut bench = Bench::new(&gpu)?;
    let (counts, _) = run(&mut bench, "choice.comp", &main, BINS, Some(&LightWeights::new(&scene, 0.0).tables()))?;
    check("choice of a light", &counts, &shares)
}
