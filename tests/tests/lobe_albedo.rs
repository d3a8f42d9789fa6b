//! The table of the specular lobe's directional albedo, as shaders read it, against numerical integration.
use anyhow::{Context, Result, ensure};
use bytemuck::{Pod, Zeroable};
use glam::DVec3;
use magpie::gpu::{Buffer, Gpu};
use magpie::graph::{Access, BufferDesc, Domain, Extent, Queue, Record};
use magpie::scene::{ResidentOptions, ResidentScene};
use magpie_passes::reference::{Only, ReferenceOptions};
use magpie_shaders::Address;
use magpie_tests::against::{Shown, mean_of, truth_of};
use magpie_tests::bench::{Bench, results};
use magpie_tests::fixtures::{ball_under_an_even_sky, material};
use magpie_tests::harness::{builtin, gpu};
use magpie_tests::oracle::albedo::split_sum;
use magpie_tests::oracle::shading::alpha;
use rayon::prelude::*;
use std::sync::Arc;

/// Looks up `a` and `b` for cosines and roughnesses that lie beside the table's entries as well as on them.
const SHADER: &str = r#"#version 460
#extension GL_GOOGLE_include_directive : require
#include "lib/bindless.glsl"
#include "lib/brdf.glsl"
layout(local_size_x = 64) in;
layout(buffer_reference, scalar, buffer_reference_align = 4) buffer Pairs { vec2 at[]; };
layout(push_constant, scalar) uniform Push { uvec2 table; uvec2 wanted; uvec2 found; uint count; };
void main() {
    uint i = gl_GlobalInvocationID.x;
    if (i >= count) return;
    vec2 at = Pairs(wanted).at[i];
    SplitSum s = split_sum(table, at.y, at.x);
    Pairs(found).at[i] = vec2(s.a, s.b);
}
"#;

#[repr(C)]
#[derive(Clone, Copy, Pod, Zeroable)]
struct Params {
    table: Address,
    wanted: Address,
    found: Address,
    count: u32,
}

/// What the table gives at pairs of cosine and roughness.
fn looked_up(gpu: &Gpu, pairs: &[[f32; 2]]) -> Result<Vec<[f32; 2]>> {
    let resident = ResidentScene::new(gpu, &builtin("cornell")?, ResidentOptions::default())?;
    let mut bench = Bench::new(gpu)?;
    let kernel = bench.kernel("lobe_albedo.comp", SHADER)?;
    let bytes = (pairs.len() * 8) as u64;
    let mut wanted =
        Buffer::new(gpu, "wanted", bytes, magpie::gpu::BufferMemory::Upload, magpie::gpu::BufferUse::Storage)?;
    wanted.write(0, bytemuck::cast_slice(pairs))?;
    let (wanted, count) = (Arc::new(wanted), pairs.len() as u32);
    let mut read = None;
    bench.run(Extent::new(1, 1), &[], |g, imports| {
        let table = resident.lobe_albedo();
        let key = imports.borrow_mut().buffer(table);
        let table = g.import_buffer("table", BufferDesc::new(table.bytes()), Access::BufferRead, key).read();
        let key = imports.borrow_mut().buffer(&wanted);
        let wanted = g.import_buffer("wanted", BufferDesc::new(bytes), Access::BufferRead, key).read();
        let (found, buffer) = results(gpu, g, imports, "found", bytes)?;
        let found = g.pass("test.look_up", Queue::Graphics, |p| {
            let (table, wanted) = (p.read(table), p.read(wanted));
            let (found, target) = p.write_buffer(found);
            (found, move |c: &mut Record<'_>| {
                let params = Params { table: c.id(table), wanted: c.id(wanted), found: c.id(target), count };
                c.dispatch_groups(kernel, &params, [count.div_ceil(64), 1, 1]);
            })
        });
        g.leave(found.read(), Access::HostRead, Domain::Compute);
        read = Some(buffer);
        Ok(())
    })?;
    let read = read.context("nothing was declared")?;
    Ok(bytemuck::pod_collect_to_vec(&read.contents()[..bytes as usize]))
}

/// The analytic fit of Karis 2014, "Physically Based Shading on Mobile", which the table replaces.
fn karis_fit(n_v: f64, roughness: f64) -> [f64; 2] {
    let r = [-roughness + 1.0, -0.0275 * roughness + 0.0425, -0.572 * roughness + 1.04, 0.022 * roughness - 0.04];
    let a = (r[0] * r[0]).min((-9.28 * n_v).exp2()) * r[0] + r[1];
    [-1.04 * a + r[2], 1.04 * a + r[3]]
}

/// Root mean square and greatest error of albedos over several reflectances.
#[derive(Default)]
struct Errors {
    squares: f64,
    count: f64,
    greatest: f64,
}

