//! A user interface over a finished picture: textured triangles, in their order, in one pass.
mod texture;

use magpie::gpu::{self, Blend, BufferUse, Cull, Gpu, GpuError, RasterDesc, RasterKernel, Staging};
use magpie::graph::execute::Imports;
use magpie::graph::{Access, BufferDesc, Domain, Draw, DrawClass, ImageState};
use magpie::prelude::*;
use magpie::scene::{Sampler, Wrap};
use magpie::slot::{Build, SlotError};
use magpie_shaders::overlay::OverlayParams;
use magpie_shaders::{OVERLAY_DRAW_FRAG, OVERLAY_DRAW_VERT, SamplerId};
use std::borrow::Cow;
use std::collections::BTreeMap;
use std::sync::Arc;
use texture::Texture;

pub use magpie_shaders::overlay::OverlayVertex;
pub use texture::TexturePart;

/// Triangles with one image.
#[derive(Clone)]
pub struct Mesh<'a> {
    /// Corners.
    pub vertices: Cow<'a, [OverlayVertex]>,
    /// Three corners per triangle.
    pub indices: Cow<'a, [u32]>,
    /// Pixels of the target per unit of the positions of corners.
    pub scale: f32,
    /// Left, top, right and bottom of what is drawn of them, pixels.
    pub clip: [f32; 4],
    /// What colours are multiplied with.
    pub image: MeshImage,
}

/// The image of a [`Mesh`].
#[derive(Clone)]
pub enum MeshImage {
    /// A texture of the interface, by the number that [`Overlay::set_texture`] was given. A mesh whose texture is not known is not drawn.
    Own(u64),
    /// An image of the frame with display values, such as its picture. Its alpha does not count.
    OfFrame(Handle<Image>),
    /// An image that an earlier frame, of this renderer or another one, has left to be copied from, such as the target of another overlay. Its alpha
    /// does not count.
    OfAnother(Arc<gpu::Image>),
}

/// Draws a user interface.
pub struct Overlay {
    gpu: Gpu,
    /// For targets in each of the formats.
    kernels: [RasterKernel; 2],
    filtered: SamplerId,
    vertices: Staging,
    indices: Staging,
    textures: BTreeMap<u64, Texture>,
}

impl Overlay {
    /// Formats of images that can be drawn into.
    pub const FORMATS: [Format; 2] = [Format::Rgba8Unorm, Format::A2Rgb10Unorm];

    /// Describes the pipeline.
    ///
    /// # Errors
    /// [`SlotError`] if the device cannot blend, or has no sampler left.
    pub fn new(gpu: &Gpu, build: &Build<'_>) -> Result<Self, SlotError> {
        let kernel = |format: Format| {
            build.raster_kernel(&RasterDesc {
                name: "overlay.draw",
                vertex: &OVERLAY_DRAW_VERT,
                fragment: &OVERLAY_DRAW_FRAG,
                constants: &[],
                colours: &[format],
                blend: Blend::PremultipliedOver,
                depth: None,
            })
        };
        let clamped = Sampler { wrap: [Wrap::Clamp; 2], linear_mips: false, mips: false, ..Sampler::default() };
        Ok(Self {
            gpu: gpu.clone(),
            kernels: [kernel(Self::FORMATS[0])?, kernel(Self::FORMATS[1])?],
            filtered: gpu.sampler(clamped).map_err(SlotError::other)?,
            vertices: Staging::new(gpu, "overlay.vertices"),
            indices: Staging::with_use(gpu, "overlay.indices", BufferUse::Index),
            textures: BTreeMap::new(),
        })
    }

    /// Makes or replaces a texture, or a part of one. The next frame uploads it.
    ///
    /// # Errors
    /// [`GpuError::Limit`] if it is too large, [`GpuError::OutOfMemory`].
    pub fn set_texture(&mut self, number: u64, part: &TexturePart<'_>) -> Result<(), GpuError> {
        match (part.at, self.textures.get_mut(&number)) {
            (Some(at), Some(texture)) => texture.change(at, part),
            (Some(_), None) => {}
            (None, _) => drop(self.textures.insert(number, Texture::new(&self.gpu, part)?)),
        }
        Ok(())
    }

    /// Frees a texture.
    pub fn remove_texture(&mut self, number: u64) {
        self.textures.remove(&number);
    }

