//! Whether what fills a slot gives what the slot's contract in [`stages`](crate::stages) says: formats and sizes. An image that is not so is
//! a mistake of the frame, as any other in its declaration: nothing runs, and the message names slot, implementation and both.
use crate::stages::{AoOut, DirectOut, GBuffer, IndirectOut, PostOut, RaysOut, ShadowOut};
use magpie::graph::{Contract, Extent, Format, FrameGraph, Handle, Image, WriteHandle};
use magpie::stage::Filled;

const ONE: &[Format] = &[Format::R8Unorm, Format::R16Float, Format::R32Float];
/// Two numbers, or four where materials have a reflection of their own.
const MATERIAL: &[Format] =
    &[Format::Rg8Unorm, Format::Rg16Float, Format::Rg32Float, Format::Rgba16Snorm, Format::Rgba32Float];
/// Shares of lights in one, two or four channels.
const SHARES: &[Format] = &[
    Format::R8Unorm,
    Format::Rg8Unorm,
    Format::Rgba8Unorm,
    Format::R16Float,
    Format::Rg16Float,
    Format::Rgba16Float,
    Format::R32Float,
    Format::Rg32Float,
    Format::Rgba32Float,
];
const COLOUR: &[Format] = &[Format::Rgba8Srgb, Format::Rgba8Unorm, Format::Rgba16Float, Format::Rgba32Float];
const NORMAL: &[Format] = &[Format::Rgba16Snorm, Format::Rgba16Float, Format::Rgba32Float];
const DIRECTION: &[Format] = &[Format::Rg16Float, Format::Rg32Float];
const RADIANCE: &[Format] = &[Format::Rgba32Float, Format::Rgba16Float];

/// What a slot gives.
pub trait Gives {
    /// Its images, each with its name in the contract and the formats that it may have.
    fn images(&self) -> Vec<(&'static str, Handle<Image>, &'static [Format])>;
}

/// Compares what the implementation in a slot has given with the contract: every image is `extent` large.
pub fn keep<In, T: Gives>(g: &mut FrameGraph, slot: &str, filled: &Filled<In, impl Sized>, gives: &T, extent: Extent) {
    for (output, image, formats) in gives.images() {
        g.check_contract(image, Contract { slot, implementation: filled.implementation(), output, formats, extent });
    }
}

impl Gives for GBuffer {
    fn images(&self) -> Vec<(&'static str, Handle<Image>, &'static [Format])> {
        vec![
            ("depth", self.depth, &[Format::D32Float]),
            ("base_colour", self.base_colour, COLOUR),
            ("normal", self.normal, NORMAL),
            ("material", self.material, MATERIAL),
            ("emission", self.emission, RADIANCE),
            ("motion", self.motion, DIRECTION),
            ("ids", self.ids, &[Format::Rg32Uint]),
        ]
    }
}

impl Gives for RaysOut {
    fn images(&self) -> Vec<(&'static str, Handle<Image>, &'static [Format])> {
        self.colours.map(|image| ("colours", image, &[Format::Rgba8Unorm][..])).into_iter().collect()
    }
}

impl Gives for ShadowOut {
    fn images(&self) -> Vec<(&'static str, Handle<Image>, &'static [Format])> {
        self.groups.iter().flatten().map(|group| ("visibility", group.visibility, SHARES)).collect()
    }
}

impl Gives for AoOut {
    fn images(&self) -> Vec<(&'static str, Handle<Image>, &'static [Format])> {
        let openness = self.openness.map(|image| ("openness", image, ONE));
        openness.into_iter().chain(self.bent_normal.map(|image| ("bent_normal", image, DIRECTION))).collect()
    }
}

impl Gives for DirectOut {
    fn images(&self) -> Vec<(&'static str, Handle<Image>, &'static [Format])> {
        self.radiance.images()
    }
}

impl Gives for IndirectOut {
    fn images(&self) -> Vec<(&'static str, Handle<Image>, &'static [Format])> {
        self.radiance.map(|image| ("radiance", image, RADIANCE)).into_iter().collect()
    }
}

/// Slot `compose`.
impl Gives for WriteHandle<Image> {
    fn images(&self) -> Vec<(&'static str, Handle<Image>, &'static [Format])> {
        self.read().images()
    }
}

/// Slot `sky`.
impl Gives for Handle<Image> {
    fn images(&self) -> Vec<(&'static str, Handle<Image>, &'static [Format])> {
        vec![("radiance", *self, RADIANCE)]
    }
}

impl Gives for PostOut {
    fn images(&self) -> Vec<(&'static str, Handle<Image>, &'static [Format])> {
        vec![("radiance", self.radiance, RADIANCE), ("display", self.display, &[Format::Rgba8Unorm])]
    }
}
