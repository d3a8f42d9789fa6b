//! Draws the environment map, or the analytic sky with the sun's disc, into background pixels.
use crate::contracts::{SkyIn, SkyOut};
use magpie::gpu::Kernel;
use magpie::prelude::*;
use magpie::scene::SceneFacts;
use magpie::slot::{Build, Needs, Slot, SlotError};
use magpie_shaders::SKY_FILL_COMP;
use magpie_shaders::sky::FillParams;

pub fn slot() -> Slot<SkyIn, SkyOut> {
    Slot::new("sky")
        .about("Background.")
        .with(
            "analytic",
            "The scene's environment map; without one, daylight (Preetham et al. 1999) with the sun's disc.",
            &[],
            |build, _| Ok(Box::new(Analytic::new(build)?)),
        )
        .with("off", "Black.", &[], |_, _| Ok(Box::new(Off)))
}

struct Off;

impl Effect for Off {
    type In = SkyIn;
    type Out = SkyOut;

    fn add(&mut self, _: &mut FrameGraph, _: &View, i: SkyIn) -> SkyOut {
        i.lit
    }
}

struct Analytic {
    fill: Kernel,
}

impl Analytic {
    fn new(build: &Build<'_>) -> Result<Self, SlotError> {
        Ok(Self { fill: build.kernel(&SKY_FILL_COMP)? })
    }
}

impl Effect for Analytic {
    type In = SkyIn;
    type Out = SkyOut;

    fn needs(&self, facts: &SceneFacts) -> Needs {
        if facts.has_sky { Needs::default() } else { Needs::idle("the scene has no sky") }
    }

    fn add(&mut self, g: &mut FrameGraph, view: &View, i: SkyIn) -> SkyOut {
        if !view.facts.has_sky {
            return i.lit;
        }
        let (kernel, block) = (self.fill, view.block);
        g.pass("sky.fill", Queue::Graphics, |p| {
            let (block, depth) = (p.read(block), p.sample(i.depth));
            let (extent, greatest) = (p.extent(i.depth), p.desc(i.lit.read()).format.greatest());
            let (lit, target) = p.overwrite(i.lit);
            (lit, move |c: &mut Record<'_>| {
                let params = FillParams { view: c.id(block), depth: c.id(depth), lit: c.id(target), greatest };
                c.dispatch(kernel, &params, extent);
            })
        })
    }
}
