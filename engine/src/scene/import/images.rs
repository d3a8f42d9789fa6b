//! Decodes PNG and JPEG images to textures.
use super::accessor::Data;
use super::material::Request;
use super::{Import, Of, file, label};
use crate::scene::Texture;
use crate::scene::error::Fault;
use image::{DynamicImage, ImageDecoder, ImageFormat, ImageReader, Limits};
use rayon::prelude::*;
use std::borrow::Cow;
use std::io::Cursor;
use std::path::Path;

/// Largest width and height of an image, texels.
const MAX_EDGE: u32 = 16384;
/// Largest number of texels of all textures: 2 GiB, plus a third for mips.
const MAX_TEXELS: u64 = 1 << 29;
/// Memory limit for decoding one image, bytes.
const MAX_DECODE: u64 = 1 << 32;

/// Decodes the images in parallel, after checking their sizes.
pub(super) fn decode(data: &Data, folder: &Path, requests: &[Request]) -> Import<Vec<Texture>> {
    let mut total = 0;
    let mut sources = Vec::with_capacity(requests.len());
    for request in requests {
        let element = || format!("image {}", request.image);
        let bytes = source(data, folder, request.image).of(element)?;
        let [width, height] = open(&bytes).map(|d| <[u32; 2]>::from(d.dimensions())).of(element)?;
        total += u64::from(width) * u64::from(height);
        if total > MAX_TEXELS {
            return Err(Fault::Limit { what: "texels of all textures", got: total, limit: MAX_TEXELS }).of(element);
        }
        sources.push(bytes);
    }
    requests
        .par_iter()
        .zip(sources)
        .map(|(request, bytes)| {
            let decoded = open(&bytes).and_then(|d| DynamicImage::from_decoder(d).map_err(failed));
            let rgba = decoded.of(|| format!("image {}", request.image))?.into_rgba8();
            let size = [rgba.width(), rgba.height()];
            let name = data.root.images[request.image].name.as_deref();
            let name = label(name, || format!("image {}", request.image));
            Ok(Texture::new(name, size, request.colour_space, rgba.into_raw()))
        })
        .collect()
}

/// The encoded bytes of an image. The index was checked when the materials were read.
fn source<'a>(data: &Data<'a>, folder: &Path, image: usize) -> Result<Cow<'a, [u8]>, Fault> {
    let image = &data.root.images[image];
    match (&image.uri, image.buffer_view) {
        (Some(uri), _) => file::fetch(uri, folder, None).map(Cow::Owned),
        (None, Some(view)) => data.view(view.value()).map(Cow::Borrowed),
        (None, None) => Err(Fault::Missing("its URI or buffer view")),
    }
}

fn failed(error: image::ImageError) -> Fault {
    Fault::Image(error.to_string())
}

/// A decoder for an image whose size has been checked.
fn open(bytes: &[u8]) -> Result<impl ImageDecoder + '_, Fault> {
    let format = image::guess_format(bytes).ok().filter(|f| matches!(f, ImageFormat::Png | ImageFormat::Jpeg));
    let Some(format) = format else {
        return Err(Fault::Image("neither PNG nor JPEG".to_owned()));
    };
    let mut reader = ImageReader::with_format(Cursor::new(bytes), format);
    let mut limits = Limits::no_limits();
    limits.max_alloc = Some(MAX_DECODE);
    reader.limits(limits);
    let decoder = reader.into_decoder().map_err(failed)?;
    let (width, height) = decoder.dimensions();
    if width == 0 || height == 0 {
        return Err(Fault::Image(format!("{width}x{height} texels")));
    }
    let edge = width.max(height);
    if edge > MAX_EDGE {
        return Err(Fault::Limit { what: "texels along an edge", got: edge.into(), limit: MAX_EDGE.into() });
    }
    Ok(decoder)
}
