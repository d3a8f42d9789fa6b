//! The CPU path tracer's surface model against numerical integration, and its sampler against its pdf.
use super::bsdf::{Layers, Scatterer, fresnel};
use super::random::{Random, from_polar};
use glam::DVec3;
use std::env;
use std::f64::consts::{FRAC_PI_2, PI, TAU};

/// Angles between viewer and normal, radians.
const ANGLES: [f64; 6] = [0.0, 0.35, 0.8, 1.1, 1.35, 1.5];
const ROUGHNESS: [f64; 7] = [0.0, 0.1, 0.3, 0.45, 0.6, 0.8, 1.0];

/// White materials of every kind, with names.
fn kinds(roughness: f64) -> Vec<(&'static str, Layers)> {
    let alpha = (roughness * roughness).max(0.002);
    let plain = Layers {
        base: DVec3::ONE,
        metalness: 0.0,
        alpha,
        transmission: 0.0,
        ior: 1.5,
        specular: 1.0,
        specular_colour: DVec3::ONE,
        volume: false,
        inside: false,
        coat: 0.0,
        coat_alpha: 0.002,
        scatters_again: true,
    };
    let glass = Layers { transmission: 1.0, volume: true, ..plain };
    vec![
        ("dielectric", plain),
        ("lambertian", Layers { ior: 1.0, ..plain }),
        ("dense dielectric", Layers { ior: 2.4, ..plain }),
        ("without a reflection", Layers { specular: 0.0, ..plain }),
        ("half the reflection", Layers { specular: 0.5, ..plain }),
        ("a mirror over white", Layers { specular_colour: DVec3::splat(25.0), specular: 0.6, ..plain }),
        ("weak glass", Layers { specular: 0.4, ..glass }),
        ("metal", Layers { metalness: 1.0, ..plain }),
        ("half metal", Layers { metalness: 0.5, ..plain }),
        ("thin glass", Layers { volume: false, ..glass }),
        ("glass from outside", glass),
        ("glass from inside", Layers { inside: true, ..glass }),
        ("milk glass", Layers { transmission: 0.5, ..glass }),
        ("coated dielectric", Layers { coat: 1.0, coat_alpha: 0.04, ..plain }),
        ("coated metal", Layers { coat: 1.0, coat_alpha: 0.3, metalness: 1.0, ..plain }),
        ("coated glass", Layers { coat: 0.7, coat_alpha: 0.1, ..glass }),
        ("half metal of milk glass", Layers { metalness: 0.4, transmission: 0.6, ..glass }),
    ]
}

fn at(theta: f64, layers: Layers) -> Scatterer {
    let to_viewer = DVec3::new(theta.sin(), 0.0, theta.cos());
    Scatterer { normal: DVec3::Z, plane: DVec3::Z, to_viewer, layers }
}

/// Factor that converts transmitted radiance to energy: radiance scales with the square of the index.
fn energy(s: &Scatterer, l: DVec3) -> f64 {
    let lobes = s.value(l);
    let transmitted = if s.layers.volume { s.eta().powi(2) } else { 1.0 };
    (lobes.diffuse + lobes.specular + lobes.coat).y + transmitted * lobes.transmission.y
}

/// Integral over the sphere, on a grid of angles.
fn over_sphere(rings: usize, mut f: impl FnMut(DVec3) -> f64) -> f64 {
    let mut sum = 0.0;
    for i in 0..rings {
        let theta = (i as f64 + 0.5) * PI / rings as f64;
        for j in 0..2 * rings {
            sum += f(from_polar(theta.cos(), (j as f64 + 0.5) * PI / rings as f64)) * theta.sin();
        }
    }
    sum * (PI / rings as f64).powi(2)
}

/// Integral over half vectors, on a grid that is densest around the normal.
fn over_half_vectors(alpha: f64, steps: usize, mut f: impl FnMut(DVec3) -> f64) -> f64 {
    let mut sum = 0.0;
    for i in 0..steps {
        let x = (i as f64 + 0.5) / steps as f64;
        let tan = alpha * x / (1.0 - x);
        let theta = tan.atan();
        let width = alpha / (1.0 - x).powi(2) / (1.0 + tan * tan);
        for j in 0..2 * steps {
            sum += f(from_polar(theta.cos(), (j as f64 + 0.5) * PI / steps as f64)) * theta.sin() * width;
        }
    }
    sum * PI / (steps * steps) as f64
}

