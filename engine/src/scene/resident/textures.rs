//! Textures and environment maps on the device.
use super::ResidentError;
use super::block::Block;
use crate::gpu::{Buffer, BufferMemory, BufferUse, Gpu, Image, ImageUse};
use crate::graph::execute::{Executor, Imports};
use crate::graph::{Access, BufferDesc, Domain, Extent, Format, ImageDesc, ImageState, MipCopy, Queue, Record};
use crate::scene::{ColourSpace, Environment, Scene, Texture, Wrap};
use magpie_shaders::SampledImage;
use magpie_shaders::view::Sky;
use std::sync::Arc;

pub(super) fn upload_textures(
    gpu: &Gpu,
    executor: &mut Executor,
    scene: &Scene,
) -> Result<Vec<Arc<Image>>, ResidentError> {
    let one = |texture: &Texture| {
        let format = match texture.colour_space {
            ColourSpace::Srgb => Format::Rgba8Srgb,
            ColourSpace::Linear => Format::Rgba8Unorm,
        };
        let mips: Vec<&[u8]> = texture.mips.iter().map(Vec::as_slice).collect();
        upload(gpu, executor, &texture.name, format, Extent::new(texture.size[0], texture.size[1]), &mips)
    };
    scene.textures.iter().map(one).collect()
}

/// Uploads an environment map as 32-bit floats with alpha 1, and returns it with the sky struct for shaders.
pub(super) fn upload_environment(
    gpu: &Gpu,
    executor: &mut Executor,
    environment: &Environment,
) -> Result<(Arc<Image>, Sky), ResidentError> {
    let named = |fault| ResidentError::Environment { name: environment.name.clone(), fault };
    environment.validate().map_err(named)?;
    let format = Format::Rgba32Float;
    let texels: Vec<[f32; 4]> = environment.radiance.iter().map(|texel| texel.extend(1.0).to_array()).collect();
    let extent = Extent::new(environment.width, environment.height);
    let image = upload(gpu, executor, &environment.name, format, extent, &[bytemuck::cast_slice(&texels)])?;
    let sampler = gpu.bilinear(format, [Wrap::Repeat, Wrap::Clamp])?;
    let sky = environment.to_gpu(image.sampled().unwrap_or(SampledImage::NONE), sampler);
    Ok((image, sky))
}

/// Uploads an image with its mips, for sampling.
fn upload(
    gpu: &Gpu,
    executor: &mut Executor,
    name: &str,
    format: Format,
    extent: Extent,
    mips: &[&[u8]],
) -> Result<Arc<Image>, ResidentError> {
    let usage = ImageUse { sampled: true, ..Default::default() };
    let image = Arc::new(Image::new(gpu, name, format, extent, mips.len() as u32, usage)?);
    let mut block = Block::default();
    let mips: Vec<_> = mips.iter().zip(0..).map(|(data, mip)| MipCopy { offset: block.add(data), mip }).collect();
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
    Ok(image)
}
