/// Input of the slot `new_pass`.
#[derive(Clone, Copy, Debug)]
pub struct NewPassIn {
    /// Linear radiance.
    pub colour: Handle<Image>,
}

/// Output of the slot `new_pass`, which goes on to `post`.
#[derive(Clone, Copy, Debug)]
pub struct NewPassOut {
    /// Linear radiance.
    pub colour: Handle<Image>,
}

impl Gives for NewPassOut {
    fn images(&self) -> Vec<(&'static str, Handle<Image>, &'static [Format])> {
        vec![("colour", self.colour, RADIANCE)]
    }
}

