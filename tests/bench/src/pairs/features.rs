//! The features to combine. A new effect is added as a line of [`FEATURES`].
use crate::FrameBenchError;
use glam::{DVec3, Vec3};
use magpie::config::{Config, Value};
use magpie::graph::Switches;
use magpie::prelude::Rays;
use magpie::scene::{Light, Scene};
use magpie_passes::Slots;

/// A feature that can be on or off.
#[derive(Clone, Copy, Debug, PartialEq, Eq)]
pub struct Feature {
    /// Name in the table and for `--only`.
    pub name: &'static str,
    /// Changes to the configuration; those that its implementations do not have are skipped.
    pub settings: &'static [&'static str],
    /// Backend for rays, if the feature sets one.
    pub rays: Option<Rays>,
    /// Whether the frame uses several queues.
    pub queues: bool,
    /// Whether six lights are added to the scene.
    pub lights: bool,
    /// Whether every surface gets a clear coat.
    pub coats: bool,
}

impl Feature {
    /// The unchanged configuration.
    pub const NONE: Self = Self { name: "", settings: &[], rays: None, queues: false, lights: false, coats: false };

    const fn set(name: &'static str, settings: &'static [&'static str]) -> Self {
        Self { name, settings, ..Self::NONE }
    }

    const fn traced(name: &'static str, rays: Rays) -> Self {
        Self { name, rays: Some(rays), ..Self::NONE }
    }
}

/// All features. Ambient occlusion by rays is included because its noise also goes through the denoisers.
pub const FEATURES: [Feature; 35] = [
    Feature::set("taa", &["post.anti_aliasing=taa"]),
    Feature::set("upsampling", &["post.anti_aliasing=taa", "post.resolution_scale=0.67"]),
    Feature::set("half shadows", &["shadows.resolution=half"]),
    Feature::set("half ao", &["stages.ao=ray-traced", "ao.resolution=half"]),
    Feature::set("svgf", &["shadows.denoiser=svgf"]),
    Feature::set("bilateral", &["shadows.denoiser=bilateral"]),
    Feature::set("blur", &["shadows.denoiser=recurrent-blur"]),
    Feature::set("no denoiser", &["shadows.denoiser=none"]),
    Feature::set("fixed history", &["shadows.adaptive=false"]),
    Feature::set("ray-traced ao", &["stages.ao=ray-traced"]),
    Feature::set("bilateral ao", &["stages.ao=ray-traced", "ao.denoiser=bilateral"]),
    Feature::set("blurred ao", &["stages.ao=ray-traced", "ao.denoiser=recurrent-blur"]),
    Feature::set("probes", &["stages.reflections=probe"]),
    Feature::set("traced reflections", &["stages.reflections=ray-traced"]),
    Feature::set(
        "quarter reflections",
        &["stages.reflections=ray-traced", "reflections.pixels_per_ray=4", "reflections.denoiser=pica-pica"],
    ),
    Feature::set(
        "blurred reflections",
        &["stages.reflections=ray-traced", "reflections.pixels_per_ray=4", "reflections.denoiser=recurrent-blur"],
    ),
    Feature::set("hybrid reflections", &["stages.reflections=hybrid"]),
    Feature::set("screen reflections", &["stages.reflections=screen-space"]),
    Feature::set("screen gi", &["stages.gi=screen-space"]),
    Feature::set("traced gi", &["stages.gi=ray-traced"]),
    Feature::set("resampled gi", &["stages.gi=restir"]),
    Feature::set("clusters", &["stages.direct=clustered", "direct.near=1"]),
    Feature::set("sampled lights", &["stages.direct=ris"]),
    Feature::set("resampled lights", &["stages.direct=restir"]),
    Feature::set("lights by the tree", &["stages.direct=light-tree"]),
    Feature::set("half surfels", &["gi.resolution=half"]),
    Feature::set("surfels at hits", &["stages.gi=ray-traced", "gi.cache=surfels"]),
    Feature::set("light of the sky", &["stages.gi=sky"]),
    Feature { coats: true, ..Feature::set("clear coats", &[]) },
    Feature::set("single scattering", &["gbuffer.multiple_scattering=false"]),
    Feature { lights: true, ..Feature::set("six lamps", &["shadows.most_lights=8"]) },
    Feature { queues: true, ..Feature::set("three queues", &[]) },
    Feature::traced("software", Rays::Software),
    Feature::traced("query", Rays::Query),
    Feature::traced("pipeline", Rays::Pipeline),
];

/// The `post` setting that averages over pixels, and so decides which ground truth a picture is compared with.
const SAMPLED_OVER: &str = "post.anti_aliasing=taa";
/// Settings of a ground truth: many rays, no denoiser, full resolution.
const TRUE: [&str; 13] = [
    "shadows.rays=8",
    "shadows.most_lights=8",
    "shadows.denoiser=none",
    "shadows.resolution=full",
    "ao.rays=8",
    "ao.denoiser=none",
    "ao.resolution=full",
    "reflections.rays=8",
    "reflections.pixels_per_ray=1",
    "reflections.denoiser=none",
    "gi.rays=8",
    "gi.denoiser=none",
    "post.resolution_scale=1",
];

/// The configuration with changes; settings that the slot's implementation does not have are skipped.
fn change<'a>(config: &Config, changes: impl IntoIterator<Item = &'a str>) -> Result<Config, FrameBenchError> {
    let catalogue = Slots::default().catalogue();
    let mut config = config.clone();
    let changes: Vec<&str> = changes.into_iter().collect();
    // Implementations first, as they decide which settings exist.
    for stage in changes.iter().filter(|change| change.starts_with("stages.")) {
        config.set(stage)?;
    }
    for change in changes.iter().filter(|change| !change.starts_with("stages.")) {
        let mut with = config.clone();
        with.set(change)?;
        if catalogue.check(&with, "bench pairs").is_ok() {
            config = with;
        }
    }
    catalogue.check(&config, "bench pairs")?;
    Ok(config)
}

