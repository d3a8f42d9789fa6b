//! Breadcrumbs: which passes a lost device had begun and ended.
//!
//! Each pass has two words in memory that the host can read even after a device loss. The number of the frame is written to the
//! first word before the pass and to the second after it; other values are from earlier frames. With VK_AMD_buffer_marker the
//! device writes them on the fly. Without it they are buffer fills with a barrier on either side, which makes passes run one
//! after another, so this is done only on request.

use super::super::{access::Queue, declaration::Declaration, plan::Plan};
use crate::gpu::{self, BufferMemory, BufferUse, CommandEncoder, Gpu, GpuError, Moment};

const FIRST_PASSES: u32 = 64;
const WORDS: usize = 2;
const WORD_BYTES: usize = size_of::<u32>();

/// How far one queue came.
#[derive(Clone, Debug, PartialEq, Eq)]
pub struct QueueProgress {
    /// The queue that this describes.
    pub queue: Queue,
    /// Name of the last pass that began; `None` if none did.
    pub last_begun: Option<String>,
    /// Name of the first pass that did not end; `None` if all did.
    pub first_unfinished: Option<String>,
}

impl std::fmt::Display for QueueProgress {
    fn fmt(&self, f: &mut std::fmt::Formatter<'_>) -> std::fmt::Result {
        f.write_str(self.queue.name())?;
        match (&self.last_begun, &self.first_unfinished) {
            (_, None) => f.write_str(": every pass ended"),
            (None, Some(first)) => write!(f, ": no pass began, the first is {first}"),
            (Some(begun), Some(first)) if begun == first => write!(f, ": {begun} began last and did not end"),
            (Some(begun), Some(first)) => write!(f, ": {begun} began last, {first} is the first that did not end"),
        }
    }
}

/// The progress of all queues as one sentence, for the error message.
pub(super) fn describe(progress: &[QueueProgress]) -> String {
    if progress.is_empty() {
        return "no breadcrumbs were laid that would name the pass (--breadcrumbs lays them on any device)".to_owned();
    }
    progress.iter().map(ToString::to_string).collect::<Vec<_>>().join("; ")
}

/// Whether one pass began and ended.
#[derive(Clone, Copy, Debug, PartialEq, Eq)]
struct Breadcrumb {
    begun: bool,
    ended: bool,
}

/// The markers of one frame.
pub(super) struct Breadcrumbs {
    gpu: Gpu,
    buffer: Option<gpu::Buffer>,
    /// Number of the frame, the value of its markers. Never 0, since new buffers are zeroed.
    frame: u32,
}

impl Breadcrumbs {
    pub fn new(gpu: &Gpu) -> Self {
        Self { gpu: gpu.clone(), buffer: None, frame: 0 }
    }

    /// Makes room for the passes of a new frame. The device must have finished the one before that used these.
    pub fn prepare(&mut self, passes: u32) -> Result<(), GpuError> {
        self.frame = self.frame.checked_add(1).unwrap_or(1);
        let bytes = |passes: u32| u64::from(passes) * (WORDS * WORD_BYTES) as u64;
        if self.buffer.as_ref().is_none_or(|b| b.bytes() < bytes(passes)) {
            let bytes = bytes(passes.next_power_of_two().max(FIRST_PASSES));
            let mut new =
                gpu::Buffer::new(&self.gpu, "breadcrumbs", bytes, BufferMemory::ReadBack, BufferUse::Storage)?;
            new.write(0, &vec![0; bytes as usize])?;
            self.buffer = Some(new);
        }
        Ok(())
    }

    pub fn open_pass(&self, encoder: &mut CommandEncoder, position: usize) {
        self.mark(encoder, WORDS * position, Moment::Reached);
        if !self.gpu.has_markers() {
            encoder.full_barrier();
        }
    }

    pub fn close_pass(&self, encoder: &mut CommandEncoder, position: usize) {
        if !self.gpu.has_markers() {
            encoder.full_barrier();
        }
        self.mark(encoder, WORDS * position + 1, Moment::Done);
    }

    fn mark(&self, encoder: &mut CommandEncoder, word: usize, moment: Moment) {
        if let Some(buffer) = &self.buffer {
            encoder.mark(buffer, (word * WORD_BYTES) as u64, self.frame, moment);
        }
    }

    /// How far each queue came in the last frame that was prepared. `plan` must be the plan of that frame.
    pub fn progress(&self, declaration: &Declaration, plan: &Plan) -> Vec<QueueProgress> {
        let bytes = self.buffer.as_ref().map_or(&[][..], gpu::Buffer::contents);
        let words: Vec<u32> =
            bytes.as_chunks::<WORD_BYTES>().0.iter().map(|bytes| u32::from_le_bytes(*bytes)).collect();
        progress(&breadcrumbs(&words, self.frame), declaration, plan)
    }
}

/// Decodes the words of a frame, by position.
fn breadcrumbs(words: &[u32], frame: u32) -> Vec<Breadcrumb> {
    let (pairs, _) = words.as_chunks::<WORDS>();
    pairs.iter().map(|[begun, ended]| Breadcrumb { begun: *begun == frame, ended: *ended == frame }).collect()
}

