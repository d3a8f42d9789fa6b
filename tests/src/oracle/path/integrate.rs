//! Path tracing from the camera with light sampling at every surface.
use super::bsdf::{Lobes, Scatterer};
use super::geometry::{Hit, Ray};
use super::lights::{self, chances, choose, draw, has_size, meet};
use super::random::{Random, frame, from_polar};
use super::surface::Surface;
use super::{CpuPathTracer, CpuPathTracerOptions};
use glam::DVec3;
use magpie::scene::Light;
use magpie_passes::reference::Only;
use std::f64::consts::TAU;

/// Scatterings before Russian roulette.
const SAFE_SCATTERINGS: u32 = 4;
/// Least and greatest survival probability of Russian roulette.
const SURVIVAL: [f64; 2] = [0.05, 0.97];
/// Offset of ray origins and ends, relative to coordinates and distances.
const GAP: f64 = 1e-9;

/// Light that counts at a scattering.
#[derive(Clone, Copy)]
struct Counted {
    /// Light of lights and emissive surfaces.
    lights: bool,
    /// Light of the sky.
    sky: bool,
    /// Lobes that count.
    lobes: Only,
}

impl Counted {
    fn at(only: Only, first: bool) -> Self {
        match only {
            _ if !first => Self { lights: true, sky: true, lobes: Only::All },
            Only::Direct => Self { lights: true, sky: false, lobes: Only::All },
            Only::Gi | Only::Reflections | Only::Transparency => Self { lights: false, sky: true, lobes: only },
            _ => Self { lights: true, sky: true, lobes: Only::All },
        }
    }

    fn of(&self, lobes: &Lobes) -> DVec3 {
        match self.lobes {
            Only::Gi => lobes.diffuse,
            Only::Reflections => lobes.specular + lobes.coat,
            Only::Transparency => lobes.transmission,
            _ => lobes.total(),
        }
    }
}

/// Weight of a sample by multiple importance sampling, power heuristic with exponent 2 (Veach and Guibas 1995).
fn part(mine: f64, other: f64) -> f64 {
    mine * mine / (mine * mine + other * other)
}

/// Transmittance of an absorption, per metre, over a distance that may be infinite.
fn left(absorption: DVec3, distance: f64) -> DVec3 {
    absorption.map(|a| if a > 0.0 { (-a * distance).exp() } else { 1.0 })
}

/// Offset of rays that start at a point.
fn begin(position: DVec3) -> f64 {
    GAP * (1.0 + position.abs().max_element())
}

impl CpuPathTracer {
    /// One sample of a pixel. `direction` has unit view depth, in which `near` is measured too.
    pub(super) fn path(
        &self,
        eye: DVec3,
        direction: DVec3,
        near: f64,
        options: &CpuPathTracerOptions,
        random: &mut Random,
    ) -> DVec3 {
        let (length, only) = (direction.length(), options.only);
        let direction = direction / length;
        let seen = Ray { origin: eye, direction, from: near * length, to: f64::INFINITY };
        let Some(hit) = self.closest(&seen, true, random) else {
            return match only {
                Only::All => self.sky.as_ref().map_or(DVec3::ZERO, |s| s.seen(direction)),
                Only::AmbientOcclusion => DVec3::ONE,
                _ => DVec3::ZERO,
            };
        };
        let mut surface = self.materials.surface(&self.geometry, &hit, eye, direction);
        match only {
            Only::Shadows => return self.lights_seen(&surface, random),
            Only::AmbientOcclusion => return DVec3::splat(self.openness(&surface, options.ao_range, random)),
            _ => {}
        }
        let mut throughput = match surface.volume {
            Some((absorption, true)) => left(absorption, hit.t),
            _ => DVec3::ONE,
        };
        let mut radiance = DVec3::ZERO;
        if matches!(only, Only::All | Only::Direct) {
            radiance += throughput * surface.shown;
        }

        // Radiance scales by the squared index inside a volume and back outside; Russian roulette ignores that factor.
        let mut shrunk = 1.0;
        for scatterings in 1.. {
            let scatterer = surface.scatterer;
            if !surface.scatters || (options.depth > 0 && scatterings > options.depth) {
                break;
            }
            if scatterings > SAFE_SCATTERINGS {
                let survives = (throughput.max_element() / shrunk).clamp(SURVIVAL[0], SURVIVAL[1]);
                if random.unit() >= survives {
                    break;
                }
                throughput /= survives;
            }
            let counted = Counted::at(only, scatterings == 1);
            radiance += throughput * self.asked(&surface, &scatterer, counted, random);

            let Some(direction) = scatterer.sample(random) else { break };
            let density = scatterer.pdf(direction);
            throughput *= counted.of(&scatterer.value(direction)) / density;
            if throughput == DVec3::ZERO {
                break;
            }
            if scatterer.layers.volume && scatterer.plane.dot(direction) < 0.0 {
                shrunk /= scatterer.eta().powi(2);
            }
            let origin = surface.position;
            let ray = Ray { origin, direction, from: begin(origin), to: f64::INFINITY };
            let medium = inside(&surface, direction);
            let next = self.closest(&ray, false, random);
            radiance += throughput * self.met(&ray, next.as_ref(), medium, density, counted);
            if only == Only::Direct {
                break;
            }
            let Some(hit) = next else { break };
            surface = self.materials.surface(&self.geometry, &hit, origin, direction);
            let medium = medium.or(surface.volume.and_then(|(absorption, inside)| inside.then_some(absorption)));
            throughput *= left(medium.unwrap_or(DVec3::ZERO), hit.t);
        }
        radiance
    }

