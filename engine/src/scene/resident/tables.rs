//! The scene's tables in the layout of the shaders.
use super::block::Block;
use crate::gpu::{Cull, Gpu, GpuError, Image};
use crate::graph::{Draw, DrawClass, DrawLists};
use crate::scene::facts::lets_light_through;
use crate::scene::{AlphaMode, Instance, Light, Material, Mesh, Scene, TextureUse};
use glam::{Affine3A, DVec3, Vec3};
use magpie_shaders::scene as shared;
use magpie_shaders::view::MAX_SHADOW_LIGHTS;
use magpie_shaders::{SampledImage, SamplerId};
use std::f32::consts::PI;
use std::sync::Arc;

pub(super) fn attributes(mesh: &Mesh) -> Vec<shared::VertexAttributes> {
    (0..mesh.positions.len())
        .map(|i| shared::VertexAttributes {
            normal: mesh.normals[i].to_array(),
            tangent: mesh.tangents[i].to_array(),
            uv0: mesh.uv0[i].to_array(),
            uv1: mesh.uv1[i].to_array(),
            colour: mesh.colours[i].to_array(),
        })
        .collect()
}

pub(super) fn rows(m: &Affine3A) -> [[f32; 4]; 3] {
    let (a, t) = (m.matrix3, m.translation);
    [0, 1, 2].map(|r| [a.x_axis[r], a.y_axis[r], a.z_axis[r], t[r]])
}

/// The constant fields of an instance.
pub(super) fn instance(scene: &Scene, instance: &Instance, mesh: usize) -> shared::Instance {
    let material = &scene.materials[instance.material as usize];
    let is_spheres = !scene.meshes[instance.mesh as usize].spheres.is_empty();
    let mut flags = 0;
    for (set, bit) in [
        (material.alpha != AlphaMode::Opaque && !is_spheres, shared::INSTANCE_ALPHA_TEST),
        (material.double_sided, shared::INSTANCE_DOUBLE_SIDED),
        (is_spheres, shared::INSTANCE_SPHERES),
    ] {
        flags |= if set { bit } else { 0 };
    }
    let mask =
        if lets_light_through(scene, instance) { shared::INSTANCE_MASK_CLEAR } else { shared::INSTANCE_MASK_SOLID };
    shared::Instance { mesh: mesh as u32, material: instance.material, mask, flags, ..Default::default() }
}

/// The triangles of a box; bits 0, 1 and 2 of a corner select the far side in x, y and z. They are counter-clockwise as seen from
/// inside, so that back-face culling keeps the far faces of the box.
const BOX: [u32; 36] = [
    0, 2, 6, 0, 6, 4, // -x
    1, 5, 7, 1, 7, 3, // +x
    0, 4, 5, 0, 5, 1, // -y
    2, 3, 7, 2, 7, 6, // +y
    0, 1, 3, 0, 3, 2, // -z
    4, 6, 7, 4, 7, 5, // +z
];

/// Number of indices for rasterisation.
pub(super) fn raster_index_count(mesh: &Mesh) -> usize {
    mesh.indices.len() + mesh.spheres.len() * BOX.len()
}

/// Indices for rasterisation: the triangles, or a box with eight corners around each sphere.
pub(super) fn raster_indices(mesh: &Mesh) -> Vec<u32> {
    let boxes = (0..mesh.spheres.len() as u32).flat_map(|sphere| BOX.map(|corner| 8 * sphere + corner));
    mesh.indices.iter().copied().chain(boxes).collect()
}

/// Adds a mesh's positions, attributes and boxes, and returns their offsets. Only spheres have boxes; the offset is 0 otherwise.
pub(super) fn add_vertices(block: &mut Block, mesh: &Mesh) -> [u64; 3] {
    if mesh.spheres.is_empty() {
        return [block.add(&mesh.positions), block.add(&attributes(mesh)), 0];
    }
    let spheres: Vec<[f32; 4]> = mesh.spheres.iter().map(|s| s.centre.extend(s.radius).to_array()).collect();
    let boxes: Vec<[[f32; 3]; 2]> = mesh
        .spheres
        .iter()
        .map(|s| {
            [(s.centre - s.radius).map(f32::next_down), (s.centre + s.radius).map(f32::next_up)].map(|c| c.to_array())
        })
        .collect();
    let spheres = block.add(&spheres);
    // An offset of 0 means that there are none.
    [spheres, spheres, block.add(&boxes)]
}

