//! Textures and environment maps on the device.
use super::ResidentError;
use super::block::Block;
use crate::gpu::{Buffer, BufferMemory, BufferUse, Gpu, Image, ImageUse};
use crate::graph::execute::{Executor, Imports};
use crate::graph::{Access, BufferDesc, Domain, Extent, Format, ImageDesc, ImageState, MipCopy, Queue, Record};
use crate::scene::{ColourSpace, Environment, EnvironmentError, Sampler, Scene, Texture, Wrap};
use half::f16;
use magpie_shaders::SampledImage;
use magpie_shaders::scene::NO_TEXTURE;
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
        upload(gpu, executor, &texture.name, (format, Extent::new(texture.size[0], texture.size[1])), &mips)
    };
    scene.textures.iter().map(one).collect()
}

/// The image of an environment map, and the sky that shaders read. In 32 bits where the device filters those, else in 16, which hold
/// less.
pub(super) fn upload_environment(
    gpu: &Gpu,
    executor: &mut Executor,
    environment: &Environment,
) -> Result<(Arc<Image>, Sky), ResidentError> {
    let named = |fault| ResidentError::Environment { name: environment.name.clone(), fault };
    environment.validate().map_err(named)?;
    let format = if gpu.filters(Format::Rgba32Float) { Format::Rgba32Float } else { Format::Rgba16Float };
    let texels = texels(environment, format).map_err(named)?;
    let extent = Extent::new(environment.width, environment.height);
    let image = upload(gpu, executor, &environment.name, (format, extent), &[&texels])?;
    let wrap = [Wrap::Repeat, Wrap::Clamp];
    let sampler = gpu.sampler(Sampler { wrap, mips: false, ..Sampler::default() })?;
    let sky = environment.to_gpu(image.sampled().unwrap_or(SampledImage(NO_TEXTURE)), sampler);
    Ok((image, sky))
}

/// The texels as a format holds them, with an alpha of 1.
fn texels(environment: &Environment, format: Format) -> Result<Vec<u8>, EnvironmentError> {
    let narrow = format == Format::Rgba16Float;
    if narrow {
        environment.limit_to(f16::MAX.to_f32())?;
    }
    let mut bytes = Vec::with_capacity(environment.radiance.len() * format.bytes_per_pixel() as usize);
    for texel in environment.radiance.iter() {
        let four = texel.extend(1.0).to_array();
        if narrow {
            four.map(f16::from_f32).iter().for_each(|c| bytes.extend_from_slice(&c.to_ne_bytes()));
        } else {
            bytes.extend_from_slice(bytemuck::bytes_of(&four));
        }
    }
    Ok(bytes)
}

/// An image that shaders sample, with its mips.
fn upload(
    gpu: &Gpu,
    executor: &mut Executor,
    name: &str,
    (format, extent): (Format, Extent),
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

#[cfg(test)]
mod tests {
    use super::*;
    use glam::Vec3;

    #[test]
    fn what_16_bits_do_not_hold_is_an_error() {
        let with = |bright: f32| {
            let (name, radiance) = ("e".to_owned(), [Vec3::ONE, Vec3::new(0.5, bright, 2.0)].into());
            Environment { name, width: 2, height: 1, radiance, scale: 1.0, turn: 0.0 }
        };
        let bytes = texels(&with(65504.0), Format::Rgba16Float).unwrap();
        let halves: Vec<f32> = bytes.chunks_exact(2).map(|b| f16::from_ne_bytes([b[0], b[1]]).to_f32()).collect();
        assert_eq!(halves, [1.0, 1.0, 1.0, 1.0, 0.5, 65504.0, 2.0, 1.0]);
        let error = texels(&with(65600.0), Format::Rgba16Float).unwrap_err().to_string();
        assert!(error.contains("pixel (1, 0)") && error.contains("6.55"), "{error}");
        let bytes = texels(&with(65600.0), Format::Rgba32Float).unwrap();
        assert_eq!(bytes[20..24], 65600.0_f32.to_ne_bytes());
    }
}
