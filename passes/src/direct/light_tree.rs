//! `light-tree`: a light of each cluster into which the light tree is split, with a shadow ray each, and a denoiser. Directional lights are
//! evaluated at every pixel.
use super::light_change::LightChange;
use super::lobes::{self, Lobes, Reflected};
use super::shade::{self, Lights, Shade};
use crate::contracts::{Channel, DirectIn, DirectOut, RAY_START};
use crate::parts::denoise::{self, Hints};
use crate::parts::light_tree;
use crate::precision;
use crate::ray_kernels::RayKernels;
use magpie::prelude::*;
use magpie::scene::{LightKind, SceneFacts};
use magpie::slot::{Build, Needs, SettingSpec, Settings, SlotError};
use magpie_shaders::direct::TreeLightParams;
use magpie_shaders::light_tree::LightSplit;
use magpie_shaders::{DIRECT_TINTED_TREE_RAY, DIRECT_TREE_RAY};

/// What shading reads beside what rays start from.
const MATERIAL: &[Channel] = &[Channel::BaseColour, Channel::Material, Channel::Coat];

/// Settings of the choice of lights.
pub fn own_settings() -> Vec<SettingSpec> {
    let lobe =
        "Roughness below which a ray along the specular lobe finds what smooth surfaces reflect of lights. 0: never.";
    let mut settings = light_tree::split_settings(4).to_vec();
    settings.push(SettingSpec::float("lobe", "", lobe, 0.5, 0.0..=1.0).sweep([0.0, 0.25, 0.5]));
    settings
}

/// All settings.
pub fn settings() -> Vec<SettingSpec> {
    let mut settings = own_settings();
    settings.push(SettingSpec { sweep: Vec::new(), ..shade::area() });
    settings.extend(lobes::settings(lobes::SMOOTH));
    settings.push(denoise::adaptive_to_lamps());
    settings.push(precision::setting());
    settings
}

/// Lights that the tree chooses.
pub struct TreeLights {
    trace: RayKernels,
    split: LightSplit,
    /// Roughness below which there is a ray along the lobe.
    lobe: f32,
    change: LightChange,
    lobes: Lobes,
    shade: Shade,
}

impl TreeLights {
    /// Creates the pipelines.
    pub fn new(build: &Build<'_>, settings: &Settings) -> Result<Self, SlotError> {
        let (split, lobe) = (light_tree::split(settings)?, settings.f32("lobe")?);
        // LIGHT_TREE, MOST_CLUSTERS, HAS_LOBE_RAYS: what a scene does not call for takes no registers.
        let [rough, smooth] = [[1, split.most, 0], [1, split.most, 1]];
        let (clear, tinted) = (&DIRECT_TREE_RAY, &DIRECT_TINTED_TREE_RAY);
        Ok(Self {
            trace: RayKernels::with_constants(build, clear, tinted, [&rough, &smooth])?,
            split,
            lobe,
            change: LightChange::new(build, settings)?,
            lobes: Lobes::new(build, settings, true)?,
            shade: Shade::new(build, settings)?,
        })
    }

    /// Adds the rays and the denoisers. `None` in scenes without a light for the tree.
    fn light(&self, g: &mut FrameGraph, view: &View, i: DirectIn) -> Option<Reflected> {
        let (lights, tree) = (i.scene.lights?, i.scene.light_tree?);
        let has_lobe_rays = view.facts.has_smooth(self.lobe);
        let (kernel, block) = (self.trace.of_scene_with(view, has_lobe_rays), view.block);
        let (split, widest_alpha) = (self.split, self.lobe.powi(2));
        let noisy = g.pass("direct.tree", Queue::AsyncCompute, |p| {
            let (block, scene) = (p.read(block), i.scene.trace(p));
            let (lights, tree) = (p.read(lights), p.read(tree));
            let gbuffer = i.gbuffer.read(p, &[RAY_START, MATERIAL].concat());
            let (noisy, targets) = self.lobes.create(p, &view.facts, i);
            let extent = p.extent(i.gbuffer.depth);
            (noisy, move |c: &mut Record<'_>| {
                let params = TreeLightParams {
                    view: c.id(block),
                    scene: c.id(scene.root),
                    rays: c.rays(),
                    not_finite: c.not_finite(),
                    lights: c.id(lights),
                    tree: c.id(tree),
                    gbuffer: gbuffer.images(c),
                    lobes: targets.images(c),
                    split,
                    widest_alpha,
                };
                c.trace(kernel, scene.tlas, &params, extent);
            })
        });
        // A mirror's ray along the lobe meets the same lamp in every frame.
        let hints = Hints::default().sharp(has_lobe_rays).change(self.change.add(g, view, i));
        Some(self.lobes.denoise(g, view, i, noisy, hints))
    }
}

/// Whether there is anything that the tree holds.
fn has_local(facts: &SceneFacts) -> bool {
    facts.emits() || facts.lights.iter().any(|light| light.kind != LightKind::Directional)
}

impl Effect for TreeLights {
    type In = DirectIn;
    type Out = DirectOut;

    fn needs(&self, facts: &SceneFacts) -> Needs {
        let light_tree = has_local(facts);
        Needs { light_tables: light_tree, light_tree, samples_lamps: true, ..Needs::default() }
    }

    fn add(&mut self, g: &mut FrameGraph, view: &View, i: DirectIn) -> DirectOut {
        let lit = self.light(g, view, i);
        let any = view.facts.lights.iter().any(|light| light.kind == LightKind::Directional);
        self.shade.add(g, view, i, lit, if any { Lights::Directional } else { Lights::None })
    }
}