    /// Adds `overlay.draw`, which draws the meshes over black into `target`, which has one of the [`FORMATS`](Self::FORMATS), and leaves that to be
    /// [presented](magpie::gpu::Surface::present). It returns the result. Textures that have changed are uploaded before, by `overlay.upload_N`.
    ///
    /// # Errors
    /// [`GpuError::OutOfMemory`].
    pub fn add(
        &mut self,
        g: &mut FrameGraph,
        imports: &mut Imports,
        meshes: &[Mesh<'_>],
        target: &Arc<gpu::Image>,
    ) -> Result<Handle<Image>, GpuError> {
        let textures = self
            .textures
            .iter_mut()
            .map(|(number, texture)| Ok((*number, texture.import(g, imports, *number)?)))
            .collect::<Result<BTreeMap<u64, Handle<Image>>, GpuError>>()?;
        let mut others = Vec::<(&Arc<gpu::Image>, Handle<Image>)>::new();
        let mut drawn: Vec<(&Mesh<'_>, Handle<Image>, bool)> = Vec::new();
        for mesh in meshes.iter().filter(|mesh| !mesh.indices.is_empty()) {
            match &mesh.image {
                MeshImage::Own(number) => drawn.extend(textures.get(number).map(|image| (mesh, *image, false))),
                MeshImage::OfFrame(image) => drawn.push((mesh, *image, true)),
                MeshImage::OfAnother(image) => {
                    let known = others.iter().find(|(other, _)| Arc::ptr_eq(other, image)).map(|(_, handle)| *handle);
                    let handle = known.unwrap_or_else(|| import_other(g, imports, image, others.len()));
                    if known.is_none() {
                        others.push((image, handle));
                    }
                    drawn.push((mesh, handle, true));
                }
            }
        }
        let meshes = drawn;
        // Buffers are never empty; nothing is drawn of these.
        let (no_vertex, no_index) = ([OverlayVertex::default()], [0_u32]);
        let (mut vertices, mut indices) = (Vec::<&[u8]>::new(), Vec::<&[u8]>::new());
        let (mut first_vertex, mut first_index, mut draws) = (0, 0, Vec::new());
        for (mesh, _, _) in &meshes {
            let (class, index_count) = (DrawClass::Blended, mesh.indices.len() as u32);
            draws.push((first_vertex, Draw { first_index, index_count, instance: 0, cull: Cull::None, class }));
            vertices.push(bytemuck::cast_slice(&mesh.vertices));
            indices.push(bytemuck::cast_slice(&mesh.indices));
            (first_vertex, first_index) = (first_vertex + mesh.vertices.len() as u32, first_index + index_count);
        }
        if draws.is_empty() {
            (vertices, indices) = (vec![bytemuck::cast_slice(&no_vertex)], vec![bytemuck::cast_slice(&no_index)]);
        }
        let mut bring = |g: &mut FrameGraph, name, staging: &mut Staging, parts: &[&[u8]], access| {
            let desc = BufferDesc::new(parts.iter().map(|part| part.len() as u64).sum());
            let key = imports.buffer(staging.write_parts(parts)?);
            Ok::<_, GpuError>(g.import_buffer(name, desc, access, key).read())
        };
        let vertices = bring(g, "overlay.vertices", &mut self.vertices, &vertices, Access::BufferRead)?;
        let indices = bring(g, "overlay.indices", &mut self.indices, &indices, Access::Index)?;

        let extent = target.extent();
        let desc = ImageDesc::fixed(target.format(), extent);
        let window = g.import_image("overlay.window", desc, ImageState::UNDEFINED, imports.image(target));
        let kernel = self.kernels[usize::from(target.format() == Self::FORMATS[1])];
        let filtered = self.filtered;
        let window = g.pass("overlay.draw", Queue::Graphics, |p| {
            let mut tokens = BTreeMap::new();
            let draws: Vec<_> = std::iter::zip(&meshes, draws)
                .map(|((mesh, image, is_opaque), draw)| {
                    let token = *tokens.entry(image.id()).or_insert_with(|| p.sample(*image));
                    (draw, mesh.clip, mesh.scale, token, *is_opaque)
                })
                .collect();
            let (vertices, indices) = (p.read(vertices), p.index(indices));
            let (window, _) = p.color_over(window, [0.0, 0.0, 0.0, 1.0]);
            (window, move |c: &mut Record<'_>| {
                for ((first_vertex, draw), clip, scale, image, is_opaque) in draws {
                    let params = OverlayParams {
                        vertices: c.id(vertices),
                        size: [extent.width as f32, extent.height as f32],
                        clip,
                        image: c.id(image),
                        sampler_id: filtered,
                        is_opaque: is_opaque.into(),
                        first_vertex,
                        scale,
                    };
                    c.draw(kernel, &params, indices, &[draw]);
                }
            })
        });
        g.leave(window.read(), Access::CopyRead, Domain::Copy);
        Ok(window.read())
    }
}

/// Brings in an image that was left to be copied from, to be sampled and left so again.
fn import_other(g: &mut FrameGraph, imports: &mut Imports, image: &Arc<gpu::Image>, number: usize) -> Handle<Image> {
    let desc = ImageDesc::fixed(image.format(), image.extent());
    let state = ImageState::last(Access::CopyRead, Domain::Copy);
    let handle = g.import_image(&format!("overlay.other_{number}"), desc, state, imports.image(image)).read();
    g.leave(handle, Access::CopyRead, Domain::Copy);
    handle
}
