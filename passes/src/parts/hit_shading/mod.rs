//! Shading at the hits of rays: direct light by sampling every kind of light, or all light that the previous frame saw there. The shader
//! code is `lib/hit_shading.glsl`, which the reference uses too.
use crate::contracts::{LightCache, LightCacheToken, LightingIn};
use magpie::graph::{Buffer, BufferToken, Handle, Image, PassBuilder, Record, SampleToken};
use magpie::scene::SceneFacts;
use magpie::slot::{Needs, SettingSpec};
use magpie_shaders::hit_shading::HitShadingParams;
use magpie_shaders::{Address, SampledImage};

/// Setting of everything that follows paths.
pub fn regularization() -> SettingSpec {
    let regularization = "Behind rough surfaces, small lights light smooth surfaces as rougher ones: lobes are at least this share as wide \
                          as the path was spread before. Higher: fewer bright specks, softer highlights within reflections. 0: off, which is exact.";
    SettingSpec::float("regularization", "", regularization, 0.25, 0.0..=1.0).sweep([0.0, 0.1, 0.25, 0.5])
}

/// Local lights from which on they are chosen by the [light tree](super::light_tree), and found by it along rays.
pub const LIGHTS_FOR_TREE: usize = 8;

/// Whether a scene has so many local lights that a tree over them pays.
#[must_use]
pub fn wants_tree(facts: &SceneFacts) -> bool {
    facts.lamps() >= LIGHTS_FOR_TREE
}

/// What shading at hits needs of a frame in any case.
#[must_use]
pub fn needs(facts: &SceneFacts) -> Needs {
    Needs { light_tables: true, light_tree: wants_tree(facts), ..Needs::default() }
}

/// What shading at hits reads of a frame.
#[derive(Clone, Copy, Debug)]
pub struct HitShading {
    lights: Handle<Buffer>,
    /// The tables of lights lead to it.
    tree: Option<Handle<Buffer>>,
    previous: Option<Previous>,
    cache: Option<LightCache>,
}

/// What the previous frame saw.
#[derive(Clone, Copy, Debug)]
struct Previous {
    radiance: Handle<Image>,
    guide: Handle<Image>,
}

impl HitShading {
    /// From what an effect is given. `None` unless it asked for [`needs`], or [`Needs::light_tables`] alone. With `reuse`,
    /// hits use the light of the previous frame, for which it has to ask for [`Needs::previous_radiance`]; without, they do not, even where
    /// another effect asked. Indirect light is that of [`LightingIn::cache`], where there is one.
    pub fn new(i: &LightingIn, reuse: bool) -> Option<Self> {
        let guide = i.reprojected.previous_guide;
        let previous = i.previous_radiance.filter(|_| reuse).map(|radiance| Previous { radiance, guide });
        Some(Self { lights: i.scene.lights?, tree: i.scene.light_tree, previous, cache: i.cache })
    }

    /// The same with the light of another cache.
    #[must_use]
    pub fn with_cache(self, cache: Option<LightCache>) -> Self {
        Self { cache, ..self }
    }

    /// Declares that a pass shades hits. It also has to declare that it [traces](crate::contracts::SceneHandles::trace).
    pub fn read(self, p: &mut PassBuilder<'_>) -> HitShadingToken {
        let previous = self.previous.map(|previous| (p.sample(previous.radiance), p.sample(previous.guide)));
        if let Some(tree) = self.tree {
            p.read(tree);
        }
        HitShadingToken { lights: p.read(self.lights), previous, cache: self.cache.map(|cache| cache.read(p)) }
    }
}

/// What a pass declared with [`HitShading::read`].
#[derive(Clone, Copy, Debug)]
pub struct HitShadingToken {
    lights: BufferToken,
    previous: Option<(SampleToken, SampleToken)>,
    cache: Option<LightCacheToken>,
}

impl HitShadingToken {
    /// The block for the parameters of the shader.
    pub fn params(self, c: &Record<'_>) -> HitShadingParams {
        let image = |token: Option<SampleToken>| token.map_or(SampledImage::NONE, |token| c.id(token));
        let (radiance, guide) = self.previous.unzip();
        HitShadingParams {
            lights: c.id(self.lights),
            cache: self.cache.map_or(Address::default(), |token| token.address(c)),
            previous_radiance: image(radiance),
            previous_guide: image(guide),
        }
    }
}
