//! Minimal effects with history, and a CPU model of each.
use anyhow::{Context, Result, ensure};
use bytemuck::{Pod, Zeroable};
use magpie::gpu::{Buffer, Gpu, Kernel};
use magpie::graph::execute::{ExecuteOptions, Executed, Executor, Imports};
use magpie::graph::{
    Access, BufferDesc, Domain, Extent, Format, FrameGraph, Handle, HistoryScope, Image, ImageDesc, Part, Queue,
    Record, Switches, WriteHandle,
};
use magpie_shaders::{Address, SampledImage, StorageImage};
use magpie_tests::bench::{Shared, results};
use std::sync::Arc;

const HEAD: &str = r#"#version 460
#extension GL_GOOGLE_include_directive : require
#include "lib/bindless.glsl"
"#;

const ADD: &str = r#"
layout(local_size_x = 8, local_size_y = 8) in;
layout(push_constant, scalar) uniform Push { uint before; uint after; uvec2 size; float unit; uint salt; uint whole; };
void main() {
    uvec2 p = gl_GlobalInvocationID.xy;
    if (any(greaterThanEqual(p, size))) return;
    uvec4 more = uvec4(0, 1, 2, 3) + 1u + (p.x * 3u + p.y * 5u + salt) % 13u;
    if (whole == 1u) store_uint(after, ivec2(p), load_uint(before, ivec2(p)) + more);
    else store(after, ivec2(p), load(before, ivec2(p)) + unit * vec4(more));
}
"#;

const READ: &str = r#"
layout(local_size_x = 8, local_size_y = 8) in;
layout(buffer_reference, scalar, buffer_reference_align = 4) writeonly buffer Texels { uvec4 at[]; };
layout(push_constant, scalar) uniform Push { uvec2 to; uint image; uint first; uvec2 size; uint whole; };
void main() {
    uvec2 p = gl_GlobalInvocationID.xy;
    if (any(greaterThanEqual(p, size))) return;
    uvec4 value = whole == 1u ? load_uint(image, ivec2(p)) : floatBitsToUint(load(image, ivec2(p)));
    Texels(to).at[first + p.y * size.x + p.x] = value;
}
"#;

const WORDS: &str = r#"
layout(local_size_x = 64) in;
layout(buffer_reference, scalar, buffer_reference_align = 4) buffer Words { uint at[]; };
layout(push_constant, scalar) uniform Push { uvec2 before; uvec2 after; uint count; };
void main() {
    uint i = gl_GlobalInvocationID.x;
    if (i < count) Words(after).at[i] = Words(before).at[i] + i + 1u;
}
"#;

#[repr(C)]
#[derive(Clone, Copy, Pod, Zeroable)]
struct Add {
    before: SampledImage,
    after: StorageImage,
    size: [u32; 2],
    unit: f32,
    salt: u32,
    whole: u32,
}

#[repr(C)]
#[derive(Clone, Copy, Pod, Zeroable)]
struct Read {
    to: Address,
    image: SampledImage,
    first: u32,
    size: [u32; 2],
    whole: u32,
}

#[repr(C)]
#[derive(Clone, Copy, Pod, Zeroable)]
struct Words {
    before: Address,
    after: Address,
    count: u32,
}

/// An executor with validation, and the kernels of the effects.
pub struct Rig {
    pub gpu: Gpu,
    pub executor: Executor,
    pub kernels: Kernels,
}

#[derive(Clone, Copy)]
pub struct Kernels {
    add: Kernel,
    read: Kernel,
    words: Kernel,
}

impl Rig {
    pub fn new(gpu: &Gpu, words: &str) -> Result<Self> {
        let mut switches = Switches::default();
        for word in words.split(',').filter(|w| !w.is_empty()) {
            ensure!(switches.set(word), "{word}");
        }
        let executor = Executor::with(gpu, ExecuteOptions { switches, ..Default::default() })?;
        let kernel = |name: &str, glsl: &str| -> Result<Kernel> {
            let words = magpie_shaders::compile(name, &format!("{HEAD}{glsl}"), magpie_shaders::Stage::Compute)?;
            Ok(gpu.kernel_from_words(name, &words)?)
        };
        let kernels = Kernels {
            add: kernel("history.add.comp", ADD)?,
            read: kernel("history.read.comp", READ)?,
            words: kernel("history.words.comp", WORDS)?,
        };
        Ok(Self { gpu: gpu.clone(), executor, kernels })
    }

