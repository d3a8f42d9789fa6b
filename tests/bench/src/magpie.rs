//! Magpie's frame graph, with the whole frame declared anew every time.

use crate::{BenchError, Clock, Contestant, Frame, Variant, Work};
use magpie::gpu::{Buffer, BufferMemory, BufferUse, Gpu, Kernel};
use magpie::graph::execute::{ExecuteOptions, Executor, Imports};
use magpie::graph::{
    Access, BufferDesc, Domain, Extent, Format, FrameGraph, Handle, ImageDesc, MipCopy, Queue, Record, Switches,
};
use magpie_shaders::bench::{BufferParams, ImageParams, SIDE};
use magpie_shaders::{BENCH_BUFFER_COMP, BENCH_IMAGE_COMP};
use std::sync::Arc;

/// The graph, with or without its cache of plans. Like the others it records on the calling thread only, and takes no GPU timestamps.
pub struct Magpie {
    cached: bool,
    executor: Executor,
    imports: Imports,
    kernels: [Kernel; 2],
    work: Work,
    /// Names of the passes, kept by the application: creating them is not part of the graph's work.
    names: Vec<String>,
    result: Arc<Buffer>,
}

impl Magpie {
    /// On this device.
    ///
    /// # Errors
    /// [`BenchError::Gpu`].
    pub fn new(gpu: &Gpu, cached: bool) -> Result<Self, BenchError> {
        let bytes = Variant::Buffer.bytes();
        let switches = Switches { cache: cached, ..Switches::default() };
        let options = ExecuteOptions { switches, measure: false, passes_per_thread: None, ..ExecuteOptions::default() };
        Ok(Self {
            cached,
            executor: Executor::with(gpu, options)?,
            imports: Imports::default(),
            kernels: [gpu.kernel(&BENCH_BUFFER_COMP)?, gpu.kernel(&BENCH_IMAGE_COMP)?],
            work: Work { variant: Variant::Buffer, passes: 0 },
            names: Vec::new(),
            result: Arc::new(Buffer::new(gpu, "result", bytes, BufferMemory::ReadBack, BufferUse::Storage)?),
        })
    }