/// Directional albedo: every lobe is integrated over the variable in which it is smooth.
fn albedo(s: &Scatterer) -> f64 {
    const STEPS: usize = 90;
    let v = s.to_viewer;
    let diffuse = over_sphere(60, |l| s.value(l).diffuse.y);
    // The solid angle of reflected directions is 4 v·h times that of half vectors.
    let mirrored = |h: DVec3| Some((2.0 * v.dot(h) * h - v, 4.0 * v.dot(h))).filter(|_| v.dot(h) > 0.0);
    let specular =
        over_half_vectors(s.layers.alpha, STEPS, |h| mirrored(h).map_or(0.0, |(l, w)| s.value(l).specular.y * w));
    let coat =
        over_half_vectors(s.layers.coat_alpha, STEPS, |h| mirrored(h).map_or(0.0, |(l, w)| s.value(l).coat.y * w));
    let through = over_half_vectors(s.layers.alpha, STEPS, |h| {
        let Some((l, w)) = mirrored(h) else { return 0.0 };
        if !s.layers.volume {
            return if l.z > 0.0 { s.value(DVec3::new(l.x, l.y, -l.z)).transmission.y * w } else { 0.0 };
        }
        // Snell's law; the solid angle follows from the cosines on either side of the interface.
        let (eta, v_h) = (s.eta(), v.dot(h));
        let cos2 = 1.0 - (1.0 - v_h * v_h) / (eta * eta);
        if cos2 <= 0.0 {
            return 0.0;
        }
        let l = (v_h * h - v) / eta - cos2.sqrt() * h;
        let spread = (v_h - eta * cos2.sqrt()).powi(2) / (eta * eta * cos2.sqrt());
        eta * eta * s.value(l).transmission.y * spread
    });
    diffuse + specular + coat + if s.layers.transmission > 0.0 { through } else { 0.0 }
}

#[test]
fn nothing_gives_back_more_than_it_gets() {
    for roughness in ROUGHNESS {
        for (name, layers) in kinds(roughness) {
            for theta in ANGLES {
                let got = albedo(&at(theta, layers));
                assert!(got <= 1.0 + 1e-3, "{name}, roughness {roughness}, angle {theta}: {got}");
                // A half metal is grey, and rough glass loses what scatters more than once.
                let whole = layers.metalness == 0.0 || layers.metalness == 1.0;
                let least = match layers {
                    Layers { metalness: 1.0, .. } => 0.99,
                    _ if whole && roughness <= 0.1 && theta < 1.2 => 0.98,
                    _ => 0.25,
                };
                assert!(got >= least, "{name}, roughness {roughness}, angle {theta}: {got}");
                let once = albedo(&at(theta, Layers { scatters_again: false, ..layers }));
                assert!(once <= got + 1e-9, "{name}, roughness {roughness}, angle {theta}: {once} without, {got} with");
            }
        }
    }
}

#[test]
fn two_quadratures_agree() {
    for roughness in [0.6, 1.0] {
        for (name, layers) in kinds(roughness) {
            let layers = Layers { coat_alpha: layers.coat_alpha.max(0.1), ..layers };
            for theta in [0.0, 0.8, 1.35] {
                let s = at(theta, layers);
                let (by_sphere, by_lobe) = (over_sphere(400, |l| energy(&s, l)), albedo(&s));
                let off = (by_sphere / by_lobe - 1.0).abs();
                // Refraction ends abruptly where microfacets face away: there a grid of 400 rings has an error of 0.7 %, one of 1600 of 0.1
                // %.
                let most = if layers.volume { 8e-3 } else { 2e-3 };
                assert!(off < most, "{name}, roughness {roughness}, angle {theta}: {by_sphere} {by_lobe}");
            }
        }
    }
}

#[test]
fn light_and_viewer_may_change_places() {
    let mut random = Random::new(5, 0);
    let mut pairs = [0; 2];
    for roughness in ROUGHNESS {
        for (name, layers) in kinds(roughness) {
            // The coat attenuates by the viewer's angle only, and by that what scatters again is given back: the parts that are not reciprocal.
            let layers = Layers { scatters_again: false, ..layers };
            for _ in 0..400 {
                let (v, l) = (random.direction(), random.direction());
                if layers.coat > 0.0 || v.z < 0.05 || l.z.abs() < 0.05 {
                    continue;
                }
                let there = Scatterer { to_viewer: v, ..at(0.0, layers) };
                let turned = if l.z < 0.0 { DVec3::NEG_Z } else { DVec3::Z };
                let inside = layers.inside != (l.z < 0.0);
                let layers = Layers { inside: layers.volume && inside, ..layers };
                let back = Scatterer { normal: turned, plane: turned, to_viewer: l, layers };
                // Radiance over the squared index is reciprocal (Veach 1997, equation 5.14).
                let index = if there.layers.volume && l.z < 0.0 { there.eta().powi(2) } else { 1.0 };
                let (f, b) = (there.value(l).total() * index / l.z.abs(), back.value(v).total() / v.z);
                let off = (f - b).abs().max_element();
                // Close to the critical angle, the cosine to the microfacet on the far side is the root of a difference, and rounding is
                // amplified by the inverse of its square.
                let half = (v + l * there.eta()).normalize();
                let cosine = if l.z < 0.0 { v.dot(half).abs().min(l.dot(half).abs()) } else { 1.0 };
                let bound = f64::max(1e-9, 2.0 * f64::EPSILON / cosine.powi(2));
                assert!(off <= bound * f.max_element(), "{name}, roughness {roughness}, {v} {l}: {f} {b}, {cosine}");
                pairs[usize::from(l.z < 0.0)] += usize::from(f.max_element() > 0.0);
            }
        }
    }
    assert!(pairs[0] > 2000 && pairs[1] > 1000, "{pairs:?}");
}

