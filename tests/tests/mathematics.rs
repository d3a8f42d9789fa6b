//! Closed forms and furnace tests of the CPU implementations of surface model and lights. No GPU.
use glam::{DVec3, Vec3};
use magpie::scene::Light;
use magpie_tests::oracle::shading::{
    SurfacePoint, alpha, brdf, direct, ggx_d, incident, reflected, scattered_once, smith_g2,
};
use std::f64::consts::PI;

const ROUGHNESS: [f64; 7] = [0.0, 0.045, 0.1, 0.25, 0.5, 0.75, 1.0];

fn surface(base_colour: f64, metalness: f64, roughness: f64) -> SurfacePoint {
    SurfacePoint {
        position: DVec3::ZERO,
        normal: DVec3::Z,
        to_viewer: DVec3::Z,
        base_colour: DVec3::splat(base_colour),
        metalness,
        roughness,
    }
}

/// A unit vector at these angles from +z.
fn at(theta: f64, phi: f64) -> DVec3 {
    DVec3::new(theta.sin() * phi.cos(), theta.sin() * phi.sin(), theta.cos())
}

fn close(got: f64, want: f64, relative: f64) {
    assert!((got - want).abs() <= relative * want.abs().max(1e-300), "got {got}, want {want}");
}

#[test]
fn ggx_normals_cover_the_surface_once() {
    for roughness in ROUGHNESS {
        let a = alpha(roughness);
        // tan theta = a x / (1 - x) maps the peak evenly to 0..1.
        let n = 20_000;
        let sum: f64 = (0..n)
            .map(|i| {
                let x = (f64::from(i) + 0.5) / f64::from(n);
                let tan = a * x / (1.0 - x);
                let theta = tan.atan();
                let d_theta = a / (1.0 - x).powi(2) / (1.0 + tan * tan);
                ggx_d(theta.cos(), a) * theta.cos() * theta.sin() * 2.0 * PI * d_theta / f64::from(n)
            })
            .sum();
        close(sum, 1.0, 1e-5);
    }
}

/// Directional albedo: integral of the BRDF times cosine, with half vectors sampled from D on a grid that is densest where facets are steep:
/// those are rare, but weigh much at grazing angles.
fn specular_albedo(p: &SurfacePoint, v: DVec3) -> f64 {
    let (a, n) = (alpha(p.roughness), 300);
    let mut sum = 0.0;
    for i in 0..n {
        for j in 0..n {
            let (rest, y) = (1.0 - (f64::from(i) + 0.5) / f64::from(n), (f64::from(j) + 0.5) / f64::from(n));
            let (x, spacing) = (1.0 - rest.powi(4), 4.0 * rest.powi(3));
            // Sampling of D: Walter et al. 2007, equation 35.
            let theta = (a * (x / (1.0 - x)).sqrt()).atan();
            let h = at(theta, 2.0 * PI * y);
            let v_h = v.dot(h);
            let l = 2.0 * v_h * h - v;
            if v_h <= 0.0 || l.z <= 0.0 {
                continue;
            }
            let density = ggx_d(h.z, a) * h.z / (4.0 * v_h);
            sum += spacing * brdf(p, v, l).x * l.z / density;
        }
    }
    sum / f64::from(n * n)
}

#[test]
fn a_perfect_metal_reflects_what_it_gets() {
    for roughness in ROUGHNESS {
        let p = surface(1.0, 1.0, roughness);
        for theta in [0.0, 0.3, 0.7, 1.1, 1.4, 1.55] {
            let albedo = specular_albedo(&p, at(theta, 0.4));
            // Light that scatters more than once between microfacets is given back.
            assert!((albedo - 1.0).abs() <= 2e-3, "roughness {roughness}, angle {theta}: {albedo}");
        }
    }
}

