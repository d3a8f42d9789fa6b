//! Surface attributes at hits: textures, normals, alpha, emission.
use super::bsdf::{Layers, Scatterer};
use super::geometry::{Geometry, Hit, Shape, normal_of};
use crate::oracle::shading::alpha as alpha_of_roughness;
use glam::{DVec2, DVec3, DVec4};
use magpie::scene::{AlphaMode, ColourSpace, Material, Sampler, Scene, Texture, TextureUse, Wrap};

/// Least cosine between the shading normal and the direction to the viewer.
const MIN_COSINE: f64 = 0.01;

/// Materials and textures of a scene.
pub struct Materials {
    materials: Vec<Material>,
    textures: Vec<Texture>,
    samplers: Vec<Sampler>,
}

/// A surface point.
#[derive(Clone, Copy, Debug)]
pub struct Surface {
    /// World, metres.
    pub position: DVec3,
    /// Its normals and material.
    pub scatterer: Scatterer,
    /// Whether it scatters light at all.
    pub scatters: bool,
    /// Geometric normal, unit, outwards on either side.
    pub outward: DVec3,
    /// Radiance emitted towards the viewer, for scattered paths.
    pub emission: DVec3,
    /// The same for camera rays.
    pub shown: DVec3,
    /// Absorption, per metre, of the volume behind the surface, and whether the surface was hit from inside.
    pub volume: Option<(DVec3, bool)>,
}

/// Interpolated attributes of a triangle, and their equivalent on a sphere.
struct Interpolated {
    normal: DVec3,
    tangent: DVec4,
    uv: [DVec2; 2],
    colour: DVec4,
}

fn interpolate(geometry: &Geometry, primitive: u32, barycentric: DVec2, outward: DVec3) -> Interpolated {
    let here = geometry.primitives[primitive as usize];
    match here.shape {
        Shape::Triangle(corners) => {
            let [a, b, c] = geometry.vertices(here.instance, corners);
            let [x, y, z] = [1.0 - barycentric.element_sum(), barycentric.x, barycentric.y];
            let uv = |i: usize| a.uv[i] * x + b.uv[i] * y + c.uv[i] * z;
            Interpolated {
                normal: a.normal * x + b.normal * y + c.normal * z,
                tangent: (a.tangent * x + b.tangent * y + c.tangent * z),
                uv: [uv(0), uv(1)],
                colour: a.colour * x + b.colour * y + c.colour * z,
            }
        }
        Shape::Sphere(..) => {
            Interpolated { normal: outward, tangent: DVec4::ZERO, uv: [DVec2::ZERO; 2], colour: DVec4::ONE }
        }
    }
}

impl Materials {
    /// The materials of a scene.
    pub fn new(scene: &Scene) -> Self {
        let (materials, textures, samplers) = (&scene.materials, &scene.textures, &scene.samplers);
        for m in materials.iter().filter(|m| m.transmission > 0.0 && m.thickness > 0.0) {
            assert!(m.ior > 1.001, "{}: a volume of index {} has no microfacets that refract", m.name, m.ior);
        }
        Self { materials: materials.clone(), textures: textures.clone(), samplers: samplers.clone() }
    }

    /// The material of a hit.
    pub fn of(&self, geometry: &Geometry, hit: &Hit) -> &Material {
        &self.materials[geometry.instance_of(hit.primitive).material as usize]
    }

    /// Greatest emission of a material, with textures and vertex colours taken as white: 0 if it illuminates nothing.
    pub fn greatest_emission(&self, material: u32) -> DVec3 {
        let m = &self.materials[material as usize];
        match (m.shows_light, m.unlit) {
            (true, _) => DVec3::ZERO,
            (false, true) => m.base_colour.truncate().as_dvec3(),
            (false, false) => m.emission.as_dvec3(),
        }
    }

    fn read(&self, used: &Option<TextureUse>, uv: &[DVec2; 2]) -> DVec4 {
        let Some(used) = used else { return DVec4::ONE };
        let sampler = self.samplers.get(used.sampler as usize).copied().unwrap_or_default();
        texel_at(&self.textures[used.texture as usize], &sampler, used, uv)
    }

