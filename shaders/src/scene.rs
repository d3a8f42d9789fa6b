//! The scene as every shader sees it: tables reached from one root by device address.
use super::types::{Address, SampledImage, SamplerId};
use bytemuck::{Pod, Zeroable};

/// [`Material::flags`]: fragments below the alpha cut-off are discarded.
pub const MATERIAL_ALPHA_TEST: u32 = 1;
/// [`Material::flags`]: back faces are drawn, with the normal turned towards the viewer.
pub const MATERIAL_DOUBLE_SIDED: u32 = 2;
/// [`Material::flags`]: the base colour is emitted and nothing is reflected.
pub const MATERIAL_UNLIT: u32 = 4;
/// [`Material::flags`]: alpha is coverage, the share of light that the surface stops; passes without blending test it against 0.5.
pub const MATERIAL_BLEND: u32 = 8;
/// [`Material::flags`]: the emission only depicts a light source; illumination comes from that light alone.
pub const MATERIAL_SHOWS_LIGHT: u32 = 16;
/// [`Light::kind`]: parallel light; `intensity` is illuminance.
pub const LIGHT_DIRECTIONAL: u32 = 0;
/// [`Light::kind`]: a point; `intensity` is radiant intensity.
pub const LIGHT_POINT: u32 = 1;
/// [`Light::kind`]: a cone; `intensity` is radiant intensity on its axis.
pub const LIGHT_SPOT: u32 = 2;
/// [`Light::kind`]: a one-sided rectangle; `intensity` is radiance.
pub const LIGHT_RECTANGLE: u32 = 3;
/// [`Light::kind`]: a one-sided disc; `intensity` is radiance.
pub const LIGHT_DISC: u32 = 4;
/// [`Light::kind`]: a sphere; `intensity` is radiance.
pub const LIGHT_SPHERE: u32 = 5;
/// [`Material::layers`] of a material that has none.
pub const NO_LAYERS: u32 = 4294967295;
/// [`TextureSlot::image`] of a slot without a texture.
pub const NO_TEXTURE: u32 = 4294967295;
/// [`Instance::mask`]: hit by every ray.
pub const INSTANCE_MASK_ALL: u32 = 255;
/// [`Instance::mask`]: opaque, or alpha-tested.
pub const INSTANCE_MASK_SOLID: u32 = 127;
/// [`Instance::mask`]: may transmit light straight through: blended surfaces, and smooth thin ones that transmit.
pub const INSTANCE_MASK_CLEAR: u32 = 128;
/// [`Instance::flags`]: its material is alpha-tested.
pub const INSTANCE_ALPHA_TEST: u32 = 1;
/// [`Instance::flags`]: its material is double-sided, so rays hit both sides.
pub const INSTANCE_DOUBLE_SIDED: u32 = 2;
/// [`Instance::flags`]: its mesh consists of spheres.
pub const INSTANCE_SPHERES: u32 = 4;
/// [`Instance::flags`]: its transform changes with time.
pub const INSTANCE_MOVES: u32 = 8;
/// Entries of the traversal stack for both levels of the BVH; deeper BVHs are refused when they are built.
pub const TRAVERSAL_STACK: u32 = 48;

/// Root of the scene's tables.
#[repr(C)]
#[derive(Clone, Copy, Debug, Default, Pod, Zeroable)]
pub struct Scene {
    /// [`Instance`] table.
    pub instances: Address,
    /// [`Mesh`] table.
    pub meshes: Address,
    /// [`Material`] table.
    pub materials: Address,
    /// [`MaterialLayers`] table; zero where no material has any.
    pub layers: Address,
    /// [`Light`] table.
    pub lights: Address,
    /// The driver's top-level acceleration structure; zero where rays are traced in software.
    pub tlas: Address,
    /// Top-level CWBVH: [`BvhNode`] table; zero where the driver traces.
    pub tlas_nodes: Address,
    /// [`BvhInstance`] of each top-level primitive, in the order of the BVH.
    pub tlas_instances: Address,
    /// Table of the specular lobe's albedo, [`LobeAlbedo`](super::lobe_albedo::LobeAlbedo): the one of the view.
    pub lobe_albedo: Address,
    /// [`Light`] table of the previous frame, relative to the origin of this one.
    pub previous_lights: Address,
    /// Number of instances.
    pub instance_count: u32,
    /// Number of lights.
    pub light_count: u32,
}

