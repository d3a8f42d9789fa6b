//! The tables of the specular lobe's directional albedo, for `split_sum` of `lib/brdf.glsl`: one that gives back what scatters more than once
//! between microfacets, and one for the single-scattering model. All scenes on a device share them. They are computed by the device when the
//! first scene is brought there, before any frame.
use super::ResidentError;
use crate::gpu::{Buffer, BufferMemory, BufferUse, Gpu};
use crate::graph::execute::{Executor, Imports};
use crate::graph::{Access, BufferDesc, Domain, Extent, Queue, Record};
use magpie_shaders::Address;
use magpie_shaders::LOBE_ALBEDO_TABULATE_COMP;
use magpie_shaders::lobe_albedo::{LOBE_ALBEDO_SIZE, LobeAlbedo, TabulateParams};
use std::sync::Arc;

/// Bytes of one table.
const TABLE_BYTES: u64 = (LOBE_ALBEDO_SIZE * LOBE_ALBEDO_SIZE) as u64 * size_of::<LobeAlbedo>() as u64;

/// The tables of this device.
pub(super) fn lobe_albedo(gpu: &Gpu, executor: &mut Executor) -> Result<Arc<Buffer>, ResidentError> {
    gpu.shared_buffer("lobe albedo", || compute(gpu, executor))
}

/// The address of the table for either model.
pub(super) fn address_in(tables: &Buffer, single_scattering: bool) -> Address {
    tables.address().offset(if single_scattering { TABLE_BYTES } else { 0 })
}

/// Computes them, and waits for that.
fn compute(gpu: &Gpu, executor: &mut Executor) -> Result<Arc<Buffer>, ResidentError> {
    let bytes = 2 * TABLE_BYTES;
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
