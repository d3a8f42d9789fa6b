//! Frames that were submitted: their tickets, and what is done once the device has run them.
use crate::parts::inspect::Inspecting;
use crate::picture::NamedCopies;
use crate::read_back::Copies;
use crate::renderer::{FrameResult, ReadBack, RenderError, Renderer};
use crate::slots::Slots;
use magpie::gpu::{GpuError, SemaphoreValue};
use magpie::graph::check::Scanned;
use magpie::graph::execute::{ExecuteError, Executed, InFlight};
use magpie::measure::FrameSample;
use magpie::pixels::Pixels;
use magpie::scene::ResidentError;
use std::cell::RefCell;
use std::rc::Rc;

/// A frame that was submitted: [`Renderer::finish`] has its result. The frame runs to its end without the ticket as well.
#[must_use]
pub struct FrameTicket {
    pub(crate) frame: u32,
    pub(crate) done: SemaphoreValue,
    pub(crate) result: Outcome,
}

/// Where the result of a frame is left.
pub(crate) type Outcome = Rc<RefCell<Option<Result<FrameResult, RenderError>>>>;

impl FrameTicket {
    /// Number of the frame, from 0.
    pub fn frame(&self) -> u32 {
        self.frame
    }

    /// The semaphore value that the device reaches when the frame is done: other work on the device can wait for it. The semaphore is destroyed
    /// with the last clone of the [`Gpu`](magpie::gpu::Gpu); what waits for it must be done by then.
    pub fn done(&self) -> SemaphoreValue {
        self.done
    }
}

/// A frame in flight.
pub(crate) struct Pending {
    pub(crate) work: InFlight,
    /// The result, as far as it is known.
    pub(crate) known: FrameResult,
    pub(crate) scan: Option<Scanned>,
    pub(crate) copies: Copies,
    pub(crate) read: NamedCopies,
    /// The image of [`Renderer::inspect`].
    pub(crate) inspecting: Option<Inspecting>,
    /// Copies of [`Renderer::read_slots`].
    pub(crate) slots: Option<SlotCopies>,
    pub(crate) outcome: Outcome,
}

/// Main images of slots.
pub(crate) struct SlotCopies {
    pub(crate) requested: Vec<String>,
    pub(crate) has_image: Rc<RefCell<Vec<bool>>>,
    pub(crate) copies: Copies,
}

impl Renderer {
    /// Waits for a frame and those before it, and returns its result. Of a lost device the error of the oldest frame that did not end is returned,
    /// whichever frame is asked for.
    ///
    /// # Errors
    /// As [`Renderer::frame`], and [`RenderError::Ticket`] if the ticket is that of another renderer.
    pub fn finish(&mut self, ticket: FrameTicket) -> Result<FrameResult, RenderError> {
        loop {
            if let Some(result) = ticket.result.borrow_mut().take() {
                return result;
            }
            let Some(oldest) = self.pending.pop_front() else {
                return Err(RenderError::Ticket { frame: ticket.frame });
            };
            if Rc::ptr_eq(&oldest.outcome, &ticket.result) {
                return self.complete(oldest);
            }
            if let Some(loss) = self.retire(oldest) {
                return Err(loss);
            }
        }
    }

    /// Waits for all frames in flight. Returns the error of the oldest one that did not end: the one in which the device was lost.
    pub(crate) fn first_loss(&mut self) -> Option<RenderError> {
        let mut first = None;
        while let Some(frame) = self.pending.pop_front() {
            let loss = self.retire(frame);
            first = first.or(loss);
        }
        first
    }

    /// Whether a frame is done, so that [`Renderer::finish`] does not wait for it.
    pub fn is_done(&self, ticket: &FrameTicket) -> bool {
        let of_ticket = self.pending.iter().find(|p| Rc::ptr_eq(&p.outcome, &ticket.result));
        of_ticket.is_none_or(|pending| pending.work.is_done())
    }

