//! Spoils outputs on purpose, within the pass that writes them, so that tests can tell whether that is found.

use super::super::{
    access::{Access, Domain, Layout, Uses},
    check::{Place, Poison, Poisoned},
    declaration::Declaration,
    plan::Plan,
    record::Physical,
};
use super::ExecuteError;
use crate::gpu::{Buffer, BufferMemory, BufferUse, CommandEncoder, Gpu, ImageBarrier};

/// One [`Poison`], and a buffer that holds what is copied.
pub(super) struct Spoil {
    what: Poisoned,
    source: Buffer,
}

impl Spoil {
    /// Makes ready what a frame is to be spoilt with.
    pub fn all(
        gpu: &Gpu,
        poisons: &[Poison],
        declaration: &Declaration,
        plan: &Plan,
    ) -> Result<Vec<Self>, ExecuteError> {
        let one = |poison: &Poison| {
            let what = poison.resolve(declaration, &plan.order)?;
            let bytes = what.bytes.len() as u64;
            let mut source = Buffer::new(gpu, "poison", bytes, BufferMemory::Upload, BufferUse::Storage)?;
            source.write(0, &what.bytes)?;
            Ok(Self { what, source })
        };
        poisons.iter().map(one).collect()
    }

    /// The pass whose output it is.
    pub fn pass(&self) -> u32 {
        self.what.pass
    }

    /// Copies over the pixel or element once all commands of the pass are done, and leaves the rest as the pass left it.
    pub fn record(&self, encoder: &mut CommandEncoder, physical: &[Physical]) {
        let Poisoned { resource, length, place, part, layout, .. } = self.what;
        encoder.full_barrier();
        match (&physical[resource as usize], place) {
            (Physical::Image(image), Place::Pixel { x, y, .. }) => {
                let (all, copied) = (Uses::ANY, Uses::of((Access::CopyWrite, Domain::Copy)));
                let there = (layout, Layout::TransferTarget);
                encoder.barriers(&[], &[ImageBarrier::new(image, part, (all, copied), there, None)]);
                encoder.copy_pixel(&self.source, image, part, [x, y]);
                let back = (Layout::TransferTarget, layout);
                encoder.barriers(&[], &[ImageBarrier::new(image, part, (copied, all), back, None)]);
            }
            (Physical::Buffer(range), Place::Element(index)) => {
                encoder.copy_buffer(&self.source, 0, &range.buffer, range.offset + 4 * index, length);
            }
            (Physical::Image(_) | Physical::Buffer(_) | Physical::Accel(_) | Physical::Unused, _) => {}
        }
        encoder.full_barrier();
    }
}
