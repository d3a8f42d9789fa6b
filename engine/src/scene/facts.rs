//! What a scene is made of, in numbers: enough for an effect to say whether it has anything to do.
use super::light_sampling::{is_emitter, luminance, mean_emission};
use super::supply::{PosedInstance, posed_instances};
use super::{AlphaMode, Animator, Instance, Light, MAX_PROBES, Material, Mesh, ReflectionProbe, Scene};
use crate::ray::Bounds;
use glam::{DAffine3, DVec3, Vec3};
use rayon::prelude::*;
use serde::Serialize;
use std::f64::consts::PI;

/// Bins of a [`Histogram`].
pub const BINS: usize = 16;
/// Textures are read at the largest mip that is at most this wide and high.
const TEXELS: u32 = 256;

/// Shares of a scene's surface, by area, over a number from 0 to 1: bin `i` holds what lies from `i / 16` on. They sum to 1, or to 0 where
/// there is no surface.
#[derive(Clone, Copy, Debug, Default, PartialEq, Serialize)]
#[serde(transparent)]
pub struct Histogram(pub [f64; BINS]);

impl Histogram {
    fn add(&mut self, value: f64, weight: f64) {
        self.0[((value * BINS as f64) as usize).min(BINS - 1)] += weight;
    }

    /// The share from a value on, which is rounded down to the border of a bin.
    #[must_use]
    pub fn from(&self, value: f64) -> f64 {
        self.0[((value * BINS as f64) as usize).min(BINS)..].iter().sum()
    }
}

/// The kind of a light.
#[derive(Clone, Copy, Debug, PartialEq, Eq, Serialize)]
#[serde(rename_all = "lowercase")]
pub enum LightKind {
    /// Parallel light.
    Directional,
    /// A point that shines in every direction.
    Point,
    /// A cone.
    Spot,
    /// A rectangle that shines from one side.
    Rectangle,
    /// A disc that shines from one side.
    Disc,
    /// A sphere.
    Sphere,
}

/// One light of a scene.
#[derive(Clone, Copy, Debug, PartialEq, Serialize)]
pub struct LightFacts {
    /// What it is.
    pub kind: LightKind,
    /// Luminous flux over 683 lm/W, as it is dimmed now. Of directional light what falls through a disc as wide as the scene.
    pub power: f64,
    /// The same undimmed.
    pub full_power: f64,
    /// It has an extent, so that its shadows have penumbrae.
    pub has_extent: bool,
}

/// What a scene is made of. Shares are of its surface by area, in the rest pose. What has no area there but moves counts with the area of its
/// mesh.
///
/// Gathered once from the scene in memory, without a device. What can change while frames go on is kept up: the power of lights.
#[derive(Clone, Debug, Default, PartialEq, Serialize)]
pub struct SceneFacts {
    /// The lights, in the order of the scene.
    pub lights: Vec<LightFacts>,
    /// A light moves.
    pub lights_move: bool,
    /// The transform of an instance changes with time.
    pub instances_move: bool,
    /// Surface of all instances, m².
    pub area: f64,
    /// A surface looks brighter than what lights it: its material emits, or shows its base colour without lighting.
    pub shows_emission: bool,
    /// Surface that lights others by its emission, m²: emissive texels alone, less what alpha takes.
    pub emissive_area: f64,
    /// Its luminous flux over 683 lm/W, by a few look-ups of textures per triangle: 0 does not prove that nothing shines.
    pub emissive_power: f64,
    /// Perceptual roughness.
    pub roughness: Histogram,
    /// Metalness.
    pub metalness: Histogram,
    /// Share that reflects diffusely at all: all but what is metal throughout, black or unlit.
    pub diffuse: f64,
    /// Share of materials that have a specular reflection: all but unlit ones, and dielectrics whose reflection KHR_materials_specular takes away.
    pub specular: f64,
    /// Share whose alpha is tested.
    pub alpha_tested: f64,
    /// Share that is blended.
    pub blended: f64,
    /// Share that light goes through (KHR_materials_transmission).
    pub transmissive: f64,
    /// Share that moves or deforms.
    pub moving: f64,
    /// Light may go straight through an instance: thin smooth glass, or blended surfaces that do not cover all.
    pub lets_light_through: bool,
    /// A material reflects otherwise than a dielectric of index 1.5 or a metal: [`Material::has_own_specular`].
    pub has_own_specular: bool,
    /// A material has a clear coat (KHR_materials_clearcoat).
    pub has_coat: bool,
    /// A sky or an environment map surrounds the scene, and is not black.
    pub has_sky: bool,
    /// The reflection probes that the scene places; their number in JSON.
    #[serde(serialize_with = "as_number")]
    pub probes: Vec<ReflectionProbe>,
    /// A box around all instances in the rest pose: its lower and upper corner, metres; `None` where there are none.
    pub bounds: Option<[[f64; 3]; 2]>,
    /// Instances that light others by their emission, as far as factors, alpha and areas can tell.
    pub emissive_instances: u32,
    /// How many instances.
    pub instances: u32,
    /// Triangles of all instances.
    pub triangles: u64,
    /// Procedural spheres of all instances.
    pub spheres: u64,
}

