//! What an effect asks of the frame before it is declared, and whether it has anything to do.

use std::borrow::Cow;

use serde::Serialize;

/// What an effect asks of the whole frame, or why it has nothing to do. See [`Effect::needs`](super::Effect::needs).
///
/// ```
/// use magpie::slot::Needs;
/// let needs = Needs { jitter: true, ..Needs::default() };
/// assert_eq!(needs.and(Needs::idle("the scene has no sky")).jitter, true);
/// ```
#[derive(Clone, Debug, PartialEq, Serialize)]
pub struct Needs {
    /// Why the effect has nothing to do in this scene: its [`add`](super::Effect::add) then adds no pass.
    pub idle: Option<Cow<'static, str>>,
    /// Parts of the effect that can be idle by themselves.
    pub parts: Vec<Part>,
    /// Pixels are sampled at another point in every frame.
    pub jitter: bool,
    /// Rendered pixels over those of the picture, each way; above 0, at most 1. Where several effects ask, the least counts.
    pub resolution_scale: f64,
    /// The table by which emissive triangles and spheres are chosen: [`SceneHandles::emitters`](crate::scene::SceneHandles::emitters).
    pub emitters: bool,
    /// The tables by which every light is sampled, the sky and emissive surfaces among them, for light at places that the camera does not
    /// see: [`SceneHandles::lights`](crate::scene::SceneHandles::lights).
    pub light_tables: bool,
    /// The effect finds out by itself which local lights are seen, so that the slot `shadows` need not.
    pub samples_lamps: bool,
    /// The light tree, by which a light is chosen for a point, and `light_tables` with it:
    /// [`SceneHandles::light_tree`](crate::scene::SceneHandles::light_tree).
    pub light_tree: bool,
    /// The lit picture of the previous frame, before anti-aliasing and tone mapping.
    pub previous_radiance: bool,
    /// The surface model leaves out light that scatters more than once between microfacets.
    pub single_scattering: bool,
    /// How the scene's geometry is brought to the device; of several the first counts.
    pub geometry: Option<Geometry>,
}

/// A part of an effect. Its passes are called `slot.part`, and may go on with `_`.
#[derive(Clone, Debug, PartialEq, Eq, Serialize)]
pub struct Part {
    /// Name within the effect.
    pub name: &'static str,
    /// Why it has nothing to do; `None` where it runs.
    pub idle: Option<Cow<'static, str>>,
    /// The setting of the slot that leaves it out, as `key=value`.
    pub without: Option<&'static str>,
}

/// What the implementation in a slot asks for.
#[derive(Clone, Debug, PartialEq, Serialize)]
pub struct SlotNeeds {
    /// Name of the slot.
    pub slot: &'static str,
    /// Name of the implementation.
    pub implementation: String,
    /// What it asks for.
    pub needs: Needs,
}

/// How geometry is brought to the device when a scene is loaded.
#[derive(Clone, Copy, Debug, PartialEq, Serialize)]
pub struct Geometry {
    /// The driver's acceleration structures over meshes that keep their shape are compacted.
    pub compaction: bool,
    /// Share of the triangles that rays see of such meshes, 0 to 1.
    pub ray_detail: f32,
}

impl Default for Needs {
    fn default() -> Self {
        Self {
            idle: None,
            parts: Vec::new(),
            jitter: false,
            resolution_scale: 1.0,
            emitters: false,
            light_tables: false,
            samples_lamps: false,
            light_tree: false,
            previous_radiance: false,
            single_scattering: false,
            geometry: None,
        }
    }
}

impl Needs {
    /// Those of an effect that has nothing to do, for this reason: a few words, as in "no material emits".
    pub fn idle(reason: impl Into<Cow<'static, str>>) -> Self {
        Self { idle: Some(reason.into()), ..Self::default() }
    }

    /// Adds a part that can be idle by itself.
    #[must_use]
    pub fn part(mut self, part: Part) -> Self {
        self.parts.push(part);
        self
    }

    /// All that either asks for. What `self` says of being idle stays.
    #[must_use]
    pub fn and(mut self, other: Self) -> Self {
        let new = |part: &Part| !self.parts.iter().any(|known| known.name == part.name);
        let new: Vec<Part> = other.parts.into_iter().filter(new).collect();
        self.parts.extend(new);
        Self {
            idle: self.idle,
            parts: self.parts,
            jitter: self.jitter || other.jitter,
            resolution_scale: self.resolution_scale.min(other.resolution_scale),
            emitters: self.emitters || other.emitters,
            light_tables: self.light_tables || other.light_tables,
            samples_lamps: self.samples_lamps || other.samples_lamps,
            light_tree: self.light_tree || other.light_tree,
            previous_radiance: self.previous_radiance || other.previous_radiance,
            single_scattering: self.single_scattering || other.single_scattering,
            geometry: self.geometry.or(other.geometry),
        }
    }
}
