//! Reflections found on the screen: the march, confidence, radiance of the previous frame, and lobes.
#[path = "screen_space_reflections/blurs.rs"]
mod blurs;
#[path = "screen_space_reflections/light.rs"]
mod light;
#[path = "screen_space_reflections/marches.rs"]
mod marches;
#[path = "screen_space_reflections/rig.rs"]
mod rig;
#[path = "screen_space_reflections/work.rs"]
mod work;