#[test]
fn the_sampler_draws_by_its_density() {
    const BINS: [usize; 2] = [16, 12];
    let samples = if env::var_os("MAGPIE_FULL").is_some() { 2_000_000 } else { 100_000 };
    let mut random = Random::new(11, 0);
    let mut tests = 0;
    for roughness in [0.5, 1.0] {
        for (name, layers) in kinds(roughness) {
            let layers = Layers { coat_alpha: layers.coat_alpha.max(0.2), ..layers };
            for theta in [0.3, 1.2] {
                let s = at(theta, layers);
                let mut counts = vec![0_u32; BINS[0] * BINS[1]];
                let mut failed = 0_u32;
                for _ in 0..samples {
                    let Some(l) = s.sample(&mut random) else {
                        failed += 1;
                        continue;
                    };
                    let row = ((0.5 - 0.5 * l.z) * BINS[0] as f64) as usize;
                    let column = ((l.y.atan2(l.x) / TAU + 0.5) * BINS[1] as f64) as usize;
                    counts[row.min(BINS[0] - 1) * BINS[1] + column.min(BINS[1] - 1)] += 1;
                }
                // Bins with small expected counts are merged with the invalid samples.
                let (mut chi2, mut freedom, mut rest) = (0.0, 0, (f64::from(samples), f64::from(failed)));
                for (bin, count) in counts.iter().enumerate() {
                    let expected = f64::from(samples) * in_bin(&s, bin / BINS[1], bin % BINS[1], BINS);
                    if expected >= 20.0 {
                        chi2 += (f64::from(*count) - expected).powi(2) / expected;
                        freedom += 1;
                        rest.0 -= expected;
                    } else {
                        rest.1 += f64::from(*count);
                    }
                }
                assert!(rest.0 > -1e-3 * f64::from(samples), "{name} {roughness} {theta}: {} is negative", rest.0);
                let few = (rest.1 - rest.0).abs() / rest.0.max(20.0).sqrt();
                let far = (chi2 - f64::from(freedom)) / f64::from(2 * freedom).sqrt();
                assert!(freedom > 20 && far < 5.0 && few < 5.0, "{name}, {roughness}, {theta}: {far} {few} {rest:?}");
                tests += 1;
            }
        }
    }
    assert_eq!(tests, 2 * kinds(0.5).len() * 2);
}

/// Probability of a direction in a bin of equal solid angle.
fn in_bin(s: &Scatterer, row: usize, column: usize, bins: [usize; 2]) -> f64 {
    // Refraction ends abruptly, so it needs a finer grid.
    let fine = if s.layers.volume { 72 } else { 24 };
    let mut sum = 0.0;
    for i in 0..fine {
        let z = 1.0 - 2.0 * (row as f64 + (f64::from(i) + 0.5) / f64::from(fine)) / bins[0] as f64;
        for j in 0..fine {
            let phi = TAU * ((column as f64 + (f64::from(j) + 0.5) / f64::from(fine)) / bins[1] as f64 - 0.5);
            sum += s.pdf(from_polar(z, phi));
        }
    }
    sum / f64::from(fine * fine) * 4.0 * PI / (bins[0] * bins[1]) as f64
}

