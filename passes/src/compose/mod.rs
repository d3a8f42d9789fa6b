//! The sum of direct light, diffuse and specular indirect light. Without indirect light there is no pass.
use crate::contracts::ComposeIn;
use crate::precision;
use magpie::gpu::Kernel;
use magpie::prelude::*;
use magpie::slot::{Build, Settings, Slot, SlotError};
use magpie_shaders::COMPOSE_SUM_COMP;
use magpie_shaders::compose::{NO_INPUT, SumParams};

pub fn slot() -> Slot<ComposeIn, WriteHandle<Image>> {
    Slot::new("compose").about("Sum of all light.").with(
        "sum",
        "Direct light, gi and reflections, added.",
        &[precision::setting()],
        |build, settings| Ok(Box::new(Sum::new(build, settings)?)),
    )
}

struct Sum {
    kernel: Kernel,
    format: Format,
}

impl Sum {
    fn new(build: &Build<'_>, settings: &Settings) -> Result<Self, SlotError> {
        let kernel = build.kernel(&COMPOSE_SUM_COMP)?;
        Ok(Self { kernel, format: precision::format(settings)? })
    }
}

impl Effect for Sum {
    type In = ComposeIn;
    type Out = WriteHandle<Image>;

    fn add(&mut self, g: &mut FrameGraph, _: &View, i: ComposeIn) -> WriteHandle<Image> {
        if i.gi.radiance.is_none() && i.reflections.radiance.is_none() {
            return i.direct.radiance;
        }
        let (kernel, format) = (self.kernel, self.format);
        g.pass("compose.sum", Queue::Graphics, |p| {
            let direct = p.sample(i.direct.radiance.read());
            let gi = i.gi.radiance.map(|h| p.sample(h));
            let reflections = i.reflections.radiance.map(|h| p.sample(h));
            let extent = p.extent(i.direct.radiance.read());
            let desc = ImageDesc::like(format, i.direct.radiance.read());
            let (lit, target) = p.create("lit", desc);
            (lit, move |c: &mut Record<'_>| {
                let params = SumParams {
                    direct: c.id(direct),
                    gi: gi.map_or(NO_INPUT, |t| c.id(t).index()),
                    reflections: reflections.map_or(NO_INPUT, |t| c.id(t).index()),
                    lit: c.id(target),
                    greatest: format.greatest(),
                    size: [extent.width, extent.height],
                };
                c.dispatch(kernel, &params, extent);
            })
        })
    }
}
