//! The weak passes that scan a frame.

use std::{cell::RefCell, collections::HashSet, rc::Rc, sync::Arc};

use magpie_shaders::{
    Address, CHECK_PROBE_COMP, CHECK_SCAN_COMP, CHECK_SCAN_WORDS_COMP, SampledImage,
    check::{Counted, FLOAT_IMAGE, ProbeParams, ScanParams, ScanWordsParams, Seen as SeenBits, UINT_IMAGE, WORDS},
};

use super::{
    super::{
        access::{Access, Queue},
        declaration::{ImportKey, Origin, Shape, Use},
        desc::{BufferDesc, Extent, Format, Part},
        execute::Imports,
        handle::{self, WriteHandle},
        pass::FrameGraph,
        record::Record,
        token::{BufferToken, SampleToken},
    },
    Finding, Input, InputValue, NotScannable, Place, Value,
    finding::{IndexSpace, corresponding},
};
use crate::gpu::{Buffer, BufferMemory, BufferUse, Gpu, GpuError, Kernel};

/// Size of the first findings buffer of a frame, bytes. Each further one is twice as large.
const FIRST_BUFFER_BYTES: u64 = 1 << 12;

/// Largest buffer that is scanned, in 32-bit words. Shader byte offsets stay below 2^33 and indices fit a positive 32-bit integer.
const MAX_WORDS: u64 = (1 << 31) - 1;

/// Workgroups per dimension that every Vulkan device supports (`maxComputeWorkGroupCount`).
const MAX_GROUPS: u64 = 65_535;

/// The imports of a frame, shared because the scan adds to them while the frame is declared.
pub type SharedImports = Rc<RefCell<Imports>>;

/// The compute pipelines of the scan.
#[derive(Clone, Copy, Debug)]
pub struct Scan {
    image: Kernel,
    words: Kernel,
    probe: Kernel,
}

/// The scan of one frame. Read it after the frame has run.
pub struct Scanned {
    log: Rc<RefCell<ScanLog>>,
}

/// An output that could not be scanned.
#[derive(Clone, Debug, PartialEq, Eq)]
pub struct Unscanned {
    /// The output, as `pass:output`.
    pub name: String,
    /// The reason, in words.
    pub why: String,
}

#[derive(Default)]
struct ScanLog {
    buffers: Vec<Arc<Buffer>>,
    subjects: Vec<ScannedVersion>,
    unscanned: Vec<Unscanned>,
}

/// What was scanned, and where its results are in the findings buffers.
struct ScannedVersion {
    pass: Option<(u32, String)>,
    output: String,
    subject: Subject,
    inputs: Rc<[Source]>,
    buffer: usize,
    offset: u64,
}

/// One version of a resource that is scanned.
#[derive(Clone, Copy)]
struct Subject {
    resource: u32,
    version: u32,
    kind: Scannable,
}

/// A resource whose contents can be scanned.
#[derive(Clone, Copy)]
enum Scannable {
    /// A part of an image; `extent` is the size of mip 0.
    Image { format: Format, extent: Extent, part: Part },
    /// A buffer, with its number of 32-bit words.
    Words(u64),
}

/// A resource that a pass read.
struct Source {
    name: String,
    resource: u32,
    kind: Result<Scannable, NotScannable>,
}

/// The free space of the newest findings buffer.
struct FindingsSpace {
    target: WriteHandle<handle::Buffer>,
    buffer: usize,
    used: u64,
    bytes: u64,
}

struct ScanObserver {
    gpu: Gpu,
    scan: Scan,
    imports: SharedImports,
    log: Rc<RefCell<ScanLog>>,
    space: Option<FindingsSpace>,
    /// Imported resources that have already been scanned in this frame.
    imports_scanned: HashSet<u32>,
}

impl Scan {
    /// Creates the pipelines.
    ///
    /// # Errors
    /// Pipeline creation failed.
    pub fn new(gpu: &Gpu) -> Result<Self, GpuError> {
        Ok(Self {
            image: gpu.kernel(&CHECK_SCAN_COMP)?,
            words: gpu.kernel(&CHECK_SCAN_WORDS_COMP)?,
            probe: gpu.kernel(&CHECK_PROBE_COMP)?,
        })
    }

