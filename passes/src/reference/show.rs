//! Display values of an estimate, by the slot `post`.
use super::{Reference, ReferenceError};
use crate::Slots;
use crate::contracts::PostIn;
use crate::outputs::Slotted;
use crate::read_back::Copies;
use magpie::config::Config;
use magpie::frame::ViewDesc;
use magpie::gpu::Staging;
use magpie::graph::execute::Imports;
use magpie::graph::{Access, BufferDesc, Extent, Format, ImageDesc, Queue, Record};
use magpie::pixels::Pixels;
use magpie::slot::{Build, SlotError};
use magpie_shaders::REFERENCE_PRESENT_COMP;
use magpie_shaders::reference::PresentParams;
use std::cell::RefCell;
use std::rc::Rc;

impl Reference {
    /// The estimate so far as display values, RGBA8: with the exposure, tone curve and encoding that the configuration sets for `post`.
    ///
    /// # Errors
    /// [`ReferenceError`].
    pub fn display(&mut self, slots: &Slots, config: &Config) -> Result<Pixels, ReferenceError> {
        let build = Build::new(&self.gpu, self.options.rays);
        let mut post = slots.post.from_config(&build, config)?;
        let kernel = self.gpu.kernel(&REFERENCE_PRESENT_COMP)?;
        let mut staging = Staging::new(&self.gpu, "reference mean");
        let values: Vec<f32> = self.estimate.mean.iter().flat_map(|m| m.as_vec3().to_array()).collect();
        let extent = Extent::new(self.options.width, self.options.height);
        let mut g = self.executor.begin(extent);
        let imports = Rc::<RefCell<Imports>>::default();
        let desc = ViewDesc { seed: self.options.seed, ..ViewDesc::new(&self.camera, extent) };
        let view = desc.declare(&mut self.view, &self.scene, &mut g, &mut imports.borrow_mut())?;
        let key = imports.borrow_mut().buffer(staging.write(bytemuck::cast_slice(&values))?);
        let bytes = 4 * values.len() as u64;
        let values = g.import_buffer("reference.mean", BufferDesc::new(bytes), Access::BufferRead, key).read();
        let colour = g.pass("reference.present", Queue::Graphics, |p| {
            let values = p.read(values);
            let (image, target) = p.create("radiance", ImageDesc::full(Format::Rgba32Float));
            (image.read(), move |c: &mut Record<'_>| {
                let size = [extent.width, extent.height];
                c.dispatch(kernel, &PresentParams { values: c.id(values), image: c.id(target), size }, extent);
            })
        });
        let shown = post.give(&mut g, &view, PostIn { colour, seen: None });
        let copies = Copies::new(&self.gpu, &imports);
        copies.copy(&mut g, "read_back.display", shown.display);
        self.executor.run(g, &imports.borrow())?;
        if self.options.check {
            self.gpu.check_validation()?;
        }
        copies.finish()?.pop().ok_or_else(|| SlotError::other("post gave no picture").into())
    }
}
