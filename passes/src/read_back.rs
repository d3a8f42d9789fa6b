//! Copies images to the host.
use magpie::gpu::{Buffer, BufferMemory, BufferUse, Gpu, GpuError};
use magpie::graph::execute::Imports;
use magpie::graph::{Access, BufferDesc, Domain, Extent, Format, FrameGraph, Handle, Image, MipCopy, Queue, Record};
use magpie::pixels::Pixels;
use std::cell::RefCell;
use std::rc::Rc;
use std::sync::Arc;

/// Images that are copied to the host, in the order of the calls of [`Copies::copy`].
#[derive(Clone)]
pub struct Copies {
    gpu: Gpu,
    imports: Rc<RefCell<Imports>>,
    buffers: Rc<RefCell<Vec<ImageBuffer>>>,
}

/// The read-back buffer of one image, or the error from allocating it.
type ImageBuffer = Result<(Format, Extent, Arc<Buffer>), GpuError>;

impl Copies {
    /// No copies yet. `imports` are those of the frame to which copies will be added.
    pub fn new(gpu: &Gpu, imports: &Rc<RefCell<Imports>>) -> Self {
        Self { gpu: gpu.clone(), imports: imports.clone(), buffers: Rc::default() }
    }

    /// Adds a pass that copies mip 0 of an image to a new buffer. `name` is the name of both.
    pub fn copy(&self, g: &mut FrameGraph, name: &str, image: Handle<Image>) {
        self.copy_with(g, &mut self.imports.borrow_mut(), name, image);
    }

    /// The same for who has borrowed the imports.
    pub fn copy_with(&self, g: &mut FrameGraph, imports: &mut Imports, name: &str, image: Handle<Image>) {
        let (format, extent) = (g.desc(image).format, g.extent(image));
        let bytes = u64::from(extent.width) * u64::from(extent.height) * u64::from(format.bytes_per_pixel());
        let buffer = Buffer::new(&self.gpu, name, bytes, BufferMemory::ReadBack, BufferUse::Storage).map(Arc::new);
        if let Ok(target) = &buffer {
            let key = imports.buffer(target);
            let target = g.import_buffer(name, BufferDesc::new(bytes), Access::HostRead, key);
            let target = g.pass(name, Queue::Transfer, |p| {
                let from = p.copy_from(image);
                let (target, to) = p.copy_to(target);
                (target, move |c: &mut Record<'_>| c.copy_from_image(from, to, MipCopy { offset: 0, mip: 0 }))
            });
            g.leave(target.read(), Access::HostRead, Domain::Copy);
        }
        self.buffers.borrow_mut().push(buffer.map(|buffer| (format, extent, buffer)));
    }

    /// Returns the images. Must be called after the frame has run.
    ///
    /// # Errors
    /// [`GpuError`] if a buffer could not be allocated.
    pub fn finish(&self) -> Result<Vec<Pixels>, GpuError> {
        let buffers = self.buffers.borrow_mut().drain(..).collect::<Result<Vec<_>, _>>()?;
        let pixels = |(format, extent, buffer): (Format, Extent, Arc<Buffer>)| {
            let bytes = extent.width as usize * extent.height as usize * format.bytes_per_pixel() as usize;
            Pixels { extent, format, bytes: buffer.contents()[..bytes].to_vec() }
        };
        Ok(buffers.into_iter().map(pixels).collect())
    }
}