/// Whether a configuration, with its presets and defaults, has this value.
fn has(config: &Config, slot: &str, key: &str, value: &Value) -> bool {
    let full = Slots::default().catalogue().complete(config);
    full.settings.get(slot).and_then(|settings| settings.get(key)) == Some(value)
}

/// Whether presets or settings average over pixels.
pub fn is_anti_aliased(config: &Config) -> bool {
    has(config, "post", "anti_aliasing", &Value::Text("taa".to_owned()))
}

/// Whether light scatters but once between microfacets. That is another model of surfaces, not an error.
pub fn is_single_scattering(config: &Config) -> bool {
    has(config, "gbuffer", "multiple_scattering", &Value::Bool(false))
}

/// Which slots that can do without rays trace them, or do as if: their ground truth is another one then.
#[derive(Clone, Copy, Debug, PartialEq, Eq, PartialOrd, Ord)]
pub struct Traced {
    ao: bool,
    reflections: bool,
}

impl Traced {
    /// What a configuration traces.
    pub fn of(config: &Config) -> Self {
        let full = Slots::default().catalogue().complete(config);
        let is = |slot, names: &[&str]| full.stages.get(slot).is_some_and(|name| names.contains(&name.as_str()));
        // Probes and what is found on the screen stand for what rays find.
        Self {
            ao: is("ao", &["ray-traced"]),
            reflections: is("reflections", &["ray-traced", "probe", "screen-space", "hybrid"]),
        }
    }
}

/// The configuration without noise, sampled at pixel centres or averaged over pixels.
pub fn settle(
    config: &Config,
    anti_aliased: bool,
    traced: Traced,
    single_scattering: bool,
) -> Result<Config, FrameBenchError> {
    let sampled = if anti_aliased { SAMPLED_OVER } else { "post.anti_aliasing=none" };
    let ao = traced.ao.then_some("stages.ao=ray-traced");
    let reflections = traced.reflections.then_some("stages.reflections=ray-traced");
    let scattering = single_scattering.then_some("gbuffer.multiple_scattering=false");
    change(config, TRUE.into_iter().chain([sampled]).chain(ao).chain(reflections).chain(scattering))
}

