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
            "How the edges of maps are filtered. `none`: one texel, hard and stepped. `pcf`: a box of texels, as soft everywhere. `pcss`: \
             as wide as the penumbra of the light, from a search of what casts it; lights without a size get the box.",
            "pcss",
            &["none", "pcf", "pcss"],
        )
        .sweep_all(),
        SettingSpec::float(
            "kernel",
            "texels",
            "Side of the box of `pcf`. Higher: softer and slower, and more of the dark seam where two lit surfaces meet.",
            3.0,
            (1.0, 9.0),
        ),
        SettingSpec::among(
            "taps",
            "",
            "Samples of a soft edge of a map, and of the search before it. Higher: less grain, slower.",
            16,
            &[8, 16, 32, 64],
        )
        .sweep([16_i64, 64]),
        SettingSpec::choice(
            "pattern",
            "Where `pcf` looks. `grid`: at every texel of its box, smooth. `noise`: at `taps` points of a disc, turned for each pixel; \
             grain, and less to read for a wide kernel. `pcss` always does that.",
            "grid",
            &["grid", "noise"],
        ),
        SettingSpec::among(
            "map_size",
            "texels",
            "Side of a cascade of the sun. Higher: finer edges, less that is unsure; memory and drawing grow with the square.",
            2048,
            &[512, 1024, 2048, 4096],
        )
        .sweep([512_i64, 2048]),
        SettingSpec::among(
            "lamp_map_size",
            "texels",
            "Side of the map of a spot, and of each face of the cube around another lamp.",
            1024,
            &[256, 512, 1024, 2048, 4096],
        ),
        SettingSpec::integer("cascades", "", "Maps of the sun, at most. Higher: finer near the camera.", 4, (1, 4)),
        SettingSpec::float(
            "split",
            "",
            "Where cascades end: at equal lengths (0), at equal factors (1), or between. Higher: finer near the camera, coarser far from it.",
            0.75,
            (0.0, 1.0),
        ),
        SettingSpec::float(
            "distance",
            "metres",
            "As far from the camera the sun has maps; beyond, it shines through everything. Higher: coarser.",
            200.0,
            (1.0, 1e6),
        ),
        SettingSpec::float(
            "blend",
            "",
            "Share of a cascade over which it goes over into the next. Higher: a softer change, and more pixels that look at two.",
            0.1,
            (0.0, 0.5),
        ),
        SettingSpec::float(
            "contact",
            "metres",
            "Length of a march through the depth buffer towards each light that has a map, for shadows of what is smaller than texels. \
             0: none. Higher: further, coarser, and more that is wrongly dark behind what the picture shows.",
            0.0,
            (0.0, 10.0),
        )
        .sweep([0.0, 0.1]),
        SettingSpec::integer(
            "contact_steps",
            "",
            "Steps of that march. Higher: thinner things cast contact shadows; slower.",
            16,
            (4, 64),
        ),
        SettingSpec::switch(
            "doubts",
            "Maps also say where they are not to be trusted, for `--view shadows.map_look:unsure`; `hybrid` always asks.",
            false,
        ),
        SettingSpec::float(
            "coarse",
            "pixels",
            "How wide a texel of a map may be on the screen before `hybrid` no longer trusts the edges near it.",
            1.0,
            (0.0, 1000.0),
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
