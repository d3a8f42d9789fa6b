//! The picture of a frame while the frame is declared, for passes that callers of the renderer add.
use crate::read_back::Copies;
use crate::renderer::{FrameRequest, RenderError, Renderer};
use magpie::gpu::{self, ImageUse, Presented, Surface};
use magpie::graph::execute::Imports;
use magpie::graph::{Access, Domain, ImageState};
use magpie::pixels::Pixels;
use magpie::prelude::*;
use std::sync::Arc;

/// The images of a frame that has all its own passes.
pub struct Picture {
    /// Linear radiance before exposure and tone curve.
    pub radiance: Handle<Image>,
    /// Display values, RGBA8, sRGB-encoded.
    pub display: Handle<Image>,
    /// Depth, reversed: the distance of the near plane over that of what is seen, both along the line of sight; 0 where it is the sky. It has the
    /// size of the frame, which may be smaller than the picture.
    pub depth: Handle<Image>,
    /// What effects get beside their inputs.
    pub view: View,
    /// The image of [`Renderer::inspect`] as display values in the size of the picture, RGBA8; `None` if the frame does not make it.
    pub inspected: Option<Handle<Image>>,
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

    /// Copies the display values to an image that outlives the frame, in a pass `NAME.copy`. Its size and format are those of the display
    /// values. What it held is lost. The frame leaves it ready for `access`.
    ///
    /// # Errors
    /// [`RenderError::Target`] if size or format differ.
    pub fn copy_into(
        &self,
        g: &mut FrameGraph,
        imports: &mut Imports,
        name: &str,
        image: &Arc<gpu::Image>,
        access: Access,
    ) -> Result<(), RenderError> {
        let (found, wanted) = ((image.format(), image.extent()), (g.desc(self.display).format, g.extent(self.display)));
        if found != wanted {
            return Err(RenderError::Target { name: name.to_owned(), found, wanted });
        }
        let desc = ImageDesc::fixed(image.format(), image.extent());
        let target = g.import_image(&format!("{name}.image"), desc, ImageState::UNDEFINED, imports.image(image));
        let target = g.pass(&format!("{name}.copy"), Queue::Graphics, |p| {
            let from = p.copy_from(self.display);
            let (target, to) = p.copy_to(target);
            (target, move |c: &mut Record<'_>| c.copy_image(from, 0, to, 0))
        });
        g.leave(target.read(), access, Domain::Raster);
        Ok(())
    }
}

impl NamedCopies {
    /// The images, after the frame has run.
    pub fn finish(self) -> Result<Vec<(String, Pixels)>, RenderError> {
        Ok(self.names.into_iter().zip(self.copies.finish()?).collect())
    }
}

impl Renderer {
    /// Submits a frame and shows its picture in a window of the same size. It returns while the device works, as
    /// [`Renderer::submit`] does.
    ///
    /// # Errors
    /// As [`Renderer::submit`] and [`Surface::present`].
    pub fn show(&mut self, request: FrameRequest<'_>, surface: &mut Surface) -> Result<Presented, RenderError> {
        let size = Extent::new(self.options.width, self.options.height);
        if size.width == 0 || size.height == 0 {
            return Ok(Presented::Hidden);
        }
        let (gpu, mut shown) = (self.gpu.clone(), self.shown.take());
        let ticket = self.submit_with(request, &mut |g, imports, made| {
            let format = g.desc(made.display).format;
            let image = match shown.take().filter(|image| (image.extent(), image.format()) == (size, format)) {
                Some(image) => image,
                None => {
                    // Vulkan wants a view of it.
                    let usage = ImageUse { attachment: true, ..ImageUse::default() };
                    Arc::new(gpu::Image::new(&gpu, "window", format, size, 1, usage)?)
                }
            };
            shown = Some(image.clone());
            made.copy_into(g, imports, "present", &image, Access::CopyRead)
        })?;
        drop(ticket);
        let Some(image) = shown else { return Ok(Presented::Hidden) };
        surface.set_bits(if image.format() == Format::Rgba16Unorm { 10 } else { 8 });
        let presented = surface.present(&image, size)?;
        self.shown = Some(image);
        Ok(presented)
    }
}
