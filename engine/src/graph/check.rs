//! The scan for NaN and infinity: after every pass, over each floating-point image that it wrote.

use std::{cell::RefCell, rc::Rc, sync::Arc};

use magpie_shaders::{
    CHECK_SCAN_COMP,
    check::{Finding as Counted, ScanParams},
};

use super::{
    access::{Access, Queue},
    desc::BufferDesc,
    execute::Imports,
    pass::{FrameGraph, Produced},
    record::Record,
};
use crate::gpu::{Buffer, BufferMemory, BufferUse, Gpu, GpuError, Kernel};

/// Most images that one frame can have scanned.
const MOST: usize = 1024;

/// Values that no image should hold.
#[derive(Clone, Debug, PartialEq, Eq)]
pub struct Finding {
    /// The pass that wrote them.
    pub pass: String,
    /// Its output.
    pub output: String,
    /// Pixels with a NaN.
    pub nan: u32,
    /// Pixels with an infinity and no NaN.
    pub infinite: u32,
    /// The first of them in reading order.
    pub pixel: [u32; 2],
}

impl std::fmt::Display for Finding {
    fn fmt(&self, f: &mut std::fmt::Formatter<'_>) -> std::fmt::Result {
        let Self { pass, output, nan, infinite, pixel: [x, y] } = self;
        write!(f, "{pass}:{output}: {nan} pixels with NaN and {infinite} with infinity, the first at ({x}, {y})")
    }
}

/// The scan's pipeline.
#[derive(Clone, Copy, Debug)]
pub struct Scan {
    kernel: Kernel,
}

/// The scan of one frame, to be read once it ran.
pub struct Scanned {
    buffer: Arc<Buffer>,
    images: Rc<RefCell<Vec<Produced>>>,
}

impl Scan {
    /// Makes the pipeline.
    ///
    /// # Errors
    /// Failing calls.
    pub fn new(gpu: &Gpu) -> Result<Self, GpuError> {
        Ok(Self { kernel: gpu.kernel(&CHECK_SCAN_COMP)? })
    }

    /// An observer that scans what every pass declared from now on writes; see [`FrameGraph::observe`].
    ///
    /// # Errors
    /// [`GpuError::OutOfMemory`].
    pub fn watch(
        self,
        gpu: &Gpu,
        g: &mut FrameGraph,
        imports: &mut Imports,
    ) -> Result<(Scanned, impl FnMut(&mut FrameGraph, &Produced) + 'static), GpuError> {
        let none = Counted { nan: 0, infinite: 0, first: u32::MAX };
        let bytes = (MOST * size_of::<Counted>()) as u64;
        let mut buffer = Buffer::new(gpu, "scan findings", bytes, BufferMemory::ReadBack, BufferUse::Storage)?;
        buffer.write(0, bytemuck::cast_slice(&vec![none; MOST]))?;
        let buffer = Arc::new(buffer);
        let key = imports.buffer(&buffer);
        let mut target = Some(g.import_buffer("check.findings", BufferDesc::new(bytes), Access::HostRead, key));
        let images = Rc::<RefCell<Vec<Produced>>>::default();
        let seen = images.clone();
        let kernel = self.kernel;
        let observer = move |g: &mut FrameGraph, produced: &Produced| {
            let index = seen.borrow().len();
            if !produced.format.is_float() || index == MOST {
                return;
            }
            let Some(findings) = target.take() else { return };
            seen.borrow_mut().push(produced.clone());
            let (image, extent) = (produced.image, produced.extent);
            let name = format!("check.{}.{}", produced.pass, produced.output);
            target = Some(g.weak_pass(&name, Queue::Graphics, |p| {
                let image = p.sample(image);
                let (findings, table) = p.write_buffer(findings);
                (findings, move |c: &mut Record<'_>| {
                    let finding = c.id(table).offset((index * size_of::<Counted>()) as u64);
                    let size = [extent.width, extent.height];
                    c.dispatch(kernel, &ScanParams { image: c.id(image), size, finding }, extent);
                })
            }));
        };
        Ok((Scanned { buffer, images }, observer))
    }
}

impl Scanned {
    /// What the frame held that it should not.
    pub fn findings(&self) -> Vec<Finding> {
        let counted: Vec<Counted> = bytemuck::pod_collect_to_vec(self.buffer.contents());
        let images = self.images.borrow();
        let bad = images.iter().zip(counted).filter(|(_, c)| c.nan > 0 || c.infinite > 0);
        bad.map(|(image, c)| Finding {
            pass: image.pass.clone(),
            output: image.output.clone(),
            nan: c.nan,
            infinite: c.infinite,
            pixel: [c.first % image.extent.width, c.first / image.extent.width],
        })
        .collect()
    }
}
