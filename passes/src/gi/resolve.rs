//! Multiplies light with the albedo of the diffuse lobe, at full resolution; denoised before where it is noisy.
use super::MATERIAL;
use crate::contracts::{Channel, LightingIn};
use crate::parts::denoise::{Content, DenoiseIn, Denoiser, Hints, Options, Signal, Surfaces};
use crate::precision;
use magpie::gpu::Kernel;
use magpie::prelude::*;
use magpie::slot::{Build, Settings, SlotError};
use magpie_shaders::GI_RESOLVE_COMP;
use magpie_shaders::gi::ResolveParams;

/// The last pass of implementations that denoise light without the albedo of what it falls on.
pub struct Resolve {
    kernel: Kernel,
    format: Format,
}

impl Resolve {
    /// Creates the pipeline. `format`: of the radiance that the slot gives.
    pub fn new(build: &Build<'_>, format: Format) -> Result<Self, SlotError> {
        Ok(Self { kernel: build.kernel(&GI_RESOLVE_COMP)?, format })
    }

    /// Adds the pass, which writes to `kept`, an image of the size of the frame and of the format of the slot, or else to one of its own.
    pub fn add(
        &self,
        g: &mut FrameGraph,
        view: &View,
        i: LightingIn,
        denoised: Handle<Image>,
        kept: Option<WriteHandle<Image>>,
    ) -> Handle<Image> {
        let (kernel, block, format) = (self.kernel, view.block, self.format);
        g.pass("gi.resolve", Queue::AsyncCompute, |p| {
            let (block, denoised) = (p.read(block), p.sample(denoised));
            let gbuffer = i.gbuffer.read(p, &[&[Channel::Depth, Channel::Normal], MATERIAL].concat());
            let (radiance, target) = match kept {
                Some(kept) => p.write(kept),
                None => p.create("radiance", ImageDesc::like(format, i.gbuffer.depth)),
            };
            let extent = p.extent(i.gbuffer.depth);
            (radiance.read(), move |c: &mut Record<'_>| {
                let params = ResolveParams {
                    view: c.id(block),
                    gbuffer: gbuffer.images(c),
                    denoised: c.id(denoised),
                    radiance: c.id(target),
                    greatest: format.greatest(),
                };
                c.dispatch(kernel, &params, extent);
            })
        })
    }
}

/// Light of the frame with noise.
#[derive(Clone, Copy)]
pub struct Noisy {
    /// In the size of the frame.
    pub image: Handle<Image>,
    /// As [`Hints::change`].
    pub change: Option<Handle<Image>>,
}

/// The end of implementations whose light is noisy.
pub struct Finish {
    denoiser: Denoiser,
    resolve: Resolve,
}

impl Finish {
    /// Creates the pipelines, as the settings of the denoiser and of the precision say.
    pub fn new(build: &Build<'_>, settings: &Settings) -> Result<Self, SlotError> {
        Ok(Self {
            denoiser: Denoiser::new(build, "gi", Options::read(settings)?)?,
            resolve: Resolve::new(build, precision::format(settings)?)?,
        })
    }

    /// Adds the passes. `kept` as in [`Resolve::add`].
    pub fn add(
        &mut self,
        g: &mut FrameGraph,
        view: &View,
        i: LightingIn,
        noisy: Noisy,
        kept: Option<WriteHandle<Image>>,
    ) -> Handle<Image> {
        let noisy = DenoiseIn {
            signal: Signal { image: noisy.image, content: Content::Radiance },
            surfaces: Surfaces { gbuffer: i.gbuffer, reprojected: i.reprojected },
            hints: Hints::default().change(noisy.change),
        };
        let denoised = self.denoiser.add(g, view, noisy, "");
        self.resolve.add(g, view, i, denoised, kept)
    }
}
