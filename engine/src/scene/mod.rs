//! Scenes: what glTF import and the built-in scenes produce, and what the GPU tables are made from.
//!
//! Conventions: metres, y up, right-handed, linear Rec.709; a camera looks along its -z.

use glam::{Affine3A, DAffine3, DVec3, Mat3A, Vec2, Vec3, Vec4};

mod animation;
mod builtin;
mod camera;
mod coverage;
mod daylight;
mod deform;
mod environment;
mod error;
mod facts;
mod glow;
mod import;
mod mesh;
pub mod odds;
mod origin;
mod pose;
mod reach;
mod resident;
mod supply;
mod texture;

pub use animation::{Animation, Channel, Interpolation, Local, Node, Property, Skin};
pub use builtin::{BUILTIN, builtin};
pub use camera::{Camera, CameraFile};
pub use daylight::{Daylight, SkyModel};
pub use deform::{Deformed, deform};
pub use environment::{Environment, EnvironmentError};
pub use error::{Fault, SceneError};
pub use facts::{Histogram, LightFacts, LightKind, SceneFacts};
pub use import::load;
pub use origin::FloatingOrigin;
pub use pose::{Animator, Pose};
pub use resident::{
    Caster, Culling, Moment, Placed, Policy, ResidentError, ResidentOptions, ResidentScene, SceneHandles, SceneSketch,
    SharedScene,
};
pub use supply::{Supply, supply, supply_missing};
pub use texture::{ColourSpace, Texture, mip_chain};

/// Everything that is drawn, in plain memory.
///
/// After [`load`] and [`supply`], or from [`builtin`], a scene holds at least one instance, camera and material; every index is
/// in range and every number finite.
#[derive(Clone, Debug, Default)]
pub struct Scene {
    /// Name for messages: the file's stem or the built-in name.
    pub name: String,
    /// Geometry; one entry per glTF primitive, shared by all nodes that show it.
    pub meshes: Vec<Mesh>,
    /// Materials.
    pub materials: Vec<Material>,
    /// Textures with all their mips.
    pub textures: Vec<Texture>,
    /// Samplers.
    pub samplers: Vec<Sampler>,
    /// What instances, lights and cameras hang on; parents before children.
    pub nodes: Vec<Node>,
    /// Joints of skinned instances.
    pub skins: Vec<Skin>,
    /// Movements; [`Animator`] plays one.
    pub animations: Vec<Animation>,
    /// Placed meshes, in the rest pose.
    pub instances: Vec<Instance>,
    /// Lights, in the rest pose.
    pub lights: Vec<Light>,
    /// The node of each light; those beyond the table, or with `None`, stay where they are.
    pub light_nodes: Vec<Option<u32>>,
    /// Analytic daylight, if the scene has any.
    pub daylight: Option<Daylight>,
    /// Light from all around, from an image; it takes the place of the sky of `daylight`.
    pub environment: Option<Environment>,
    /// Cameras, the default first, in the rest pose.
    pub cameras: Vec<Camera>,
    /// The node of each camera; those beyond the table, or with `None`, stay where they are.
    pub camera_nodes: Vec<Option<u32>>,
    /// What was ignored or repaired, one sentence each, for the log.
    pub warnings: Vec<String>,
    /// What it lacked and was given, one sentence each, for the log.
    pub supplied: Vec<String>,
}

/// Triangles of one material, or spheres of one. All vertex tables have the same length.
#[derive(Clone, Debug, Default)]
pub struct Mesh {
    /// Name for messages.
    pub name: String,
    /// Positions, object space.
    pub positions: Vec<Vec3>,
    /// Unit normals.
    pub normals: Vec<Vec3>,
    /// Unit tangents; `w` is the sign of the bitangent.
    pub tangents: Vec<Vec4>,
    /// First texture coordinates.
    pub uv0: Vec<Vec2>,
    /// Second texture coordinates.
    pub uv1: Vec<Vec2>,
    /// Linear colours and alpha; white where the file has none.
    pub colours: Vec<Vec4>,
    /// Three per triangle, counter-clockwise from the front.
    pub indices: Vec<u32>,
    /// What the vertices of a skinned mesh follow: four or eight for each, one vertex after another; empty without a skin.
    pub influences: Vec<Influence>,
    /// Morph targets.
    pub targets: Vec<MorphTarget>,
    /// Weight of each target where nothing else is said; 0 for those beyond the table.
    pub weights: Vec<f32>,
    /// Spheres. A mesh that has any has no vertices and no triangles, and does not deform.
    pub spheres: Vec<Sphere>,
}

/// The part that a joint has in a vertex.
#[derive(Clone, Copy, Debug, Default, PartialEq)]
pub struct Influence {
    /// Index into [`Skin::joints`].
    pub joint: u32,
    /// At least 0; those of a vertex sum to 1.
    pub weight: f32,
}