impl Errors {
    fn add(&mut self, found: [f64; 2], wanted: [f64; 2]) {
        for f0 in [0.0, 0.02, 0.04, 0.2, 0.5, 0.9, 1.0] {
            let error = (f0 * (found[0] - wanted[0]) + found[1] - wanted[1]).abs();
            self.squares += error * error;
            self.count += 1.0;
            self.greatest = self.greatest.max(error);
        }
    }

    fn rms(&self) -> f64 {
        (self.squares / self.count).sqrt()
    }
}

#[test]
fn the_table_is_the_integral_of_the_lobe() -> Result<()> {
    let Some(gpu) = gpu()? else { return Ok(()) };
    // Cosines from 0.001 to 1 by their square root, roughnesses from 0 to 1; neither spacing is that of the table.
    let cosine = |i: u32| (0.001_f64.sqrt() + (1.0 - 0.001_f64.sqrt()) * f64::from(i) / 46.0).powi(2);
    let places: Vec<[f64; 2]> = (0..47).flat_map(|i| (0..=40).map(move |j| [cosine(i), f64::from(j) / 40.0])).collect();
    let pairs: Vec<[f32; 2]> = places.iter().map(|p| p.map(|x| x as f32)).collect();
    let found = looked_up(&gpu, &pairs)?;
    let wanted: Vec<[f64; 2]> = places.par_iter().map(|[n_v, r]| split_sum(*n_v, alpha(*r), 128)).collect();
    let (mut table, mut fit) = (Errors::default(), Errors::default());
    for ((place, found), wanted) in places.iter().zip(&found).zip(&wanted) {
        let found = found.map(f64::from);
        let [n_v, roughness] = *place;
        ensure!(found[0] >= 0.0 && found[1] >= 0.0, "cosine {n_v}, roughness {roughness}: {found:?}");
        ensure!(found[0] + found[1] <= 1.0 + 1e-6, "cosine {n_v}, roughness {roughness}: {found:?} gains energy");
        table.add(found, *wanted);
        fit.add(karis_fit(n_v, roughness), *wanted);
    }
    println!("table: RMSE {:.5}, greatest error {:.5}", table.rms(), table.greatest);
    println!("fit by Karis: RMSE {:.5}, greatest error {:.5}", fit.rms(), fit.greatest);
    ensure!(table.rms() <= 0.003 && table.greatest <= 0.02, "RMSE {}, greatest {}", table.rms(), table.greatest);
    // The fit would not pass.
    ensure!(fit.rms() > 0.003 && fit.greatest > 0.02, "RMSE {}, greatest {}", fit.rms(), fit.greatest);
    // At normal incidence and roughness 1 the whole albedo is 1 - ln 2 (D = 1 / pi, G = 2 c / (1 + c)), and a mirror's is 1.
    let ends = looked_up(&gpu, &[[1.0, 1.0], [1.0, 0.0]])?.into_iter().map(|[a, b]| f64::from(a + b));
    for (found, wanted) in ends.zip([1.0 - 2.0_f64.ln(), 1.0]) {
        ensure!((found - wanted).abs() < 1e-3, "{found} instead of {wanted}");
    }
    Ok(())
}

/// Under uniform light the product of both sums is exact: the frame's sky is the reference's.
#[test]
fn uniform_light_is_reflected_exactly() -> Result<()> {
    let Some(gpu) = gpu()? else { return Ok(()) };
    let shown = Shown { size: [16, 16], time: 0.0 };
    for roughness in [0.0, 0.1, 0.3, 0.6, 1.0] {
        let scene = ball_under_an_even_sky("ball", material([0.7, 0.5, 0.3], 1.0, roughness), 3.0);
        let changes = ["stages.ao=off", "gbuffer.precision=full", "reflections.precision=32"];
        let (found, _) = mean_of("reflections", &gpu, &scene, &changes, shown, 1)?;
        let options = ReferenceOptions { only: Only::Reflections, ..ReferenceOptions::default() };
        let truth = truth_of(options, &gpu, &scene, shown, 1024)?;
        let light = |values: &[DVec3]| values.iter().copied().sum::<DVec3>();
        let share = light(&found) / light(&truth.mean);
        println!("roughness {roughness}: {share:.4} of the reference's light");
        ensure!((share - DVec3::ONE).abs().max_element() < 0.01, "roughness {roughness}: {share}");
        let mut seen = 0;
        for (at, ((found, wanted), error)) in found.iter().zip(&truth.mean).zip(truth.standard_error()).enumerate() {
            let slack = 0.01 * *wanted + 4.0 * error + DVec3::splat(1e-4);
            ensure!(
                (*found - *wanted).abs().cmple(slack).all(),
                "roughness {roughness}, pixel {at}: {found}, {wanted}"
            );
            seen += usize::from(wanted.x > 0.1);
        }
        ensure!(seen > 60, "the ball covers {seen} pixels");
    }
    Ok(())
}