    /// An observer that scans what every pass declared from now on writes; see [`FrameGraph::observe_passes`].
    ///
    /// Its passes are weak: they keep nothing alive. Two follow each pass: `check.PASS` scans the outputs, and
    /// `check.PASS.inputs` reads the inputs where something was found.
    pub fn observer(self, gpu: &Gpu, imports: &SharedImports) -> (Scanned, impl FnMut(&mut FrameGraph, u32) + 'static) {
        let log = Rc::<RefCell<ScanLog>>::default();
        let mut observer = ScanObserver {
            gpu: gpu.clone(),
            scan: self,
            imports: imports.clone(),
            log: log.clone(),
            space: None,
            imports_scanned: HashSet::new(),
        };
        (Scanned { log }, move |g: &mut FrameGraph, pass: u32| observer.scan_pass(g, pass))
    }
}

impl ScanObserver {
    /// Scans the outputs of a pass, and before that the imports that it is the first to read.
    fn scan_pass(&mut self, g: &mut FrameGraph, pass: u32) {
        let name = g.declaration().pass_name(pass).to_owned();
        let uses = g.declaration().uses_of(pass).to_vec();
        for u in &uses {
            let d = &g.declaration().resources[u.resource as usize];
            let holds_earlier_contents =
                u.reads == Some(0) && d.versions == 1 && !d.is_transient() && !d.is_undefined();
            if holds_earlier_contents && self.imports_scanned.insert(u.resource) {
                let (_, layers) = d.shape.parts();
                let all = Part::ALL.of(d.shape.parts().0, layers);
                let Ok(kind) = self.scannable(g, u.resource, all) else { continue };
                if !kind.can_hold_nan() {
                    continue;
                }
                let output = g.declaration().resource_name(u.resource);
                let subject = Subject { resource: u.resource, version: 0, kind };
                // Several instances of an effect have histories of the same name, so further ones are numbered.
                let namesake = |r: &&u32| **r != u.resource && g.declaration().resource_name(**r) == output;
                let name = match self.imports_scanned.iter().filter(namesake).count() {
                    0 => format!("import.{output}"),
                    others => format!("import.{output}_{}", others + 1),
                };
                self.add(g, &name, None, vec![(output, subject)], Vec::new());
            }
        }
        let mut subjects = Vec::new();
        let written = uses.iter().filter_map(|u| Some((u, u.writes?)));
        for ((u, version), output) in written.zip(g.declaration().outputs_of(pass)) {
            match self.scannable(g, u.resource, u.part) {
                Ok(kind) if kind.can_hold_nan() => {
                    subjects.push((output.name, Subject { resource: u.resource, version, kind }));
                }
                Ok(_) | Err(NotScannable::Raw | NotScannable::Acceleration | NotScannable::Overwritten) => {}
                Err(why @ (NotScannable::TooLarge | NotScannable::NotSampled)) => {
                    self.leave_out(format!("{name}:{}", output.name), why.name());
                }
            }
        }
        if !subjects.is_empty() {
            let sources = uses.iter().filter_map(|u| self.source(g, u, &uses)).collect();
            self.add(g, &name, Some(pass), subjects, sources);
        }
    }

    fn leave_out(&self, name: String, why: &str) {
        self.log.borrow_mut().unscanned.push(Unscanned { name, why: why.to_owned() });
    }

    /// Whether a part of a resource can be scanned, and as what.
    fn scannable(&self, g: &FrameGraph, resource: u32, part: Part) -> Result<Scannable, NotScannable> {
        let decl = &g.declaration().resources[resource as usize];
        match decl.shape {
            Shape::Accel { .. } => Err(NotScannable::Acceleration),
            Shape::Buffer { .. } if !g.declaration().is_floats(resource) => Err(NotScannable::Raw),
            Shape::Buffer { bytes } if bytes / 4 > MAX_WORDS => Err(NotScannable::TooLarge),
            Shape::Buffer { bytes } => Ok(Scannable::Words(bytes / 4)),
            Shape::Image { format, extent, .. } => {
                if let Origin::Imported { key: key @ ImportKey::Caller(_), .. } = decl.origin {
                    // While somebody else has the imports borrowed, their usage is unknown.
                    let known = self.imports.try_borrow().is_ok_and(|imports| imports.is_sampled(key));
                    if !known {
                        return Err(NotScannable::NotSampled);
                    }
                }
                Ok(Scannable::Image { format, extent, part })
            }
        }
    }