#[test]
fn a_white_dielectric_returns_all_light_and_no_more() {
    for roughness in [0.1, 0.3, 0.5, 1.0] {
        let (white, black) = (surface(1.0, 0.0, roughness), surface(0.0, 0.0, roughness));
        for (theta, least) in [(0.0_f64, 0.97), (0.7, 0.97), (1.1, 0.9), (1.4, 0.6), (1.5, 0.3)] {
            let v = at(theta, 0.0);
            // Cosine-weighted directions for the difference, which is the diffuse part.
            let n = 300;
            let mut diffuse = 0.0;
            for i in 0..n {
                for j in 0..n {
                    let (x, y) = ((f64::from(i) + 0.5) / f64::from(n), (f64::from(j) + 0.5) / f64::from(n));
                    let l = at(x.sqrt().asin(), 2.0 * PI * y);
                    diffuse += (brdf(&white, v, l).x - brdf(&black, v, l).x) * PI / f64::from(n * n);
                }
            }
            let albedo = diffuse + specular_albedo(&black, v);
            assert!(albedo <= 1.0 + 1e-3 && albedo > least, "roughness {roughness}, angle {theta}: {albedo}");
        }
    }
}

#[test]
fn light_and_viewer_may_change_places() {
    let mut pairs = 0;
    for roughness in ROUGHNESS {
        for metalness in [0.0, 0.5, 1.0] {
            let p = surface(0.6, metalness, roughness);
            for i in 0..200 {
                let i = f64::from(i);
                // Irrational steps: directions all over the hemisphere.
                let v = at((i * 0.618_034).fract() * 1.55, i * 2.1);
                let l = at((i * 0.754_878).fract() * 1.55, i * 3.7);
                // What scatters more than once is given back by the viewer's angle alone, and is not reciprocal.
                let [there, back] = [scattered_once(&p, v, l), scattered_once(&p, l, v)]
                    .map(|[diffuse, specular]| (diffuse + specular).x);
                assert!(there > 0.0);
                close(there, back, 1e-9);
                pairs += 1;
            }
        }
    }
    assert_eq!(pairs, 7 * 3 * 200);
}

#[test]
fn nothing_is_infinite_or_negative() {
    let angles = [0.0, 1e-9, 0.5, PI / 2.0 - 1e-9, PI / 2.0, PI / 2.0 + 1e-9, 2.0, PI];
    for roughness in ROUGHNESS {
        for metalness in [0.0, 1.0] {
            for base_colour in [0.0, 1.0] {
                for theta_v in angles {
                    for theta_l in angles {
                        for phi in [0.0, 1.0, PI] {
                            let mut p = surface(base_colour, metalness, roughness);
                            p.to_viewer = at(theta_v, 0.0);
                            let light = Light::Directional {
                                direction: -at(theta_l, phi).as_vec3(),
                                illuminance: Vec3::ONE,
                                angular_radius: 0.0,
                            };
                            let out = reflected(&p, &light);
                            assert!(out.is_finite() && out.min_element() >= 0.0, "{p:?} {light:?}: {out}");
                        }
                    }
                }
            }
        }
    }
}

#[test]
fn a_black_metal_reflects_nothing() {
    for theta in [0.0, 1.0, 1.5] {
        assert_eq!(brdf(&surface(0.0, 1.0, 0.3), at(theta, 0.0), at(theta, PI)), DVec3::ZERO);
    }
}

#[test]
fn masking_is_one_face_on_and_falls_to_nothing() {
    for roughness in ROUGHNESS {
        let a = alpha(roughness);
        close(smith_g2(1.0, 1.0, a), 1.0, 1e-12);
        let mut last = 1.0;
        for i in 1..=100 {
            let g = smith_g2((f64::from(i) / 100.0 * PI / 2.0).cos().max(1e-12), 1.0, a);
            assert!(g <= last, "roughness {roughness}, step {i}");
            last = g;
        }
        assert!(last < 1e-6);
    }
}