impl SceneFacts {
    /// Gathers those of a scene.
    #[must_use]
    pub fn new(scene: &Scene) -> Self {
        let (animator, posed_instances) = (Animator::new(scene), posed_instances(scene));
        let one = |(index, (instance, posed)): (usize, (&Instance, &PosedInstance<'_>))| {
            InstanceFacts::new(scene, instance, posed, animator.moves(index) || animator.changes(index))
        };
        let all: Vec<InstanceFacts> = scene.instances.par_iter().zip(&posed_instances).enumerate().map(one).collect();
        let mut facts = Self {
            lights_move: (0..scene.lights.len()).any(|light| animator.moves_light(light)),
            instances_move: (0..scene.instances.len()).any(|instance| animator.moves(instance)),
            has_sky: scene.environment.as_ref().map_or(scene.daylight.is_some(), |e| !e.is_black()),
            instances: scene.instances.len() as u32,
            lets_light_through: scene.instances.iter().any(|i| lets_light_through(scene, i)),
            shows_emission: scene.instances.iter().any(|i| shows_emission(&scene.materials[i.material as usize])),
            probes: scene.probes.iter().take(MAX_PROBES).copied().collect(),
            has_own_specular: scene.instances.iter().any(|i| scene.materials[i.material as usize].has_own_specular()),
            has_coat: scene.instances.iter().any(|i| scene.materials[i.material as usize].clearcoat > 0.0),
            ..Self::default()
        };
        let area: f64 = all.iter().map(|i| i.area).sum();
        for instance in &all {
            facts.add(instance, if area > 0.0 { instance.area / area } else { 0.0 });
        }
        facts.area = area;
        let bounds = all.iter().filter_map(|i| i.bounds).reduce(around);
        facts.bounds = bounds.map(|corners| corners.map(|corner| corner.to_array()));
        let radius = bounds.map_or(0.0, |[min, max]| 0.5 * (max - min).length());
        facts.lights = scene.lights.iter().map(|light| LightFacts::new(light, radius)).collect();
        facts
    }

    /// Adds an instance with this share of the surface.
    fn add(&mut self, i: &InstanceFacts, share: f64) {
        let of = |is: bool| if is { share } else { 0.0 };
        self.emissive_instances += u32::from(i.emits);
        self.emissive_area += i.emissive_area;
        self.emissive_power += i.emissive_power;
        for (sum, own) in [(&mut self.roughness, &i.roughness), (&mut self.metalness, &i.metalness)] {
            sum.0.iter_mut().zip(own.0).for_each(|(sum, own)| *sum += share * own);
        }
        self.diffuse += of(i.diffuse);
        self.specular += of(i.specular);
        self.alpha_tested += of(i.alpha_tested);
        self.blended += of(i.blended);
        self.transmissive += of(i.transmissive);
        self.moving += of(i.moving);
        self.triangles += i.triangles;
        self.spheres += i.spheres;
    }

    /// The lights that shine, as they are dimmed now.
    pub fn shining(&self) -> impl Iterator<Item = &LightFacts> {
        self.lights.iter().filter(|light| light.power > 0.0)
    }

    /// Number of local lights that have any power, dimmed or not.
    #[must_use]
    pub fn lamps(&self) -> usize {
        let is_lamp = |light: &&LightFacts| light.kind != LightKind::Directional && light.full_power > 0.0;
        self.lights.iter().filter(is_lamp).count()
    }

    /// A surface lights others by its emission.
    #[must_use]
    pub fn emits(&self) -> bool {
        self.emissive_instances > 0
    }

    /// Whether any surface may be smoother than a limit of perceptual roughness. Of clear coats nothing is known but that there are any.
    #[must_use]
    pub fn has_smooth(&self, limit: f32) -> bool {
        let is_smooth = |bin: usize| (bin as f32) < limit * BINS as f32;
        self.has_coat || self.roughness.0.iter().enumerate().any(|(bin, share)| *share > 0.0 && is_smooth(bin))
    }

    /// Multiplies the power of a light with a factor. Nothing where there is no such light.
    pub(crate) fn scale_light(&mut self, light: usize, factor: f32) {
        if let Some(light) = self.lights.get_mut(light) {
            light.power = light.full_power * f64::from(factor);
        }
    }
}

impl LightFacts {
    /// A light of a scene of this radius, metres.
    fn new(light: &Light, radius: f64) -> Self {
        let (kind, full_power, has_extent) = match light {
            Light::Directional { illuminance, angular_radius, .. } => {
                (LightKind::Directional, PI * radius * radius * luminance(*illuminance), *angular_radius > 0.0)
            }
            Light::Point { intensity, .. } => (LightKind::Point, 4.0 * PI * luminance(*intensity), false),
            Light::Spot { intensity, outer, .. } => {
                (LightKind::Spot, 2.0 * PI * (1.0 - f64::from(*outer).cos()) * luminance(*intensity), false)
            }
            Light::Rectangle { half_u, half_v, radiance, .. } => {
                let area = 4.0 * f64::from(half_u.cross(*half_v).length());
                (LightKind::Rectangle, PI * area * luminance(*radiance), true)
            }
            Light::Disc { radius, radiance, .. } => {
                (LightKind::Disc, PI * PI * f64::from(*radius).powi(2) * luminance(*radiance), true)
            }
            Light::Sphere { radius, radiance, .. } => {
                (LightKind::Sphere, 4.0 * PI * PI * f64::from(*radius).powi(2) * luminance(*radiance), true)
            }
        };
        Self { kind, power: full_power, full_power, has_extent }
    }
}

fn as_number<S: serde::Serializer>(probes: &[ReflectionProbe], to: S) -> Result<S::Ok, S::Error> {
    to.serialize_u64(probes.len() as u64)
}

fn shows_emission(material: &Material) -> bool {
    material.emission != Vec3::ZERO || material.unlit
}

/// What one instance adds.
struct InstanceFacts {
    area: f64,
    emits: bool,
    emissive_area: f64,
    emissive_power: f64,
    roughness: Histogram,
    metalness: Histogram,
    diffuse: bool,
    specular: bool,
    alpha_tested: bool,
    blended: bool,
    transmissive: bool,
    moving: bool,
    triangles: u64,
    spheres: u64,
    bounds: Option<[DVec3; 2]>,
}

impl InstanceFacts {
    fn new(scene: &Scene, instance: &Instance, posed: &PosedInstance<'_>, moving: bool) -> Self {
        let (mesh, material) = (&scene.meshes[instance.mesh as usize], &scene.materials[instance.material as usize]);
        let is_emitter = is_emitter(scene, instance);
        let full = luminance(material.emission);
        let measure = |world: &DAffine3, balls: &[f64]| {
            let [mut area, mut emissive_area, mut emissive_power] = [0.0; 3];
            let mut add = |piece: f64, sides: f64, emission: f64| {
                // A triangle thrown out of the world by its transform has no area that could be added up.
                if piece.is_finite() && piece > 0.0 {
                    area += piece;
                    emissive_area += piece * emission / full.max(f64::MIN_POSITIVE);
                    emissive_power += PI * sides * piece * emission;
                }
            };
            let sides = if material.double_sided { 2.0 } else { 1.0 };
            for corners in mesh.indices.chunks_exact(3) {
                let [a, b, c] =
                    [0, 1, 2].map(|k| world.transform_point3(posed.positions[corners[k] as usize].as_dvec3()));
                let emission = if is_emitter { mean_emission(scene, material, mesh, corners) } else { 0.0 };
                add(0.5 * (b - a).cross(c - a).length(), sides, emission);
            }
            for radius in balls {
                add(4.0 * PI * radius * radius, 1.0, if is_emitter { full } else { 0.0 });
            }
            [area, emissive_area, emissive_power]
        };
        let balls: Vec<f64> = posed.spheres.iter().map(|(_, ball)| ball.determinant().abs().cbrt()).collect();
        let mut measured = measure(&posed.world, &balls);
        if measured[0] == 0.0 && moving {
            // It grows from nothing, so it counts with the size that its mesh has.
            let balls: Vec<f64> = mesh.spheres.iter().map(|sphere| f64::from(sphere.radius)).collect();
            measured = measure(&DAffine3::IDENTITY, &balls);
        }
        let [area, emissive_area, emissive_power] = measured;
        let ([roughness, metalness], least_metalness) = surfaces(scene, material);
        Self {
            area,
            emits: is_emitter && area > 0.0,
            emissive_area,
            emissive_power,
            roughness,
            metalness,
            diffuse: least_metalness < 1.0 && !material.unlit && material.base_colour.truncate() != Vec3::ZERO,
            specular: !material.unlit
                && (material.specular > 0.0 || material.metalness > 0.0 || material.clearcoat > 0.0),
            alpha_tested: matches!(material.alpha, AlphaMode::Mask(_)),
            blended: material.alpha == AlphaMode::Blend,
            transmissive: material.transmission > 0.0,
            moving,
            triangles: mesh.indices.len() as u64 / 3,
            spheres: mesh.spheres.len() as u64,
            bounds: bounds(posed),
        }
    }
}

/// The box around two.
fn around([min, max]: [DVec3; 2], [lower, upper]: [DVec3; 2]) -> [DVec3; 2] {
    [min.min(lower), max.max(upper)]
}

/// A box around an instance.
fn bounds(posed: &PosedInstance<'_>) -> Option<[DVec3; 2]> {
    let own = Bounds::of_points(&posed.positions);
    let corners = if own.is_empty() { 0..0 } else { 0..8 };
    let corners = corners.map(|k: u32| {
        let upper = glam::BVec3::new(k & 1 > 0, k & 2 > 0, k & 4 > 0);
        [posed.world.transform_point3(Vec3::select(upper, own.max, own.min).as_dvec3()); 2]
    });
    let balls = posed.spheres.iter().map(|(centre, shape)| {
        let reach = DVec3::from_array([0, 1, 2].map(|axis| shape.row(axis).length()));
        [*centre - reach, *centre + reach]
    });
    corners.chain(balls).filter(|[min, max]| min.is_finite() && max.is_finite()).reduce(around)
}

/// Perceptual roughness and metalness of a material, and the least metalness: its factors, times the texels of its texture as though all of
/// them were used alike.
fn surfaces(scene: &Scene, material: &Material) -> ([Histogram; 2], f64) {
    let [mut roughness, mut metalness] = [Histogram::default(); 2];
    let factors = [material.roughness, material.metalness].map(f64::from);
    let texture = material.metallic_roughness_texture.and_then(|used| scene.textures.get(used.texture as usize));
    let Some(texture) = texture else {
        roughness.add(factors[0], 1.0);
        metalness.add(factors[1], 1.0);
        return ([roughness, metalness], factors[1]);
    };
    let small = |mip: &usize| texture.mip_size(*mip).iter().all(|side| *side <= TEXELS);
    let texels = &texture.mips[(0..texture.mips.len()).find(small).unwrap_or(texture.mips.len() - 1)];
    let (weight, mut least) = (4.0 / texels.len() as f64, 1.0_f64);
    for texel in texels.chunks_exact(4) {
        let [rough, metal] = [1, 2].map(|channel| factors[channel - 1] * f64::from(texel[channel]) / 255.0);
        roughness.add(rough, weight);
        metalness.add(metal, weight);
        least = least.min(metal);
    }
    ([roughness, metalness], least)
}

/// Whether light may go straight through an instance. Of materials that are blended but cover all, none does.
pub(super) fn lets_light_through(scene: &Scene, instance: &Instance) -> bool {
    let material = &scene.materials[instance.material as usize];
    material.is_clear() || material.alpha == AlphaMode::Blend && !covers_all(scene, instance)
}

/// Whether the alpha of a blended instance is 1 everywhere.
fn covers_all(scene: &Scene, instance: &Instance) -> bool {
    let (material, mesh): (&Material, &Mesh) =
        (&scene.materials[instance.material as usize], &scene.meshes[instance.mesh as usize]);
    let texels = material.base_colour_texture.and_then(|used| scene.textures.get(used.texture as usize));
    let is_opaque = |mip: &Vec<u8>| mip.iter().skip(3).step_by(4).all(|alpha| *alpha == u8::MAX);
    material.base_colour.w >= 1.0
        && mesh.colours.iter().all(|colour| colour.w >= 1.0)
        && texels.is_none_or(|texture| texture.mips.first().is_none_or(is_opaque))
}

#[cfg(test)]
mod tests {
    use super::*;
    use crate::scene::{ColourSpace, Sphere, Supply, Texture, TextureUse, builtin, supply};
    use glam::Affine3A;

