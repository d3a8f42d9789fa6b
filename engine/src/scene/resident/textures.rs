//! Textures on the device.
use super::ResidentError;
use super::block::Block;
use crate::gpu::{Buffer, BufferMemory, BufferUse, Gpu, Image, ImageUse};
use crate::graph::execute::{Executor, Imports};
use crate::graph::{Access, BufferDesc, Domain, Extent, Format, ImageDesc, ImageState, MipCopy, Queue, Record};
use crate::scene::{ColourSpace, Scene};
use std::sync::Arc;

pub(super) fn upload_textures(
    gpu: &Gpu,
    executor: &mut Executor,
    scene: &Scene,
) -> Result<Vec<Arc<Image>>, ResidentError> {
    let usage = ImageUse { sampled: true, ..Default::default() };
    let mut images = Vec::with_capacity(scene.textures.len());
    for texture in &scene.textures {
        let format = match texture.colour_space {
            ColourSpace::Srgb => Format::Rgba8Srgb,
            ColourSpace::Linear => Format::Rgba8Unorm,
        };
        let extent = Extent::new(texture.size[0], texture.size[1]);
        let image = Arc::new(Image::new(gpu, &texture.name, format, extent, texture.mips.len() as u32, usage)?);
        let mut block = Block::default();
        let mips: Vec<_> =
            texture.mips.iter().zip(0..).map(|(data, mip)| MipCopy { offset: block.add(data), mip }).collect();
        let bytes = block.0.len() as u64;
        let mut staging = Buffer::new(gpu, "staging", bytes, BufferMemory::Upload, BufferUse::Storage)?;
        staging.write(0, &block.0)?;

        let (mut g, mut imports) = (executor.begin(extent), Imports::default());
        let source =
            g.import_buffer("staging", BufferDesc::new(bytes), Access::CopyRead, imports.buffer(&Arc::new(staging)));
        let desc = ImageDesc { mips: image.mips(), ..ImageDesc::fixed(format, extent) };
        let to = g.import_image("texture", desc, ImageState::UNDEFINED, imports.image(&image));
        let to = g.pass("upload.texture", Queue::Transfer, |p| {
            let from = p.copy_from(source.read());
            let (to, into) = p.copy_to(to);
            (to, move |c: &mut Record<'_>| c.copy_to_image(from, into, &mips))
        });
        g.leave(to.read(), Access::Sample, Domain::Raster);
        executor.run(g, &imports)?;
        images.push(image);
    }
    Ok(images)
}
