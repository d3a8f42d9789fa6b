//! Scenes: the result of glTF import and of the built-in scenes, and the source of the tables on the GPU.
//!
//! Conventions: metres, y up, right-handed, linear Rec.709; a camera looks along its -z.

use glam::{Affine3A, DAffine3, DVec3, Mat3A, Vec2, Vec3, Vec4};

mod animation;
mod builtin;
mod camera;
mod camera_path;
mod coverage;
mod daylight;
mod deform;
mod emissive;
mod environment;
mod error;
mod facts;
mod import;
pub mod light_sampling;
pub mod light_tables;
pub mod light_tree;
mod mesh;
mod origin;
mod pose;
mod pose_bounds;
mod probe;
mod resident;
mod supply;
mod texture;

pub use animation::{Animation, Channel, Interpolation, Local, Node, Property, Skin};
pub use builtin::{BUILTIN, BuiltinError, BuiltinParameter, builtin, builtin_parameters};
pub use camera::{Camera, CameraFile};
pub use camera_path::{CameraKey, CameraPath};
pub use daylight::{Daylight, SkyModel};
pub use deform::{Deformed, deform};
pub use environment::{Environment, EnvironmentError};
pub use error::{Fault, SceneError};
pub use facts::{Histogram, LightFacts, LightKind, SceneFacts};
pub use import::load;
pub use origin::FloatingOrigin;
pub use pose::{Animator, Pose};
pub use probe::{MAX_PROBES, ReflectionProbe};
pub use resident::{
    Culling, LightTreeUpdate, Moment, Placed, Policy, ResidentError, ResidentOptions, ResidentScene, SceneHandles,
    SceneSketch, SceneToken, ShadowLight, SharedScene,
};
pub use supply::{Supply, supply, supply_missing};
pub use texture::{ColourSpace, Texture, mip_chain};

/// A scene in host memory.
///
/// After [`load`] and [`supply`], or from [`builtin`], a scene has at least one instance, camera and material, and every index is
/// in range and every number finite.
#[derive(Clone, Debug, Default)]
pub struct Scene {
    /// Name, for messages: the stem of the file name, or the built-in name.
    pub name: String,
    /// One mesh per glTF primitive, shared by all instances of it.
    pub meshes: Vec<Mesh>,
    /// Materials, referred to by instances.
    pub materials: Vec<Material>,
    /// Textures with all their mips.
    pub textures: Vec<Texture>,
    /// Samplers, referred to by [`TextureUse`].
    pub samplers: Vec<Sampler>,
    /// The hierarchy that instances, lights and cameras are attached to; parents before children.
    pub nodes: Vec<Node>,
    /// Skins of skinned instances.
    pub skins: Vec<Skin>,
    /// Animations; an [`Animator`] plays one of them.
    pub animations: Vec<Animation>,
    /// Instances, in the rest pose.
    pub instances: Vec<Instance>,
    /// Lights, in the rest pose. Their order is the index that shaders and settings use.
    pub lights: Vec<Light>,
    /// The node of each light. Lights with `None`, or beyond the end of this table, do not move.
    pub light_nodes: Vec<Option<u32>>,
    /// Reflection probes, in the rest pose; at most [`MAX_PROBES`].
    pub probes: Vec<ReflectionProbe>,
    /// Analytic daylight, if the scene has any.
    pub daylight: Option<Daylight>,
    /// An environment map; it replaces the sky of `daylight`.
    pub environment: Option<Environment>,
    /// Cameras, the default first, in the rest pose.
    pub cameras: Vec<Camera>,
    /// The node of each camera. Cameras with `None`, or beyond the end of this table, do not move.
    pub camera_nodes: Vec<Option<u32>>,
    /// What was ignored or repaired while loading, one sentence each.
    pub warnings: Vec<String>,
    /// What was supplied because it was missing, one sentence each.
    pub supplied: Vec<String>,
}