    /// Runs one frame; validation messages are errors.
    pub fn frame<T>(
        &mut self,
        full: Extent,
        declare: impl FnOnce(&mut Frame<'_>) -> Result<T>,
    ) -> Result<(T, Executed)> {
        let imports = Shared::default();
        let mut g = self.executor.begin(full);
        let mut frame = Frame { g: &mut g, imports: &imports, gpu: &self.gpu, kernels: self.kernels };
        let declared = declare(&mut frame)?;
        let executed = self.executor.run(g, &imports.borrow())?;
        self.gpu.check_validation()?;
        Ok((declared, executed))
    }

    /// Runs one frame of these effects and compares their results with the model.
    pub fn images(&mut self, full: Extent, effects: &mut [&mut Accumulate], valid: &[bool]) -> Result<()> {
        let (pending, _) = self.frame(full, |f| effects.iter().map(|e| e.declare(f)).collect::<Result<Vec<_>>>())?;
        effects.iter_mut().zip(&pending).zip(valid).try_for_each(|((effect, seen), valid)| effect.check(seen, *valid))
    }

    /// An empty frame.
    pub fn nothing(&mut self) -> Result<()> {
        let imports = Imports::default();
        let g = self.executor.begin(Extent::new(1, 1));
        self.executor.run(g, &imports)?;
        Ok(())
    }
}

/// A frame that is being declared.
pub struct Frame<'a> {
    pub g: &'a mut FrameGraph,
    imports: &'a Shared,
    gpu: &'a Gpu,
    kernels: Kernels,
}

/// An image history: each frame adds a number to every texel that depends on the texel.
pub struct Accumulate {
    /// Prefix of its pass names; the history has the same name for all.
    pub name: &'static str,
    pub scope: HistoryScope,
    pub desc: ImageDesc,
    last: Vec<[u32; 4]>,
}

/// Read-back of an image in one frame.
pub struct Seen {
    valid: bool,
    parts: Vec<(Part, Extent, usize)>,
    before: Arc<Buffer>,
    after: Arc<Buffer>,
}

impl Accumulate {
    pub fn new(name: &'static str, desc: ImageDesc) -> Self {
        Self { name, scope: HistoryScope::new(), desc, last: Vec::new() }
    }

    /// Replaces the effect by another instance, which has a history of its own.
    pub fn swap(&mut self) {
        self.scope = HistoryScope::new();
    }

    /// The smallest step between two values of the format.
    fn unit(&self) -> f32 {
        match self.desc.format {
            Format::R8Unorm | Format::Rg8Unorm | Format::Rgba8Unorm => 1.0 / 255.0,
            Format::R16Unorm | Format::Rg16Unorm | Format::Rgba16Unorm => 1.0 / 65535.0,
            Format::Rg16Snorm | Format::Rgba16Snorm => 1.0 / 32767.0,
            _ => 1.0,
        }
    }

    pub fn declare(&self, f: &mut Frame<'_>) -> Result<Seen> {
        let history = f.g.history(&self.scope, "colour", self.desc);
        let (whole, extent) = (self.desc.format.is_uint(), f.g.extent(history.previous));
        let (mut parts, mut texels) = (Vec::new(), 0);
        for (mip, layer) in (0..self.desc.mips).flat_map(|m| (0..self.desc.layers).map(move |l| (m, l))) {
            let part = Part { mips: 1, layers: 1, mip: mip as u16, layer: layer as u16 };
            parts.push((part, extent.mip(mip), texels));
            texels += (extent.mip(mip).width * extent.mip(mip).height) as usize;
        }
        let before = f.read(&format!("{}.before", self.name), history.previous, &parts, whole)?;
        let mut next = history.next;
        for &(part, size, _) in &parts {
            next = self.add(f, history.previous, next, part, size);
        }
        let after = f.read(&format!("{}.after", self.name), next.read(), &parts, whole)?;
        Ok(Seen { valid: history.valid, parts, before, after })
    }

    fn add(
        &self,
        f: &mut Frame<'_>,
        previous: Handle<Image>,
        next: WriteHandle<Image>,
        part: Part,
        size: Extent,
    ) -> WriteHandle<Image> {
        let name = format!("{}.add.{}.{}", self.name, part.mip, part.layer);
        let (kernel, unit, whole) = (f.kernels.add, self.unit(), self.desc.format.is_uint());
        f.g.pass(&name, Queue::AsyncCompute, |p| {
            let before = p.sample_part(previous, part);
            let (next, after) = p.write_part(next, part);
            (next, move |c: &mut Record<'_>| {
                let params = Add {
                    before: c.id(before),
                    after: c.id(after),
                    size: [size.width, size.height],
                    unit,
                    salt: salt(part),
                    whole: whole.into(),
                };
                c.dispatch(kernel, &params, size);
            })
        })
    }

    /// Compares a frame's read-back with the model: the previous frame's values if valid, else zeros.
    pub fn check(&mut self, seen: &Seen, valid: bool) -> Result<()> {
        let name = self.name;
        ensure!(seen.valid == valid, "{name}: valid is {}, should be {valid}", seen.valid);
        let (channels, units) = (self.desc.format.channels() as usize, f64::from(self.unit()).recip());
        let whole = |texel: &[u32; 4], c: usize| -> Result<u32> {
            if self.desc.format.is_uint() {
                return Ok(texel[c]);
            }
            let value = f64::from(f32::from_bits(texel[c])) * units;
            ensure!((value - value.round()).abs() < 0.01 && value >= 0.0, "{name}: {value} is no whole number");
            Ok(value.round() as u32)
        };
        let texels = |buffer: &Buffer| -> Result<Vec<[u32; 4]>> {
            let raw: Vec<[u32; 4]> = bytemuck::pod_collect_to_vec(buffer.contents());
            raw.iter().map(|t| Ok([whole(t, 0)?, whole(t, 1)?, whole(t, 2)?, whole(t, 3)?])).collect()
        };
        let (before, after) = (texels(&seen.before)?, texels(&seen.after)?);
        for &(part, size, first) in &seen.parts {
            for i in 0..(size.width * size.height) as usize {
                let (x, y) = (i as u32 % size.width, i as u32 / size.width);
                for c in 0..channels {
                    let (was, is) = (before[first + i][c], after[first + i][c]);
                    let expected = if valid { self.last[first + i][c] } else { 0 };
                    let more = c as u32 + 1 + (x * 3 + y * 5 + salt(part)) % 13;
                    ensure!(was == expected, "{name}: ({x}, {y}) of {part:?}: {was} was read instead of {expected}");
                    ensure!(is == was + more, "{name}: ({x}, {y}) of {part:?}: {is} instead of {was} + {more}");
                }
            }
        }
        self.last = after;
        Ok(())
    }
}