/// The tables of materials and of the layers that some of them have.
pub(super) fn materials(
    gpu: &Gpu,
    scene: &Scene,
    textures: &[Arc<Image>],
    blend_cutoff: f32,
) -> Result<(Vec<shared::Material>, Vec<shared::MaterialLayers>), GpuError> {
    let slot = |used: Option<TextureUse>| -> Result<shared::TextureSlot, GpuError> {
        let Some(used) = used else {
            return Ok(shared::TextureSlot { image: SampledImage::NONE, ..Default::default() });
        };
        let image = textures.get(used.texture as usize).and_then(|t| t.sampled());
        let sampler = scene.samplers.get(used.sampler as usize).copied().unwrap_or_default();
        let sampler_id: SamplerId = gpu.sampler(sampler)?;
        Ok(shared::TextureSlot {
            image: image.unwrap_or(SampledImage::NONE),
            sampler_id,
            uv_set: used.uv_set,
            row_u: used.rows[0].to_array(),
            row_v: used.rows[1].to_array(),
        })
    };
    let mut layers = Vec::new();
    let mut one = |m: &Material| -> Result<shared::Material, GpuError> {
        let layered = if m.is_layered() {
            layers.push(shared::MaterialLayers {
                transmission: m.transmission,
                ior: m.ior,
                specular: m.specular,
                specular_colour: m.specular_colour.to_array(),
                thickness: m.thickness,
                absorption: m.absorption().to_array(),
                clearcoat: m.clearcoat,
                clearcoat_roughness: m.clearcoat_roughness,
                specular_texture: slot(m.specular_texture)?,
                specular_colour_texture: slot(m.specular_colour_texture)?,
                transmission_texture: slot(m.transmission_texture)?,
                clearcoat_texture: slot(m.clearcoat_texture)?,
                clearcoat_roughness_texture: slot(m.clearcoat_roughness_texture)?,
            });
            layers.len() as u32 - 1
        } else {
            shared::NO_LAYERS
        };
        let mut flags = 0;
        let (tested, alpha_cutoff) = match m.alpha {
            AlphaMode::Opaque => (false, 0.0),
            AlphaMode::Mask(cutoff) => (true, cutoff),
            AlphaMode::Blend => (true, blend_cutoff),
        };
        for (set, bit) in [
            (tested, shared::MATERIAL_ALPHA_TEST),
            (m.double_sided, shared::MATERIAL_DOUBLE_SIDED),
            (m.unlit, shared::MATERIAL_UNLIT),
            (m.alpha == AlphaMode::Blend, shared::MATERIAL_BLEND),
            (m.shows_light, shared::MATERIAL_SHOWS_LIGHT),
        ] {
            flags |= if set { bit } else { 0 };
        }
        Ok(shared::Material {
            base_colour: m.base_colour.to_array(),
            emission: m.emission.to_array(),
            metalness: m.metalness,
            roughness: m.roughness,
            normal_scale: m.normal_scale,
            occlusion_strength: m.occlusion_strength,
            alpha_cutoff,
            flags,
            layers: layered,
            base_colour_texture: slot(m.base_colour_texture)?,
            metallic_roughness_texture: slot(m.metallic_roughness_texture)?,
            normal_texture: slot(m.normal_texture)?,
            occlusion_texture: slot(m.occlusion_texture)?,
            emission_texture: slot(m.emission_texture)?,
        })
    };
    let materials = scene.materials.iter().map(&mut one).collect::<Result<_, _>>()?;
    Ok((materials, layers))
}

