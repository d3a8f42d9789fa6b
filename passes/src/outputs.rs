//! Checks the output images of a slot against the formats and sizes of its contract in [`contracts`](crate::contracts). A violation is an error
//! in the declaration of the frame: no pass runs, and the message names the slot, the implementation, and what was wanted and found.
use magpie::frame::View;
use magpie::graph::{Contract, Extent, Format, FrameGraph, Handle, Idle, Image};
use magpie::slot::Implementation;

/// Formats of one value, 0 to 1.
pub const SCALAR: &[Format] = &[Format::R8Unorm, Format::R16Unorm, Format::R16Float, Format::R32Float];
/// Formats of metalness and roughness; those with four channels also hold the specular reflectance of the dielectric part.
pub const MATERIAL: &[Format] =
    &[Format::Rg8Unorm, Format::Rg16Float, Format::Rg32Float, Format::Rgba16Snorm, Format::Rgba32Float];
/// Formats of the clear coat's strength and roughness.
pub const COAT: &[Format] = &[Format::Rg8Unorm, Format::Rg16Float, Format::Rg32Float];
/// Formats of the visibility of one, two or up to four lights.
pub const VISIBILITY: &[Format] = &[
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
/// Formats of display values.
pub const DISPLAY: [Format; 2] = [Format::Rgba8Unorm, Format::Rgba16Unorm];
pub const NORMAL: &[Format] = &[Format::Rg16Snorm, Format::Rg16Float, Format::Rg32Float];
pub const DIRECTION: &[Format] = &[Format::Rg16Float, Format::Rg32Float];
pub const DISTANCE: &[Format] = &[Format::R16Float, Format::R32Float];
pub const DEPTH: &[Format] = &[Format::D32Float];
pub const IDS: &[Format] = &[Format::Rg32Uint];
pub const RADIANCE: &[Format] = &[Format::Rgba32Float, Format::Rgba16Float];

/// The outputs of a slot.
pub trait Gives {
    /// Whether the slot has a main image, which observers of the slot get.
    const SHOWN: bool = true;

    /// All output images, each with its name in the contract and its allowed formats.
    fn images(&self) -> Vec<(&'static str, Handle<Image>, &'static [Format])>;

    /// The main image; `None` if this implementation outputs none.
    fn shown(&self) -> Option<Handle<Image>> {
        self.images().first().map(|(_, image, _)| *image)
    }

    /// The size that all output images must have.
    fn extent(&self, g: &FrameGraph, _: &View) -> Extent {
        g.full()
    }
}

/// An implementation whose outputs are checked against the contract of its slot.
pub trait Slotted<In, Out> {
    /// Adds the passes of the implementation, checks its outputs, and passes the main image to observers of the slot.
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