    fn ball(scene: &mut Scene, radius: f32, material: Material, at: Affine3A) {
        let (mesh, made) = (scene.meshes.len() as u32, scene.materials.len() as u32);
        scene.meshes.push(Mesh { spheres: vec![Sphere { centre: Vec3::ZERO, radius }], ..Mesh::default() });
        scene.materials.push(material);
        scene.instances.push(Instance::fixed("ball", mesh, made, at));
    }

    fn close(got: f64, wanted: f64) {
        assert!((got - wanted).abs() <= 1e-6 * wanted.abs(), "{got}, wanted {wanted}");
    }

    #[test]
    fn shares_are_by_area() {
        let mut scene = Scene::default();
        let plain = || Material { metalness: 0.0, roughness: 0.5, ..Material::default() };
        ball(&mut scene, 1.0, plain(), Affine3A::IDENTITY);
        let glowing = Material { emission: Vec3::splat(2.0), metalness: 1.0, roughness: 0.0, ..plain() };
        // Twice as large: four times the area.
        ball(
            &mut scene,
            1.0,
            glowing,
            Affine3A::from_scale(Vec3::splat(2.0)) * Affine3A::from_translation(Vec3::X * 5.0),
        );
        let facts = SceneFacts::new(&scene);
        close(facts.area, 20.0 * PI);
        close(facts.emissive_area, 16.0 * PI);
        close(facts.emissive_power, PI * 2.0 * 16.0 * PI);
        close(facts.diffuse, 0.2);
        close(facts.specular, 1.0);
        close(facts.metalness.from(0.9), 0.8);
        close(facts.roughness.from(0.5), 0.2);
        close(facts.roughness.0.iter().sum(), 1.0);
        assert_eq!(facts.bounds, Some([[-1.0, -2.0, -2.0], [12.0, 2.0, 2.0]]));
        assert_eq!((facts.instances, facts.triangles, facts.spheres), (2, 0, 2));
        assert!(facts.emits() && !facts.has_sky && !facts.lets_light_through && facts.moving == 0.0);
    }