    /// What a pass read by one of its uses, if it still holds the same contents after the pass.
    fn source(&self, g: &FrameGraph, read: &Use, all: &[Use]) -> Option<Source> {
        let version = read.reads?;
        let decl = &g.declaration().resources[read.resource as usize];
        if version == 0 && decl.is_undefined() {
            return None; // It had no contents.
        }
        let written = |u: &Use| u.writes.is_some() && u.resource == read.resource && u.part.overlaps(read.part);
        let kind = if all.iter().any(written) {
            Err(NotScannable::Overwritten)
        } else {
            self.scannable(g, read.resource, Part { mips: 1, ..read.part })
        };
        Some(Source { name: g.declaration().resource_name(read.resource), resource: read.resource, kind })
    }

    /// Zeroed space for `bytes` bytes of findings; makes another buffer where the last one is full.
    fn space(&mut self, g: &mut FrameGraph, bytes: u64) -> Result<FindingsSpace, String> {
        if let Some(space) = self.space.take_if(|space| space.used + bytes <= space.bytes) {
            return Ok(space);
        }
        let mut imports = self.imports.try_borrow_mut().map_err(|_| "the imports were in use".to_owned())?;
        let mut log = self.log.borrow_mut();
        let size = bytes.max(FIRST_BUFFER_BYTES << log.buffers.len().min(12));
        let name = format!("check.findings.{}", log.buffers.len());
        let made = Buffer::new(&self.gpu, &name, size, BufferMemory::ReadBack, BufferUse::Storage);
        let mut buffer = made.map_err(|e| e.to_string())?;
        buffer.write(0, &vec![0; size as usize]).map_err(|e| e.to_string())?;
        let buffer = Arc::new(buffer);
        let target = g.import_buffer(&name, BufferDesc::new(size), Access::HostRead, imports.buffer(&buffer));
        log.buffers.push(buffer);
        Ok(FindingsSpace { target, buffer: log.buffers.len() - 1, used: 0, bytes: size })
    }

    /// Adds the passes that scan some outputs of one pass and read its inputs.
    fn add(
        &mut self,
        g: &mut FrameGraph,
        name: &str,
        pass: Option<u32>,
        subjects: Vec<(String, Subject)>,
        sources: Vec<Source>,
    ) {
        let sources: Rc<[Source]> = sources.into();
        let bytes = subjects.iter().map(|(_, s)| s.bytes(sources.len())).sum();
        let FindingsSpace { mut target, buffer, used, bytes: size } = match self.space(g, bytes) {
            Ok(space) => space,
            Err(why) => return subjects.into_iter().for_each(|(o, _)| self.leave_out(format!("{name}:{o}"), &why)),
        };
        let mut offset = used;
        let mut scans: Vec<(Subject, u64)> = Vec::with_capacity(subjects.len());
        for (output, subject) in subjects {
            let pass = pass.map(|p| (p, name.to_owned()));
            let inputs = sources.clone();
            self.log.borrow_mut().subjects.push(ScannedVersion { pass, output, subject, inputs, buffer, offset });
            scans.push((subject, offset));
            offset += subject.bytes(sources.len());
        }

        let kernels = self.scan;
        target = g.weak_pass(&format!("check.{name}"), Queue::Graphics, |p| {
            let subjects: Vec<_> = scans.iter().map(|(s, at)| (*s, *at, Tokens::new(p, s.resource, s.kind))).collect();
            let (target, table) = p.write_buffer(target);
            (target, move |c: &mut Record<'_>| {
                for (subject, offset, tokens) in &subjects {
                    subject.scan(c, kernels, tokens, c.id(table).offset(*offset));
                }
            })
        });
        target = g.weak_pass(&format!("check.{name}.inputs"), Queue::Graphics, |p| {
            let own = |s: &Subject, p: &mut _| (s.kind, Tokens::new(p, s.resource, s.kind));
            let subjects: Vec<_> = scans.iter().map(|(s, at)| (*s, *at, own(s, p))).collect();
            let read = |s: &Source| s.kind.ok().map(|kind| (kind, Tokens::new(p, s.resource, kind)));
            let read: Vec<_> = sources.iter().map(read).collect();
            let (target, table) = p.write_buffer(target);
            (target, move |c: &mut Record<'_>| {
                for (subject, offset, own) in &subjects {
                    let (counted, mut seen) =
                        (c.id(table).offset(*offset), c.id(table).offset(offset + subject.counts()));
                    subject.probe(c, kernels.probe, own, counted, seen, true);
                    for source in &read {
                        seen = seen.offset(size_of::<SeenBits>() as u64);
                        if let Some(source) = source {
                            subject.probe(c, kernels.probe, source, counted, seen, false);
                        }
                    }
                }
            })
        });
        self.space = Some(FindingsSpace { target, buffer, used: offset, bytes: size });
    }
}

