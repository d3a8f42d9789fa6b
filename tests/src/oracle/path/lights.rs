//! Lights and emissive surfaces: sampling, and pdf of hits.
use super::geometry::{Geometry, Shape};
use super::random::{Random, frame, from_polar};
use super::surface::Materials;
use crate::oracle::shading::incident;
use glam::{DVec2, DVec3, Vec3};
use magpie::scene::Light;
use std::f64::consts::{PI, TAU};

/// Share of the samples that is distributed evenly over all lights.
const EQUAL_SHARE: f64 = 0.1;

/// Luminance of linear Rec.709.
pub fn luminance(c: DVec3) -> f64 {
    c.dot(DVec3::new(0.2126, 0.7152, 0.0722))
}

/// Light from one direction.
#[derive(Clone, Copy, Debug)]
pub struct Arriving {
    /// Unit, towards the light.
    pub direction: DVec3,
    /// Metres; infinite for directional lights.
    pub distance: f64,
    /// Radiance, or irradiance at normal incidence without a density.
    pub light: DVec3,
    /// Pdf of the sample, per steradian; `None` for lights without a size, which no ray hits.
    pub density: Option<f64>,
}

/// Solid angle of a cone over 2 pi, 1 - cos, without cancellation.
fn cap(sine2: f64) -> f64 {
    sine2 / (1.0 + (1.0 - sine2).max(0.0).sqrt())
}

/// Samples a point of a light, ignoring occlusion. None if it sends no light from there.
pub fn draw(light: &Light, from: DVec3, random: &mut Random) -> Option<Arriving> {
    let (x, y) = (random.unit(), random.unit());
    let on_plane = |point: DVec3, normal: DVec3, area: f64, light: DVec3| {
        let to = point - from;
        let (distance, direction) = (to.length(), to.normalize());
        let cosine = -normal.dot(direction);
        let density = Some(distance * distance / (cosine * area));
        (cosine > 0.0).then_some(Arriving { direction, distance, light, density })
    };
    match light {
        Light::Rectangle { centre, half_u, half_v, radiance } => {
            let (u, v) = (half_u.as_dvec3(), half_v.as_dvec3());
            let across = u.cross(v);
            let point = centre + u * (2.0 * x - 1.0) + v * (2.0 * y - 1.0);
            on_plane(point, across.normalize(), 4.0 * across.length(), radiance.as_dvec3())
        }
        Light::Disc { centre, normal, radius, radiance } => {
            let (normal, radius) = (normal.as_dvec3().normalize(), f64::from(*radius));
            let (s, c) = (TAU * y).sin_cos();
            let point = centre + frame(normal) * DVec3::new(c, s, 0.0) * (radius * x.sqrt());
            on_plane(point, normal, PI * radius * radius, radiance.as_dvec3())
        }
        Light::Sphere { .. } | Light::Directional { .. } if has_size(light) => {
            // Uniform in the cone that it subtends.
            let (axis, sine2) = cone(light, from)?;
            let cap = cap(sine2);
            let direction = (frame(axis) * from_polar(1.0 - x * cap, TAU * y)).normalize();
            let met = meet(light, from, direction)?;
            Some(Arriving { direction, distance: met.0, light: met.1, density: Some(1.0 / (TAU * cap)) })
        }
        _ => {
            let i = incident(light, from);
            let (direction, distance, light) = (i.direction, i.distance, i.irradiance);
            (light != DVec3::ZERO).then_some(Arriving { direction, distance, light, density: None })
        }
    }
}

/// Whether rays can hit it.
pub fn has_size(light: &Light) -> bool {
    match light {
        Light::Point { .. } | Light::Spot { .. } => false,
        Light::Directional { angular_radius, .. } => *angular_radius > 0.0,
        _ => true,
    }
}

/// The cone that a sphere or the disc of a directional light subtends: axis and squared sine of the half angle. None inside the sphere.
fn cone(light: &Light, from: DVec3) -> Option<(DVec3, f64)> {
    match light {
        Light::Sphere { centre, radius, .. } => {
            let to = centre - from;
            let sine2 = f64::from(*radius).powi(2) / to.length_squared();
            (sine2 < 1.0).then(|| (to.normalize(), sine2))
        }
        Light::Directional { direction, angular_radius, .. } => {
            Some((-direction.as_dvec3().normalize(), f64::from(*angular_radius).sin().powi(2)))
        }
        _ => None,
    }
}

