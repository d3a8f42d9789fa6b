//! The surface model: values by lobe, and a sampler.
//!
//! Written from the formulas, independently of the shaders. Diffuse directions are cosine-weighted, and half vectors are sampled by
//! spherical caps (Dupuy and Benyoub 2023, "Sampling Visible GGX Normals with Spherical Caps").
use super::random::{Random, frame, from_polar};
use crate::oracle::albedo::again;
use crate::oracle::shading::{ggx_d, smith_g2, smith_lambda};
use glam::DVec3;
use std::f64::consts::{PI, TAU};

/// Loss of the diffuse part below a surface that reflects fully at grazing incidence, so that a white surface conserves energy.
const DIFFUSE_LOSS: f64 = 0.0026;
/// Reflectance of a clear coat at normal incidence (KHR_materials_clearcoat).
const COAT_F0: f64 = 0.04;
/// Least sampling probability of a lobe that contributes.
const MIN_PROBABILITY: f64 = 0.05;
/// Least sampling probability of transmission through glass.
const MIN_TRANSMISSION_PROBABILITY: f64 = 0.3;

/// Reflected and transmitted light by lobe.
#[derive(Clone, Copy, Debug, Default, PartialEq)]
pub struct Lobes {
    /// Coupled diffuse reflection.
    pub diffuse: DVec3,
    /// Reflection at the surface below a coat.
    pub specular: DVec3,
    /// Reflection at the clear coat.
    pub coat: DVec3,
    /// Transmission through the surface.
    pub transmission: DVec3,
}

impl Lobes {
    /// Sum of the lobes.
    pub fn total(&self) -> DVec3 {
        self.diffuse + self.specular + self.coat + self.transmission
    }
}

/// Schlick's approximation of reflectance (1994, equation 15).
#[derive(Clone, Copy, Debug)]
pub struct Schlick {
    /// Reflectance at normal incidence.
    pub f0: DVec3,
    /// Reflectance at grazing incidence, the same in every channel.
    pub f90: f64,
    /// f0 for the diffuse part below.
    pub below: DVec3,
    /// Share of `DIFFUSE_LOSS` that applies, 0 to 1.
    pub loss: f64,
}

impl Schlick {
    /// For a blend of a dielectric and a metal (KHR_materials_specular, with the blend of glTF 2.0, appendix B). Grazing reflectance
    /// decreases with an f0 below 2 %.
    pub fn new(m: &Layers) -> Self {
        let by_index = ((m.ior - 1.0) / (m.ior + 1.0)).powi(2);
        let dielectric = (by_index * m.specular_colour).min(DVec3::ONE) * m.specular;
        let mixed = |dielectric: DVec3| dielectric.lerp(m.base, m.metalness);
        let black = (50.0 * mixed(DVec3::splat(0.04)).max_element()).min(1.0);
        let grazing = (50.0 * by_index).min(1.0) * m.specular * (1.0 - m.metalness) + m.metalness;
        Self {
            f0: mixed(dielectric),
            f90: black * grazing,
            loss: grazing,
            below: mixed(DVec3::splat(dielectric.max_element())),
        }
    }

    /// The reflectance for the diffuse part below.
    pub fn seen_from_below(&self) -> Self {
        Self { f0: self.below, ..*self }
    }

    /// Reflectance at a cosine.
    pub fn at(&self, cosine: f64) -> DVec3 {
        self.f0 + (DVec3::splat(self.f90) - self.f0) * (1.0 - cosine.clamp(0.0, 1.0)).powi(5)
    }

    /// Cosine-weighted mean over the hemisphere: the integral of `2 c (1 - c)^5` is 1/21.
    pub fn mean(&self) -> DVec3 {
        self.f0 + (DVec3::splat(self.f90) - self.f0) / 21.0
    }
}

/// Unpolarised Fresnel reflectance between dielectrics; `eta` is the index behind over the index in front.
pub fn fresnel(cosine: f64, eta: f64) -> f64 {
    let sine2 = (1.0 - cosine * cosine).max(0.0) / (eta * eta);
    if sine2 >= 1.0 {
        return 1.0;
    }
    let behind = (1.0 - sine2).sqrt();
    let across = (cosine - eta * behind) / (cosine + eta * behind);
    let along = (eta * cosine - behind) / (eta * cosine + behind);
    0.5 * (across * across + along * along)
}