fn salt(part: Part) -> u32 {
    u32::from(part.mip) * 11 + u32::from(part.layer) * 7
}

impl Frame<'_> {
    /// Reads back texels of parts of an image, four words each.
    pub fn read(
        &mut self,
        name: &str,
        image: Handle<Image>,
        parts: &[(Part, Extent, usize)],
        whole: bool,
    ) -> Result<Arc<Buffer>> {
        let (_, size, first) = parts.last().copied().context("an image without parts")?;
        let bytes = (first as u64 + u64::from(size.width * size.height)) * 16;
        let (mut target, buffer) = results(self.gpu, self.g, self.imports, name, bytes)?;
        for &(part, size, first) in parts {
            let kernel = self.kernels.read;
            target = self.g.pass(&format!("{name}.{}.{}", part.mip, part.layer), Queue::Graphics, |p| {
                let image = p.sample_part(image, part);
                let (target, to) = p.write_buffer(target);
                (target, move |c: &mut Record<'_>| {
                    let (image, size_words) = (c.id(image), [size.width, size.height]);
                    let first = first as u32;
                    let params = Read { to: c.id(to), image, first, size: size_words, whole: whole.into() };
                    c.dispatch(kernel, &params, size);
                })
            });
        }
        self.g.leave(target.read(), Access::HostRead, Domain::Copy);
        Ok(buffer)
    }

    /// Reads back bytes of a buffer.
    pub fn copy(&mut self, name: &str, from: Handle<magpie::graph::Buffer>, bytes: u64) -> Result<Arc<Buffer>> {
        let (target, buffer) = results(self.gpu, self.g, self.imports, name, bytes)?;
        let target = self.g.pass(name, Queue::Transfer, |p| {
            let from = p.copy_from(from);
            let (target, to) = p.copy_to(target);
            (target, move |c: &mut Record<'_>| c.copy_buffer(from, 0, to, 0, bytes))
        });
        self.g.leave(target.read(), Access::HostRead, Domain::Copy);
        Ok(buffer)
    }

    /// A history of words: each is incremented by its number, from 1. Returns validity, and buffers with the words before and after.
    pub fn words(&mut self, scope: &HistoryScope, count: u32) -> Result<(bool, Arc<Buffer>, Arc<Buffer>)> {
        let bytes = u64::from(count) * 4;
        let history = self.g.history_buffer(scope, "words", BufferDesc::new(bytes));
        let before = self.copy("words.before", history.previous, bytes)?;
        let kernel = self.kernels.words;
        let next = self.g.pass("words.add", Queue::AsyncCompute, |p| {
            let before = p.read(history.previous);
            let (next, after) = p.write_buffer(history.next);
            (next, move |c: &mut Record<'_>| {
                let params = Words { before: c.id(before), after: c.id(after), count };
                c.dispatch_groups(kernel, &params, [count.div_ceil(64), 1, 1]);
            })
        });
        let after = self.copy("words.after", next.read(), bytes)?;
        Ok((history.valid, before, after))
    }

    /// The same in a kept buffer, of which `count` words are read and `written` are written. Returns how many bytes were valid, and a
    /// buffer with the words afterwards.
    pub fn kept(&mut self, scope: &HistoryScope, count: u32, written: u32) -> Result<(u64, Arc<Buffer>)> {
        let bytes = u64::from(count) * 4;
        let kept = self.g.kept_buffer(scope, "kept", BufferDesc::new(bytes));
        let kernel = self.kernels.words;
        let buffer = self.g.pass("kept.add", Queue::Graphics, |p| {
            let (buffer, words) = p.write_buffer(kept.buffer);
            (buffer, move |c: &mut Record<'_>| {
                let params = Words { before: c.id(words), after: c.id(words), count: written };
                c.dispatch_groups(kernel, &params, [written.div_ceil(64), 1, 1]);
            })
        });
        Ok((kept.valid_bytes, self.copy("kept.after", buffer.read(), bytes)?))
    }
}

/// Reads the words of a buffer.
pub fn words_of(buffer: &Buffer, count: u32) -> Vec<u32> {
    bytemuck::pod_collect_to_vec(&buffer.contents()[..count as usize * 4])
}