/// A mesh placed in the world. Matrices are the three upper rows of an affine transform.
#[repr(C)]
#[derive(Clone, Copy, Debug, Default, Pod, Zeroable)]
pub struct Instance {
    /// World from object.
    pub world_from_object: [[f32; 4]; 3],
    /// Object from world.
    pub object_from_world: [[f32; 4]; 3],
    /// World from object one frame ago.
    pub previous_world_from_object: [[f32; 4]; 3],
    /// Index of the mesh.
    pub mesh: u32,
    /// Index of the material.
    pub material: u32,
    /// Rays hit it only if their masks share a bit; 8 bits.
    pub mask: u32,
    /// `INSTANCE_*` bits.
    pub flags: u32,
    /// Bound, metres, above 0, of the rounding errors that displace its points in world space against a ray; where rays see a coarser mesh
    /// than the raster, plus the distance between the two.
    pub rounding: f32,
}

/// Geometry with one material: vertex tables and a bottom-level CWBVH in object space; or spheres.
#[repr(C)]
#[derive(Clone, Copy, Debug, Default, Pod, Zeroable)]
pub struct Mesh {
    /// Vertex positions, three `f32` each; of spheres, centre and radius, four `f32` each.
    pub positions: Address,
    /// Positions one frame ago; the same table where the mesh keeps its shape.
    pub previous_positions: Address,
    /// [`VertexAttributes`] table.
    pub attributes: Address,
    /// Three `u32` per triangle.
    pub indices: Address,
    /// Three `u32` per triangle of the mesh that rays see, which may be coarser; [`BvhPrimitive::primitive`] is an index here.
    pub ray_indices: Address,
    /// [`BvhNode`] table, root first.
    pub nodes: Address,
    /// [`BvhPrimitive`] table in the order of the BVH.
    pub primitives: Address,
    /// Number of triangles or spheres.
    pub primitive_count: u32,
}

/// Attributes of a vertex beside its position.
#[repr(C)]
#[derive(Clone, Copy, Debug, Default, Pod, Zeroable)]
pub struct VertexAttributes {
    /// Unit normal, object space.
    pub normal: [f32; 3],
    /// Unit tangent, object space; `w` is the sign of the bitangent.
    pub tangent: [f32; 4],
    /// First texture coordinates.
    pub uv0: [f32; 2],
    /// Second texture coordinates.
    pub uv1: [f32; 2],
    /// Linear colour and alpha.
    pub colour: [f32; 4],
}

/// One node of a compressed wide BVH (Ylitie et al. 2017), 80 bytes, in `obvhs` layout.
#[repr(C)]
#[derive(Clone, Copy, Debug, Default, Pod, Zeroable)]
pub struct BvhNode {
    /// Origin of the node's quantisation grid.
    pub origin: [f32; 3],
    /// Exponents x, y, z of the grid, then the mask of inner children: one byte each, low first.
    pub exponents_and_mask: u32,
    /// Index of the first inner child.
    pub child_base: u32,
    /// Index of the first primitive.
    pub primitive_base: u32,
    /// One byte of meta data per child.
    pub meta: [u32; 2],
    /// Quantised lower x of the eight children.
    pub min_x: [u32; 2],
    /// Quantised upper x.
    pub max_x: [u32; 2],
    /// Quantised lower y.
    pub min_y: [u32; 2],
    /// Quantised upper y.
    pub max_y: [u32; 2],
    /// Quantised lower z.
    pub min_z: [u32; 2],
    /// Quantised upper z.
    pub max_z: [u32; 2],
}

/// A triangle or sphere for traversal. Positions are in the table at [`Mesh::positions`], which the raster reads as well.
#[repr(C)]
#[derive(Clone, Copy, Debug, Default, PartialEq, Eq, Pod, Zeroable)]
pub struct BvhPrimitive {
    /// Vertex indices of a triangle; zero for a sphere.
    pub corners: [u32; 3],
    /// Index of the triangle in the mesh's index table, or of the sphere.
    pub primitive: u32,
}

/// An instance for traversal, in world space.
///
/// The quantised boxes of a compressed node are up to a 255th of the node too large. Testing the exact box here is cheaper than entering an
/// instance in vain.
#[repr(C)]
#[derive(Clone, Copy, Debug, Default, PartialEq, Pod, Zeroable)]
pub struct BvhInstance {
    /// Lower corner of its bounds, metres.
    pub min: [f32; 3],
    /// Index in the scene's instances.
    pub instance: u32,
    /// Upper corner.
    pub max: [f32; 3],
    /// Padding to 32 bytes, two loads of 16.
    pub unused: u32,
}