/// A material at a point.
#[derive(Clone, Copy, Debug)]
pub struct Layers {
    /// Base colour, linear, 0 to 1.
    pub base: DVec3,
    /// Metalness, 0 to 1.
    pub metalness: f64,
    /// Alpha of GGX.
    pub alpha: f64,
    /// Share of the dielectric part that is glass, 0 to 1.
    pub transmission: f64,
    /// Index of refraction, at least 1.
    pub ior: f64,
    /// Strength of the dielectric reflection, 0 to 1.
    pub specular: f64,
    /// Colour of the dielectric reflection at normal incidence, at least 0.
    pub specular_colour: DVec3,
    /// Whether it is the boundary of a volume, which refracts; else a thin sheet.
    pub volume: bool,
    /// Whether the viewer is inside the volume.
    pub inside: bool,
    /// Strength of the coat, 0 to 1.
    pub coat: f64,
    /// Alpha of GGX of the coat.
    pub coat_alpha: f64,
    /// Whether what scatters more than once between microfacets counts.
    pub scatters_again: bool,
}

/// A surface point that scatters light.
#[derive(Clone, Copy, Debug)]
pub struct Scatterer {
    /// Shading normal, unit, on the side of the viewer.
    pub normal: DVec3,
    /// Geometric normal, unit, on the side of the viewer.
    pub plane: DVec3,
    /// Direction to the viewer, unit.
    pub to_viewer: DVec3,
    /// Its material.
    pub layers: Layers,
}

/// Strategies for sampling a direction.
#[derive(Clone, Copy, PartialEq)]
enum Way {
    Cosine,
    Mirror,
    Coat,
    Through,
}

impl Scatterer {
    /// BSDF times cosine for light from a unit direction, per steradian.
    pub fn value(&self, l: DVec3) -> Lobes {
        let Self { normal: n, plane, to_viewer: v, layers: m } = *self;
        let (n_v, n_l, p_l) = (n.dot(v), n.dot(l), plane.dot(l));
        let glass = (1.0 - m.metalness) * m.transmission;
        let mut lobes = Lobes::default();
        if n_v <= 0.0 {
            return lobes;
        }
        // Scattered again between microfacets: COAT_F0 and f0 of it per scattering. The coat's albedo is missing below it.
        let again = |alpha| if m.scatters_again { again(n_v, alpha) } else { 0.0 };
        let coat_again = again(m.coat_alpha);
        let coat = self.coat_share() * (1.0 + COAT_F0 * coat_again);
        let under = 1.0 - coat / (1.0 + coat_again);
        if n_l > 0.0 && p_l > 0.0 {
            let h = (v + l).normalize();
            let v_h = v.dot(h);
            let surface = self.schlick();
            let microfacets = |alpha| ggx_d(n.dot(h), alpha) * smith_g2(n_v, n_l, alpha) / (4.0 * n_v);
            let opaque = surface.at(v_h) * (DVec3::ONE + surface.f0 * again(m.alpha));
            let reflected = opaque * (1.0 - glass) + glass * self.glass(v_h);
            lobes.specular = under * reflected * microfacets(m.alpha);
            lobes.coat = DVec3::splat(coat * microfacets(m.coat_alpha));
            let above = surface.seen_from_below();
            let lost = DVec3::ONE - above.mean();
            let coupled = (DVec3::ONE - above.at(n_v)) * (DVec3::ONE - above.at(n_l));
            let coupled = DVec3::select(lost.cmpgt(DVec3::ZERO), coupled / lost, DVec3::ZERO);
            let scale = 1.0 - DIFFUSE_LOSS * above.loss;
            lobes.diffuse = under * (1.0 - glass) * scale * (1.0 - m.metalness) * m.base / PI * coupled * n_l;
        }
        if n_l < 0.0 && p_l < 0.0 && glass > 0.0 {
            let through = if m.volume { self.refracted(l) } else { self.through_sheet(l) };
            lobes.transmission = under * glass * m.base * through;
        }
        lobes
    }

