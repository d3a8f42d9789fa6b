//! White furnace tests: surfaces without absorption in uniform light. The mean over the device's BSDF samples equals numerical integration
//! of the formulas in double precision, and never exceeds the incident light.
use anyhow::{Context, Result, ensure};
use bytemuck::{Pod, Zeroable};
use glam::DVec3;
use magpie::gpu::{Buffer, Gpu};
use magpie::graph::{Access, BufferDesc, Domain, Extent, Queue, Record};
use magpie::scene::{Material, ResidentOptions, ResidentScene};
use magpie_passes::reference::{Only, Reference, ReferenceOptions};
use magpie_shaders::Address;
use magpie_tests::against::{Shown, mean_of, truth_of};
use magpie_tests::bench::{Bench, results};
use magpie_tests::fixtures::{ball_under_an_even_sky, material};
use magpie_tests::harness::gpu;
use rayon::prelude::*;
use std::f64::consts::PI;
use std::sync::Arc;

const ROUGHNESS: [f64; 9] = [0.0, 0.1, 0.2, 0.3, 0.4, 0.5, 0.6, 0.8, 1.0];
/// View angles, degrees.
const ANGLES: [f64; 5] = [0.0, 30.0, 60.0, 80.0, 87.0];
const KINDS: [&str; 9] = [
    "metal",
    "dielectric",
    "clear coat",
    "glass",
    "glass from inside",
    "thin glass",
    "no reflection",
    "half the reflection",
    "a strong reflection",
];
/// Index of refraction of the glasses.
const IOR: f64 = 1.5;
/// Samples per sum, and sums per case.
const SUMS: u32 = 2048;
const SAMPLES: u32 = 256;
/// Tolerance above the incident light.
const ABOVE: f64 = 1e-3;

const SHADER: &str = r#"#version 460
#extension GL_GOOGLE_include_directive : require
#include "lib/bindless.glsl"
#include "lib/random.glsl"
#include "lib/bsdf.glsl"
layout(local_size_x = 64) in;
layout(buffer_reference, scalar, buffer_reference_align = 4) buffer Floats { float at[]; };
// `table`: of the albedo of lobes that give back what scatters again; 0 for the single-scattering model.
layout(push_constant, scalar) uniform Push { uvec2 sums; uvec2 table; uint count; uint samples; };

const float ROUGHNESS[9] = float[9](0.0, 0.1, 0.2, 0.3, 0.4, 0.5, 0.6, 0.8, 1.0);
const float DEGREES[5] = float[5](0.0, 30.0, 60.0, 80.0, 87.0);

Bsdf bsdf_of(uint kind, float roughness) {
    float alpha = alpha_of_roughness(roughness);
    vec3 white = vec3(1.0);
    if (kind == 0u) return opaque_bsdf(white, 1.0, roughness);
    if (kind == 1u) return opaque_bsdf(white, 0.0, roughness);
    if (kind == 2u) {
        Bsdf coated = opaque_bsdf(white, 0.0, 0.5);
        coated.coat = 1.0;
        coated.coat_alpha = alpha;
        return coated;
    }
    // KHR_materials_specular: nothing is left of the reflection, half of it, and half of one that is ten times as strong face on.
    if (kind >= 6u) {
        Dielectric d = dielectric_of(1.5, kind == 6u ? 0.0 : 0.5, vec3(kind == 8u ? 10.0 : 1.0));
        return opaque_bsdf(white, 0.0, roughness, fresnel_of(d, white, 0.0));
    }
    float eta = kind == 4u ? 1.0 / 1.5 : 1.5;
    return Bsdf(white, 0.0, Fresnel(vec3(0.04), 1.0, vec3(0.04), 0.9974), alpha, 1.0, eta, kind == 5u, 0.0, 1.0, NO_LESS, NO_SPLIT_SUM, NO_SPLIT_SUM);
}

