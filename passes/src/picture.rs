//! The picture of a frame while the frame is declared, for passes that callers of the renderer add.
use crate::read_back::Copies;
use crate::renderer::RenderError;
use magpie::graph::execute::Imports;
use magpie::pixels::Pixels;
use magpie::prelude::*;

/// The images of a frame that has all its own passes.
pub struct Picture {
    /// Linear radiance before exposure and tone curve.
    pub radiance: Handle<Image>,
    /// Display values, RGBA8, sRGB-encoded.
    pub display: Handle<Image>,
    /// Depth, reversed: the distance of the near plane over that of what is seen, both along the line of sight; 0 where it is the sky. It has the
    /// size of the frame, which may be smaller than the picture.
    pub depth: Handle<Image>,
    pub(crate) read: NamedCopies,
}

/// Adds passes to a frame that has all its own. They run if they write something imported.
pub type AddPasses<'a> = dyn FnMut(&mut FrameGraph, &mut Imports, &mut Picture) -> Result<(), RenderError> + 'a;

/// Copies to the host, and their names.
pub(crate) struct NamedCopies {
    pub copies: Copies,
    pub names: Vec<String>,
}

impl Picture {
    /// Copies an image of the frame to the host: [`FrameResult::copied`](crate::FrameResult::copied) has it under this name.
    pub fn read_back(&mut self, g: &mut FrameGraph, imports: &mut Imports, name: &str, image: Handle<Image>) {
        self.read.copies.copy_with(g, imports, &format!("read_back.{name}"), image);
        self.read.names.push(name.to_owned());
    }
}

impl NamedCopies {
    /// The images, after the frame has run.
    pub fn finish(self) -> Result<Vec<(String, Pixels)>, RenderError> {
        Ok(self.names.into_iter().zip(self.copies.finish()?).collect())
    }
}