/// Triangles or spheres with one material. All vertex tables have the same length.
#[derive(Clone, Debug, Default)]
pub struct Mesh {
    /// Name, for messages.
    pub name: String,
    /// Positions, object space.
    pub positions: Vec<Vec3>,
    /// Unit normals, object space.
    pub normals: Vec<Vec3>,
    /// Unit tangents, object space; `w` is the sign of the bitangent.
    pub tangents: Vec<Vec4>,
    /// First set of texture coordinates.
    pub uv0: Vec<Vec2>,
    /// Second set of texture coordinates.
    pub uv1: Vec<Vec2>,
    /// Linear vertex colours and alpha; white if the file has none.
    pub colours: Vec<Vec4>,
    /// Three indices per triangle, counter-clockwise from the front.
    pub indices: Vec<u32>,
    /// Joint influences of a skinned mesh: four or eight per vertex, vertex by vertex; empty without a skin.
    pub influences: Vec<Influence>,
    /// Morph targets, in the order of the weights.
    pub targets: Vec<MorphTarget>,
    /// Default weights of the targets; 0 for targets beyond the end of this table.
    pub weights: Vec<f32>,
    /// Procedural spheres. A mesh with spheres has no vertices and no triangles, and does not deform.
    pub spheres: Vec<Sphere>,
}

/// Influence of a joint on a vertex.
#[derive(Clone, Copy, Debug, Default, PartialEq)]
pub struct Influence {
    /// Index into [`Skin::joints`].
    pub joint: u32,
    /// Weight, at least 0; the weights of a vertex sum to 1.
    pub weight: f32,
}

/// What a morph target with weight 1 adds to the vertices. A table is empty if the target does not change that attribute.
#[derive(Clone, Debug, Default)]
pub struct MorphTarget {
    /// Deltas of positions, object space.
    pub positions: Vec<Vec3>,
    /// Deltas of normals.
    pub normals: Vec<Vec3>,
    /// Deltas of the directions of tangents.
    pub tangents: Vec<Vec3>,
}

/// A procedural sphere, which shaders intersect analytically.
#[derive(Clone, Copy, Debug, PartialEq)]
pub struct Sphere {
    /// Centre, object space.
    pub centre: Vec3,
    /// Radius in object space, above 0.
    pub radius: f32,
}

/// An instance of a mesh.
#[derive(Clone, Debug)]
pub struct Instance {
    /// Name of its node.
    pub name: String,
    /// Index into [`Scene::meshes`].
    pub mesh: u32,
    /// Index into [`Scene::materials`].
    pub material: u32,
    /// World-from-object transform in the rest pose; that of the node, if it has one.
    pub world_from_object: DAffine3,
    /// Index into [`Scene::nodes`]; an instance with `None` never moves.
    pub node: Option<u32>,
    /// Index into [`Scene::skins`]; `None` if it is not skinned.
    pub skin: Option<u32>,
}

impl Instance {
    /// An instance that never moves.
    pub fn fixed(name: impl Into<String>, mesh: u32, material: u32, world_from_object: Affine3A) -> Self {
        let world_from_object = double(&world_from_object);
        Self { name: name.into(), mesh, material, world_from_object, node: None, skin: None }
    }
}

/// The transform, rounded to `f32`.
pub fn single(m: &DAffine3) -> Affine3A {
    Affine3A { matrix3: Mat3A::from(m.matrix3.as_mat3()), translation: m.translation.as_vec3().into() }
}

/// The same transform in `f64`.
pub fn double(m: &Affine3A) -> DAffine3 {
    let [x, y, z] = [m.matrix3.x_axis, m.matrix3.y_axis, m.matrix3.z_axis].map(|c| c.as_dvec3());
    DAffine3 { matrix3: glam::DMat3::from_cols(x, y, z), translation: m.translation.as_dvec3() }
}

/// How the alpha of a material is used.
#[derive(Clone, Copy, Debug, Default, PartialEq)]
pub enum AlphaMode {
    /// Alpha is ignored.
    #[default]
    Opaque,
    /// Alpha-tested: not there where alpha is below this cut-off.
    Mask(f32),
    /// Blended: covers by the fraction alpha.
    Blend,
}