    /// Transmission through a rough interface (Walter et al. 2007, equation 21) without the colour, times the cosine. Their index of the
    /// transmitted side is the viewer's here, divided out, which leaves only the quotient `eta`.
    fn refracted(&self, l: DVec3) -> f64 {
        let (n, v, eta, alpha) = (self.normal, self.to_viewer, self.eta(), self.layers.alpha);
        let Some(h) = self.refracting(l) else { return 0.0 };
        let (v_h, l_h) = (v.dot(h), l.dot(h));
        let g_d = smith_g2(n.dot(v), -n.dot(l), alpha) * ggx_d(n.dot(h), alpha);
        v_h * -l_h * (1.0 - self.glass(v_h).max_element()) * g_d / (n.dot(v) * (v_h + eta * l_h).powi(2))
    }

    /// The half vector of refraction, on the side of the viewer; none if no microfacet refracts in this direction.
    fn refracting(&self, l: DVec3) -> Option<DVec3> {
        let h = (self.to_viewer + self.eta() * l).try_normalize()?;
        let h = if h.dot(self.normal) < 0.0 { -h } else { h };
        (self.to_viewer.dot(h) > 0.0 && l.dot(h) < 0.0).then_some(h)
    }

    /// Transmission through a thin sheet without the colour, times the cosine: a reflection, mirrored through the sheet.
    fn through_sheet(&self, l: DVec3) -> f64 {
        let (n, v, alpha) = (self.normal, self.to_viewer, self.layers.alpha);
        let mirrored = l - 2.0 * n.dot(l) * n;
        let h = (v + mirrored).normalize();
        let microfacets = ggx_d(n.dot(h), alpha) * smith_g2(n.dot(v), n.dot(mirrored), alpha) / (4.0 * n.dot(v));
        (1.0 - self.glass(v.dot(h)).max_element()) * microfacets
    }

    fn schlick(&self) -> Schlick {
        Schlick::new(&self.layers)
    }

    /// Reflectance of glass: interpolated between the values that strength and colour give at normal and at grazing incidence, along the
    /// exact Fresnel curve. Total internal reflection stays total.
    fn glass(&self, cosine: f64) -> DVec3 {
        let (m, f) = (&self.layers, fresnel(cosine, self.eta()));
        if f >= 1.0 {
            return DVec3::ONE;
        }
        let by_index = ((m.ior - 1.0) / (m.ior + 1.0)).powi(2);
        let (far, normal) =
            ((f - by_index).max(0.0) / (1.0 - by_index), (by_index * m.specular_colour).min(DVec3::ONE));
        let plain = by_index * (1.0 - far) + far;
        (normal * m.specular).lerp(DVec3::splat(m.specular), far) + DVec3::splat(f - plain)
    }

    /// Relative index of refraction: behind the surface over the viewer's side.
    pub fn eta(&self) -> f64 {
        if self.layers.volume && self.layers.inside { 1.0 / self.layers.ior } else { self.layers.ior }
    }

    /// Share of the light that the coat reflects.
    fn coat_share(&self) -> f64 {
        if self.layers.inside {
            return 0.0;
        }
        let fresnel = COAT_F0 + (1.0 - COAT_F0) * (1.0 - self.normal.dot(self.to_viewer).clamp(0.0, 1.0)).powi(5);
        self.layers.coat * fresnel
    }

    /// Probability of each sampling strategy.
    fn ways(&self) -> [(Way, f64); 4] {
        let (m, n_v) = (&self.layers, self.normal.dot(self.to_viewer));
        let glass = (1.0 - m.metalness) * m.transmission;
        let coat = self.coat_share();
        let reflected = (1.0 - glass) * self.schlick().at(n_v).max_element() + glass * fresnel(n_v, self.eta());
        let diffuse = (1.0 - glass) * (1.0 - m.metalness) * m.base.max_element();
        let through = glass * (1.0 - fresnel(n_v, self.eta())) * m.base.max_element();
        let at_least = |share: f64, exists: bool| if exists { share.max(MIN_PROBABILITY) } else { 0.0 };
        // The cosine strategy also covers the tails of wide lobes at grazing angles, which half vectors sample badly.
        let ways = [
            (Way::Cosine, at_least((1.0 - coat) * diffuse, glass < 1.0)),
            (Way::Mirror, at_least((1.0 - coat) * reflected, true)),
            (Way::Coat, at_least(coat, coat > 0.0)),
            // Rough glass transmits some of what smooth glass would totally reflect.
            (Way::Through, at_least((1.0 - coat) * through.max(MIN_TRANSMISSION_PROBABILITY * glass), glass > 0.0)),
        ];
        let sum: f64 = ways.iter().map(|w| w.1).sum();
        ways.map(|(way, share)| (way, share / sum))
    }