#[test]
fn a_surface_lit_and_seen_face_on_has_a_closed_form() {
    for roughness in [0.2, 0.5, 1.0] {
        let p = surface(0.5, 0.0, roughness);
        let a = alpha(roughness);
        // F = 0.04, D = 1 / (pi a²), G2 = 1; light enters and leaves with 0.96, over 1 less the mean of F, 0.04 + 0.96 / 21.
        let diffuse = 0.9974 * 0.5 / PI * 0.96 * 0.96 / (0.96 * 20.0 / 21.0);
        let specular = 0.04 / (4.0 * PI * a * a);
        let [found_diffuse, found_specular] = scattered_once(&p, DVec3::Z, DVec3::Z);
        close(found_diffuse.x, diffuse, 1e-12);
        close(found_specular.x, specular, 1e-12);
        // Seen face on, the albedo of a mirror of such facets is an integral over their angle alone.
        let steps = 20_000;
        let albedo: f64 = (0..steps)
            .map(|i| (f64::from(i) + 0.5) * PI / 4.0 / f64::from(steps))
            .map(|t| ggx_d(t.cos(), a) * t.cos() * smith_g2(1.0, (2.0 * t).cos(), a) * 2.0 * PI * t.sin())
            .sum::<f64>()
            * (PI / 4.0 / f64::from(steps));
        let again = 1.0 + 0.04 * (1.0 / albedo - 1.0);
        let want = 3.0 * (diffuse + specular * again);
        let sun = Light::Directional { direction: Vec3::NEG_Z, illuminance: Vec3::splat(3.0), angular_radius: 0.0 };
        close(direct(&p, std::slice::from_ref(&sun)).x, want, 1e-5);
        close(direct(&p, &[sun.clone(), sun]).x, 2.0 * want, 1e-5);
    }
}

#[test]
fn lights_follow_their_laws() {
    let point = |range| Light::Point { position: DVec3::new(0.0, 0.0, 2.0), intensity: Vec3::splat(8.0), range };
    close(incident(&point(None), DVec3::ZERO).irradiance.x, 2.0, 1e-12);
    close(incident(&point(None), DVec3::new(0.0, 0.0, -2.0)).irradiance.x, 0.5, 1e-12);
    close(incident(&point(Some(4.0)), DVec3::ZERO).irradiance.x, 2.0 * (1.0 - 1.0 / 16.0), 1e-12);
    assert_eq!(incident(&point(Some(2.0)), DVec3::ZERO).irradiance, DVec3::ZERO);
    assert!(incident(&point(None), DVec3::new(0.0, 0.0, 2.0)).irradiance.is_finite());

    let spot = Light::Spot {
        position: DVec3::Z,
        direction: Vec3::NEG_Z,
        intensity: Vec3::ONE,
        range: None,
        inner: 0.3,
        outer: 0.5,
    };
    let by_angle = |theta: f64| incident(&spot, DVec3::Z - at(theta, 0.0)).irradiance.x;
    close(by_angle(0.0), 1.0, 1e-12);
    close(by_angle(0.29), 1.0, 1e-12);
    let halfway = ((0.3_f32 as f64).cos() + 0.5_f64.cos()) / 2.0;
    close(by_angle(halfway.acos()), 0.25, 1e-9);
    assert_eq!(by_angle(0.51), 0.0);

    let lamp =
        Light::Rectangle { centre: DVec3::Z, half_u: 0.01 * Vec3::Y, half_v: 0.01 * Vec3::X, radiance: Vec3::ONE };
    // Emits downwards: y cross x is -z. Far away it acts as a point of intensity radiance * area * cos.
    close(incident(&lamp, DVec3::ZERO).irradiance.x, 0.0004, 1e-6);
    close(incident(&lamp, DVec3::new(1.0, 0.0, 0.0)).irradiance.x, 0.0004 * 0.5_f64.sqrt() / 2.0, 1e-6);
    assert_eq!(incident(&lamp, DVec3::new(0.0, 0.0, 2.0)).irradiance, DVec3::ZERO);
    close(incident(&lamp, DVec3::new(0.0, 0.0, 1.0 - 1e-6)).irradiance.x, PI, 1e-6);
}
