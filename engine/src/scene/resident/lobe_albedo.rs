//! The table of the specular lobe's directional albedo, for `split_sum` of `lib/brdf.glsl`. All scenes on a device share one. It is computed by
//! the device when the first of them is brought there, before any frame.
use super::ResidentError;
use crate::gpu::{Buffer, BufferMemory, BufferUse, Gpu};
use crate::graph::execute::{Executor, Imports};
use crate::graph::{Access, BufferDesc, Domain, Extent, Queue, Record};
use magpie_shaders::LOBE_ALBEDO_TABULATE_COMP;
use magpie_shaders::lobe_albedo::{LOBE_ALBEDO_SIZE, LobeAlbedo, TabulateParams};
use std::sync::Arc;

/// The table of this device.
pub(super) fn lobe_albedo(gpu: &Gpu, executor: &mut Executor) -> Result<Arc<Buffer>, ResidentError> {
    gpu.shared_buffer("lobe albedo", || compute(gpu, executor))
}

/// Computes it, and waits for it.
fn compute(gpu: &Gpu, executor: &mut Executor) -> Result<Arc<Buffer>, ResidentError> {
    let bytes = u64::from(LOBE_ALBEDO_SIZE * LOBE_ALBEDO_SIZE) * size_of::<LobeAlbedo>() as u64;
    let buffer = Arc::new(Buffer::new(gpu, "lobe albedo", bytes, BufferMemory::Device, BufferUse::Storage)?);
    let kernel = gpu.kernel(&LOBE_ALBEDO_TABULATE_COMP)?;
    let extent = Extent::new(LOBE_ALBEDO_SIZE, LOBE_ALBEDO_SIZE);
    let (mut g, mut imports) = (executor.begin(extent), Imports::default());
    let table = g.import_buffer("lobe_albedo", BufferDesc::new(bytes), Access::BufferWrite, imports.buffer(&buffer));
    let table = g.pass("lobe_albedo.tabulate", Queue::Graphics, |p| {
        let (table, target) = p.write_buffer(table);
        (table, move |c: &mut Record<'_>| c.dispatch(kernel, &TabulateParams { table: c.id(target) }, extent))
    });
    // Later frames read it by its address alone, at any stage.
    g.leave(table.read(), Access::BufferRead, Domain::Compute);
    executor.run(g, &imports)?;
    Ok(buffer)
}