    /// Samples a direction towards light; none if the sample is invalid.
    pub fn sample(&self, random: &mut Random) -> Option<DVec3> {
        let mut rest = random.unit();
        let ways = self.ways();
        let drawn = ways.iter().find(|(_, share)| {
            rest -= share;
            rest < 0.0
        });
        let (way, _) = *drawn.unwrap_or(&ways[1]);
        let (n, v) = (self.normal, self.to_viewer);
        let (x, angle) = (random.unit(), TAU * random.unit());
        if way == Way::Cosine {
            return Some(frame(n) * from_polar((1.0 - x).sqrt(), angle));
        }
        let alpha = if way == Way::Coat { self.layers.coat_alpha } else { self.layers.alpha };
        let h = seen_normal(n, v, alpha, [x, angle]);
        let v_h = v.dot(h);
        if v_h <= 0.0 {
            return None;
        }
        let mirrored = 2.0 * v_h * h - v;
        let l = match way {
            Way::Through if self.layers.volume => {
                // Snell's law: the sine is divided by eta.
                let sine2 = (1.0 - v_h * v_h).max(0.0) / self.eta().powi(2);
                if sine2 >= 1.0 {
                    return None;
                }
                (v_h * h - v) / self.eta() - (1.0 - sine2).sqrt() * h
            }
            Way::Through => mirrored - 2.0 * n.dot(mirrored) * n,
            _ => mirrored,
        };
        let below = n.dot(l) < 0.0;
        (below == (way == Way::Through)).then(|| l.normalize())
    }

    /// Pdf of [`sample`](Self::sample), per steradian. Its integral is 1 less the share of invalid samples.
    pub fn pdf(&self, l: DVec3) -> f64 {
        let (n, v, m) = (self.normal, self.to_viewer, &self.layers);
        let n_l = n.dot(l);
        let by_half_vector = |l: DVec3, alpha: f64| {
            let h = (v + l).normalize();
            if v.dot(h) > 0.0 { normal_density(n, v, h, alpha) / (4.0 * v.dot(h)) } else { 0.0 }
        };
        let of = |way: Way| match way {
            Way::Cosine => n_l.max(0.0) / PI,
            Way::Mirror if n_l > 0.0 => by_half_vector(l, m.alpha),
            Way::Coat if n_l > 0.0 => by_half_vector(l, m.coat_alpha),
            Way::Through if n_l < 0.0 && !m.volume => by_half_vector(l - 2.0 * n_l * n, m.alpha),
            Way::Through if n_l < 0.0 => self.refracting(l).map_or(0.0, |h| {
                let (v_h, l_h, eta) = (v.dot(h), l.dot(h), self.eta());
                normal_density(n, v, h, m.alpha) * eta * eta * -l_h / (v_h + eta * l_h).powi(2)
            }),
            _ => 0.0,
        };
        self.ways().into_iter().filter(|(_, share)| *share > 0.0).map(|(way, share)| share * of(way)).sum()
    }
}

/// Samples the visible normals: stretched to a sphere, the directions that mirror the viewer form a cap, uniform in height.
fn seen_normal(n: DVec3, v: DVec3, alpha: f64, [x, angle]: [f64; 2]) -> DVec3 {
    let world = frame(n);
    let stretch = DVec3::new(alpha, alpha, 1.0);
    let viewer = (world.transpose() * v * stretch).normalize();
    let mirrored = from_polar((1.0 - x) * (1.0 + viewer.z) - viewer.z, angle);
    (world * ((mirrored + viewer) * stretch)).normalize()
}

/// Pdf of [`seen_normal`], per steradian (Heitz 2014, equation 16).
fn normal_density(n: DVec3, v: DVec3, h: DVec3, alpha: f64) -> f64 {
    let n_v = n.dot(v);
    ggx_d(n.dot(h), alpha) * v.dot(h).max(0.0) / (n_v * (1.0 + smith_lambda(n_v, alpha)))
}