/// A metallic-roughness material of glTF 2.0, with extensions.
#[derive(Clone, Debug)]
pub struct Material {
    /// Name, for messages.
    pub name: String,
    /// Base colour and alpha factor, linear.
    pub base_colour: Vec4,
    /// Metalness factor, 0 to 1.
    pub metalness: f32,
    /// Perceptual roughness factor, 0 to 1.
    pub roughness: f32,
    /// Factor of the emitted radiance, strength included.
    pub emission: Vec3,
    /// Scale of the normal map's x and y.
    pub normal_scale: f32,
    /// Strength of the occlusion map, 0 to 1.
    pub occlusion_strength: f32,
    /// How alpha is used.
    pub alpha: AlphaMode,
    /// Whether it is visible from behind.
    pub double_sided: bool,
    /// Whether it shows its base colour without lighting (KHR_materials_unlit).
    pub unlit: bool,
    /// Whether its emission only shows a light of the scene to the camera; the light itself illuminates the scene, not this surface.
    pub shows_light: bool,
    /// Fraction of the light entering a dielectric that is transmitted instead of being scattered, 0 to 1 (KHR_materials_transmission).
    pub transmission: f32,
    /// Index of refraction, at least 1 (KHR_materials_ior).
    pub ior: f32,
    /// Strength of the specular reflection of a dielectric, 0 to 1, at normal and grazing incidence (KHR_materials_specular). At
    /// 0 the surface is Lambertian.
    pub specular: f32,
    /// Factor on the reflectance at normal incidence, linear, at least 0.
    pub specular_colour: Vec3,
    /// Above 0 if the surface bounds a volume, which refracts; 0 for a thin sheet (KHR_materials_volume).
    pub thickness: f32,
    /// Transmittance of the volume over `attenuation_distance`, linear, 0 to 1.
    pub attenuation_colour: Vec3,
    /// Metres, above 0; infinite if the volume absorbs nothing.
    pub attenuation_distance: f32,
    /// Strength of a clear coat, 0 to 1 (KHR_materials_clearcoat).
    pub clearcoat: f32,
    /// Perceptual roughness of the coat, 0 to 1.
    pub clearcoat_roughness: f32,
    /// Base colour in sRGB, and alpha.
    pub base_colour_texture: Option<TextureUse>,
    /// Roughness in green, metalness in blue.
    pub metallic_roughness_texture: Option<TextureUse>,
    /// Tangent-space normals.
    pub normal_texture: Option<TextureUse>,
    /// Occlusion in red.
    pub occlusion_texture: Option<TextureUse>,
    /// Emission in sRGB.
    pub emission_texture: Option<TextureUse>,
    /// Strength of the specular reflection in alpha.
    pub specular_texture: Option<TextureUse>,
    /// Specular colour at normal incidence, in sRGB.
    pub specular_colour_texture: Option<TextureUse>,
    /// Transmission in red.
    pub transmission_texture: Option<TextureUse>,
    /// Strength of the coat in red.
    pub clearcoat_texture: Option<TextureUse>,
    /// Roughness of the coat in green.
    pub clearcoat_roughness_texture: Option<TextureUse>,
}

/// A texture as a material uses it.
#[derive(Clone, Copy, Debug, PartialEq)]
pub struct TextureUse {
    /// Index into [`Scene::textures`].
    pub texture: u32,
    /// Index into [`Scene::samplers`].
    pub sampler: u32,
    /// The set of texture coordinates, 0 or 1.
    pub uv_set: u32,
    /// First two rows of KHR_texture_transform: `u' = dot(rows[0], (u, v, 1))`.
    pub rows: [Vec3; 2],
}

/// How texture coordinates outside 0 to 1 are treated.
#[derive(Clone, Copy, Debug, Default, PartialEq, Eq, Hash)]
pub enum Wrap {
    /// The texture repeats.
    #[default]
    Repeat,
    /// The texture repeats, mirrored every other time.
    Mirror,
    /// Clamped to the edge texels.
    Clamp,
}

/// Sampling parameters of a texture.
#[derive(Clone, Copy, Debug, PartialEq, Eq, Hash)]
pub struct Sampler {
    /// Wrapping of u and v.
    pub wrap: [Wrap; 2],
    /// Linear magnification; otherwise nearest.
    pub linear_magnify: bool,
    /// Linear minification; otherwise nearest.
    pub linear_minify: bool,
    /// Linear interpolation between mips; otherwise nearest.
    pub linear_mips: bool,
    /// Whether mips are used.
    pub mips: bool,
}

impl Default for Sampler {
    fn default() -> Self {
        Self { wrap: [Wrap::Repeat; 2], linear_magnify: true, linear_minify: true, linear_mips: true, mips: true }
    }
}