/// A texture with its sampler and transform (KHR_texture_transform).
#[repr(C)]
#[derive(Clone, Copy, Debug, Default, Pod, Zeroable)]
pub struct TextureSlot {
    /// Bindless image, or [`NO_TEXTURE`].
    pub image: SampledImage,
    /// Bindless sampler.
    pub sampler_id: SamplerId,
    /// Set of texture coordinates, 0 or 1.
    pub uv_set: u32,
    /// `u' = dot(row, (u, v, 1))`, first row.
    pub row_u: [f32; 3],
    /// Second row.
    pub row_v: [f32; 3],
}

/// Metallic-roughness material of glTF 2.0.
#[repr(C)]
#[derive(Clone, Copy, Debug, Default, Pod, Zeroable)]
pub struct Material {
    /// Linear base colour and alpha factor.
    pub base_colour: [f32; 4],
    /// Emitted radiance factor, linear, strength included.
    pub emission: [f32; 3],
    /// Metalness factor, 0 to 1.
    pub metalness: f32,
    /// Perceptual roughness factor, 0 to 1.
    pub roughness: f32,
    /// Scale of the normal map's x and y.
    pub normal_scale: f32,
    /// Strength of the occlusion map, 0 to 1.
    pub occlusion_strength: f32,
    /// Alpha below which an alpha-tested fragment is discarded.
    pub alpha_cutoff: f32,
    /// `MATERIAL_*` bits.
    pub flags: u32,
    /// Index of its [`MaterialLayers`], or [`NO_LAYERS`].
    pub layers: u32,
    /// Base colour (sRGB) and alpha.
    pub base_colour_texture: TextureSlot,
    /// Roughness in green, metalness in blue.
    pub metallic_roughness_texture: TextureSlot,
    /// Tangent-space normals.
    pub normal_texture: TextureSlot,
    /// Occlusion in red.
    pub occlusion_texture: TextureSlot,
    /// Emission (sRGB).
    pub emission_texture: TextureSlot,
}

/// Rare properties of materials: transmission, volume, clear coat, and other dielectric reflections than that of index 1.5.
#[repr(C)]
#[derive(Clone, Copy, Debug, Default, Pod, Zeroable)]
pub struct MaterialLayers {
    /// Share of the light entering the surface that is transmitted, 0 to 1.
    pub transmission: f32,
    /// Index of refraction, at least 1.
    pub ior: f32,
    /// Strength of the dielectric reflection, 0 to 1.
    pub specular: f32,
    /// Factor of the dielectric reflectance at normal incidence, at least 0.
    pub specular_colour: [f32; 3],
    /// Above 0 if the surface is the boundary of a volume, 0 for a thin sheet.
    pub thickness: f32,
    /// Absorption coefficient of the volume, per metre, at least 0.
    pub absorption: [f32; 3],
    /// Strength of the clear coat, 0 to 1.
    pub clearcoat: f32,
    /// Perceptual roughness of the coat, 0 to 1.
    pub clearcoat_roughness: f32,
    /// Strength of the reflection in alpha.
    pub specular_texture: TextureSlot,
    /// Colour of the reflection (sRGB).
    pub specular_colour_texture: TextureSlot,
    /// Transmission in red.
    pub transmission_texture: TextureSlot,
    /// Strength of the coat in red.
    pub clearcoat_texture: TextureSlot,
    /// Roughness of the coat in green.
    pub clearcoat_roughness_texture: TextureSlot,
}

/// A light. Units follow KHR_lights_punctual.
#[repr(C)]
#[derive(Clone, Copy, Debug, Default, PartialEq, Pod, Zeroable)]
pub struct Light {
    /// `LIGHT_*`.
    pub kind: u32,
    /// Position in the world, metres (rectangle, disc, sphere: its centre).
    pub position: [f32; 3],
    /// Unit direction in which light travels (rectangle, disc: normal of the emitting side).
    pub direction: [f32; 3],
    /// Linear Rec.709 strength; the unit depends on the kind.
    pub intensity: [f32; 3],
    /// Distance at which a point or spot light has faded to 0, metres; 0 for no limit.
    pub range: f32,
    /// `1 / (cos(inner) - cos(outer))` of a spot.
    pub cone_scale: f32,
    /// `-cos(outer) * cone_scale` of a spot.
    pub cone_offset: f32,
    /// Half edge of a rectangle, metres.
    pub half_u: [f32; 3],
    /// The other half edge.
    pub half_v: [f32; 3],
    /// Radius of a disc or sphere, metres; for directional lights half the angular diameter, radians, 0 for parallel light.
    pub radius: f32,
}