/// How far each queue came, for the queues that the plan uses. Passes without a breadcrumb count as not begun.
fn progress(breadcrumbs: &[Breadcrumb], declaration: &Declaration, plan: &Plan) -> Vec<QueueProgress> {
    let at =
        |position: &usize| breadcrumbs.get(*position).copied().unwrap_or(Breadcrumb { begun: false, ended: false });
    let name = |position: usize| declaration.pass_name(plan.order[position]).to_owned();
    let of_queue = |queue: Queue| {
        let own = || plan.batches.iter().filter(move |b| b.queue == queue).flat_map(|b| b.passes.range());
        own().next()?;
        Some(QueueProgress {
            queue,
            last_begun: own().rev().find(|p| at(p).begun).map(name),
            first_unfinished: own().find(|p| !at(p).ended).map(name),
        })
    };
    Queue::ALL.into_iter().filter_map(of_queue).collect()
}

#[cfg(test)]
mod tests {
    use super::super::super::{
        Extent, Format, FrameGraph, Handle, Image, ImageDesc, Queues, Record, Switches,
        plan::{Packed, plan},
    };
    use super::*;

    /// Batches: graphics draw, light; async compute ao, blur; graphics join.
    fn frame() -> (Declaration, Plan) {
        let mut g = FrameGraph::new(Extent::new(8, 8));
        let mut step = |name: &str, queue, inputs: &[Handle<Image>]| {
            g.pass(name, queue, |p| {
                for &input in inputs {
                    let _token = p.sample(input);
                }
                (p.create("x", ImageDesc::full(Format::R8Unorm)).0.read(), |_: &mut Record<'_>| {})
            })
        };
        let draw = step("draw", Queue::Graphics, &[]);
        let light = step("light", Queue::Graphics, &[draw]);
        let ao = step("ao", Queue::AsyncCompute, &[draw]);
        let blur = step("blur", Queue::AsyncCompute, &[ao]);
        let join = step("join", Queue::Graphics, &[light, blur]);
        g.output(join);
        let declaration = g.finish().unwrap().declaration;
        let switches = Switches { reorder: false, queues: Some(2), ..Switches::default() };
        let plan = plan(&declaration, &switches, Queues::default(), &mut Packed);
        let names: Vec<_> = plan.order.iter().map(|&p| declaration.pass_name(p)).collect();
        assert_eq!(names, ["draw", "light", "ao", "blur", "join"]);
        assert_eq!(plan.batches.len(), 3);
        (declaration, plan)
    }

    /// The progress in frame 7, as (last begun, first unfinished).
    fn frame_progress(words: &[u32]) -> Vec<(Option<String>, Option<String>)> {
        let (declaration, plan) = frame();
        let progress = progress(&breadcrumbs(words, 7), &declaration, &plan);
        assert_eq!(progress.iter().map(|p| p.queue).collect::<Vec<_>>(), [Queue::Graphics, Queue::AsyncCompute]);
        progress.into_iter().map(|p| (p.last_begun, p.first_unfinished)).collect()
    }

    fn pair(begun: &str, unfinished: &str) -> (Option<String>, Option<String>) {
        let some = |name: &str| (!name.is_empty()).then(|| name.to_owned());
        (some(begun), some(unfinished))
    }

    #[test]
    fn nothing_began() {
        let fresh = [pair("", "draw"), pair("", "ao")];
        assert_eq!(frame_progress(&[0; 10]), fresh);
        assert_eq!(frame_progress(&[6; 10]), fresh, "words of the frame before");
        assert_eq!(frame_progress(&[]), fresh, "no words at all");
    }

    #[test]
    fn one_queue_stopped_while_the_other_went_on() {
        let words = [7, 7, 7, 7, 7, 0, 6, 6, 6, 6];
        assert_eq!(frame_progress(&words), [pair("light", "join"), pair("ao", "ao")]);
        let words = [7, 7, 7, 6, 7, 7, 7, 7, 6, 6];
        assert_eq!(frame_progress(&words), [pair("light", "light"), pair("blur", "")]);
    }

    #[test]
    fn passes_overlap() {
        // Both compute passes have begun, and the later one was done first.
        let words = [7, 7, 7, 7, 7, 6, 7, 7, 6, 6];
        assert_eq!(frame_progress(&words)[1], pair("blur", "ao"));
        // Between two passes: one has ended, the next has not begun.
        let words = [7, 7, 6, 6, 6, 6, 6, 6, 6, 6];
        assert_eq!(frame_progress(&words)[0], pair("draw", "light"));
    }

    #[test]
    fn everything_ended() {
        assert_eq!(frame_progress(&[7; 10]), [pair("join", ""), pair("blur", "")]);
    }

    #[test]
    fn the_message_names_queues_and_passes() {
        let (declaration, plan) = frame();
        let words = |words: &[u32]| describe(&progress(&breadcrumbs(words, 7), &declaration, &plan));
        assert_eq!(
            words(&[7, 7, 7, 6, 7, 7, 7, 7, 6, 6]),
            "graphics: light began last and did not end; async compute: every pass ended"
        );
        assert_eq!(
            words(&[7, 7, 0, 0, 0, 0, 0, 0, 0, 0]),
            "graphics: draw began last, light is the first that did not end; async compute: no pass began, the first is ao"
        );
        assert!(describe(&[]).contains("--breadcrumbs"));
    }
}