    #[test]
    fn textures_count_texel_by_texel() {
        let mut scene = builtin("cornell").unwrap();
        let texture = scene.textures.len() as u32;
        // A quarter is rough metal, the rest smooth and none.
        let texels = [[0, 255, 255, 255], [0; 4], [0; 4], [0; 4]].concat();
        scene.textures.push(Texture::new("t".into(), [2, 2], ColourSpace::Linear, texels));
        let used = TextureUse { texture, sampler: 0, uv_set: 0, rows: [Vec3::X, Vec3::Y] };
        for material in &mut scene.materials {
            (material.roughness, material.metalness) = (1.0, 1.0);
            material.metallic_roughness_texture = Some(used);
        }
        let facts = SceneFacts::new(&scene);
        close(facts.metalness.from(0.9), 0.25);
        close(facts.roughness.from(0.9), 0.25);
        // All but the lamp, which is black.
        let lamp = (1.3 * 1.05) / 5.55_f64.powi(2);
        assert!(facts.diffuse < 1.0 && facts.diffuse > 1.0 - lamp, "{}", facts.diffuse);
    }

    /// A few look-ups per triangle miss a single texel that shines; the effect must not be idle for that.
    #[test]
    fn a_glow_that_look_ups_miss_still_emits() {
        let mut scene = builtin("cornell").unwrap();
        let texture = scene.textures.len() as u32;
        let mut texels = vec![[0, 0, 0, 255]; 64 * 64];
        texels[0] = [255; 4];
        scene.textures.push(Texture::new("t".into(), [64, 64], ColourSpace::Srgb, texels.concat()));
        let used = TextureUse { texture, sampler: 0, uv_set: 0, rows: [Vec3::X, Vec3::Y] };
        let glowing = Material { emission: Vec3::ONE, emission_texture: Some(used), ..Material::default() };
        for mesh in &mut scene.meshes {
            mesh.uv0.iter_mut().for_each(|uv| *uv = glam::Vec2::splat(0.5));
        }
        assert!(!SceneFacts::new(&scene).emits());
        scene.materials[0] = glowing;
        let facts = SceneFacts::new(&scene);
        assert!(facts.emits() && facts.emissive_power == 0.0, "{facts:?}");
        scene.materials[0].alpha = AlphaMode::Mask(0.5);
        scene.materials[0].base_colour.w = 0.25;
        assert!(!SceneFacts::new(&scene).emits(), "cut out whole");
    }

