//! Looking at a frame while it is declared.

use super::{
    builder::PassBuilder,
    check::Poison,
    handle::{Handle, Image},
    pass::{FrameGraph, Produced},
};

impl FrameGraph {
    /// Lets `observer` see every image output of the passes declared from now on, each while it is still the newest version.
    /// Passes that the observer itself declares are not shown to it. `--view` stands on this.
    pub fn observe(&mut self, mut observer: impl FnMut(&mut Self, &Produced) + 'static) {
        self.observe_passes(move |g, pass| {
            for one in g.images_of(pass) {
                observer(g, &one);
            }
        });
    }

    /// Lets `observer` see every pass declared from now on, by its index, while its outputs are the newest versions and what it
    /// only read still is. It takes the place of any observer before it. The scan of [`check`](super::check) stands on this.
    pub fn observe_passes(&mut self, observer: impl FnMut(&mut Self, u32) + 'static) {
        self.observer = Some(Box::new(observer));
    }

    /// Lets `observer` see what [`slot_image`](Self::slot_image) is told from now on. It takes the place of any before it.
    pub fn observe_slots(&mut self, observer: impl FnMut(&mut Self, &str, Option<Handle<Image>>) + 'static) {
        self.slot_observer = Some(Box::new(observer));
    }

    /// Says which image a slot of the frame gives, whichever implementation made it; `None` where the slot is off and gives nothing.
    /// It costs nothing unless somebody observes.
    pub fn slot_image(&mut self, slot: &str, image: Option<Handle<Image>>) {
        if let Some(mut observer) = self.slot_observer.take() {
            observer(self, slot, image);
            self.slot_observer = Some(observer);
        }
    }

    /// Spoils one pixel or element of one output of a pass, as if the pass had written it so: for tests of what finds NaN.
    ///
    /// Running the frame fails with [`ExecuteError::Poison`](super::execute::ExecuteError::Poison) where that cannot be done.
    pub fn poison(&mut self, poison: Poison) {
        self.poisons.push(poison);
    }

    /// Says that this output of this pass will be looked at, for [`PassBuilder::is_watched`], as others may be. It does not keep the
    /// output alive.
    pub fn watch(&mut self, pass: &str, output: &str) {
        self.watched.push((pass.to_owned(), output.to_owned()));
    }
}

impl PassBuilder<'_> {
    /// Whether somebody looks at this output of the pass. An image that serves inspection alone is made only then, so that it costs
    /// nothing else.
    #[must_use]
    pub fn is_watched(&self, output: &str) -> bool {
        let pass = self.graph.declaration.pass_name(self.pass);
        self.graph.watched.iter().any(|(p, o)| p == pass && o == output)
    }
}