    /// The nearest hit; blended surfaces are hit with the probability of their coverage. Camera rays ignore back faces.
    fn closest(&self, ray: &Ray, from_camera: bool, random: &mut Random) -> Option<Hit> {
        let mut ray = *ray;
        loop {
            let hit = self.geometry.nearest(&ray, |hit| {
                let culled = from_camera && !hit.front && !self.materials.of(&self.geometry, hit).double_sided;
                !culled && self.materials.coverage(&self.geometry, hit) > 0.0
            })?;
            let coverage = self.materials.coverage(&self.geometry, &hit);
            if coverage == 1.0 || random.unit() < coverage {
                return Some(hit);
            }
            ray.from = hit.t * (1.0 + GAP);
        }
    }

    /// Transmittance from a point along a unit direction up to a distance.
    fn transmittance(&self, origin: DVec3, direction: DVec3, distance: f64) -> f64 {
        let ray = Ray { origin, direction, from: begin(origin), to: distance * (1.0 - GAP) };
        let mut left = 1.0;
        self.geometry.all(&ray, |hit| {
            left *= 1.0 - self.materials.coverage(&self.geometry, hit);
            left > 0.0
        });
        left
    }

    /// Direct light by light sampling: one sample each of the lights, the emissive surfaces and the sky, combined with BSDF sampling.
    fn asked(&self, surface: &Surface, scatterer: &Scatterer, counted: Counted, random: &mut Random) -> DVec3 {
        let position = surface.position;
        let mut sum = DVec3::ZERO;
        let mut add = |direction: DVec3, distance: f64, light: DVec3, density: Option<f64>| {
            let value = counted.of(&scatterer.value(direction));
            if value == DVec3::ZERO || light == DVec3::ZERO {
                return;
            }
            let through = self.transmittance(position, direction, distance);
            let absorbed = inside(surface, direction).map_or(DVec3::ONE, |a| left(a, distance));
            let weight = density.map_or(1.0, |d| part(d, scatterer.pdf(direction)) / d);
            sum += value * light * absorbed * (through * weight);
        };
        if counted.lights && !self.lights.is_empty() {
            let chances = chances(&self.lights, position);
            let chosen = choose(&chances, random);
            if let Some(l) = draw(&self.lights[chosen], position, random) {
                let chance = chances[chosen];
                // The selection probability is part of the pdf; without a pdf it divides the light.
                let light = if l.density.is_some() { l.light } else { l.light / chance };
                add(l.direction, l.distance, light, l.density.map(|d| d * chance));
            }
        }
        if counted.lights
            && let Some((primitive, barycentric, point, by_area)) = self.emitters.draw(&self.geometry, position, random)
        {
            let (to, direction) = (point - position, (point - position).normalize_or_zero());
            let (light, normal) = self.materials.emitted(&self.geometry, primitive, (barycentric, point), direction);
            let cosine = normal.dot(direction).abs();
            if cosine > 0.0 {
                add(direction, to.length(), light, Some(by_area * to.length_squared() / cosine));
            }
        }
        if counted.sky
            && let Some(sky) = &self.sky
        {
            let (direction, density) = sky.draw(random);
            add(direction, f64::INFINITY, sky.radiance(direction), Some(density));
        }
        sum
    }