/// The tokens of one resource in a pass of the scan; an image has one per layer.
enum Tokens {
    Layers(Vec<SampleToken>),
    Words(BufferToken),
}

impl Tokens {
    fn new(p: &mut super::super::PassBuilder<'_>, resource: u32, kind: Scannable) -> Self {
        let newest = p.graph.declaration().resources[resource as usize].versions - 1;
        match kind {
            Scannable::Image { part, .. } => {
                let image = p.graph.handle(resource, newest);
                let layers = part.layer..part.layer + part.layers;
                Self::Layers(layers.map(|layer| p.sample_part(image, Part { layer, layers: 1, ..part })).collect())
            }
            Scannable::Words(_) => {
                let buffer = p.graph.handle(resource, newest);
                Self::Words(p.read(buffer))
            }
        }
    }
}

impl Scannable {
    /// Whether the contents can hold a NaN.
    fn can_hold_nan(self) -> bool {
        match self {
            Self::Image { format, .. } => format.is_float(),
            Self::Words(count) => count > 0,
        }
    }

    fn format(self) -> Option<Format> {
        match self {
            Self::Image { format, .. } => Some(format),
            Self::Words(_) => None,
        }
    }
}

impl Subject {
    /// Number of [`Counted`]s: one for each mip of each layer.
    fn pieces(&self) -> u32 {
        match self.kind {
            Scannable::Image { part, .. } => u32::from(part.mips) * u32::from(part.layers),
            Scannable::Words(_) => 1,
        }
    }

    /// Bytes of the [`Counted`]s.
    fn counts(&self) -> u64 {
        u64::from(self.pieces()) * size_of::<Counted>() as u64
    }

    /// Bytes of all results: the counts, the bad value, and one value per input.
    fn bytes(&self, inputs: usize) -> u64 {
        self.counts() + (1 + inputs as u64) * size_of::<SeenBits>() as u64
    }

    fn scan(&self, c: &mut Record<'_>, kernels: Scan, tokens: &Tokens, counted: Address) {
        match (self.kind, tokens) {
            (Scannable::Image { extent, part, .. }, Tokens::Layers(layers)) => {
                let mut counted = counted;
                for layer in layers {
                    for mip in 0..u32::from(part.mips) {
                        let size = extent.mip(u32::from(part.mip) + mip);
                        let image = c.id(*layer);
                        let params = ScanParams { image, mip, size: [size.width, size.height], counted };
                        c.dispatch(kernels.image, &params, size);
                        counted = counted.offset(size_of::<Counted>() as u64);
                    }
                }
            }
            (Scannable::Words(count), Tokens::Words(words)) => {
                let groups = count.div_ceil(u64::from(kernels.words.local_size[0]));
                let rows = groups.div_ceil(MAX_GROUPS);
                let params = ScanWordsParams { words: c.id(*words), counted, count: count as u32 };
                c.dispatch_groups(kernels.words, &params, [groups.div_ceil(rows) as u32, rows as u32, 1]);
            }
            (Scannable::Image { .. }, Tokens::Words(_)) | (Scannable::Words(_), Tokens::Layers(_)) => {}
        }
    }

    /// Reads a source at the place where the subject is bad. Parameters that do not apply to the kind of source stay zero.
    fn probe(
        &self,
        c: &mut Record<'_>,
        kernel: Kernel,
        (kind, tokens): &(Scannable, Tokens),
        counted: Address,
        seen: Address,
        own: bool,
    ) {
        let mut params =
            ProbeParams { counted, seen, pieces: self.pieces(), own: u32::from(own), ..ProbeParams::default() };
        match self.kind {
            Scannable::Image { extent, part, .. } => {
                params.size = [extent.width, extent.height];
                (params.mip, params.mips, params.layer) = (part.mip.into(), part.mips.into(), part.layer.into());
            }
            Scannable::Words(count) => params.count = count as u32,
        }
        match (kind, tokens) {
            (Scannable::Image { format, extent, part }, Tokens::Layers(layers)) => {
                let size = extent.mip(part.mip.into());
                params.kind = if format.is_uint() { UINT_IMAGE } else { FLOAT_IMAGE };
                params.source_size = [size.width, size.height];
                let (first, last) = part.layer_range();
                params.source_layers = [first, last];
                for (layer, token) in (first..).zip(layers) {
                    let image: SampledImage = c.id(*token);
                    c.dispatch_groups(kernel, &ProbeParams { image, source_layer: layer, ..params }, [1; 3]);
                }
            }
            (Scannable::Words(count), Tokens::Words(words)) => {
                params.kind = WORDS;
                (params.words, params.source_count) = (c.id(*words), *count as u32);
                c.dispatch_groups(kernel, &params, [1; 3]);
            }
            (Scannable::Image { .. }, Tokens::Words(_)) | (Scannable::Words(_), Tokens::Layers(_)) => {}
        }
    }
}