void main() {
    uint i = gl_GlobalInvocationID.x;
    if (i >= count * 2048u) return;
    uint which = i / 2048u;
    float angle = radians(DEGREES[which % 5u]);
    Bsdf b = bsdf_of(which / 45u, ROUGHNESS[which / 5u % 9u]);
    vec3 v = vec3(sin(angle), 0.0, cos(angle));
    if (table != uvec2(0u)) b = towards_viewer(table, b, v.z);
    Random random = random_of(i, 1u, 2u);
    float sum = 0.0;
    for (uint s = 0u; s < samples; s++) {
        vec4 u = random4(random);
        vec3 l;
        if (!bsdf_sample(b, v, LOBE_ALL, u.x, u.yz, l)) continue;
        float pdf = bsdf_pdf(b, v, l, LOBE_ALL);
        // Energy, not radiance, which is compressed behind the surface.
        float energy = l.z < 0.0 && !b.thin ? b.eta * b.eta : 1.0;
        sum += energy * bsdf_cosine(b, v, l, LOBE_ALL).g / pdf;
    }
    Floats(sums).at[i] = sum / float(samples);
}
"#;

#[repr(C)]
#[derive(Clone, Copy, Pod, Zeroable)]
struct Params {
    sums: Address,
    table: Address,
    count: u32,
    samples: u32,
}

fn lambda(cosine: f64, alpha: f64) -> f64 {
    let tan2 = (1.0 - cosine * cosine).max(0.0) / (cosine * cosine);
    0.5 * ((1.0 + alpha * alpha * tan2).sqrt() - 1.0)
}

fn schlick(f0: f64, cosine: f64) -> f64 {
    f0 + (1.0 - f0) * (1.0 - cosine).powi(5)
}

/// Fresnel's equations with Snell's law.
fn fresnel(cosine: f64, eta: f64) -> f64 {
    let sine = (1.0 - cosine * cosine).max(0.0).sqrt() / eta;
    if sine >= 1.0 {
        return 1.0;
    }
    let inner = (1.0 - sine * sine).sqrt();
    let s = (cosine - eta * inner) / (cosine + eta * inner);
    let p = (eta * cosine - inner) / (eta * cosine + inner);
    0.5 * (s * s + p * p)
}

/// Integral over all microfacets with masking. `scatter` returns, for a microfacet and the viewer, a factor and the cosine of the incident
/// direction.
fn over_microfacets(cosine: f64, alpha: f64, scatter: impl Fn(DVec3, DVec3) -> f64 + Sync) -> f64 {
    const N: usize = 700;
    let v = DVec3::new((1.0 - cosine * cosine).sqrt(), 0.0, cosine);
    let row = |i: usize| -> f64 {
        // Slopes of GGX by inverse transform sampling: D(h) n·h is the pdf. Steep ones are rare but have large weights, hence the spacing.
        let left = 1.0 - (i as f64 + 0.5) / N as f64;
        let (u, density) = (1.0 - left.powi(4), 4.0 * left.powi(3));
        let tangent = alpha * (u / (1.0 - u)).sqrt();
        let cos = 1.0 / (1.0 + tangent * tangent).sqrt();
        let ring = |j: usize| {
            let phi = (j as f64 + 0.5) / N as f64 * PI; // symmetric: half of the circle is enough
            let h = DVec3::new(tangent * cos * phi.cos(), tangent * cos * phi.sin(), cos);
            let v_h = v.dot(h);
            if v_h > 0.0 { scatter(v, h) * v_h / (cosine * h.z) } else { 0.0 }
        };
        density * (0..N).map(ring).sum::<f64>()
    };
    (0..N).into_par_iter().map(row).sum::<f64>() / (N * N) as f64
}

/// Albedo of a rough surface with this Fresnel function, single scattering.
fn reflected(cosine: f64, alpha: f64, f: impl Fn(f64) -> f64 + Sync) -> f64 {
    over_microfacets(cosine, alpha, |v, h| {
        let l = 2.0 * v.dot(h) * h - v;
        if l.z <= 0.0 { 0.0 } else { f(v.dot(h)) / (1.0 + lambda(v.z, alpha) + lambda(l.z, alpha)) }
    })
}