    /// Light that a BSDF-sampled ray hits: lights before the next surface, its emission, else the sky. `density` is the ray's pdf.
    fn met(&self, ray: &Ray, next: Option<&Hit>, medium: Option<DVec3>, density: f64, counted: Counted) -> DVec3 {
        let (origin, direction) = (ray.origin, ray.direction);
        let end = next.map_or(f64::INFINITY, |hit| hit.t);
        let mut sum = DVec3::ZERO;
        if counted.lights && self.lights.iter().any(has_size) {
            let mut chosen = None;
            for (i, light) in self.lights.iter().enumerate() {
                let Some((distance, radiance, asked)) = meet(light, origin, direction) else { continue };
                let reached = distance < end || (distance == f64::INFINITY && next.is_none());
                if reached && distance > ray.from {
                    let chance = chosen.get_or_insert_with(|| chances(&self.lights, origin))[i];
                    let absorbed = medium.map_or(DVec3::ONE, |a| left(a, distance));
                    sum += radiance * absorbed * part(density, asked * chance);
                }
            }
        }
        match next {
            Some(hit) if counted.lights => {
                let surface = self.materials.surface(&self.geometry, hit, origin, direction);
                if surface.emission != DVec3::ZERO {
                    let inside = surface.volume.and_then(|(absorption, inside)| inside.then_some(absorption));
                    let absorbed = medium.or(inside).map_or(DVec3::ONE, |a| left(a, hit.t));
                    let by_area = self.emitters.density(&self.geometry, hit.primitive, origin, surface.position);
                    let asked = by_area * hit.t * hit.t / hit.outward.dot(direction).abs();
                    sum += surface.emission * absorbed * part(density, asked);
                }
            }
            None if counted.sky => {
                if let Some(sky) = &self.sky {
                    let absorbed = medium.map_or(DVec3::ONE, |a| left(a, f64::INFINITY));
                    sum += sky.radiance(direction) * absorbed * part(density, sky.density(direction));
                }
            }
            _ => {}
        }
        sum
    }

    /// Visibility of the first three shadow-casting lights; a single one is in all channels.
    fn lights_seen(&self, surface: &Surface, random: &mut Random) -> DVec3 {
        let mut seen = DVec3::ZERO;
        let shadow_lights = lights::shadow_lights(&self.lights);
        for (channel, light) in shadow_lights.iter().take(3).enumerate() {
            seen[channel] = self.light_seen(light, surface, random);
        }
        if shadow_lights.len() == 1 { DVec3::splat(seen.x) } else { seen }
    }

    /// Visibility of a light by one sample, uniform over its area or over the cone that it subtends.
    fn light_seen(&self, light: &Light, surface: &Surface, random: &mut Random) -> f64 {
        let Some(l) = draw(light, surface.position, random) else { return 0.0 };
        let s = surface.scatterer;
        if s.normal.dot(l.direction) <= 0.0 || s.plane.dot(l.direction) <= 0.0 {
            return 0.0;
        }
        self.transmittance(surface.position, l.direction, l.distance)
    }

    /// Openness by one sample: cosine-weighted, occluders within the range.
    fn openness(&self, surface: &Surface, range: f64, random: &mut Random) -> f64 {
        let s = surface.scatterer;
        let x = random.unit();
        let direction = frame(s.normal) * from_polar((1.0 - x).sqrt(), TAU * random.unit());
        if s.plane.dot(direction) <= 0.0 {
            return 0.0;
        }
        self.transmittance(surface.position, direction, range)
    }
}

/// Absorption, per metre, if a direction leads into the volume behind a surface.
fn inside(surface: &Surface, direction: DVec3) -> Option<DVec3> {
    let (absorption, _) = surface.volume?;
    (surface.outward.dot(direction) < 0.0).then_some(absorption)
}
