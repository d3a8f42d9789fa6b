//! Checks an image that a slot of the frame outputs against the contract of that slot.

use super::{
    desc::{Extent, Format},
    error::GraphError,
    handle::{Handle, Image},
    pass::FrameGraph,
};

/// What a slot requires of one of its output images.
#[derive(Clone, Copy, Debug)]
pub struct Contract<'a> {
    /// Name of the slot, such as `shadows`.
    pub slot: &'a str,
    /// Name of the implementation that fills the slot.
    pub implementation: &'a str,
    /// Name of the output in the contract.
    pub output: &'a str,
    /// Formats that are allowed.
    pub formats: &'a [Format],
    /// Required size of mip 0, pixels.
    pub extent: Extent,
}

/// What said that it has nothing to do.
#[derive(Clone, Copy, Debug)]
pub struct Idle<'a> {
    /// Name of the slot.
    pub slot: &'a str,
    /// Name of the implementation.
    pub implementation: &'a str,
    /// Name of the part of it that is idle; `None` where all of it is.
    pub part: Option<&'a str>,
    /// Why.
    pub reason: &'a str,
}

/// Whether a pass belongs to a part of a slot: it is called `slot.part` or `slot.part_...`.
fn is_of_part(pass: &str, slot: &str, part: &str) -> bool {
    let step = pass.strip_prefix(slot).and_then(|rest| rest.strip_prefix('.'));
    let suffix = step.and_then(|step| step.strip_prefix(part));
    suffix.is_some_and(|suffix| suffix.is_empty() || suffix.starts_with('_'))
}

impl FrameGraph {
    /// How many passes were declared so far.
    pub fn pass_count(&self) -> u32 {
        self.declaration.passes.len() as u32
    }

    /// Notes a mistake where what is idle has added passes: any of those from number `first` on, or of a part those called `slot.part` or
    /// `slot.part_...`.
    pub fn check_idle(&mut self, idle: Idle<'_>, first: u32) {
        let Idle { slot, implementation, part, reason } = idle;
        let is_idle = |pass: &u32| part.is_none_or(|part| is_of_part(self.declaration.pass_name(*pass), slot, part));
        let added = (first..self.pass_count()).find(is_idle);
        if let Some(pass) = added {
            let pass = self.declaration.pass_name(pass).to_owned();
            let [slot, implementation, reason] = [slot, implementation, reason].map(str::to_owned);
            self.errors.push(GraphError::NotIdle { slot, implementation, reason, pass });
        }
    }

    /// Records [`GraphError::Contract`] if the image's format or size breaks the contract.
    pub fn check_contract(&mut self, image: Handle<Image>, contract: Contract<'_>) {
        let (format, extent, ..) = self.image_at(image);
        let Contract { slot, implementation, output, formats, extent: wanted } = contract;
        if !formats.contains(&format) || extent != wanted {
            self.errors.push(GraphError::Contract {
                slot: slot.to_owned(),
                implementation: implementation.to_owned(),
                output: output.to_owned(),
                wanted: (formats.to_vec(), wanted),
                given: (format, extent),
            });
        }
    }
}

#[cfg(test)]
mod tests {
    use super::is_of_part;

    #[test]
    fn passes_of_a_part_have_its_name_with_or_without_a_suffix() {
        let of_trace = |pass| is_of_part(pass, "shadows", "trace");
        assert!(of_trace("shadows.trace") && of_trace("shadows.trace_far"));
        for other in ["shadows.tracer", "shadows.denoise", "shadows", "shadowstrace", "ao.trace", "soft.shadows.trace"]
        {
            assert!(!of_trace(other), "{other}");
        }
    }
}