/// Distance, radiance and pdf of [`draw`] for the hit of a unit direction on a light that has a size.
pub fn meet(light: &Light, from: DVec3, direction: DVec3) -> Option<(f64, DVec3, f64)> {
    let on_plane = |centre: DVec3, normal: DVec3| {
        let cosine = -normal.dot(direction);
        let distance = normal.dot(from - centre) / cosine;
        (cosine > 0.0 && distance > 0.0).then(|| (distance, cosine, from + direction * distance - centre))
    };
    match light {
        Light::Rectangle { centre, half_u, half_v, radiance } => {
            let (u, v) = (half_u.as_dvec3(), half_v.as_dvec3());
            let across = u.cross(v);
            let (distance, cosine, at) = on_plane(*centre, across.normalize())?;
            // Coordinates along edges that need not be orthogonal.
            let (s, t) = (at.cross(v).dot(across), u.cross(at).dot(across));
            let inside = s.abs().max(t.abs()) <= across.length_squared();
            inside.then(|| (distance, radiance.as_dvec3(), distance * distance / (cosine * 4.0 * across.length())))
        }
        Light::Disc { centre, normal, radius, radiance } => {
            let (distance, cosine, at) = on_plane(*centre, normal.as_dvec3().normalize())?;
            let radius2 = f64::from(*radius).powi(2);
            let density = distance * distance / (cosine * PI * radius2);
            (at.length_squared() <= radius2).then(|| (distance, radiance.as_dvec3(), density))
        }
        Light::Sphere { centre, radius, radiance } => {
            let (_, sine2) = cone(light, from)?;
            let to = centre - from;
            let along = to.dot(direction);
            let beside2 = (to - direction * along).length_squared();
            let half2 = f64::from(*radius).powi(2) - beside2;
            // Samples at the silhouette may miss by rounding: those within a small tolerance count as hits.
            let met = along > 0.0 && half2 >= -1e-9 * f64::from(*radius).powi(2);
            met.then(|| (along - half2.max(0.0).sqrt(), radiance.as_dvec3(), 1.0 / (TAU * cap(sine2))))
        }
        Light::Directional { illuminance, angular_radius, .. } if *angular_radius > 0.0 => {
            let (axis, sine2) = cone(light, from)?;
            let off = axis.cross(direction).length_squared();
            let solid = TAU * cap(sine2);
            let inside = axis.dot(direction) > 0.0 && off <= sine2 * (1.0 + 1e-9);
            inside.then(|| (f64::INFINITY, illuminance.as_dvec3() / solid, 1.0 / solid))
        }
        _ => None,
    }
}

/// Estimated contribution of a light at a point, for light selection.
fn strength(light: &Light, from: DVec3) -> f64 {
    let of_area = |centre: &DVec3, area: f64, radiance: &Vec3| {
        luminance(radiance.as_dvec3()) * area / centre.distance_squared(from).max(area / PI)
    };
    match light {
        Light::Rectangle { centre, half_u, half_v, radiance } => {
            of_area(centre, 4.0 * f64::from(half_u.cross(*half_v).length()), radiance)
        }
        Light::Disc { centre, radius, radiance, .. } => of_area(centre, PI * f64::from(*radius).powi(2), radiance),
        _ => luminance(incident(light, from).irradiance),
    }
}

/// Selection probability of each light at a point.
pub fn chances(lights: &[Light], from: DVec3) -> Vec<f64> {
    let strengths: Vec<f64> = lights.iter().map(|l| strength(l, from)).collect();
    let (sum, equal) = (strengths.iter().sum::<f64>(), 1.0 / lights.len() as f64);
    let chance = |s: f64| if sum > 0.0 { EQUAL_SHARE * equal + (1.0 - EQUAL_SHARE) * s / sum } else { equal };
    strengths.into_iter().map(chance).collect()
}

/// Samples an index by its probability; `chances` sum to 1.
pub fn choose(chances: &[f64], random: &mut Random) -> usize {
    let mut rest = random.unit();
    let found = chances.iter().position(|c| {
        rest -= c;
        rest < 0.0
    });
    found.unwrap_or(chances.len() - 1)
}

/// The shadow-casting lights in the order of the frame: directional ones first, then by strength.
pub fn shadow_lights(lights: &[Light]) -> Vec<&Light> {
    let power = |l: &Light| match l {
        Light::Directional { illuminance, .. } => {
            if *illuminance == Vec3::ZERO {
                0.0
            } else {
                f64::INFINITY
            }
        }
        Light::Point { intensity, .. } | Light::Spot { intensity, .. } => luminance(intensity.as_dvec3()),
        Light::Rectangle { half_u, half_v, radiance, .. } => {
            luminance(radiance.as_dvec3()) * 4.0 * half_u.as_dvec3().cross(half_v.as_dvec3()).length()
        }
        Light::Disc { radius, radiance, .. } | Light::Sphere { radius, radiance, .. } => {
            luminance(radiance.as_dvec3()) * PI * f64::from(*radius).powi(2)
        }
    };
    let mut shadow_lights: Vec<&Light> = lights.iter().filter(|l| power(l) > 0.0).collect();
    shadow_lights.sort_by(|a, b| power(b).total_cmp(&power(a)));
    shadow_lights
}