    /// Waits for a frame and leaves its result where the holder of the ticket finds it. If the device was lost, its error is returned, and the ticket
    /// gets one that does not name the pass.
    pub(crate) fn retire(&mut self, frame: Pending) -> Option<RenderError> {
        let outcome = frame.outcome.clone();
        let result = self.complete(frame);
        let is_claimed = Rc::strong_count(&outcome) > 1;
        match result {
            Err(loss) if is_loss(&loss) => {
                let later = GpuError::DeviceLost { during: "this frame or one before" };
                outcome.replace(is_claimed.then(|| Err(later.into())));
                return Some(loss);
            }
            result if is_claimed => drop(outcome.replace(Some(result))),
            Err(error) => drop(self.unclaimed.get_or_insert(error)),
            Ok(_) => {}
        }
        None
    }

    /// Waits for a frame. What is known of the scene is not relied upon after an error.
    fn complete(&mut self, frame: Pending) -> Result<FrameResult, RenderError> {
        let result = self.try_complete(frame);
        if result.is_err() {
            self.scene.borrow_mut().forget();
        }
        result
    }

    fn try_complete(&mut self, frame: Pending) -> Result<FrameResult, RenderError> {
        let Pending { work, mut known, scan, copies, read, inspecting, slots, outcome: _ } = frame;
        let Executed { sample, .. } = self.executor.finish(work)?;
        if sample.passes.iter().any(|p| p.not_finite > 0) {
            // Data derived from the scene, such as deformed meshes, is updated only where the scene moves, so it could keep values that are not
            // finite. All of it is updated in the next frame.
            self.scene.borrow_mut().forget();
        }
        if self.options.check {
            self.gpu.check_validation()?;
        }
        let before = std::mem::replace(&mut known.sample, sample);
        let FrameSample { declare_ns, memory, acceleration, .. } = before;
        (known.sample.declare_ns, known.sample.acceleration) = (declare_ns, acceleration);
        known.sample.cpu_ns += declare_ns;
        (known.sample.memory.scene_bytes, known.sample.memory.acceleration_bytes) =
            (memory.scene_bytes, memory.acceleration_bytes);
        if let Some(scanned) = scan {
            known.findings = scanned.findings();
            let FrameResult { frame, declaration, plan, findings, .. } = &known;
            self.tracker.follow(*frame, declaration, &plan.order, findings, &scanned.unscanned());
        }
        if let Some(SlotCopies { requested, has_image, copies }) = slots {
            known.slots = in_order(&requested, &has_image.borrow(), copies.finish()?);
        }
        known.copied = read.finish()?;
        known.inspected = inspecting.map(Inspecting::finish);
        let mut images = copies.finish()?.into_iter();
        known.images = images.next().map(|linear| ReadBack { linear, display: images.next() });
        Ok(known)
    }
}

/// Sorts the images of slots, which come in the order of the frame, by the order in which they were requested.
fn in_order(requested: &[String], has_image: &[bool], images: Vec<Pixels>) -> Vec<(String, Option<Pixels>)> {
    let mut slots: Vec<(String, Option<Pixels>)> = requested.iter().map(|slot| (slot.clone(), None)).collect();
    let in_frame = Slots::with_images().into_iter();
    let places = in_frame.filter_map(|slot| requested.iter().position(|name| name == slot)).filter(|at| has_image[*at]);
    for (at, image) in places.zip(images) {
        slots[at].1 = Some(image);
    }
    slots
}

/// Whether the device was lost.
pub(crate) fn is_loss(error: &RenderError) -> bool {
    match error {
        RenderError::Gpu(error) | RenderError::Scene(ResidentError::Gpu(error)) => {
            matches!(error, GpuError::DeviceLost { .. })
        }
        RenderError::Execute(error) | RenderError::Scene(ResidentError::Upload(error)) => {
            matches!(error, ExecuteError::Lost { .. } | ExecuteError::Gpu(GpuError::DeviceLost { .. }))
        }
        RenderError::Stage(_)
        | RenderError::Config(_)
        | RenderError::Scene(_)
        | RenderError::View(_)
        | RenderError::Target { .. }
        | RenderError::Ticket { .. } => false,
    }
}