    /// Coverage of a hit, 0 to 1; 0 or 1 for alpha tests.
    pub fn coverage(&self, geometry: &Geometry, hit: &Hit) -> f64 {
        let m = self.of(geometry, hit);
        let here = geometry.primitives[hit.primitive as usize];
        if matches!(here.shape, Shape::Sphere(..)) {
            // Spheres are never alpha-tested, but may be blended.
            return if m.alpha == AlphaMode::Blend { f64::from(m.base_colour.w).clamp(0.0, 1.0) } else { 1.0 };
        }
        if m.alpha == AlphaMode::Opaque {
            return 1.0;
        }
        let at = interpolate(geometry, hit.primitive, hit.barycentric, hit.outward);
        let alpha = f64::from(m.base_colour.w) * at.colour.w * self.read(&m.base_colour_texture, &at.uv).w;
        match m.alpha {
            AlphaMode::Mask(cutoff) => f64::from(u8::from(alpha >= f64::from(cutoff))),
            _ => alpha.clamp(0.0, 1.0),
        }
    }

    /// The surface at a hit of a ray with unit direction.
    pub fn surface(&self, geometry: &Geometry, hit: &Hit, origin: DVec3, direction: DVec3) -> Surface {
        let m = self.of(geometry, hit);
        let at = interpolate(geometry, hit.primitive, hit.barycentric, hit.outward);
        let side = if hit.front { 1.0 } else { -1.0 };
        let to_viewer = -direction;
        let base = (m.base_colour.as_dvec4() * at.colour * self.read(&m.base_colour_texture, &at.uv)).truncate();
        let metal_rough = self.read(&m.metallic_roughness_texture, &at.uv);

        let mut normal = at.normal.try_normalize().unwrap_or(hit.outward);
        if m.normal_texture.is_some() {
            let texel = self.read(&m.normal_texture, &at.uv).truncate() * 2.0 - 1.0;
            let (x, y) = (texel.x * f64::from(m.normal_scale), texel.y * f64::from(m.normal_scale));
            let tangent = at.tangent.truncate();
            // The interpolated frame is not normalised (Mikkelsen 2008).
            let bitangent = at.tangent.w * at.normal.cross(tangent);
            let mapped = tangent * x + bitangent * y + at.normal * texel.z;
            normal = mapped.try_normalize().unwrap_or(normal);
        }
        normal *= side;
        let cosine = normal.dot(to_viewer);
        if cosine < MIN_COSINE {
            normal = (normal + to_viewer * (MIN_COSINE.max(-cosine) - cosine)).normalize();
        }

        let shown = self.emission(m, &at, hit.front, base);
        let emission = if m.shows_light { DVec3::ZERO } else { shown };
        let volume = (m.transmission > 0.0 && m.thickness > 0.0).then(|| (m.absorption().as_dvec3(), !hit.front));
        let coat_roughness = f64::from(m.clearcoat_roughness) * self.read(&m.clearcoat_roughness_texture, &at.uv).y;
        let layers = Layers {
            base,
            metalness: f64::from(m.metalness) * metal_rough.z,
            alpha: alpha_of_roughness(f64::from(m.roughness) * metal_rough.y),
            transmission: f64::from(m.transmission) * self.read(&m.transmission_texture, &at.uv).x,
            ior: m.ior.into(),
            specular: f64::from(m.specular) * self.read(&m.specular_texture, &at.uv).w,
            specular_colour: m.specular_colour.as_dvec3() * self.read(&m.specular_colour_texture, &at.uv).truncate(),
            volume: volume.is_some(),
            inside: volume.is_some() && !hit.front,
            coat: f64::from(m.clearcoat) * self.read(&m.clearcoat_texture, &at.uv).x,
            coat_alpha: alpha_of_roughness(coat_roughness),
            scatters_again: true,
        };
        let scatterer = Scatterer { normal, plane: hit.outward * side, to_viewer, layers };
        Surface {
            position: origin + direction * hit.t,
            scatterer,
            scatters: !m.unlit,
            outward: hit.outward,
            emission,
            shown,
            volume,
        }
    }

    fn emission(&self, m: &Material, at: &Interpolated, front: bool, base: DVec3) -> DVec3 {
        match (front || m.double_sided, m.unlit) {
            (false, _) => DVec3::ZERO,
            (true, true) => base,
            (true, false) => m.emission.as_dvec3() * self.read(&m.emission_texture, &at.uv).truncate(),
        }
    }

