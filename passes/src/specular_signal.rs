//! Noisy light of specular lobes, with what its denoiser is told of it.
use crate::contracts::{GBuffer, Reprojected};
use crate::parts::denoise::{Content, DenoiseIn, Hints, Signal, Surfaces};
use magpie::graph::{PassBuilder, StorageToken};
use magpie::prelude::*;

/// Format of hit distances.
const DISTANCE: Format = Format::R16Float;
/// Format of the width of the lobe.
const WIDTH: Format = Format::R8Unorm;

/// Images of the size of the frame.
#[derive(Clone, Copy)]
pub struct SpecularSignal {
    /// Radiance over the albedo of the specular lobes.
    pub radiance: Handle<Image>,
    /// Distance to what is reflected, metres.
    pub hit_distance: Handle<Image>,
    /// Width of the lobe on the screen, pixels over [`WIDEST_NOISE`](magpie_shaders::denoise::WIDEST_NOISE).
    pub width: Handle<Image>,
}

/// The same for the pass that writes them.
#[derive(Clone, Copy)]
pub struct SpecularTargets {
    pub radiance: StorageToken,
    pub hit_distance: StorageToken,
    pub width: StorageToken,
}

impl SpecularSignal {
    /// Declares that the pass makes the images; `name` is that of the radiance.
    pub fn create(p: &mut PassBuilder<'_>, name: &str, format: Format, like: Handle<Image>) -> (Self, SpecularTargets) {
        let mut create = |name, format| p.create(name, ImageDesc::like(format, like));
        let (radiance, radiance_target) = create(name, format);
        let (hit_distance, distance_target) = create("hit_distance", DISTANCE);
        let (width, width_target) = create("width", WIDTH);
        let targets = SpecularTargets { radiance: radiance_target, hit_distance: distance_target, width: width_target };
        (Self { radiance: radiance.read(), hit_distance: hit_distance.read(), width: width.read() }, targets)
    }

    /// As a denoiser takes it.
    pub fn noisy(self, gbuffer: GBuffer, reprojected: Reprojected) -> DenoiseIn {
        DenoiseIn {
            signal: Signal { image: self.radiance, content: Content::Radiance },
            surfaces: Surfaces { gbuffer, reprojected },
            hints: Hints::default().width(Some(self.width)).hit_distance(Some(self.hit_distance)),
        }
    }
}
