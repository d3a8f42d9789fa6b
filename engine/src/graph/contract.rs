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

impl FrameGraph {
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
