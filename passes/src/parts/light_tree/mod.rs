//! The light tree: keeps the scene's hierarchy over lights fitted to where they are and to how they are dimmed. The shader code that chooses by it is
//! `lib/light_tree.glsl`.
use crate::contracts::AccelerationIn;
use magpie::gpu::Kernel;
use magpie::prelude::*;
use magpie::scene::{LightTreeUpdate, SceneHandles};
use magpie::slot::{Build, SettingSpec, Settings, SlotError};
use magpie_shaders::light_tree::{LightRefitParams, LightSplit, MOST_SPLIT_LIGHTS};
use magpie_shaders::{LIGHT_TREE_LAMPS_COMP, LIGHT_TREE_MESHES_COMP};

/// Workgroups per dimension that every Vulkan device supports (`maxComputeWorkGroupCount`).
const MAX_GROUPS: u32 = 65535;
/// Settings of [`split_settings`].
const SPLIT_LIGHTS: &str = "split_lights";
const SPLIT_THRESHOLD: &str = "split_threshold";

/// Brings the light tree of a scene up to date.
pub struct LightTree {
    meshes: Kernel,
    lamps: Kernel,
}

impl LightTree {
    /// Describes the pipelines.
    ///
    /// # Errors
    /// [`SlotError`] if one could not be made.
    pub fn new(build: &Build<'_>) -> Result<Self, SlotError> {
        let (meshes, lamps) = (build.kernel(&LIGHT_TREE_MESHES_COMP)?, build.kernel(&LIGHT_TREE_LAMPS_COMP)?);
        Ok(Self { meshes, lamps })
    }

    /// Adds the passes that refit what has changed since the frame before, and returns the scene with its tree. Without passes where nothing has
    /// changed, and without a tree where nobody wants one.
    pub fn add(&self, g: &mut FrameGraph, source: &AccelerationIn, scene: SceneHandles) -> SceneHandles {
        // A frame that is only planned shows a scene at rest, whose handles are complete.
        let AccelerationIn::Resident { scene: resident, imports, .. } = source else { return scene };
        let update = resident.borrow_mut().declare_light_tree(g, &mut imports.borrow_mut());
        update.map_or(scene, |update| self.refit(g, update, scene))
    }

    /// Adds the passes of one update, and returns the scene with its tree.
    pub fn refit(&self, g: &mut FrameGraph, update: LightTreeUpdate, scene: SceneHandles) -> SceneHandles {
        let mut tree = update.tree;
        // Meshes first: their roots are leaves of the tree over lamps and instances.
        let passes = [
            ("light_tree.meshes", self.meshes, update.mesh_groups),
            ("light_tree.lamps", self.lamps, update.lamp_groups),
        ];
        for (name, kernel, groups) in passes.into_iter().filter(|(.., groups)| *groups > 0) {
            tree = g.pass(name, Queue::Graphics, |p| {
                let root = scene.read(p);
                let (tree, target) = p.write_buffer(tree);
                let across = groups.min(MAX_GROUPS);
                (tree, move |c: &mut Record<'_>| {
                    let params = LightRefitParams { scene: c.id(root), tree: c.id(target), groups };
                    c.dispatch_groups(kernel, &params, [across, groups.div_ceil(across), 1]);
                })
            });
        }
        SceneHandles { light_tree: Some(tree.read()), ..scene }
    }
}

/// Settings of an effect that takes several lights at once by splitting the tree; `lights` of them where nothing is set.
pub fn split_settings(lights: i64) -> [SettingSpec; 2] {
    [
        SettingSpec::integer(
            SPLIT_LIGHTS,
            "",
            "Greatest number of lights per sample, one of each cluster into which the light tree is split. Higher: less noise, with time \
             proportional to the number. 1: the tree is not split.",
            lights,
            1..=i64::from(MOST_SPLIT_LIGHTS),
        )
        .sweep([1, 4, 16]),
        SettingSpec::float(
            SPLIT_THRESHOLD,
            "",
            "Relative variance of what a cluster of lights sends to a point above which it is split. Higher: fewer lights, more noise. 0: as many \
             as may be.",
            0.25,
            0.0..=1e6,
        ),
    ]
}

/// What [`split_settings`] are set to.
///
/// # Errors
/// [`SlotError`] for settings that are missing.
pub fn split(settings: &Settings) -> Result<LightSplit, SlotError> {
    Ok(LightSplit { threshold: settings.f32(SPLIT_THRESHOLD)?, most: settings.u32(SPLIT_LIGHTS)? })
}
