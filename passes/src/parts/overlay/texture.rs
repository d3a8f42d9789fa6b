//! Textures of a user interface, such as that of its glyphs.
use magpie::gpu::{self, Gpu, GpuError, ImageUse, Staging};
use magpie::graph::execute::Imports;
use magpie::graph::{Access, BufferDesc, Domain, Extent, ImageState, MipCopy};
use magpie::prelude::*;
use std::sync::Arc;

/// Pixels of a texture.
#[derive(Clone, Copy, Debug)]
pub struct TexturePart<'a> {
    /// Where they lie in a texture that is there, from its upper left. `None`: they are the whole of a new one.
    pub at: Option<[u32; 2]>,
    /// Width and height, each at least 1.
    pub extent: Extent,
    /// Row by row: display values times alpha, then alpha, 8 bits each.
    pub pixels: &'a [u8],
}

/// A texture, on the host and on the device.
pub struct Texture {
    image: Arc<gpu::Image>,
    pixels: Vec<u8>,
    staging: Staging,
    /// Whether the device has the pixels of the host.
    is_uploaded: bool,
    /// Whether the device's image has ever been written.
    is_defined: bool,
}

const FORMAT: Format = Format::Rgba8Unorm;
const BYTES: usize = 4;

impl Texture {
    pub fn new(gpu: &Gpu, part: &TexturePart<'_>) -> Result<Self, GpuError> {
        // Under validation every pass sees all images that are only sampled, and would seem to read this one while it is uploaded.
        let usage = ImageUse { sampled: true, attachment: true, ..ImageUse::default() };
        let image = gpu::Image::new(gpu, "overlay.texture", FORMAT, part.extent, 1, usage)?;
        let bytes = BYTES * part.extent.width as usize * part.extent.height as usize;
        let mut pixels = part.pixels.to_vec();
        pixels.resize(bytes, 0);
        let staging = Staging::new(gpu, "overlay.pixels");
        Ok(Self { image: Arc::new(image), pixels, staging, is_uploaded: false, is_defined: false })
    }

    /// Replaces a part. What lies outside of the texture is left out.
    pub fn change(&mut self, [x, y]: [u32; 2], part: &TexturePart<'_>) {
        let Extent { width, height } = self.image.extent();
        let kept = part.extent.width.min(width.saturating_sub(x)) as usize * BYTES;
        let source = part.pixels.chunks_exact((part.extent.width as usize * BYTES).max(1));
        for (row, from) in (y..height).zip(source) {
            let start = (row as usize * width as usize + x as usize) * BYTES;
            if kept > 0 {
                self.pixels[start..start + kept].copy_from_slice(&from[..kept]);
            }
        }
        self.is_uploaded = false;
    }

    /// Brings it into a frame, to be sampled, and adds its upload where the device has other pixels.
    pub fn import(
        &mut self,
        g: &mut FrameGraph,
        imports: &mut Imports,
        number: u64,
    ) -> Result<Handle<Image>, GpuError> {
        let name = format!("overlay.texture_{number}");
        let desc = ImageDesc::fixed(FORMAT, self.image.extent());
        let sampled = ImageState { access: Some((Access::Sample, Domain::Raster)) };
        let state = if self.is_defined { sampled } else { ImageState::UNDEFINED };
        let image = g.import_image(&name, desc, state, imports.image(&self.image));
        if self.is_uploaded {
            return Ok(image.read());
        }
        let bytes = BufferDesc::new(self.pixels.len() as u64);
        let key = imports.buffer(self.staging.write(&self.pixels)?);
        let source = g.import_buffer(&format!("overlay.pixels_{number}"), bytes, Access::CopyRead, key);
        let image = g.pass(&format!("overlay.upload_{number}"), Queue::Graphics, |p| {
            let from = p.copy_from(source.read());
            let (image, to) = p.copy_to(image);
            (image, move |c: &mut Record<'_>| c.copy_to_image(from, to, &[MipCopy { offset: 0, mip: 0 }]))
        });
        g.leave(image.read(), Access::Sample, Domain::Raster);
        (self.is_uploaded, self.is_defined) = (true, true);
        Ok(image.read())
    }
}