/// What a weight of 1 adds to the vertices. A table is empty where the target does not change the attribute.
#[derive(Clone, Debug, Default)]
pub struct MorphTarget {
    /// Added to positions, object space.
    pub positions: Vec<Vec3>,
    /// Added to normals.
    pub normals: Vec<Vec3>,
    /// Added to the directions of tangents.
    pub tangents: Vec<Vec3>,
}

/// A procedural sphere.
#[derive(Clone, Copy, Debug, PartialEq)]
pub struct Sphere {
    /// Centre, object space.
    pub centre: Vec3,
    /// Radius in object space, above 0.
    pub radius: f32,
}

/// A mesh placed in the world.
#[derive(Clone, Debug)]
pub struct Instance {
    /// The node's name.
    pub name: String,
    /// Index into [`Scene::meshes`].
    pub mesh: u32,
    /// Index into [`Scene::materials`].
    pub material: u32,
    /// World from object in the rest pose; that of the node, where there is one.
    pub world_from_object: DAffine3,
    /// Index into [`Scene::nodes`]; `None` never moves.
    pub node: Option<u32>,
    /// Index into [`Scene::skins`].
    pub skin: Option<u32>,
}

impl Instance {
    /// A mesh that stays where it is put.
    pub fn fixed(name: impl Into<String>, mesh: u32, material: u32, world_from_object: Affine3A) -> Self {
        let world_from_object = double(&world_from_object);
        Self { name: name.into(), mesh, material, world_from_object, node: None, skin: None }
    }
}

/// A transform rounded to `f32`.
pub fn single(m: &DAffine3) -> Affine3A {
    Affine3A { matrix3: Mat3A::from(m.matrix3.as_mat3()), translation: m.translation.as_vec3().into() }
}

/// The same transform in `f64`.
pub fn double(m: &Affine3A) -> DAffine3 {
    let [x, y, z] = [m.matrix3.x_axis, m.matrix3.y_axis, m.matrix3.z_axis].map(|c| c.as_dvec3());
    DAffine3 { matrix3: glam::DMat3::from_cols(x, y, z), translation: m.translation.as_dvec3() }
}

/// How alpha is read.
#[derive(Clone, Copy, Debug, Default, PartialEq)]
pub enum AlphaMode {
    /// Ignored.
    #[default]
    Opaque,
    /// Discarded below this value.
    Mask(f32),
    /// Blended.
    Blend,
}

/// Metallic-roughness material of glTF 2.0.
#[derive(Clone, Debug)]
pub struct Material {
    /// Name for messages.
    pub name: String,
    /// Linear base colour and alpha factor.
    pub base_colour: Vec4,
    /// Metalness factor, 0 to 1.
    pub metalness: f32,
    /// Perceptual roughness factor, 0 to 1.
    pub roughness: f32,
    /// Emitted radiance factor, strength included.
    pub emission: Vec3,
    /// Scale of the normal map's x and y.
    pub normal_scale: f32,
    /// Strength of the occlusion map, 0 to 1.
    pub occlusion_strength: f32,
    /// How alpha is read.
    pub alpha: AlphaMode,
    /// Back faces are drawn.
    pub double_sided: bool,
    /// The base colour is shown as it is.
    pub unlit: bool,
    /// Its emission is the look of a light of the scene: seen by the camera, but what it shines on is lit by that light alone.
    pub shows_light: bool,
    /// Share of the light that enters a dielectric and goes through instead of being scattered, 0 to 1
    /// (KHR_materials_transmission).
    pub transmission: f32,
    /// Index of refraction, at least 1 (KHR_materials_ior).
    pub ior: f32,
    /// Strength of the reflection of a dielectric, 0 to 1: at normal and at grazing incidence (KHR_materials_specular). At 0 it is Lambert's.
    pub specular: f32,
    /// What its reflectance at normal incidence is multiplied with, linear, at least 0.
    pub specular_colour: Vec3,
    /// Above 0 where the surface is the border of a volume, which refracts; 0 where it is a thin sheet (KHR_materials_volume).
    pub thickness: f32,
    /// What is left of white light after `attenuation_distance` inside of the volume, linear, 0 to 1.
    pub attenuation_colour: Vec3,
    /// Metres, above 0; infinite where the volume absorbs nothing.
    pub attenuation_distance: f32,
    /// Strength of a clear coat, 0 to 1 (KHR_materials_clearcoat).
    pub clearcoat: f32,
    /// Perceptual roughness of the coat, 0 to 1.
    pub clearcoat_roughness: f32,
    /// sRGB base colour and alpha.
    pub base_colour_texture: Option<TextureUse>,
    /// Roughness in green, metalness in blue.
    pub metallic_roughness_texture: Option<TextureUse>,
    /// Tangent-space normals.
    pub normal_texture: Option<TextureUse>,
    /// Occlusion in red.
    pub occlusion_texture: Option<TextureUse>,
    /// sRGB emission.
    pub emission_texture: Option<TextureUse>,
    /// Strength of the reflection in alpha.
    pub specular_texture: Option<TextureUse>,
    /// sRGB colour of the reflection at normal incidence.
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
    /// 0 or 1: which texture coordinates.
    pub uv_set: u32,
    /// Rows of KHR_texture_transform: `u' = dot(rows[0], (u, v, 1))`.
    pub rows: [Vec3; 2],
}

