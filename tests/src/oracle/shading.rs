//! Direct lighting of one surface point, by the textbook forms of the equations.
//!
//! The definitions are those of `shaders/lib/README.md`; the formulas are written for clarity, in double precision.

use super::albedo::again;
use glam::DVec3;
use magpie::scene::Light;
use std::f64::consts::PI;

/// Least alpha of GGX.
pub const MIN_ALPHA: f64 = 0.002;
/// Least distance to a light, metres.
pub const MIN_LIGHT_DISTANCE: f64 = 1e-4;
/// Least difference of a spot light's cosines (KHR_lights_punctual).
const MIN_CONE: f64 = 0.001;
/// Replaces a cosine of 0 in denominators.
const GRAZING: f64 = 1e-12;

/// A surface point with the G-buffer's attributes.
#[derive(Clone, Copy, Debug)]
pub struct SurfacePoint {
    /// World, metres.
    pub position: DVec3,
    /// Shading normal, unit.
    pub normal: DVec3,
    /// Unit, towards the viewer.
    pub to_viewer: DVec3,
    /// Linear Rec.709, 0 to 1.
    pub base_colour: DVec3,
    /// 0 to 1.
    pub metalness: f64,
    /// Perceptual, 0 to 1.
    pub roughness: f64,
}

/// Light from one light source at a point.
#[derive(Clone, Copy, Debug)]
pub struct Incident {
    /// Direction towards the light, unit.
    pub direction: DVec3,
    /// Metres; infinite for directional lights.
    pub distance: f64,
    /// Irradiance on a surface that faces the light.
    pub irradiance: DVec3,
}

/// GGX normal distribution of the angle with cosine `n_h`, per steradian (Walter et al. 2007, equation 33):
/// `a² / (pi cos⁴ (a² + tan²)²)`.
pub fn ggx_d(n_h: f64, alpha: f64) -> f64 {
    if n_h <= 0.0 {
        return 0.0;
    }
    let cos2 = n_h * n_h;
    let tan2 = (1.0 - cos2).max(0.0) / cos2;
    let a2 = alpha * alpha;
    a2 / (PI * cos2 * cos2 * (a2 + tan2).powi(2))
}

/// Smith's Lambda of GGX (Heitz 2014, equation 72) for a direction of this cosine.
pub fn smith_lambda(cosine: f64, alpha: f64) -> f64 {
    let tan2 = (1.0 - cosine * cosine).max(0.0) / (cosine * cosine);
    ((1.0 + alpha * alpha * tan2).sqrt() - 1.0) / 2.0
}

/// Height-correlated masking and shadowing (Heitz 2014, equation 99).
pub fn smith_g2(n_v: f64, n_l: f64, alpha: f64) -> f64 {
    1.0 / (1.0 + smith_lambda(n_v, alpha) + smith_lambda(n_l, alpha))
}

/// Schlick's Fresnel reflectance (1994, equation 15), its grazing value lowered for `f0` below 2 %.
pub fn schlick(f0: DVec3, v_h: f64) -> DVec3 {
    let f90 = (50.0 * f0.max_element()).min(1.0);
    f0 + (DVec3::splat(f90) - f0) * (1.0 - v_h).clamp(0.0, 1.0).powi(5)
}

/// GGX alpha of a perceptual roughness.
pub fn alpha(roughness: f64) -> f64 {
    (roughness * roughness).max(MIN_ALPHA)
}

/// Factor of the diffuse part that conserves energy.
pub const DIFFUSE_SHARE: f64 = 0.9974;

/// The BRDF from light direction `l` to viewer `v`, per steradian; 0 for a light below the surface. What scatters more than once between
/// microfacets is given back in proportion to the specular part (Turquin 2019).
pub fn brdf(p: &SurfacePoint, v: DVec3, l: DVec3) -> DVec3 {
    let [diffuse, specular] = scattered_once(p, v, l);
    let f0 = DVec3::splat(0.04).lerp(p.base_colour, p.metalness);
    diffuse + specular * (DVec3::ONE + f0 * again(p.normal.dot(v), alpha(p.roughness)))
}

