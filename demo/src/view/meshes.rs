//! From the shapes of `egui` to the meshes of the overlay.

use std::sync::Arc;

use egui::{
    ClippedPrimitive, ImageData, TextureId,
    epaint::{ImageDelta, Primitive},
};
use magpie::gpu;
use magpie::graph::Extent;
use magpie::pixels::Pixels;
use magpie::prelude::{Handle, Image};
use magpie_passes::parts::overlay::{Mesh, MeshImage, Overlay, OverlayVertex, TexturePart};

use crate::exit::Failure;

/// What the interface calls the picture of the frame.
pub(super) const PICTURE: TextureId = TextureId::User(0);
/// What it calls the picture of the other configuration.
pub(super) const OTHER: TextureId = TextureId::User(1);

/// What it calls the reference picture, and the map of the error against it: textures of the overlay.
pub(super) const TRUTH: TextureId = TextureId::User(2);
pub(super) const ERROR: TextureId = TextureId::User(3);

/// The number that the overlay has for a texture that is not one of `egui`'s.
fn number(id: TextureId) -> Option<u64> {
    match id {
        TextureId::Managed(number) => Some(number),
        TRUTH => Some(u64::MAX),
        ERROR => Some(u64::MAX - 1),
        TextureId::User(_) => None,
    }
}

/// The meshes of one frame.
pub(super) fn meshes<'a>(
    primitives: &'a [ClippedPrimitive],
    pixels_per_point: f32,
    picture: Handle<Image>,
    other: Option<&Arc<gpu::Image>>,
) -> Vec<Mesh<'a>> {
    let mesh = |primitive: &'a ClippedPrimitive| {
        let Primitive::Mesh(mesh) = &primitive.primitive else { return None };
        let clip = primitive.clip_rect;
        let edge = |points: f32| (points * pixels_per_point).round();
        Some(Mesh {
            // The same fields in the same order.
            vertices: bytemuck::cast_slice::<_, OverlayVertex>(&mesh.vertices).into(),
            indices: mesh.indices.as_slice().into(),
            scale: pixels_per_point,
            clip: [edge(clip.min.x), edge(clip.min.y), edge(clip.max.x), edge(clip.max.y)],
            image: match (mesh.texture_id, number(mesh.texture_id)) {
                (_, Some(number)) => MeshImage::Own(number),
                (OTHER, _) => MeshImage::OfAnother(other?.clone()),
                _ => MeshImage::OfFrame(picture),
            },
        })
    };
    primitives.iter().filter_map(mesh).collect()
}

/// One image over the whole of a target.
pub(super) fn whole(picture: Handle<Image>, target: Extent) -> Mesh<'static> {
    let (right, bottom) = (target.width as f32, target.height as f32);
    let corner = |x: f32, y: f32| OverlayVertex { position: [x * right, y * bottom], uv: [x, y], colour: u32::MAX };
    Mesh {
        vertices: vec![corner(0.0, 0.0), corner(1.0, 0.0), corner(1.0, 1.0), corner(0.0, 1.0)].into(),
        indices: vec![0, 1, 2, 0, 2, 3].into(),
        scale: 1.0,
        clip: [0.0, 0.0, right, bottom],
        image: MeshImage::OfFrame(picture),
    }
}

/// Gives the overlay what has changed of a texture.
pub(super) fn set_texture(overlay: &mut Overlay, id: TextureId, delta: &ImageDelta) -> Result<(), Failure> {
    let TextureId::Managed(number) = id else { return Ok(()) };
    let ImageData::Color(image) = &delta.image;
    let [width, height] = image.size.map(|side| side as u32);
    if width == 0 || height == 0 {
        return Ok(());
    }
    let pixels: Vec<u8> = image.pixels.iter().flat_map(|colour| colour.to_array()).collect();
    let at = delta.pos.map(|at| at.map(|side| side as u32));
    overlay.set_texture(number, &TexturePart { at, extent: Extent::new(width, height), pixels: &pixels })?;
    Ok(())
}

/// Gives the overlay a whole picture under such a name.
pub(super) fn set_picture(overlay: &mut Overlay, id: TextureId, picture: &Pixels) -> Result<(), Failure> {
    let Some(number) = number(id) else { return Ok(()) };
    overlay.set_texture(number, &TexturePart { at: None, extent: picture.extent, pixels: &picture.bytes })?;
    Ok(())
}
