//! What the images that a slot of the frame gives must be like.

use super::{
    desc::{Extent, Format},
    error::GraphError,
    handle::{Handle, Image},
    pass::FrameGraph,
};

/// What an image that a slot gives must be like.
#[derive(Clone, Copy, Debug)]
pub struct Contract<'a> {
    /// Name of the slot.
    pub slot: &'a str,
    /// Name of what fills it.
    pub implementation: &'a str,
    /// Name of the image in the contract.
    pub output: &'a str,
    /// Formats that it may have.
    pub formats: &'a [Format],
    /// Its size.
    pub extent: Extent,
}

impl FrameGraph {
    /// Notes a mistake where an image is not as a slot's contract says.
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