    #[test]
    fn lights_have_the_flux_of_their_shape() {
        let radiance = Vec3::ONE;
        let power = |light: Light| LightFacts::new(&light, 2.0).power;
        let centre = DVec3::ZERO;
        close(power(Light::Sphere { centre, radius: 0.5, radiance }), PI * PI);
        close(power(Light::Disc { centre, normal: Vec3::Y, radius: 1.0, radiance }), PI * PI);
        close(power(Light::Rectangle { centre, half_u: Vec3::X, half_v: Vec3::Z, radiance }), 4.0 * PI);
        close(power(Light::Point { position: centre, intensity: radiance, range: None }), 4.0 * PI);
        let sun = Light::Directional { direction: Vec3::NEG_Y, illuminance: radiance, angular_radius: 0.0 };
        close(power(sun), 4.0 * PI);
    }

    #[test]
    fn dimming_changes_what_shines() {
        let mut facts = SceneFacts::new(&builtin("cornell").unwrap());
        let full = facts.lights[0].power;
        for (factor, shine) in [(0.0, 0), (0.25, 1), (1.0, 1)] {
            facts.scale_light(0, factor);
            assert_eq!(facts.shining().count(), shine);
            close(facts.lights[0].power, full * f64::from(factor));
        }
        facts.scale_light(99, 0.0);
    }

    #[test]
    fn whatever_the_numbers_there_is_an_answer() {
        let huge = [1e-30, 1e-3, 1e30].map(|scale| Affine3A::from_scale(Vec3::splat(scale)));
        for at in huge.into_iter().chain([Affine3A::from_scale(Vec3::ZERO)]) {
            let mut scene = Scene::default();
            ball(&mut scene, 1.0, Material { emission: Vec3::splat(f32::MAX), ..Material::default() }, at);
            supply(&mut scene, Supply::All);
            let facts = SceneFacts::new(&scene);
            for number in [facts.area, facts.emissive_area, facts.diffuse, facts.specular, facts.metalness.from(0.0)] {
                assert!(number.is_finite() && number >= 0.0, "{at:?}: {facts:?}");
            }
        }
        assert_eq!(SceneFacts::new(&Scene::default()).area, 0.0);
    }
}