impl Part {
    /// First and last layer, inclusive; counts must be resolved.
    fn layer_range(self) -> (u32, u32) {
        (self.layer.into(), u32::from(self.layer) + u32::from(self.layers) - 1)
    }
}

impl Scanned {
    /// All findings of the frame, in the order of declaration.
    pub fn findings(&self) -> Vec<Finding> {
        let log = self.log.borrow();
        log.subjects.iter().filter_map(|scanned| scanned.read(&log.buffers)).collect()
    }

    /// Outputs that could not be scanned. Raw buffers are not listed, since they were not declared to hold floats.
    pub fn unscanned(&self) -> Vec<Unscanned> {
        self.log.borrow().unscanned.clone()
    }
}

impl ScannedVersion {
    /// The finding of this subject; `None` if it is clean.
    fn read(&self, buffers: &[Arc<Buffer>]) -> Option<Finding> {
        let Self { subject, .. } = self;
        let bytes = buffers.get(self.buffer)?.contents();
        let end = self.offset + subject.bytes(self.inputs.len());
        let (counts, seen) = bytes.get(self.offset as usize..end as usize)?.split_at(subject.counts() as usize);
        let counts: Vec<Counted> = bytemuck::pod_collect_to_vec(counts);
        let seen: Vec<SeenBits> = bytemuck::pod_collect_to_vec(seen);
        let is_bad = |c: &Counted| c.nan > 0 || c.infinite > 0;
        let first = counts.iter().position(is_bad)?;
        let index = !counts[first].last;

        let (ground, place) = match subject.kind {
            Scannable::Words(count) => (IndexSpace::Buffer(count), Place::Element(index.into())),
            Scannable::Image { extent, .. } => {
                let one = subject.part(first);
                let size = extent.mip(one.mip.into());
                let (x, y) = (index % size.width, index / size.width);
                (IndexSpace::Image(size), Place::Pixel { x, y, mip: one.mip.into(), layer: one.layer.into() })
            }
        };
        let input = |(source, seen): (&Source, &SeenBits)| {
            let seen = match source.kind {
                Ok(kind) => {
                    let (to, mip, layers) = match kind {
                        Scannable::Words(count) => (IndexSpace::Buffer(count), 0, (0, 0)),
                        Scannable::Image { extent, part, .. } => {
                            (IndexSpace::Image(extent.mip(part.mip.into())), part.mip.into(), part.layer_range())
                        }
                    };
                    let at = corresponding(place, ground, to, mip, layers);
                    InputValue::At(at, Value::of(seen.bits, kind.format()))
                }
                Err(why) => InputValue::Unknown(why),
            };
            Input { name: source.name.clone(), seen }
        };
        let (own, read) = seen.split_first()?;
        Some(Finding {
            pass: self.pass.as_ref().map_or_else(|| "import".to_owned(), |(_, name)| name.clone()),
            pass_index: self.pass.as_ref().map(|(index, _)| *index),
            output: self.output.clone(),
            resource: subject.resource,
            version: subject.version,
            nan: counts.iter().map(|c| u64::from(c.nan)).sum(),
            infinite: counts.iter().map(|c| u64::from(c.infinite)).sum(),
            place,
            value: Value::of(own.bits, subject.kind.format()),
            parts: (0..counts.len()).filter(|&i| is_bad(&counts[i])).map(|i| subject.part(i)).collect(),
            inputs: self.inputs.iter().zip(read).map(input).collect(),
        })
    }
}

impl Subject {
    /// The mip and layer that a [`Counted`] belongs to.
    fn part(&self, piece: usize) -> Part {
        match self.kind {
            Scannable::Words(_) => Part { mip: 0, mips: 1, layer: 0, layers: 1 },
            Scannable::Image { part, .. } => {
                let (layer, mip) = (piece as u16 / part.mips, piece as u16 % part.mips);
                Part { mip: part.mip + mip, mips: 1, layer: part.layer + layer, layers: 1 }
            }
        }
    }
}