/// A light in the format of shaders, with its position relative to `origin`.
pub(super) fn light(light: &Light, origin: DVec3) -> shared::Light {
    let place = |p: &DVec3| (*p - origin).as_vec3().to_array();
    match light {
        Light::Directional { direction, illuminance, angular_radius } => shared::Light {
            kind: shared::LIGHT_DIRECTIONAL,
            direction: direction.to_array(),
            intensity: illuminance.to_array(),
            radius: *angular_radius,
            ..Default::default()
        },
        Light::Point { position, intensity, range } => shared::Light {
            kind: shared::LIGHT_POINT,
            position: place(position),
            intensity: intensity.to_array(),
            range: range.unwrap_or(0.0),
            ..Default::default()
        },
        Light::Spot { position, direction, intensity, range, inner, outer } => {
            // KHR_lights_punctual: the cone attenuation as one multiply-add; equal angles give a hard edge.
            let cone_scale = 1.0 / (inner.cos() - outer.cos()).max(1e-3);
            shared::Light {
                kind: shared::LIGHT_SPOT,
                position: place(position),
                direction: direction.to_array(),
                intensity: intensity.to_array(),
                range: range.unwrap_or(0.0),
                cone_scale,
                cone_offset: -outer.cos() * cone_scale,
                ..Default::default()
            }
        }
        Light::Rectangle { centre, half_u, half_v, radiance } => shared::Light {
            kind: shared::LIGHT_RECTANGLE,
            position: place(centre),
            direction: half_u.cross(*half_v).normalize_or_zero().to_array(),
            intensity: radiance.to_array(),
            half_u: half_u.to_array(),
            half_v: half_v.to_array(),
            ..Default::default()
        },
        Light::Disc { centre, normal, radius, radiance } => shared::Light {
            kind: shared::LIGHT_DISC,
            position: place(centre),
            direction: normal.to_array(),
            intensity: radiance.to_array(),
            radius: *radius,
            ..Default::default()
        },
        Light::Sphere { centre, radius, radiance } => shared::Light {
            kind: shared::LIGHT_SPHERE,
            position: place(centre),
            intensity: radiance.to_array(),
            radius: *radius,
            ..Default::default()
        },
    }
}

/// Indices of the lights that cast shadows: directional lights first, then local lights by decreasing luminous intensity on the axis.
pub(super) fn shadow_lights(lights: &[Light]) -> Vec<u32> {
    let luminance = |c: Vec3| c.dot(Vec3::new(0.2126, 0.7152, 0.0722));
    let power = |l: &Light| match l {
        Light::Directional { illuminance, .. } if luminance(*illuminance) > 0.0 => f32::INFINITY,
        Light::Directional { .. } => 0.0,
        Light::Point { intensity, .. } | Light::Spot { intensity, .. } => luminance(*intensity),
        Light::Rectangle { half_u, half_v, radiance, .. } => {
            luminance(*radiance) * half_u.cross(*half_v).length() * 4.0
        }
        // Intensity on the axis.
        Light::Disc { radius, radiance, .. } | Light::Sphere { radius, radiance, .. } => {
            luminance(*radiance) * PI * radius * radius
        }
    };
    let mut ranked: Vec<u32> = (0..lights.len() as u32).filter(|i| power(&lights[*i as usize]) > 0.0).collect();
    // The sort is stable, so equal lights stay in the order of the scene.
    ranked.sort_by(|a, b| power(&lights[*b as usize]).total_cmp(&power(&lights[*a as usize])));
    ranked.truncate(MAX_SHADOW_LIGHTS as usize);
    ranked
}

pub(super) fn draws(scene: &Scene, index_offsets: &[u64]) -> DrawLists {
    let draws = scene
        .instances
        .iter()
        .zip(0..)
        .map(|(i, instance)| {
            let (mesh, material) = (&scene.meshes[i.mesh as usize], &scene.materials[i.material as usize]);
            let spheres = !mesh.spheres.is_empty();
            let class = match material.alpha {
                _ if spheres => DrawClass::Procedural,
                AlphaMode::Opaque => DrawClass::Opaque,
                AlphaMode::Mask(_) => DrawClass::AlphaTested,
                AlphaMode::Blend => DrawClass::Blended,
            };
            let mirrored = i.world_from_object.matrix3.determinant() < 0.0;
            // Only one side of the box around a sphere is drawn, even if the sphere is double-sided.
            let cull = match (material.double_sided && !spheres, mirrored) {
                (true, _) => Cull::None,
                (false, false) => Cull::Back,
                (false, true) => Cull::BackMirrored,
            };
            Draw {
                first_index: (index_offsets[i.mesh as usize] / 4) as u32,
                index_count: raster_index_count(mesh) as u32,
                instance,
                cull,
                class,
            }
        })
        .filter(|d| d.index_count > 0)
        .collect();
    DrawLists::new(draws)
}

#[cfg(test)]
mod tests {
    use super::*;

    #[test]
    fn boxes_face_inwards() {
        let corner = |i: u32| Vec3::new((i & 1) as f32, (i >> 1 & 1) as f32, (i >> 2) as f32) - 0.5;
        let mut area = 0.0;
        for triangle in BOX.chunks_exact(3) {
            let [a, b, c] = [triangle[0], triangle[1], triangle[2]].map(corner);
            let normal = (b - a).cross(c - a);
            assert!(normal.dot(a) < 0.0, "{triangle:?}");
            area += 0.5 * normal.length();
        }
        assert_eq!(area, 6.0);
    }
}