/// What lies outside 0 to 1.
#[derive(Clone, Copy, Debug, Default, PartialEq, Eq, Hash)]
pub enum Wrap {
    /// Tiles.
    #[default]
    Repeat,
    /// Tiles, mirrored every other time.
    Mirror,
    /// Edge texels.
    Clamp,
}

/// A sampler.
#[derive(Clone, Copy, Debug, PartialEq, Eq, Hash)]
pub struct Sampler {
    /// Wrap of u and v.
    pub wrap: [Wrap; 2],
    /// Linear rather than nearest magnification.
    pub linear_magnify: bool,
    /// Linear rather than nearest minification.
    pub linear_minify: bool,
    /// Linear rather than nearest choice between mips.
    pub linear_mips: bool,
    /// Mips are used at all.
    pub mips: bool,
}

impl Default for Sampler {
    fn default() -> Self {
        Self { wrap: [Wrap::Repeat; 2], linear_magnify: true, linear_minify: true, linear_mips: true, mips: true }
    }
}

/// A light. Units follow KHR_lights_punctual.
#[derive(Clone, Debug, PartialEq)]
pub enum Light {
    /// Parallel light, as from the sun.
    Directional {
        /// Unit direction of travel.
        direction: Vec3,
        /// Illuminance at normal incidence.
        illuminance: Vec3,
        /// Half the angle that its disc subtends, radians, below a quarter turn; 0 for strictly parallel light.
        angular_radius: f32,
    },
    /// Equal in every direction.
    Point {
        /// Metres.
        position: DVec3,
        /// Radiant intensity.
        intensity: Vec3,
        /// Distance at which it has faded to nothing, metres.
        range: Option<f32>,
    },
    /// A cone with a soft edge.
    Spot {
        /// Metres.
        position: DVec3,
        /// Unit direction of travel.
        direction: Vec3,
        /// Radiant intensity on the axis.
        intensity: Vec3,
        /// Distance at which it has faded to nothing, metres.
        range: Option<f32>,
        /// Angle from the axis at which it begins to fade, radians.
        inner: f32,
        /// Angle from the axis at which it ends, radians.
        outer: f32,
    },
    /// A rectangle that emits from one side, Lambertian.
    Rectangle {
        /// Centre, metres.
        centre: DVec3,
        /// Half edges, metres; the side `cross(half_u, half_v)` emits.
        half_u: Vec3,
        /// The other half edge.
        half_v: Vec3,
        /// Emitted radiance.
        radiance: Vec3,
    },
    /// A disc that emits from one side, Lambertian.
    Disc {
        /// Centre, metres.
        centre: DVec3,
        /// Unit normal of the side that emits.
        normal: Vec3,
        /// Metres, above 0.
        radius: f32,
        /// Emitted radiance.
        radiance: Vec3,
    },
    /// A sphere that emits all around, Lambertian. Inside of it there is no light.
    Sphere {
        /// Centre, metres.
        centre: DVec3,
        /// Metres, above 0.
        radius: f32,
        /// Emitted radiance.
        radiance: Vec3,
    },
}

/// Square of the roughness of what is as smooth as shaders can say: `MIN_ALPHA` of `lib/brdf.glsl`.
const LEAST_ALPHA: f32 = 0.002;

impl Material {
    /// Whether it has any of transmission, a coat, or a reflection of its own.
    pub fn is_layered(&self) -> bool {
        self.transmission > 0.0 || self.clearcoat > 0.0 || self.has_own_specular()
    }

    /// Whether it reflects otherwise than a dielectric of index 1.5: by its index of refraction, or as KHR_materials_specular says.
    pub fn has_own_specular(&self) -> bool {
        let plain = Self::default();
        self.ior != plain.ior
            || self.specular != plain.specular
            || self.specular_colour != plain.specular_colour
            || self.specular_texture.is_some()
            || self.specular_colour_texture.is_some()
    }

    /// Whether light may go straight through it where it is solid: a thin sheet that transmits, smooth or with a texture that may say so.
    /// `lib/surface.glsl` decides at each point.
    pub fn is_clear(&self) -> bool {
        let is_dielectric = self.metalness < 1.0 || self.metallic_roughness_texture.is_some();
        let is_smooth = self.roughness * self.roughness <= LEAST_ALPHA || self.metallic_roughness_texture.is_some();
        let is_sheet = self.thickness == 0.0 && !matches!(self.alpha, AlphaMode::Mask(_)) && !self.unlit;
        self.transmission > 0.0 && is_sheet && is_dielectric && is_smooth
    }

    /// Absorption inside of its volume, per metre: `-ln(attenuation_colour) / attenuation_distance` (KHR_materials_volume). A colour
    /// of 0 counts as 1e-6, the least that is told from it.
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
