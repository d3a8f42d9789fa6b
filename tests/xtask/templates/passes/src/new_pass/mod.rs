//! Natural vignetting: the light of a pixel falls with its angle from the optical axis. An example to be replaced.
use crate::contracts::{NewPassIn, NewPassOut};
use magpie::gpu::Kernel;
use magpie::prelude::*;
use magpie::slot::{Build, SettingSpec, Settings, Slot, SlotError};
use magpie_shaders::NEW_PASS_APPLY_COMP;
use magpie_shaders::new_pass::ApplyParams;

pub fn slot() -> Slot<NewPassIn, NewPassOut> {
    let settings = [
        SettingSpec::float("exposure", "stops", "Higher is brighter: each stop doubles the light.", 0.0, -8.0..=8.0),
        SettingSpec::float("falloff", "", "Higher is darker at the edges: 1 is a simple lens, 0 is even.", 1.0, 0.0..=1.0),
    ];
    Slot::new("new_pass")
        .about("What a lens does to the radiance that falls through it.")
        .with("example", "Falls with the fourth power of the cosine.", &settings, |build, settings| {
            Ok(Box::new(Example::new(build, settings)?))
        })
        .with("off", "No lens.", &[], |_, _| Ok(Box::new(Off)))
        .default_to("off")
}

struct Off;

impl Effect for Off {
    type In = NewPassIn;
    type Out = NewPassOut;

    fn add(&mut self, _: &mut FrameGraph, _: &View, i: NewPassIn) -> NewPassOut {
        NewPassOut { colour: i.colour }
    }
}

struct Example {
    apply: Kernel,
    exposure: f32,
    falloff: f32,
}

impl Example {
    fn new(build: &Build<'_>, settings: &Settings) -> Result<Self, SlotError> {
        let apply = build.kernel(&NEW_PASS_APPLY_COMP)?;
        Ok(Self { apply, exposure: settings.f32("exposure")?.exp2(), falloff: settings.f32("falloff")? })
    }
}

impl Effect for Example {
    type In = NewPassIn;
    type Out = NewPassOut;

    fn add(&mut self, g: &mut FrameGraph, view: &View, i: NewPassIn) -> NewPassOut {
        let (kernel, block, exposure, falloff) = (self.apply, view.block, self.exposure, self.falloff);
        let colour = g.pass("new_pass.apply", Queue::Graphics, |p| {
            let (block, source) = (p.read(block), p.sample(i.colour));
            let (colour, target) = p.create("colour", ImageDesc::like(Format::Rgba32Float, i.colour));
            let extent = p.extent(i.colour);
            (colour.read(), move |c: &mut Record<'_>| {
                let params =
                    ApplyParams { view: c.id(block), source: c.id(source), target: c.id(target), exposure, falloff };
                c.dispatch(kernel, &params, extent);
            })
        });
        NewPassOut { colour }
    }
}
