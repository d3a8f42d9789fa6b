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
            "Number of frames after which the tree of a deforming mesh is rebuilt; in between it is refitted. Higher: cheaper frames, but \
             slower rays as the mesh deforms away from the pose of its last build. 0: never rebuilt.",
            i64::from(defaults.rebuild_every),
            0..=100_000,
        ),
        SettingSpec::choice(
            "top_level",
            "How the tree over instances is updated in frames where an instance moved. `rebuild`: fastest rays. `refit`: cheapest update, \
             with a rebuild every `rebuild_every` frames.",
            "rebuild",
            &["rebuild", "refit"],
        )
        .sweep_all(),
        SettingSpec::float(
            "cull_distance",
            "metres",
            "Rays ignore instances further than this from the camera. Lower: faster rays, missing shadows and reflections. 0: no limit.",
            0.0,
            0.0..=1e12,
        ),
        SettingSpec::float(
            "cull_frustum",
            "",
            "Rays ignore instances outside of a cone around the view direction: the camera's half angle times this factor. Lower: faster \
             rays, missing shadows and reflections of what is behind the camera. 0: no limit.",
            0.0,
            0.0..=100.0,
        ),
        SettingSpec::float(
            "cull_solid_angle",
            "steradians",
            "Rays ignore instances that cover less than this solid angle as seen from the camera. Higher: faster rays, missing shadows \
             and reflections of small objects. 0: no limit.",
            0.0,
            0.0..=12.6,
        ),
    ];
    let settings = [load_settings().as_slice(), settings.as_slice()].concat();
    Slot::new("acceleration").about("Updates deforming meshes and acceleration structures.").with(
        "two-level",
        "One tree per mesh and one over all instances.",
        &settings,
        |_, settings| Ok(Box::new(TwoLevel { policy: policy(settings)?, geometry: geometry(settings)? })),
    )
}

/// Settings that take effect when a scene is loaded.
fn load_settings() -> [SettingSpec; 2] {
    [
        SettingSpec::switch(
            "compaction",
            "Whether the driver's acceleration structures of meshes that do not deform are compacted when a scene is loaded. On: less \
             memory, longer loading.",
            true,
        ),
        SettingSpec::float(
            "ray_detail",
            "",
            "Fraction of the triangles that rays intersect, of each mesh that does not deform; chosen when a scene is loaded. Lower: less \
             memory and faster rays, but shadows and reflections of coarser shapes.",
            1.0,
            0.01..=1.0,
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