#[test]
fn samples_over_their_density_sum_to_the_albedo() {
    let samples = if env::var_os("MAGPIE_FULL").is_some() { 1_000_000 } else { 60_000 };
    let mut random = Random::new(12, 0);
    for roughness in [0.0, 0.3, 1.0] {
        for (name, layers) in kinds(roughness) {
            for theta in [0.0, 0.8, 1.35] {
                let s = at(theta, layers);
                let (mut mean, mut squares) = (0.0, 0.0);
                for n in 1..=samples {
                    let one = s.sample(&mut random).map_or(0.0, |l| energy(&s, l) / s.pdf(l));
                    let apart = one - mean;
                    mean += apart / f64::from(n);
                    squares += apart * (one - mean);
                }
                let error = (squares / (f64::from(samples) * f64::from(samples - 1))).sqrt();
                let want = albedo(&s);
                let off = (mean - want).abs();
                assert!(off < 4.0 * error + 1.5e-3, "{name}, {roughness}, {theta}: {mean} ± {error}, {want}");
                assert!(error < 0.008, "{name}, {roughness}, {theta}: {error}");
            }
        }
    }
}

#[test]
fn borders_reflect_as_fresnel_says() {
    let close = |a: f64, b: f64| assert!((a - b).abs() < 1e-12, "{a} {b}");
    close(fresnel(1.0, 1.5), 0.04);
    close(fresnel(1.0, 1.0 / 1.5), 0.04);
    close(fresnel(0.0, 1.5), 1.0);
    close(fresnel(0.6, 1.0), 0.0);
    // At Brewster's angle only light polarised perpendicular to the plane of incidence is reflected: ((n² - 1) / (n² + 1))² of it.
    let brewster = 1.5_f64.atan();
    close(fresnel(brewster.cos(), 1.5), 0.5 * (1.25_f64 / 3.25).powi(2));
    // Beyond the critical angle reflection is total, and reflectance is equal from both sides.
    let critical = (1.0 / 1.5_f64).asin();
    close(fresnel((critical + 1e-3).cos(), 1.0 / 1.5), 1.0);
    assert!(fresnel((critical - 1e-3).cos(), 1.0 / 1.5) < 0.95);
    close(fresnel(0.7, 1.5), fresnel((1.0 - (1.0 - 0.49) / 2.25_f64).sqrt(), 1.0 / 1.5));
}

#[test]
fn refracted_energy_is_what_is_not_reflected() {
    let glass = |inside| kinds(0.0).into_iter().find(|k| k.0 == "glass from outside").map(|k| Layers { inside, ..k.1 });
    for inside in [false, true] {
        for theta in [0.0, 0.3, 0.6, 0.9, 1.2] {
            let s = at(theta, glass(inside).unwrap());
            let reflected = over_half_vectors(s.layers.alpha, 160, |h| {
                let v_h = s.to_viewer.dot(h);
                if v_h > 0.0 { s.value(2.0 * v_h * h - s.to_viewer).specular.y * 4.0 * v_h } else { 0.0 }
            });
            let want = fresnel(theta.cos(), s.eta());
            assert!((reflected - want).abs() < 2e-3, "{inside} {theta}: {reflected} {want}");
            // 1 - R is transmitted, in the direction of Snell's law.
            let total = albedo(&s);
            assert!((total - 1.0).abs() < 1e-3, "{inside} {theta}: {total}");
            if want < 1.0 {
                let sine = theta.sin() / s.eta();
                let snell = DVec3::new(-sine, 0.0, -(1.0 - sine * sine).sqrt());
                let beside = DVec3::new(-(sine + 0.1).min(1.0), 0.0, -(1.0 - (sine + 0.1).min(1.0).powi(2)).sqrt());
                assert!(s.value(snell).transmission.y > 100.0 * s.value(beside).transmission.y);
            }
        }
    }
}

#[test]
fn nothing_is_infinite_or_negative() {
    let mut seen = 0;
    let angles = [0.0, 1e-9, 0.5, FRAC_PI_2 - 1e-9, FRAC_PI_2 + 1e-9, 2.0, PI - 1e-9, PI];
    for roughness in [0.0, 0.3, 1.0] {
        for (name, layers) in kinds(roughness) {
            for theta in [0.0, 1e-9, 0.7, 1.5, FRAC_PI_2 - 1e-6] {
                let s = at(theta, layers);
                for down in angles {
                    for phi in [0.0, 1.0, PI] {
                        let l = from_polar(f64::cos(down), phi);
                        let (value, density) = (s.value(l).total(), s.pdf(l));
                        assert!(
                            value.is_finite() && value.min_element() >= 0.0,
                            "{name} {roughness} {theta} {l}: {value}"
                        );
                        assert!(density.is_finite() && density >= 0.0, "{name} {roughness} {theta} {l}: {density}");
                        seen += usize::from(value != DVec3::ZERO);
                    }
                }
            }
        }
    }
    assert!(seen > 1000, "{seen}");
}
