//! Whether what fills a slot gives what the slot's contract in [`contracts`](crate::contracts) says: formats and sizes. An image that is not so is
//! a mistake of the frame, as any other in its declaration: nothing runs, and the message names slot, implementation and both.
use magpie::frame::View;
use magpie::graph::{Contract, Extent, Format, FrameGraph, Handle, Idle, Image};
use magpie::slot::Implementation;

pub const ONE: &[Format] = &[Format::R8Unorm, Format::R16Unorm, Format::R16Float, Format::R32Float];
/// Two numbers, or four where materials have a reflection of their own.
pub const MATERIAL: &[Format] =
    &[Format::Rg8Unorm, Format::Rg16Float, Format::Rg32Float, Format::Rgba16Snorm, Format::Rgba32Float];
/// Shares of lights in one, two or four channels.
pub const SHARES: &[Format] = &[
    Format::R8Unorm,
    Format::Rg8Unorm,
    Format::Rgba8Unorm,
    Format::R16Unorm,
    Format::Rg16Unorm,
    Format::Rgba16Unorm,
    Format::R16Float,
    Format::Rg16Float,
    Format::Rgba16Float,
    Format::R32Float,
    Format::Rg32Float,
    Format::Rgba32Float,
];
pub const COLOUR: &[Format] = &[Format::Rgba8Srgb, Format::Rgba8Unorm, Format::Rgba16Float, Format::Rgba32Float];
pub const NORMAL: &[Format] = &[Format::Rg16Snorm, Format::Rg16Float, Format::Rg32Float];
pub const DIRECTION: &[Format] = &[Format::Rg16Float, Format::Rg32Float];
pub const DISTANCE: &[Format] = &[Format::R16Float, Format::R32Float];
pub const DEPTH: &[Format] = &[Format::D32Float];
pub const IDS: &[Format] = &[Format::Rg32Uint];
pub const RADIANCE: &[Format] = &[Format::Rgba32Float, Format::Rgba16Float];

/// What a slot gives.
pub trait Gives {
    /// The slot has an image that stands for what it does.
    const SHOWN: bool = true;

    /// Its images, each with its name in the contract and the formats that it may have.
    fn images(&self) -> Vec<(&'static str, Handle<Image>, &'static [Format])>;

    /// That image; `None` where this implementation gives none.
    fn shown(&self) -> Option<Handle<Image>> {
        self.images().first().map(|(_, image, _)| *image)
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

impl<In, Out: Gives> Slotted<In, Out> for Implementation<In, Out> {
    fn give(&mut self, g: &mut FrameGraph, view: &View, input: In) -> Out {
        let (needs, first) = (self.needs(&view.facts), g.pass_count());
        let out = self.add(g, view, input);
        let (slot, implementation) = (self.slot(), self.implementation());
        let parts = needs.parts.iter().filter_map(|part| Some((Some(part.name), part.idle.as_ref()?)));
        for (part, reason) in needs.idle.as_ref().map(|reason| (None, reason)).into_iter().chain(parts) {
            g.check_idle(Idle { slot, implementation, part, reason }, first);
        }
        let extent = out.extent(g, view);
        for (output, image, formats) in out.images() {
            g.check_contract(image, Contract { slot, implementation, output, formats, extent });
        }
        if Out::SHOWN {
            g.slot_image(slot, out.shown());
        }
        out
    }
}