/// Emissive primitives, selected by area and emission of their materials.
pub struct Emitters {
    /// Indices of the primitives.
    shapes: Vec<u32>,
    /// Cumulative probabilities.
    sums: Vec<f64>,
    /// Probability of each primitive of the scene; 0 for those that do not emit.
    chance: Vec<f64>,
}

impl Emitters {
    /// The emissive primitives of a scene.
    pub fn new(geometry: &Geometry, materials: &Materials) -> Self {
        let power: Vec<f64> = (0..geometry.primitives.len() as u32)
            .map(|p| luminance(materials.greatest_emission(geometry.instance_of(p).material)) * area(geometry, p))
            .collect();
        let total: f64 = power.iter().sum();
        let chance: Vec<f64> = power.iter().map(|p| if total > 0.0 { p / total } else { 0.0 }).collect();
        let shapes: Vec<u32> = (0..).zip(&chance).filter(|(_, c)| **c > 0.0).map(|(i, _)| i).collect();
        let mut sum = 0.0;
        let sums = shapes.iter().map(|s| {
            sum += chance[*s as usize];
            sum
        });
        Self { sums: sums.collect(), shapes, chance }
    }

    /// Samples a point of an emissive surface: primitive, barycentric weights, position and pdf per area.
    pub fn draw(&self, geometry: &Geometry, from: DVec3, random: &mut Random) -> Option<(u32, DVec2, DVec3, f64)> {
        let x = random.unit() * self.sums.last()?;
        let primitive = self.shapes[self.sums.partition_point(|s| *s <= x).min(self.shapes.len() - 1)];
        let here = geometry.primitives[primitive as usize];
        match here.shape {
            Shape::Triangle(corners) => {
                // Uniform over a triangle: Osada et al. 2002, "Shape Distributions", section 4.2.
                let (root, y) = (random.unit().sqrt(), random.unit());
                let barycentric = DVec2::new(root * (1.0 - y), root * y);
                let [a, b, c] = geometry.vertices(here.instance, corners).map(|v| v.position);
                let point = a + (b - a) * barycentric.x + (c - a) * barycentric.y;
                Some((primitive, barycentric, point, self.density(geometry, primitive, from, point)))
            }
            Shape::Sphere(centre, radius) => {
                let placed = geometry.instance_of(primitive);
                let (axis, share) = seen(placed.inverse.transform_point3(from) - centre, radius);
                let cosine = 1.0 - 2.0 * share * random.unit();
                let on_sphere = frame(axis) * from_polar(cosine, TAU * random.unit());
                let point = placed.world.transform_point3(centre + radius * on_sphere);
                Some((primitive, DVec2::ZERO, point, self.density(geometry, primitive, from, point)))
            }
        }
    }

    /// Pdf per area of sampling a point of a primitive from `from`.
    pub fn density(&self, geometry: &Geometry, primitive: u32, from: DVec3, point: DVec3) -> f64 {
        let chance = self.chance[primitive as usize];
        match geometry.primitives[primitive as usize].shape {
            Shape::Triangle(_) => chance / area(geometry, primitive),
            Shape::Sphere(centre, radius) => {
                // Uniform over the visible part, in object space; the area of a stretched sphere scales with the length of the cofactor
                // normal.
                let placed = geometry.instance_of(primitive);
                let (_, share) = seen(placed.inverse.transform_point3(from) - centre, radius);
                let normal = (placed.inverse.transform_point3(point) - centre).normalize();
                let grown = placed.world.matrix3.determinant() * (placed.inverse.matrix3.transpose() * normal).length();
                chance / (4.0 * PI * radius * radius * share * grown.abs())
            }
        }
    }
}

/// The part of a sphere's surface that is visible from a point, relative to its centre: axis, and share of the whole. All of it from
/// inside, and from points on the surface, even if rounding has moved them slightly outside.
fn seen(from: DVec3, radius: f64) -> (DVec3, f64) {
    let distance = from.length();
    if distance > radius * (1.0 + 1e-6) { (from / distance, 0.5 - 0.5 * radius / distance) } else { (DVec3::Z, 1.0) }
}

/// Area in world space; approximate for stretched spheres.
fn area(geometry: &Geometry, primitive: u32) -> f64 {
    let here = geometry.primitives[primitive as usize];
    match here.shape {
        Shape::Triangle(corners) => {
            let [a, b, c] = geometry.vertices(here.instance, corners).map(|v| v.position);
            0.5 * (b - a).cross(c - a).length()
        }
        Shape::Sphere(_, radius) => {
            let scale = geometry.instance_of(primitive).world.matrix3.determinant().abs().cbrt();
            4.0 * PI * (radius * scale).powi(2)
        }
    }
}