/// Transmitted share.
fn transmitted(cosine: f64, alpha: f64, eta: f64, thin: bool) -> f64 {
    over_microfacets(cosine, alpha, |v, h| {
        let v_h = v.dot(h);
        let f = fresnel(v_h, eta);
        if thin {
            let l = 2.0 * v_h * h - v;
            return if l.z <= 0.0 { 0.0 } else { (1.0 - f) / (1.0 + lambda(v.z, alpha) + lambda(l.z, alpha)) };
        }
        let inner = 1.0 - (1.0 - v_h * v_h) / (eta * eta);
        if inner <= 0.0 {
            return 0.0;
        }
        let l = (v_h / eta - inner.sqrt()) * h - v / eta;
        if l.z >= 0.0 { 0.0 } else { (1.0 - f) / (1.0 + lambda(v.z, alpha) + lambda(-l.z, alpha)) }
    })
}

/// Albedo of a kind of surface. `again`: light that scatters more than once between microfacets counts (Turquin 2019).
fn closed_form(kind: usize, roughness: f64, cosine: f64, again: bool) -> f64 {
    let alpha = (roughness * roughness).max(0.002);
    // Share of light that scatters again, over that which scatters once.
    let again = |alpha: f64| if again { 1.0 / reflected(cosine, alpha, |_| 1.0) - 1.0 } else { 0.0 };
    let lobe =
        |alpha: f64, f0: f64, f: &(dyn Fn(f64) -> f64 + Sync)| reflected(cosine, alpha, f) * (1.0 + f0 * again(alpha));
    let dielectric = |alpha: f64| lobe(alpha, 0.04, &|c| schlick(0.04, c)) + 0.9974 * (1.0 - schlick(0.04, cosine));
    let glass =
        |eta: f64, thin: bool| reflected(cosine, alpha, |c| fresnel(c, eta)) + transmitted(cosine, alpha, eta, thin);
    match kind {
        0 => lobe(alpha, 1.0, &|_| 1.0),
        1 => dielectric(alpha),
        2 => {
            let coat = schlick(0.04, cosine) * (1.0 + 0.04 * again(alpha));
            // What the coat does not reflect reaches the surface below. With single scattering its lobe counts as though nothing was lost.
            let below = 1.0 - coat / (1.0 + again(alpha));
            below * dielectric(0.25) + coat * reflected(cosine, alpha, |_| 1.0)
        }
        3 => glass(IOR, false),
        4 => glass(1.0 / IOR, false),
        5 => glass(IOR, true),
        6 => 1.0,
        _ => {
            let f0 = if kind == 7 { 0.02 } else { 0.2 };
            let f = |c: f64| f0 + (0.5 - f0) * (1.0 - c).powi(5);
            lobe(alpha, f0, &f) + 0.9987 * (1.0 - f(cosine))
        }
    }
}

/// The device's sums. `table`: [`ResidentScene::lobe_albedo`], or `None` for the single-scattering model.
fn sums_of(gpu: &Gpu, table: Option<&Arc<Buffer>>) -> Result<Vec<f32>> {
    let mut bench = Bench::new(gpu)?;
    let kernel = bench.kernel("furnace.comp", SHADER)?;
    let count = (KINDS.len() * ROUGHNESS.len() * ANGLES.len()) as u32;
    let bytes = u64::from(count * SUMS) * 4;
    let mut read: Option<Arc<Buffer>> = None;
    bench.run(Extent::new(1, 1), &[], |g, imports| {
        let (sums, buffer) = results(gpu, g, imports, "sums", bytes)?;
        let table = table.map(|table| {
            let key = imports.borrow_mut().buffer(table);
            g.import_buffer("table", BufferDesc::new(table.bytes()), Access::BufferRead, key).read()
        });
        let sums = g.pass("test.furnace", Queue::Graphics, |p| {
            let (sums, target) = p.write_buffer(sums);
            let table = table.map(|table| p.read(table));
            (sums, move |c: &mut Record<'_>| {
                let table = table.map_or_else(Address::default, |table| c.id(table));
                let params = Params { sums: c.id(target), table, count, samples: SAMPLES };
                c.dispatch_groups(kernel, &params, [count * SUMS / 64, 1, 1]);
            })
        });
        g.leave(sums.read(), Access::HostRead, Domain::Compute);
        read = Some(buffer);
        Ok(())
    })?;
    let read = read.context("nothing was declared")?;
    Ok(bytemuck::pod_collect_to_vec(&read.contents()[..bytes as usize]))
}

