//! Catches an image of the frame right after the pass that makes it, before later passes change it.
use super::{Inspecting, Inspection, Inspector};
use magpie::gpu::GpuError;
use magpie::graph::execute::Imports;
use magpie::graph::{Declaration, ImportKey, Origin};
use magpie::prelude::*;
use std::cell::RefCell;
use std::rc::Rc;

/// Waits for an image while a frame is declared. Clones wait for the same one.
#[derive(Clone)]
pub(crate) struct Lookout {
    inspector: Inspector,
    picture: Extent,
    imports: Rc<RefCell<Imports>>,
    state: Rc<RefCell<State>>,
}

#[derive(Default)]
struct State {
    /// `None` once it was found, or is no longer waited for.
    wanted: Option<Inspection>,
    found: Option<Result<Inspecting, GpuError>>,
}

impl Lookout {
    /// `imports` are those of the frame.
    pub fn new(
        inspector: &Inspector,
        inspection: &Inspection,
        picture: Extent,
        imports: &Rc<RefCell<Imports>>,
    ) -> Self {
        let state = State { wanted: Some(inspection.clone()), found: None };
        let (inspector, imports) = (inspector.clone(), imports.clone());
        Self { inspector, picture, imports, state: Rc::new(RefCell::new(state)) }
    }

    /// Looks at what a pass has just written.
    pub fn see(&self, g: &mut FrameGraph, pass: u32) {
        let mut state = self.state.borrow_mut();
        let is_it = |wanted: &Inspection| g.declaration().pass_name(pass) == wanted.pass;
        let Some(wanted) = state.wanted.take_if(|wanted| is_it(wanted)) else { return };
        let found = g.images_of(pass).into_iter().find(|image| image.output == wanted.output);
        // Whoever declares a pass may have borrowed the imports; there is no image then.
        let (Some(found), Ok(mut imports)) = (found, self.imports.try_borrow_mut()) else { return };
        if is_readable(g.declaration(), found.image.id(), &imports) {
            state.found = Some(self.inspector.add(g, &mut imports, found.image, &wanted, self.picture));
        }
    }

    /// Ends the wait, and returns the image if it was made.
    ///
    /// # Errors
    /// Those of [`Inspector::add`].
    pub fn end(&self) -> Result<Option<Inspecting>, GpuError> {
        let mut state = self.state.borrow_mut();
        state.wanted = None;
        state.found.take().transpose()
    }
}

/// Whether shaders can read an image: those that callers import may have been made for other uses.
fn is_readable(declaration: &Declaration, image: u32, imports: &Imports) -> bool {
    match declaration.resources[image as usize].origin {
        Origin::Imported { key: key @ ImportKey::Caller(_), .. } => imports.is_sampled(key),
        Origin::Imported { .. } | Origin::Transient => true,
    }
}