    /// Declares the passes and the copy.
    fn declare(&self, g: &mut FrameGraph, imports: &mut Imports) {
        let desc = BufferDesc::new(self.work.variant.bytes());
        let key = imports.buffer(&self.result);
        let target = g.import_buffer("result", desc, Access::HostRead, key);
        let target = match self.work.variant {
            Variant::Buffer => {
                let last = self.chain(g, self.buffer_pass(desc));
                g.pass("copy", Queue::Transfer, |p| {
                    let from = last.map(|last| p.copy_from(last));
                    let (target, to) = p.copy_to(target);
                    (target, move |c: &mut Record<'_>| {
                        if let Some(from) = from {
                            c.copy_buffer(from, 0, to, 0, desc.bytes);
                        }
                    })
                })
            }
            Variant::Image => {
                let last = self.chain(g, self.image_pass());
                g.pass("copy", Queue::Transfer, |p| {
                    let from = last.map(|last| p.copy_from(last));
                    let (target, to) = p.copy_to(target);
                    (target, move |c: &mut Record<'_>| {
                        if let Some(from) = from {
                            c.copy_from_image(from, to, MipCopy { offset: 0, mip: 0 });
                        }
                    })
                })
            }
        };
        g.leave(target.read(), Access::HostRead, Domain::Copy);
    }

    /// Adds all passes, each with the outputs of the two before it, and returns the output of the last.
    fn chain<K>(
        &self,
        g: &mut FrameGraph,
        mut pass: impl FnMut(&mut FrameGraph, &str, u32, [Option<Handle<K>>; 2]) -> Handle<K>,
    ) -> Option<Handle<K>>
    where
        Handle<K>: Copy,
    {
        let (mut first, mut second) = (None, None);
        for (number, name) in self.names.iter().enumerate() {
            let written = pass(g, name, number as u32, [first, second]);
            (first, second) = (Some(written), first);
        }
        first
    }

    fn buffer_pass(
        &self,
        desc: BufferDesc,
    ) -> impl FnMut(&mut FrameGraph, &str, u32, [Option<Handle<magpie::graph::Buffer>>; 2]) -> Handle<magpie::graph::Buffer>
    {
        let kernel = self.kernels[0];
        move |g, name, number, before| {
            g.pass(name, Queue::Graphics, |p| {
                let [first, second] = before.map(|b| b.map(|b| p.read(b)));
                let (output, result) = p.create_buffer("cells", desc);
                (output.read(), move |c: &mut Record<'_>| {
                    let address = |token: Option<_>| token.map(|token| c.id(token)).unwrap_or_default();
                    let (first, second) = (address(first), address(second));
                    let params = BufferParams { first, second, result: c.id(result), number };
                    c.dispatch_groups(kernel, &params, [1; 3]);
                })
            })
        }
    }

    fn image_pass(
        &self,
    ) -> impl FnMut(&mut FrameGraph, &str, u32, [Option<Handle<magpie::graph::Image>>; 2]) -> Handle<magpie::graph::Image>
    {
        let kernel = self.kernels[1];
        let desc = ImageDesc::fixed(Format::R32Uint, Extent::new(SIDE, SIDE));
        move |g, name, number, before| {
            g.pass(name, Queue::Graphics, |p| {
                let [first, second] = before.map(|b| b.map(|b| p.storage(b)));
                let (output, result) = p.create("cells", desc);
                (output.read(), move |c: &mut Record<'_>| {
                    let index = |token: Option<_>| token.map(|token| c.id(token)).unwrap_or_default();
                    let (first, second) = (index(first), index(second));
                    let params = ImageParams { first, second, result: c.id(result), number };
                    c.dispatch_groups(kernel, &params, [1; 3]);
                })
            })
        }
    }
}

impl Contestant for Magpie {
    fn name(&self) -> &'static str {
        if self.cached { "magpie cached" } else { "magpie uncached" }
    }

    fn about(&self) -> &'static str {
        if self.cached {
            "declared and recorded anew every frame; the plan is that of the frame before, which is compared with it"
        } else {
            "declared, planned and recorded anew every frame"
        }
    }

    fn prepare(&mut self, work: Work) -> Result<(), BenchError> {
        self.work = work;
        self.names = (0..work.passes).map(|number| format!("bench.{number}")).collect();
        Ok(())
    }

    fn frame(&mut self, clock: &mut Clock) -> Result<Frame, BenchError> {
        let zeros = vec![0; self.result.bytes() as usize];
        let shared = BenchError::Failed { contestant: "magpie", what: "result", message: "still in use".to_owned() };
        Arc::get_mut(&mut self.result).ok_or(shared)?.write(0, &zeros)?;

        clock.start();
        let mut imports = std::mem::take(&mut self.imports);
        let mut g = self.executor.begin(Extent::new(SIDE, SIDE));
        self.declare(&mut g, &mut imports);
        clock.lap("declare");
        let ran = self.executor.run(g, &imports);
        clock.stop();
        imports.clear();
        self.imports = imports;
        let executed = ran?;
        let sample = &executed.sample;
        // The rest of the call, without its known phases and the wait, counts as planning.
        let known = sample.record_ns + sample.submit_ns + sample.wait_ns;
        clock.note("plan", sample.cpu_ns.saturating_sub(known));
        clock.note("record", sample.record_ns);
        clock.note("submit", sample.submit_ns);
        let barriers = Some(sample.barriers);
        clock.retire(|| drop(executed));
        Ok(Frame { barriers })
    }

    fn result(&self) -> Result<Vec<u32>, BenchError> {
        let bytes = &self.result.contents()[..self.work.variant.bytes() as usize];
        Ok(bytemuck::pod_collect_to_vec(bytes))
    }
}