/// The changes of two features; `None` if they set the same setting differently.
pub fn combine(
    config: &Config,
    rays: Rays,
    [first, second]: [&Feature; 2],
) -> Result<Option<(Config, Rays, Switches)>, FrameBenchError> {
    let key = |setting: &str| setting.split_once('=').map(|(key, _)| key.to_owned());
    let opposed = first.settings.iter().any(|a| second.settings.iter().any(|b| key(a) == key(b) && a != b));
    let ways = first.rays.is_some() && second.rays.is_some() && first.rays != second.rays;
    if opposed || ways {
        return Ok(None);
    }
    let config = change(config, first.settings.iter().chain(second.settings).copied())?;
    let mut switches = Switches::default();
    if first.queues || second.queues {
        switches.set("queues=3");
    }
    Ok(Some((config, first.rays.or(second.rays).unwrap_or(rays), switches)))
}

/// The scene with a clear coat on every surface.
pub fn coat(scene: &Scene) -> Scene {
    let mut scene = scene.clone();
    scene.materials.iter_mut().for_each(|m| (m.clearcoat, m.clearcoat_roughness) = (1.0, 0.1));
    scene
}

/// Adds six lights around the point that the camera looks at, each about a third as bright there as the sun.
pub fn light_up(scene: &Scene) -> Scene {
    let mut scene = scene.clone();
    let Some(camera) = scene.cameras.first() else { return scene };
    let forward = -camera.world_from_camera.matrix3.z_axis;
    // The near plane is at a thousandth of the distance to the point that the camera looks at.
    let away = 1e3 * f64::from(camera.near);
    let centre = camera.eye() + forward * away;
    let sun = scene.lights.iter().find_map(|light| match light {
        Light::Directional { illuminance, .. } => Some(illuminance.max_element()),
        _ => None,
    });
    let radius = 0.03 * away;
    for k in 0..6 {
        let angle = f64::from(k) * std::f64::consts::TAU / 6.0;
        let place = centre + DVec3::new(0.5 * angle.cos(), 0.5, 0.5 * angle.sin()) * away;
        let distance = 0.5 * std::f64::consts::SQRT_2 * away;
        let radiance = 0.3 * f64::from(sun.unwrap_or(10.0)) * (distance / radius).powi(2) / std::f64::consts::PI;
        let colour = Vec3::new(1.0, 0.6 + 0.08 * k as f32, 0.4 + 0.12 * k as f32);
        scene.lights.push(Light::Sphere { centre: place, radius: radius as f32, radiance: colour * radiance as f32 });
    }
    scene.light_nodes.resize(scene.lights.len(), None);
    scene
}

#[cfg(test)]
mod tests {
    use super::*;

    fn feature(name: &str) -> &'static Feature {
        FEATURES.iter().find(|f| f.name == name).unwrap()
    }

    #[test]
    fn what_excludes_each_other_is_no_pair() {
        let pair = |a, b| combine(&Config::default(), Rays::Software, [feature(a), feature(b)]).unwrap().is_some();
        assert!(!pair("svgf", "bilateral") && !pair("software", "query"));
        assert!(pair("taa", "upsampling") && pair("taa", "svgf") && pair("six lamps", "three queues"));
    }

    #[test]
    fn every_feature_changes_something_or_is_the_default() {
        let plain = combine(&Config::default(), Rays::Software, [&Feature::NONE; 2]).unwrap().unwrap();
        for feature in &FEATURES {
            let (config, rays, switches) =
                combine(&Config::default(), Rays::Software, [feature, &Feature::NONE]).unwrap().unwrap();
            let changes = config != plain.0 || rays != plain.1 || switches != plain.2;
            assert!(changes || feature.lights || feature.coats || feature.name == "software", "{}", feature.name);
            // Checks that settings are applied rather than skipped; those of `ao` exist for its ray-traced implementation only.
            for setting in feature.settings.iter().filter(|s| !s.starts_with("ao.")) {
                let mut with = config.clone();
                with.set(setting).unwrap();
                assert_eq!(with, config, "{}", feature.name);
            }
        }
    }
}