/// A light source. Units follow KHR_lights_punctual. All but `Directional` are local lights.
#[derive(Clone, Debug, PartialEq)]
pub enum Light {
    /// Parallel light, such as from the sun.
    Directional {
        /// Unit direction in which light travels.
        direction: Vec3,
        /// Illuminance at normal incidence, linear Rec.709.
        illuminance: Vec3,
        /// Half the angle that its disc subtends, radians, below pi / 2; 0 for strictly parallel light.
        angular_radius: f32,
    },
    /// A point light, equal in all directions.
    Point {
        /// Position, metres.
        position: DVec3,
        /// Radiant intensity, linear Rec.709.
        intensity: Vec3,
        /// Distance at which it is attenuated to zero, metres; `None` for no limit.
        range: Option<f32>,
    },
    /// A spot light: a cone with a soft edge.
    Spot {
        /// Position, metres.
        position: DVec3,
        /// Unit direction in which light travels along the axis.
        direction: Vec3,
        /// Radiant intensity on the axis, linear Rec.709.
        intensity: Vec3,
        /// Distance at which it is attenuated to zero, metres; `None` for no limit.
        range: Option<f32>,
        /// Angle from the axis at which attenuation begins, radians.
        inner: f32,
        /// Angle from the axis at which it reaches zero, radians.
        outer: f32,
    },
    /// A rectangle, a Lambertian emitter on one side.
    Rectangle {
        /// Centre, metres.
        centre: DVec3,
        /// Half edge, metres. The side to which `cross(half_u, half_v)` points emits.
        half_u: Vec3,
        /// The other half edge, metres.
        half_v: Vec3,
        /// Emitted radiance, linear Rec.709.
        radiance: Vec3,
    },
    /// A disc, a Lambertian emitter on one side.
    Disc {
        /// Centre, metres.
        centre: DVec3,
        /// Unit normal of the side that emits.
        normal: Vec3,
        /// Radius, metres, above 0.
        radius: f32,
        /// Emitted radiance, linear Rec.709.
        radiance: Vec3,
    },
    /// A sphere, a Lambertian emitter on the outside.
    Sphere {
        /// Centre, metres.
        centre: DVec3,
        /// Radius, metres, above 0.
        radius: f32,
        /// Emitted radiance, linear Rec.709.
        radiance: Vec3,
    },
}

/// Smallest squared roughness in shaders: `MIN_ALPHA` of `lib/brdf.glsl`.
const MIN_ALPHA: f32 = 0.002;

impl Material {
    /// Whether it has transmission, a clear coat, or its own specular reflection.
    pub fn is_layered(&self) -> bool {
        self.transmission > 0.0 || self.clearcoat > 0.0 || self.has_own_specular()
    }

    /// Whether its specular reflection differs from a dielectric of index 1.5, through its index of refraction or KHR_materials_specular.
    pub fn has_own_specular(&self) -> bool {
        let plain = Self::default();
        self.ior != plain.ior
            || self.specular != plain.specular
            || self.specular_colour != plain.specular_colour
            || self.specular_texture.is_some()
            || self.specular_colour_texture.is_some()
    }

    /// Whether light may pass straight through opaque parts of it: a transmissive thin sheet that is smooth, or that a texture
    /// may make smooth. `lib/surface.glsl` decides at each point.
    pub fn is_clear(&self) -> bool {
        let is_dielectric = self.metalness < 1.0 || self.metallic_roughness_texture.is_some();
        let is_smooth = self.roughness * self.roughness <= MIN_ALPHA || self.metallic_roughness_texture.is_some();
        let is_sheet = self.thickness == 0.0 && !matches!(self.alpha, AlphaMode::Mask(_)) && !self.unlit;
        self.transmission > 0.0 && is_sheet && is_dielectric && is_smooth
    }

    /// Absorption coefficient of its volume, per metre: `-ln(attenuation_colour) / attenuation_distance` (KHR_materials_volume).
    /// Colours below 1e-6 count as 1e-6.
    pub fn absorption(&self) -> Vec3 {
        -self.attenuation_colour.max(Vec3::splat(1e-6)).min(Vec3::ONE).map(f32::ln) / self.attenuation_distance
    }
}

impl Default for Material {
    fn default() -> Self {
        Self {
            name: "default".to_owned(),
            base_colour: Vec4::ONE,
            metalness: 1.0,
            roughness: 1.0,
            emission: Vec3::ZERO,
            normal_scale: 1.0,
            occlusion_strength: 1.0,
            alpha: AlphaMode::Opaque,
            double_sided: false,
            unlit: false,
            shows_light: false,
            transmission: 0.0,
            ior: 1.5,
            specular: 1.0,
            specular_colour: Vec3::ONE,
            thickness: 0.0,
            attenuation_colour: Vec3::ONE,
            attenuation_distance: f32::INFINITY,
            clearcoat: 0.0,
            clearcoat_roughness: 0.0,
            base_colour_texture: None,
            metallic_roughness_texture: None,
            normal_texture: None,
            occlusion_texture: None,
            emission_texture: None,
            specular_texture: None,
            specular_colour_texture: None,
            transmission_texture: None,
            clearcoat_texture: None,
            clearcoat_roughness_texture: None,
        }
    }
}
