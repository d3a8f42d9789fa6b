//! Visualises the cost of ray traversal.
use crate::contracts::{RaysIn, RaysOut};
use magpie::prelude::*;
use magpie::slot::{Build, SettingSpec, Settings, Slot, SlotError};
use magpie_shaders::RAYS_HEAT_MAP_RAY;
use magpie_shaders::rays::HeatMapParams;

pub fn slot() -> Slot<RaysIn, RaysOut> {
    let hottest = SettingSpec::float(
        "hottest",
        "steps",
        "Traversal steps that are displayed as white. Lower: more contrast among cheap rays. Higher: more contrast among expensive rays.",
        100.0,
        1.0..=10_000.0,
    );
    Slot::new("rays")
        .about("Visualises the cost of ray traversal. Does not change the picture.")
        .with("off", "No visualisation.", &[], |_, _| Ok(Box::new(Off)))
        .with(
            "heat-map",
            "Traversal steps of one camera ray per pixel through Magpie's own trees: `--view rays.heat_map:colours`.",
            &[hottest],
            |build, settings| Ok(Box::new(HeatMap::new(build, settings)?)),
        )
}

struct Off;

impl Effect for Off {
    type In = RaysIn;
    type Out = RaysOut;

    fn add(&mut self, _: &mut FrameGraph, _: &View, _: RaysIn) -> RaysOut {
        RaysOut { colours: None }
    }
}

struct HeatMap {
    kernel: RayKernel,
    hottest: f32,
}

impl HeatMap {
    fn new(build: &Build<'_>, settings: &Settings) -> Result<Self, SlotError> {
        if build.rays != Rays::Software {
            let (slot, implementation) = ("rays", "heat-map");
            let reason = format!("the driver does not say how it walks: wanted rays by software, got {}", build.rays);
            return Err(SlotError::Unsuitable { slot, implementation, reason });
        }
        Ok(Self { kernel: build.ray_kernel(&RAYS_HEAT_MAP_RAY)?, hottest: settings.f32("hottest")? })
    }
}

impl Effect for HeatMap {
    type In = RaysIn;
    type Out = RaysOut;

    fn add(&mut self, g: &mut FrameGraph, view: &View, i: RaysIn) -> RaysOut {
        let (kernel, hottest, block) = (self.kernel, self.hottest, view.block);
        let colours = g.pass("rays.heat_map", Queue::AsyncCompute, |p| {
            let (block, scene) = (p.read(block), i.scene.trace(p));
            let (_, steps) = p.create("steps", ImageDesc::full(Format::Rg32Float));
            let (colours, shown) = p.create("colours", ImageDesc::full(Format::Rgba8Unorm));
            let extent = p.extent_of(ImageDesc::full(Format::Rgba8Unorm));
            (colours.read(), move |c: &mut Record<'_>| {
                let params = HeatMapParams {
                    view: c.id(block),
                    scene: c.id(scene.root),
                    rays: c.rays(),
                    steps: c.id(steps),
                    colours: c.id(shown),
                    hottest,
                };
                c.trace(kernel, scene.tlas, &params, extent);
            })
        });
        RaysOut { colours: Some(colours) }
    }
}
