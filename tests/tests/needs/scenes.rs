//! Scenes that lack something, and what their effects say of that.
use anyhow::{Context, Result, ensure};
use glam::{Affine3A, DVec3, Vec3};
use magpie::graph::Extent;
use magpie::measure::SlotReport;
use magpie::prelude::Rays;
use magpie::scene::{Light, Material, Scene};
use magpie_passes::{FramePlan, Slots, plan_frame};
use magpie_tests::fixtures;
use magpie_tests::harness::{builtin, config};

/// Pixels of a picture.
pub const SIZE: [u32; 2] = [64, 36];

/// A ball on a plane of this material, under a sun, without a sky.
pub fn still_life(material: Material) -> Scene {
    let mut scene = fixtures::scene("still life", fixtures::camera(DVec3::new(0.0, 1.5, 4.0), DVec3::ZERO));
    fixtures::add(&mut scene, fixtures::plane(4.0), material.clone(), Affine3A::IDENTITY);
    fixtures::add(&mut scene, fixtures::sphere(12), material, Affine3A::from_translation(Vec3::Y));
    scene.lights.push(fixtures::sun(Vec3::new(0.3, 1.0, 0.4).normalize()));
    scene
}

pub fn with_sky(mut scene: Scene) -> Scene {
    scene.environment = Some(fixtures::environment());
    scene
}

pub fn plan(scene: &Scene, changes: &[&str]) -> Result<FramePlan> {
    let extent = Extent::new(SIZE[0], SIZE[1]);
    Ok(plan_frame(scene, &scene.cameras[0], &Slots::default(), &config(changes)?, Rays::Software, extent)?)
}

pub fn slot<'a>(slots: &'a [SlotReport], name: &str) -> Result<&'a SlotReport> {
    slots.iter().find(|report| report.slot == name).with_context(|| format!("no slot {name}"))
}

/// `None` where it runs.
pub fn reason(plan: &FramePlan, name: &str) -> Result<Option<String>> {
    if let Some((slot_name, part_name)) = name.split_once('.') {
        let parts = &slot(&plan.slots, slot_name)?.parts;
        let part = parts.iter().find(|part| part.part == part_name).with_context(|| format!("no part {name}"))?;
        return Ok(part.reason.as_ref().map(|reason| reason.clone().into_owned()));
    }
    let report = slot(&plan.slots, name)?;
    ensure!(report.runs == report.reason.is_none(), "{report:?}");
    Ok(report.reason.as_ref().map(|reason| reason.clone().into_owned()))
}

pub const NO_SKY: Option<&str> = Some("the scene has no sky");
pub const NO_LIGHT: Option<&str> = Some("no light shines");
pub const NO_SURFACE: Option<&str> = Some("there is no surface");
pub const NO_EMITTER: Option<&str> = Some("no material emits");
pub const UNUSED: Option<&str> = Some("nothing reads what it makes");

/// Shadows, ao, emitters, gi, reflections, sky: why each is idle.
pub type Reasons = [Option<&'static str>; 6];
pub const EFFECTS: [&str; 6] = ["shadows", "ao", "direct.emitters", "gi", "reflections", "sky"];

pub fn scenes() -> Result<Vec<(&'static str, Scene, Reasons)>> {
    let matte = || fixtures::material([0.5; 3], 0.0, 0.6);
    let metal = || fixtures::material([0.9; 3], 1.0, 0.3);
    let glass = Material { transmission: 1.0, roughness: 0.0, ..fixtures::material([1.0; 3], 0.0, 0.0) };
    let lambert = Material { specular: 0.0, ..matte() };
    let glowing = Material { emission: Vec3::splat(4.0), ..matte() };
    let mut dark = still_life(glowing);
    dark.lights.clear();
    let mut unlit = still_life(matte());
    unlit.lights.clear();
    let mut black = still_life(matte());
    black.environment = Some(magpie::scene::Environment { scale: 0.0, ..fixtures::environment() });
    let mut switched_off = still_life(matte());
    switched_off.lights = vec![Light::Point { position: DVec3::Y, intensity: Vec3::ZERO, range: None }];
    let empty = fixtures::scene("empty", fixtures::camera(DVec3::Z, DVec3::ZERO));
    Ok(vec![
        ("courtyard", builtin("courtyard")?, [None, None, NO_EMITTER, None, None, None]),
        ("carousel", builtin("carousel")?, [None, None, NO_EMITTER, None, None, None]),
        ("cornell", builtin("cornell")?, [None, None, NO_EMITTER, None, NO_SKY, NO_SKY]),
        ("a sun", still_life(matte()), [None, None, NO_EMITTER, None, NO_SKY, NO_SKY]),
        ("no lights", unlit, [NO_LIGHT, UNUSED, NO_EMITTER, NO_LIGHT, NO_SKY, NO_SKY]),
        ("emission alone", dark, [NO_LIGHT, None, None, None, NO_SKY, NO_SKY]),
        ("a lamp of no strength", switched_off, [NO_LIGHT, UNUSED, NO_EMITTER, NO_LIGHT, NO_SKY, NO_SKY]),
        ("a black sky", black, [None, None, NO_EMITTER, None, NO_SKY, NO_SKY]),
        (
            "metal",
            with_sky(still_life(metal())),
            [None, None, NO_EMITTER, Some("all surfaces are metal, black or unlit"), None, None],
        ),
        (
            "Lambert",
            with_sky(still_life(lambert)),
            [None, None, NO_EMITTER, None, Some("no surface has a specular reflection"), None],
        ),
        ("glass", with_sky(still_life(glass)), [None, None, NO_EMITTER, None, None, None]),
        ("empty", with_sky(empty), [NO_LIGHT, NO_SURFACE, NO_EMITTER, NO_SURFACE, NO_SURFACE, None]),
    ])
}