#[test]
fn no_surface_returns_more_than_it_gets() -> Result<()> {
    let Some(gpu) = gpu()? else { return Ok(()) };
    let resident =
        ResidentScene::new(&gpu, &ball_under_an_even_sky("any", Material::default(), 3.2), ResidentOptions::default())?;
    for again in [false, true] {
        println!("{}", if again { "with what scatters again" } else { "single scattering" });
        check_sums(&sums_of(&gpu, again.then(|| resident.lobe_albedo()))?, again)?;
    }
    // The greatest loss has a closed form: roughness 1 at normal incidence has D = 1 / pi and G = 2 c / (1 + c), which gives 1 - ln 2.
    let rough = closed_form(0, 1.0, 1.0, false);
    ensure!((rough - (1.0 - 2.0_f64.ln())).abs() < 1e-4, "a metal of roughness 1 returns {rough}");
    Ok(())
}

/// Compares sums with the closed forms.
fn check_sums(sums: &[f32], again: bool) -> Result<()> {
    // Error of the table of albedos. What is given back is multiplied, and its noise with it.
    let (off, noise) = if again { (2e-3, 2.5e-3) } else { (5e-4, 1e-3) };
    // Glass and surfaces without a reflection have nothing to give back.
    let changes =
        |kind: &usize| !again || matches!(KINDS[*kind], "metal" | "dielectric" | "clear coat" | "a strong reflection");
    for (kind, name) in KINDS.iter().enumerate().filter(|(kind, _)| changes(kind)) {
        let (mut most, mut apart, mut least) = (0.0_f64, 0.0_f64, f64::MAX);
        for (r, roughness) in ROUGHNESS.iter().enumerate() {
            for (a, angle) in ANGLES.iter().enumerate() {
                let which = (kind * ROUGHNESS.len() + r) * ANGLES.len() + a;
                let own = &sums[which * SUMS as usize..][..SUMS as usize];
                let n = f64::from(SUMS);
                let mean = own.iter().map(|s| f64::from(*s)).sum::<f64>() / n;
                let variance = own.iter().map(|s| (f64::from(*s) - mean).powi(2)).sum::<f64>() / (n - 1.0);
                let error = (variance / n).sqrt();
                let wanted = closed_form(kind, *roughness, angle.to_radians().cos(), again);
                let what = format!(
                    "{name}, roughness {roughness}, {angle} degrees: {mean:.5} +- {error:.5}, closed form {wanted:.5}"
                );
                ensure!(wanted <= 1.0 + ABOVE, "{what}: the model itself gains energy");
                ensure!(mean <= 1.0 + ABOVE + 4.0 * error, "{what}");
                ensure!((mean - wanted).abs() <= off + 5.0 * error, "{what}");
                let white = again && *name == "metal";
                ensure!(!white || (mean - 1.0).abs() < 0.01, "{what}: not white");
                let loses = !again && *name == "metal" && *roughness == 1.0 && *angle == 0.0;
                ensure!(!loses || mean < 0.8, "{what}: single scattering loses more");
                ensure!(error < noise, "{what}: too noisy to tell");
                most = most.max(wanted);
                least = least.min(wanted);
                apart = apart.max((mean - wanted).abs());
            }
        }
        println!("{name:<18} returns {least:.4} to {most:.4}; the sampler is within {apart:.5} of that");
    }
    Ok(())
}

