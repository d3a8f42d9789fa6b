//! Writes NaN or infinity into outputs within the pass that writes them, to test the detection.

use super::super::{
    access::{Access, Domain, Layout, Uses},
    check::{Place, Poison, Poisoned},
    declaration::Declaration,
    plan::Plan,
    record::Physical,
};
use super::ExecuteError;
use crate::gpu::{Buffer, BufferMemory, BufferUse, CommandEncoder, Gpu, ImageBarrier, Transition};

/// One [`Poison`], and the buffer that its value is copied from.
pub(super) struct PoisonWrite {
    target: Poisoned,
    source: Buffer,
}

impl PoisonWrite {
    /// Resolves the poisons of a frame and fills their buffers.
    pub fn all(
        gpu: &Gpu,
        poisons: &[Poison],
        declaration: &Declaration,
        plan: &Plan,
    ) -> Result<Vec<Self>, ExecuteError> {
        let one = |poison: &Poison| {
            let target = poison.resolve(declaration, &plan.order)?;
            let bytes = target.bytes.len() as u64;
            let mut source = Buffer::new(gpu, "poison", bytes, BufferMemory::Upload, BufferUse::Storage)?;
            source.write(0, &target.bytes)?;
            Ok(Self { target, source })
        };
        poisons.iter().map(one).collect()
    }

    /// Index of the pass whose output is overwritten.
    pub fn pass(&self) -> u32 {
        self.target.pass
    }

    /// Overwrites the pixel or element after all commands of the pass; everything else stays as the pass left it.
    pub fn record(&self, encoder: &mut CommandEncoder, physical: &[Physical]) {
        let Poisoned { resource, length, place, part, layout, .. } = self.target;
        encoder.full_barrier();
        match (&physical[resource as usize], place) {
            (Physical::Image(image), Place::Pixel { x, y, .. }) => {
                let (all, copied) = (Uses::ANY, Uses::of((Access::CopyWrite, Domain::Copy)));
                let there =
                    Transition { from: all, to: copied, layout_from: layout, layout_to: Layout::TransferTarget };
                encoder.barriers(&[], &[ImageBarrier::new(image, part, there, None)]);
                encoder.copy_pixel(&self.source, image, part, [x, y]);
                let back = Transition { from: copied, to: all, layout_from: Layout::TransferTarget, layout_to: layout };
                encoder.barriers(&[], &[ImageBarrier::new(image, part, back, None)]);
            }
            (Physical::Buffer(range), Place::Element(index)) => {
                encoder.copy_buffer(&self.source, 0, &range.buffer, range.offset + 4 * index, length);
            }
            (Physical::Image(_) | Physical::Buffer(_) | Physical::Accel(_) | Physical::Unused, _) => {}
        }
        encoder.full_barrier();
    }
}
