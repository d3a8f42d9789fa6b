//! Brings the scene on the device up to date: uploads what moved, deforms skinned and morphing meshes, refits and builds acceleration
//! structures. The engine does the work ([`magpie::scene::ResidentScene::declare`]); this module holds the settings.
use crate::contracts::AccelerationIn;
use magpie::prelude::*;
use magpie::scene::{Culling, Policy, ResidentError, SceneFacts, SceneHandles};
use magpie::slot::{Geometry, Needs, SettingSpec, Settings, Slot, SlotError};

pub fn slot() -> Slot<AccelerationIn, Result<SceneHandles, ResidentError>> {
    let defaults = Policy::default();
    let settings = [
        SettingSpec::integer(
            "rebuild_every",
            "frames",
            "After so many frames a deforming mesh's tree is built anew; between them it is refitted. Higher: cheaper frames, \
             slower rays the further the mesh has bent. 0 never builds anew.",
            i64::from(defaults.rebuild_every),
            (0, 100_000),
        ),
        SettingSpec::choice(
            "top_level",
            "The tree over instances in frames where something moved: `rebuild` for the fastest rays, `refit` for the cheapest \
             update, with a rebuild every `rebuild_every` frames.",
            "rebuild",
            &["rebuild", "refit"],
        )
        .sweep_all(),
        SettingSpec::float(
            "cull_distance",
            "metres",
            "Rays do not see instances further from the eye. Lower: faster rays, missing shadows and reflections. 0 keeps all.",
            0.0,
            (0.0, 1e12),
        ),
        SettingSpec::float(
            "cull_frustum",
            "",
            "Rays do not see instances outside of the view, its half angle times this. Lower: faster rays, shadows and reflections of \
             what is behind the eye are missing. 0 keeps all.",
            0.0,
            (0.0, 100.0),
        ),
        SettingSpec::float(
            "cull_solid_angle",
            "steradians",
            "Rays do not see instances that look smaller than this from the eye. Higher: faster rays, small shadows and reflections \
             are missing. 0 keeps all.",
            0.0,
            (0.0, 12.6),
        ),
    ];
    let settings = [load_settings().as_slice(), settings.as_slice()].concat();
    Slot::new("acceleration").about("Brings moved and deformed meshes, and the trees that rays walk, up to date.").with(
        "two-level",
        "A tree per mesh and one over the instances.",
        &settings,
        |_, settings| Ok(Box::new(TwoLevel { policy: policy(settings)?, geometry: geometry(settings)? })),
    )
}

/// Settings that take effect when a scene is loaded.
fn load_settings() -> [SettingSpec; 2] {
    [
        SettingSpec::switch(
            "compaction",
            "The driver's trees over meshes that keep their shape are compacted when a scene is loaded: less memory, a longer load.",
            true,
        ),
        SettingSpec::float(
            "ray_detail",
            "",
            "Share of the triangles that rays see of each mesh that keeps its shape, when a scene is loaded. Lower: less memory and \
             faster rays; shadows and reflections of coarser shapes.",
            1.0,
            (0.01, 1.0),
        )
        .sweep([1.0, 0.5, 0.25]),
    ]
}

fn geometry(settings: &Settings) -> Result<Geometry, SlotError> {
    Ok(Geometry { compaction: settings.switch("compaction")?, ray_detail: settings.f32("ray_detail")? })
}

fn policy(settings: &Settings) -> Result<Policy, SlotError> {
    Ok(Policy {
        rebuild_every: settings.u32("rebuild_every")?,
        refit_top: settings.choice("top_level")? == "refit",
        culling: Culling {
            distance: settings.f32("cull_distance")?,
            frustum: settings.f32("cull_frustum")?,
            solid_angle: settings.f32("cull_solid_angle")?,
        },
    })
}

struct TwoLevel {
    policy: Policy,
    geometry: Geometry,
}

impl Effect for TwoLevel {
    type In = AccelerationIn;
    type Out = Result<SceneHandles, ResidentError>;

    fn needs(&self, _: &SceneFacts) -> Needs {
        Needs { geometry: Some(self.geometry), ..Needs::default() }
    }

    fn add(&mut self, g: &mut FrameGraph, _: &View, i: AccelerationIn) -> Self::Out {
        match i {
            AccelerationIn::Resident { scene, imports, camera } => {
                scene.borrow_mut().declare(g, &mut imports.borrow_mut(), Some(&camera), &self.policy)
            }
            AccelerationIn::Sketch(scene) => Ok(scene.declare(g)),
        }
    }
}