/// Its diffuse part (Shirley et al. 1997), and the specular part of light that scatters once (glTF 2.0, appendix B).
pub fn scattered_once(p: &SurfacePoint, v: DVec3, l: DVec3) -> [DVec3; 2] {
    let n = p.normal;
    let n_l = n.dot(l);
    if n_l <= 0.0 {
        return [DVec3::ZERO; 2];
    }
    let n_v = n.dot(v).max(GRAZING);
    let h = (v + l).try_normalize().unwrap_or(n);
    let alpha = alpha(p.roughness);
    let f0 = DVec3::splat(0.04).lerp(p.base_colour, p.metalness);
    let f = schlick(f0, v.dot(h));
    let specular = f * ggx_d(n.dot(h), alpha) * smith_g2(n_v, n_l, alpha) / (4.0 * n_v * n_l);
    // Diffuse: share entering times share leaving, over the cosine-weighted mean of 1 - F.
    let f90 = (50.0 * f0.max_element()).min(1.0);
    let through = |cosine| DVec3::ONE - schlick(f0, cosine);
    let average = DVec3::ONE - (20.0 * f0 + DVec3::splat(f90)) / 21.0;
    let coupled = through(n_v) * through(n_l) / average;
    let coupled = DVec3::select(average.cmpgt(DVec3::splat(1e-12)), coupled, DVec3::ZERO);
    [DIFFUSE_SHARE * (1.0 - p.metalness) * p.base_colour / PI * coupled, specular]
}

/// Incident light at a point, unoccluded (KHR_lights_punctual; rectangles from their centre).
pub fn incident(light: &Light, position: DVec3) -> Incident {
    let towards = |at: DVec3| {
        let d = at - position;
        (d.normalize_or_zero(), d.length(), d.length().max(MIN_LIGHT_DISTANCE).powi(2))
    };
    let window = |distance: f64, range: &Option<f32>| {
        range.map_or(1.0, |r| (1.0 - (distance / f64::from(r)).powi(4)).clamp(0.0, 1.0))
    };
    match light {
        Light::Directional { direction, illuminance, .. } => {
            Incident { direction: -direction.as_dvec3(), distance: f64::INFINITY, irradiance: illuminance.as_dvec3() }
        }
        Light::Point { position: at, intensity, range } => {
            let (direction, distance, square) = towards(*at);
            Incident { direction, distance, irradiance: intensity.as_dvec3() * window(distance, range) / square }
        }
        Light::Spot { position: at, direction: axis, intensity, range, inner, outer } => {
            let (direction, distance, square) = towards(*at);
            let (inner, outer) = (f64::from(*inner).cos(), f64::from(*outer).cos());
            let cosine = axis.as_dvec3().dot(-direction);
            let cone = ((cosine - outer) / (inner - outer).max(MIN_CONE)).clamp(0.0, 1.0).powi(2);
            Incident { direction, distance, irradiance: intensity.as_dvec3() * window(distance, range) * cone / square }
        }
        Light::Rectangle { centre, half_u, half_v, radiance } => {
            let (direction, distance, square) = towards(*centre);
            let across = half_u.as_dvec3().cross(half_v.as_dvec3());
            let area = 4.0 * across.length();
            let cosine = across.normalize_or_zero().dot(-direction).max(0.0);
            // An emitter's irradiance is at most pi times its radiance.
            let irradiance = radiance.as_dvec3() * area * cosine / square.max(area / PI);
            Incident { direction, distance, irradiance }
        }
        Light::Disc { centre, normal, radius, radiance } => {
            let (direction, distance, square) = towards(*centre);
            let area = PI * f64::from(*radius).powi(2);
            let cosine = normal.as_dvec3().dot(-direction).max(0.0);
            let irradiance = radiance.as_dvec3() * area * cosine / square.max(area / PI);
            Incident { direction, distance, irradiance }
        }
        Light::Sphere { centre, radius, radiance } => {
            let (direction, distance, square) = towards(*centre);
            let radius_square = f64::from(*radius).powi(2);
            let irradiance = radiance.as_dvec3() * (PI * radius_square / square.max(radius_square));
            Incident { direction, distance, irradiance }
        }
    }
}

/// Radiance towards the viewer from one light, unoccluded.
pub fn reflected(p: &SurfacePoint, light: &Light) -> DVec3 {
    let i = incident(light, p.position);
    brdf(p, p.to_viewer, i.direction) * i.irradiance * p.normal.dot(i.direction).max(0.0)
}

/// Radiance towards the viewer from all lights, unoccluded, without emission.
pub fn direct(p: &SurfacePoint, lights: &[Light]) -> DVec3 {
    lights.iter().map(|light| reflected(p, light)).sum()
}
