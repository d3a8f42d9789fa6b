//! Ray kernels in variants for what a scene has.
use crate::parts::hit_shading::wants_tree;
use magpie::prelude::*;
use magpie::slot::{Build, SlotError};
use magpie_shaders::RayShader;

/// A kernel, and its variants for scenes with surfaces that let light straight through, and for something else that a scene has or has not: without
/// more, so many lights that a tree chooses among them (`LIGHT_TREE` of `lib/light_sampling.glsl`).
#[derive(Clone, Copy)]
pub struct RayKernels {
    clear: [RayKernel; 2],
    tinted: [RayKernel; 2],
}

/// Values of the specialization constants without and with a light tree.
pub const LIGHT_TREE: [&[u32]; 2] = [&[0], &[1]];

impl RayKernels {
    /// Describes all. Those that are not used are never made.
    ///
    /// # Errors
    /// [`SlotError`] if one could not be made.
    pub fn new(build: &Build<'_>, clear: &RayShader, tinted: &RayShader) -> Result<Self, SlotError> {
        Self::with_constants(build, clear, tinted, LIGHT_TREE)
    }

    /// The same with values of the specialization constants for scenes without and with something.
    ///
    /// # Errors
    /// As [`RayKernels::new`].
    pub fn with_constants(
        build: &Build<'_>,
        clear: &RayShader,
        tinted: &RayShader,
        [without, with]: [&[u32]; 2],
    ) -> Result<Self, SlotError> {
        let variants = |shader: &RayShader| -> Result<[RayKernel; 2], SlotError> {
            Ok([build.ray_variant(shader, without)?, build.ray_variant(shader, with)?])
        };
        Ok(Self { clear: variants(clear)?, tinted: variants(tinted)? })
    }

    /// That which the scene of a view needs.
    pub fn of(self, view: &View) -> RayKernel {
        self.of_scene_with(view, wants_tree(&view.facts))
    }

    /// That of a scene which has what [`RayKernels::with_constants`] tells apart, or has not.
    pub fn of_scene_with(self, view: &View, has: bool) -> RayKernel {
        let variants = if view.facts.lets_light_through { self.tinted } else { self.clear };
        variants[usize::from(has)]
    }
}
