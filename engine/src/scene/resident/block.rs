//! Tables in one block of memory, and their upload to the device.
use super::ResidentError;
use crate::gpu::{Buffer, BufferMemory, BufferUse, Gpu, GpuError};
use crate::graph::execute::{Executor, Imports};
use crate::graph::{Access, BufferDesc, Extent, Queue, Record};
use bytemuck::Pod;
use magpie_shaders::Address;
use std::sync::Arc;

/// Tables for one buffer, one after another, each aligned to 16 bytes.
#[derive(Default)]
pub(super) struct Block(pub Vec<u8>);

impl Block {
    pub fn add<T: Pod>(&mut self, items: &[T]) -> u64 {
        self.0.resize(self.0.len().next_multiple_of(16), 0);
        let offset = self.0.len() as u64;
        self.0.extend_from_slice(bytemuck::cast_slice(items));
        offset
    }

    pub fn put<T: Pod>(&mut self, offset: u64, items: &[T]) {
        let bytes = bytemuck::cast_slice(items);
        self.0[offset as usize..offset as usize + bytes.len()].copy_from_slice(bytes);
    }

    pub fn buffer(&self, gpu: &Gpu, name: &str, usage: BufferUse) -> Result<Arc<Buffer>, GpuError> {
        Ok(Arc::new(Buffer::new(gpu, name, self.0.len() as u64, BufferMemory::Device, usage)?))
    }

    pub fn upload(
        &self,
        gpu: &Gpu,
        executor: &mut Executor,
        name: &str,
        usage: BufferUse,
    ) -> Result<Arc<Buffer>, ResidentError> {
        let buffer = self.buffer(gpu, name, usage)?;
        self.copy_to(gpu, executor, &buffer)?;
        Ok(buffer)
    }

    pub fn copy_to(&self, gpu: &Gpu, executor: &mut Executor, target: &Arc<Buffer>) -> Result<(), ResidentError> {
        copy(gpu, executor, &self.0, target)
    }
}

/// A buffer with contents that depend on its address.
pub(super) fn upload_at(
    gpu: &Gpu,
    executor: &mut Executor,
    name: &str,
    bytes: u64,
    contents: impl FnOnce(Address) -> Vec<u8>,
) -> Result<Arc<Buffer>, ResidentError> {
    let buffer = Arc::new(Buffer::new(gpu, name, bytes, BufferMemory::Device, BufferUse::Storage)?);
    copy(gpu, executor, &contents(buffer.address()), &buffer)?;
    Ok(buffer)
}

fn copy(gpu: &Gpu, executor: &mut Executor, contents: &[u8], target: &Arc<Buffer>) -> Result<(), ResidentError> {
    let bytes = contents.len() as u64;
    if bytes == 0 {
        return Ok(());
    }
    let mut staging = Buffer::new(gpu, "staging", bytes, BufferMemory::Upload, BufferUse::Storage)?;
    staging.write(0, contents)?;
    let (mut g, mut imports) = (executor.begin(Extent::new(1, 1)), Imports::default());
    let source =
        g.import_buffer("staging", BufferDesc::new(bytes), Access::CopyRead, imports.buffer(&Arc::new(staging)));
    let desc = BufferDesc::new(target.bytes());
    let to = g.import_buffer(target.name(), desc, Access::CopyWrite, imports.buffer(target));
    let to = g.pass("upload.buffer", Queue::Transfer, |p| {
        let from = p.copy_from(source.read());
        let (to, into) = p.copy_to(to);
        (to, move |c: &mut Record<'_>| c.copy_buffer(from, 0, into, 0, bytes))
    });
    g.output(to.read());
    executor.run(g, &imports)?;
    Ok(())
}
