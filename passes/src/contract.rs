//! Whether what fills a slot gives what the slot's contract in [`stages`](crate::stages) says: formats and sizes. An image that is not so is
//! a mistake of the frame, as any other in its declaration: nothing runs, and the message names slot, implementation and both.
use crate::stages::{AoOut, DirectOut, GBuffer, IndirectOut, PostOut, RaysOut, ShadowOut};
use magpie::frame::View;
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

    /// The slot's image, for slots that have one; in it `None` where this implementation gives none.
    fn shown(&self) -> Option<Option<Handle<Image>>> {
        None
    }

    /// How large all of them are.
    fn extent(&self, g: &FrameGraph, _: &View) -> Extent {
        g.full()
    }
}

/// A slot that gives what its contract says.
pub trait Slotted<In, Out> {
    /// Adds the passes of what fills the slot, compares what it gives with the contract, and tells observers of the slot's image.
    fn give(&mut self, g: &mut FrameGraph, view: &View, input: In) -> Out;
}

impl<In, Out: Gives> Slotted<In, Out> for Filled<In, Out> {
    fn give(&mut self, g: &mut FrameGraph, view: &View, input: In) -> Out {
        let out = self.add(g, view, input);
        let (slot, implementation, extent) = (self.slot(), self.implementation(), out.extent(g, view));
        for (output, image, formats) in out.images() {
            g.check_contract(image, Contract { slot, implementation, output, formats, extent });
        }
        if let Some(image) = out.shown() {
            g.slot_image(slot, image);
        }
        out
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

    fn shown(&self) -> Option<Option<Handle<Image>>> {
        Some(self.groups[0].map(|group| group.visibility))
    }
}

impl Gives for AoOut {
    fn images(&self) -> Vec<(&'static str, Handle<Image>, &'static [Format])> {
        let openness = self.openness.map(|image| ("openness", image, ONE));
        openness.into_iter().chain(self.bent_normal.map(|image| ("bent_normal", image, DIRECTION))).collect()
    }

    fn shown(&self) -> Option<Option<Handle<Image>>> {
        Some(self.openness)
    }
}

impl Gives for DirectOut {
    fn images(&self) -> Vec<(&'static str, Handle<Image>, &'static [Format])> {
        self.radiance.images()
    }

    fn shown(&self) -> Option<Option<Handle<Image>>> {
        Some(Some(self.radiance.read()))
    }
}

impl Gives for IndirectOut {
    fn images(&self) -> Vec<(&'static str, Handle<Image>, &'static [Format])> {
        self.radiance.map(|image| ("radiance", image, RADIANCE)).into_iter().collect()
    }

    fn shown(&self) -> Option<Option<Handle<Image>>> {
        Some(self.radiance)
    }
}

/// Slot `compose`.
impl Gives for WriteHandle<Image> {
    fn images(&self) -> Vec<(&'static str, Handle<Image>, &'static [Format])> {
        self.read().images()
    }

    fn shown(&self) -> Option<Option<Handle<Image>>> {
        Some(Some(self.read()))
    }
}

/// Slot `sky`.
impl Gives for Handle<Image> {
    fn images(&self) -> Vec<(&'static str, Handle<Image>, &'static [Format])> {
        vec![("radiance", *self, RADIANCE)]
    }

    fn shown(&self) -> Option<Option<Handle<Image>>> {
        Some(Some(*self))
    }
}

impl Gives for PostOut {
    fn images(&self) -> Vec<(&'static str, Handle<Image>, &'static [Format])> {
        vec![("radiance", self.radiance, RADIANCE), ("display", self.display, &[Format::Rgba8Unorm])]
    }

    fn shown(&self) -> Option<Option<Handle<Image>>> {
        Some(Some(self.display))
    }

    fn extent(&self, _: &FrameGraph, view: &View) -> Extent {
        view.output
    }
}