    /// Emission of a point of a primitive, times coverage, for a ray in `direction`, and its outward normal.
    pub fn emitted(&self, geometry: &Geometry, primitive: u32, at: (DVec2, DVec3), direction: DVec3) -> (DVec3, DVec3) {
        let (barycentric, position) = at;
        let here = geometry.primitives[primitive as usize];
        let placed = geometry.instance_of(primitive);
        let outward = match here.shape {
            Shape::Triangle(corners) => {
                let [a, b, c] = geometry.vertices(here.instance, corners).map(|v| v.position);
                (b - a).cross(c - a).normalize() * placed.world.matrix3.determinant().signum()
            }
            Shape::Sphere(centre, _) => normal_of(&placed.inverse, placed.inverse.transform_point3(position) - centre),
        };
        let front = outward.dot(direction) < 0.0;
        let hit = Hit { primitive, t: 0.0, barycentric, outward, front };
        let surface = self.surface(geometry, &hit, position, direction);
        (surface.emission * self.coverage(geometry, &hit), outward)
    }
}

/// The finest mip, bilinear or nearest by the sampler's magnification filter.
fn texel_at(texture: &Texture, sampler: &Sampler, used: &TextureUse, uv: &[DVec2; 2]) -> DVec4 {
    let at = uv[used.uv_set as usize].extend(1.0);
    let [u, v] = used.rows.map(|row| row.as_dvec3().dot(at));
    let size = texture.size.map(i64::from);
    let fetch = |x: i64, y: i64| {
        let [x, y] = [(x, size[0], sampler.wrap[0]), (y, size[1], sampler.wrap[1])].map(|(i, n, wrap)| match wrap {
            Wrap::Repeat => i.rem_euclid(n),
            Wrap::Clamp => i.clamp(0, n - 1),
            Wrap::Mirror => {
                let i = i.rem_euclid(2 * n);
                i.min(2 * n - 1 - i)
            }
        });
        let first = 4 * (y * size[0] + x) as usize;
        let c = DVec4::from_array([0, 1, 2, 3].map(|c| f64::from(texture.mips[0][first + c]) / 255.0));
        match texture.colour_space {
            ColourSpace::Linear => c,
            ColourSpace::Srgb => c.truncate().map(from_srgb).extend(c.w),
        }
    };
    let (x, y) = (u * size[0] as f64, v * size[1] as f64);
    if !sampler.linear_magnify {
        return fetch(x.floor() as i64, y.floor() as i64);
    }
    let (x, y) = (x - 0.5, y - 0.5);
    let (column, row) = (x.floor() as i64, y.floor() as i64);
    let across = |row: i64| fetch(column, row).lerp(fetch(column + 1, row), x - x.floor());
    across(row).lerp(across(row + 1), y - y.floor())
}

/// sRGB decoding (IEC 61966-2-1).
fn from_srgb(s: f64) -> f64 {
    if s <= 0.04045 { s / 12.92 } else { ((s + 0.055) / 1.055).powf(2.4) }
}

#[cfg(test)]
mod tests {
    use super::*;
    use glam::Vec3;

    #[test]
    fn texels_are_read_between_their_centres() {
        let rgba: Vec<u8> = [0, 51, 102, 255].iter().flat_map(|v| [*v, 0, 0, 255]).collect();
        let texture = Texture::new("t".into(), [4, 1], ColourSpace::Linear, rgba);
        let read = |u: f64, wrap: Wrap, rows: [Vec3; 2], linear: bool| {
            let sampler = Sampler { wrap: [wrap; 2], linear_magnify: linear, ..Sampler::default() };
            let used = TextureUse { texture: 0, sampler: 0, uv_set: 1, rows };
            texel_at(&texture, &sampler, &used, &[DVec2::ZERO, DVec2::new(u, 0.3)]).x * 5.0
        };
        let plain = [Vec3::X, Vec3::Y];
        let near = |a: f64, b: f64| assert!((a - b).abs() < 1e-9, "{a} {b}");
        near(read(0.375, Wrap::Clamp, plain, true), 1.0);
        near(read(0.5, Wrap::Clamp, plain, true), 1.5);
        near(read(-3.0, Wrap::Clamp, plain, true), 0.0);
        near(read(0.0, Wrap::Repeat, plain, true), 2.5);
        near(read(1.375, Wrap::Repeat, plain, true), 1.0);
        near(read(1.375, Wrap::Mirror, plain, true), 2.0);
        near(read(-0.375, Wrap::Mirror, plain, true), 1.0);
        near(read(0.49, Wrap::Repeat, plain, false), 1.0);
        near(read(0.25, Wrap::Repeat, [Vec3::new(0.5, 0.0, 0.25), Vec3::Y], true), 1.0);
        near(from_srgb(1.0), 1.0);
        near(from_srgb(0.5), 0.214_041_140);
    }
}
