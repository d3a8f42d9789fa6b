//! Settings of shadow maps.
use super::cascades::Division;
use magpie::slot::{SettingSpec, Settings, SlotError};
use magpie_shaders::shadow_map::{MAP_FILTER_NONE, MAP_FILTER_PCF, MAP_FILTER_PCSS};

/// The values of the settings.
#[derive(Clone, Copy, Debug)]
pub struct MapOptions {
    /// `MAP_FILTER_*`.
    pub filter: u32,
    /// Width of the PCF box, texels.
    pub kernel: f32,
    /// Samples of a soft shadow, and of its blocker search.
    pub taps: u32,
    /// The samples of PCF are points in a disc, rotated by per-pixel noise, instead of a grid.
    pub rotate: bool,
    /// Texels on a side of a cascade.
    pub sun_side: u32,
    /// Texels on a side of a layer of a local light.
    pub lamp_side: u32,
    /// How the view is divided into cascades.
    pub division: Division,
    /// Width of the transition to the next cascade, as a share of the half side of a cascade.
    pub blend: f32,
    /// Length of the contact shadow's march, metres; 0 for no contact shadows.
    pub contact: f32,
    /// Steps of its march.
    pub contact_steps: u32,
    /// Always output where the maps are unsure.
    pub always_classify: bool,
    /// Width of a texel, pixels, from which on an edge nearby is unsure.
    pub coarse: f32,
}

/// Settings of shadow maps.
pub fn settings() -> Vec<SettingSpec> {
    vec![
        SettingSpec::choice(
            "filter",
            "How the edges of shadow maps are filtered. `none`: one texel, with hard stepped edges. `pcf`: a box of constant width. \
             `pcss`: as wide as the light's penumbra, estimated by a search for occluders; lights without an extent get the box.",
            "pcss",
            &["none", "pcf", "pcss"],
        )
        .sweep_all(),
        SettingSpec::float(
            "kernel",
            "texels",
            "Side of the box of `pcf`. Higher: softer edges, more time, and a wider dark seam where two lit surfaces meet.",
            3.0,
            1.0..=9.0,
        ),
        SettingSpec::among(
            "taps",
            "",
            "Samples of `pcss`, for the occluder search and for the filter each, and of `pcf` with `pattern=noise`. Higher: less noise, more \
             time.",
            16,
            &[8, 16, 32, 64],
        )
        .sweep([16_i64, 64]),
        SettingSpec::choice(
            "pattern",
            "Sample positions of `pcf`. `grid`: every texel of the box, without noise. `noise`: `taps` points of a disc that is rotated \
             for each pixel; noisy, but cheaper for a wide box. `pcss` always uses the latter.",
            "grid",
            &["grid", "noise"],
        ),
        SettingSpec::among(
            "map_size",
            "texels",
            "Side of each cascade of directional light. Higher: finer edges and fewer unreliable pixels, with memory and drawing \
             proportional to the square.",
            2048,
            &[512, 1024, 2048, 4096],
        )
        .sweep([512_i64, 2048]),
        SettingSpec::among(
            "lamp_map_size",
            "texels",
            "Side of the map of a spot light, and of each cube face of another local light.",
            1024,
            &[256, 512, 1024, 2048, 4096],
        ),
        SettingSpec::integer("cascades", "", "Greatest number of cascades of directional light. Higher: finer near the camera.", 4, 1..=4),
        SettingSpec::float(
            "split",
            "",
            "How cascades divide the distance from the camera: 0 is linear, 1 logarithmic. Higher: finer near the camera, coarser far \
             from it.",
            0.75,
            0.0..=1.0,
        ),
        SettingSpec::float(
            "distance",
            "metres",
            "Distance from the camera up to which directional light has cascades; beyond it nothing is shadowed. Higher: coarser maps.",
            200.0,
            1.0..=1e6,
        ),
        SettingSpec::float(
            "blend",
            "",
            "Fraction of a cascade that is blended into the next one. Higher: a smoother transition, and more pixels that read two \
             cascades.",
            0.1,
            0.0..=0.5,
        ),
        SettingSpec::float(
            "contact",
            "metres",
            "Length of a march through the depth buffer towards each light that has a map, for shadows of objects that are smaller than \
             texels. 0: none. Higher: shadows of larger objects, with coarser steps and more false shadows behind foreground objects.",
            0.0,
            0.0..=10.0,
        )
        .sweep([0.0, 0.1]),
        SettingSpec::integer(
            "contact_steps",
            "",
            "Steps of the march of `contact`. Higher: contact shadows of thinner objects, more time.",
            16,
            4..=64,
        ),
        SettingSpec::switch(
            "doubts",
            "Also writes which pixels of the maps are unreliable, for `--view shadows.map_look:unsure`. `hybrid` always does.",
            false,
        ),
        SettingSpec::float(
            "coarse",
            "pixels",
            "Width of a texel on the screen above which `hybrid` traces rays at the edges of shadows.",
            1.0,
            0.0..=1000.0,
        ),
    ]
}

impl MapOptions {
    /// Reads the settings.
    pub fn new(settings: &Settings) -> Result<Self, SlotError> {
        let filter = match settings.choice("filter")? {
            "none" => MAP_FILTER_NONE,
            "pcf" => MAP_FILTER_PCF,
            _ => MAP_FILTER_PCSS,
        };
        let division = Division {
            count: settings.u32("cascades")?,
            split: settings.f32("split")?.into(),
            distance: settings.f32("distance")?.into(),
        };
        Ok(Self {
            filter,
            kernel: settings.f32("kernel")?,
            taps: settings.u32("taps")?,
            rotate: settings.choice("pattern")? == "noise",
            sun_side: settings.u32("map_size")?,
            lamp_side: settings.u32("lamp_map_size")?,
            division,
            blend: settings.f32("blend")?,
            contact: settings.f32("contact")?,
            contact_steps: settings.u32("contact_steps")?,
            always_classify: settings.switch("doubts")?,
            coarse: settings.f32("coarse")?,
        })
    }
}