/// Whole pictures: a ball of each kind is nearly invisible against the background.
#[test]
fn balls_in_the_furnace() -> Result<()> {
    let Some(gpu) = gpu()? else { return Ok(()) };
    let white = |metalness: f32, roughness: f32| material([1.0; 3], metalness, roughness);
    let glass = |thickness: f32, roughness: f32| Material { transmission: 1.0, thickness, ..white(0.0, roughness) };
    let balls = [
        ("smooth metal", white(1.0, 0.0), 0.999),
        ("rough metal", white(1.0, 0.6), 0.99),
        ("plastic", white(0.0, 0.3), 0.9),
        ("matte", white(0.0, 1.0), 0.7),
        ("coated", Material { clearcoat: 1.0, clearcoat_roughness: 0.2, ..white(0.0, 0.7) }, 0.8),
        ("rough coat", Material { clearcoat: 1.0, clearcoat_roughness: 1.0, ..white(1.0, 1.0) }, 0.99),
        ("glass", glass(1.0, 0.0), 0.995),
        ("rough glass", glass(1.0, 0.4), 0.7),
        ("bubble", glass(0.0, 0.0), 0.995),
    ];
    for (name, material, least) in balls {
        let scene = ball_under_an_even_sky(name, material, 3.2);
        let options = ReferenceOptions { width: 16, height: 16, check: true, ..ReferenceOptions::default() };
        let mut reference = Reference::new(&gpu, &scene, &scene.cameras[0], options)?;
        reference.add(256)?;
        let estimate = reference.estimate();
        let errors = estimate.standard_error();
        let (mut lowest, mut highest) = (f64::MAX, 0.0_f64);
        for (at, (mean, error)) in estimate.mean.iter().zip(&errors).enumerate() {
            ensure!(mean.x <= 1.0 + ABOVE + 5.0 * error.x, "{name}: pixel {at} is {mean} +- {error}");
            lowest = lowest.min(mean.x + 5.0 * error.x);
            highest = highest.max(mean.x - 5.0 * error.x);
        }
        println!("{name:<14} from {lowest:.4} to {highest:.4}");
        ensure!(lowest > least, "{name}: a pixel is at most {lowest}");
    }
    Ok(())
}

/// A white metal is as bright as what surrounds it, whatever its roughness and from every angle, in the reference and in both ways of the
/// frame to reflect. With the switch off a rough one is darker in all three.
#[test]
fn white_metal_vanishes_in_the_furnace() -> Result<()> {
    let Some(gpu) = gpu()? else { return Ok(()) };
    let shown = Shown { size: [16, 16], time: 0.0 };
    let rays = ["stages.reflections=ray-traced", "reflections.denoiser=none", "reflections.reuse=false"];
    for (roughness, multiple) in
        [(0.0, true), (0.2, true), (0.4, true), (0.6, true), (0.8, true), (1.0, true), (1.0, false)]
    {
        let scene = ball_under_an_even_sky("metal", material([1.0; 3], 1.0, roughness), 3.2);
        let switch = format!("gbuffer.multiple_scattering={multiple}");
        let always = [switch.as_str(), "stages.ao=off", "gbuffer.precision=full", "reflections.precision=32"];
        let (sky, _) = mean_of("reflections", &gpu, &scene, &always, shown, 1)?;
        let (traced, _) = mean_of("reflections", &gpu, &scene, &[&always[..], &rays].concat(), shown, 64)?;
        let options =
            ReferenceOptions { only: Only::Reflections, single_scattering: !multiple, ..ReferenceOptions::default() };
        let truth = truth_of(options, &gpu, &scene, shown, 256)?;
        let on_ball: Vec<usize> = (0..sky.len()).filter(|at| sky[*at].x > 0.0).collect();
        ensure!(on_ball.len() > 60, "the ball covers {} pixels", on_ball.len());
        let mean = |values: &[DVec3]| on_ball.iter().map(|at| values[*at].x).sum::<f64>() / on_ball.len() as f64;
        let (by_sky, by_rays, by_reference) = (mean(&sky), mean(&traced), mean(&truth.mean));
        println!(
            "roughness {roughness}, multiple scattering {multiple}: sky {by_sky:.4}, rays {by_rays:.4}, reference {by_reference:.4}"
        );
        let loses = roughness == 1.0 && !multiple;
        for (what, found) in [("sky", by_sky), ("rays", by_rays), ("reference", by_reference)] {
            if loses {
                ensure!(found < 0.8, "{what}: {found} with single scattering at roughness 1");
            } else {
                ensure!((found - 1.0).abs() < 0.01, "roughness {roughness}, {what}: {found}");
            }
        }
        let errors = truth.standard_error();
        for at in on_ball.iter().copied().filter(|_| !loses) {
            ensure!((sky[at].x - 1.0).abs() < 0.01, "roughness {roughness}, pixel {at} of the sky: {}", sky[at]);
            let off = (truth.mean[at].x - 1.0).abs();
            ensure!(
                off < 0.01 + 5.0 * errors[at].x,
                "roughness {roughness}, pixel {at}: {} in the reference",
                truth.mean[at]
            );
        }
    }
    Ok(())
}
