//! Which image of its frames a renderer looks into.
use crate::parts::inspect::{Inspection, Inspector, Lookout};
use crate::renderer::{RenderError, Renderer};
use magpie::graph::Extent;
use magpie::graph::execute::Imports;
use magpie::slot::Build;
use std::cell::RefCell;
use std::rc::Rc;

impl Renderer {
    /// Looks into an image of each frame from the next one on, or into none. [`Picture::inspected`](crate::Picture::inspected) is what it looks
    /// like, [`FrameResult::inspected`](crate::FrameResult::inspected) is what was found in it. Both are `None` in frames that do not have the
    /// image; that is no error. A pass that nothing else needs runs for this, and all that the picture needs runs as well.
    ///
    /// # Errors
    /// [`RenderError::Stage`] if the pipelines cannot be described.
    pub fn inspect(&mut self, inspection: Option<Inspection>) -> Result<(), RenderError> {
        if inspection.is_some() && self.inspector.is_none() {
            self.inspector = Some(Inspector::new(&self.gpu, &Build::new(&self.gpu, self.options.rays))?);
        }
        self.inspection = inspection;
        Ok(())
    }

    /// Waits for the image in the frame that is about to be declared.
    pub(crate) fn lookout(&self, picture: Extent, imports: &Rc<RefCell<Imports>>) -> Option<Lookout> {
        let (inspector, inspection) = (self.inspector.as_ref()?, self.inspection.as_ref()?);
        Some(Lookout::new(inspector, inspection, picture, imports))
    }
}
