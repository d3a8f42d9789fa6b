//! Spoiling an output on purpose, so that tests can tell whether it is found.

use super::{
    super::{
        access::Layout,
        declaration::{Declaration, Shape},
        desc::{Format, Part},
    },
    Place,
};

/// Values to spoil with.
#[derive(Clone, Copy, Debug, PartialEq, Eq)]
pub enum Bad {
    /// A quiet NaN.
    Nan,
    /// An infinity above zero.
    Infinity,
}

/// One pixel or element of one output, to be spoilt at the end of the pass that writes it.
#[derive(Clone, Debug, PartialEq, Eq)]
pub struct Poison {
    /// The pass.
    pub pass: String,
    /// Its output.
    pub output: String,
    /// Where. The first channel is spoilt, the others become zero.
    pub place: Place,
    /// With what.
    pub value: Bad,
}

/// Why an output cannot be spoilt.
#[derive(Clone, Debug, PartialEq, Eq, thiserror::Error)]
#[error("cannot poison {pass}:{output}: {why}")]
pub struct PoisonError {
    /// The pass.
    pub pass: String,
    /// Its output.
    pub output: String,
    /// The reason.
    pub why: String,
}

/// A [`Poison`] as the executor needs it.
pub(in super::super) struct Poisoned {
    /// Index of the pass.
    pub pass: u32,
    /// Index of the resource.
    pub resource: u32,
    /// What to write; room for the largest pixel.
    pub bytes: [u8; 16],
    /// How much of that.
    pub length: u64,
    pub place: Place,
    /// The mip and layer of an image.
    pub part: Part,
    /// How the pass leaves the image.
    pub layout: Layout,
}

impl Poison {
    /// Finds what is meant, among the passes that run.
    pub(in super::super) fn resolve(&self, declaration: &Declaration, order: &[u32]) -> Result<Poisoned, PoisonError> {
        let fail = |why: String| PoisonError { pass: self.pass.clone(), output: self.output.clone(), why };
        let pass = order.iter().copied().find(|&p| declaration.pass_name(p) == self.pass);
        let pass = pass.ok_or_else(|| fail("no such pass runs".to_owned()))?;
        let output = declaration.outputs_of(pass).into_iter().find(|o| o.name == self.output);
        let output = output.ok_or_else(|| fail("no such output".to_owned()))?;
        let used = declaration.uses_of(pass).iter();
        let used = used.clone().find(|u| u.resource == output.resource && u.writes == Some(output.version));
        let (part, layout) = used.map_or((Part::ALL, Layout::Undefined), |u| (u.part, u.access.layout()));
        let (bytes, length, part) = match (declaration.resources[output.resource as usize].shape, self.place) {
            (Shape::Image { format, extent, .. }, Place::Pixel { x, y, mip, layer }) => {
                let one = Part { mip: mip as u16, mips: 1, layer: layer as u16, layers: 1 };
                let size = extent.mip(mip);
                if !part.overlaps(one) || x >= size.width || y >= size.height {
                    return Err(fail(format!("it does not write {}", self.place)));
                }
                let bytes = self.value.pixel(format).ok_or_else(|| fail(format!("{format:?} cannot hold it")))?;
                (bytes, u64::from(format.bytes_per_pixel()), one)
            }
            (Shape::Buffer { bytes }, Place::Element(index)) => {
                if index.saturating_add(1).saturating_mul(4) > bytes {
                    return Err(fail(format!("it has {bytes} bytes and no {}", self.place)));
                }
                (self.value.float(), 4, part)
            }
            (Shape::Image { .. } | Shape::Buffer { .. } | Shape::Accel { .. }, _) => {
                return Err(fail(format!("it has no {}", self.place)));
            }
        };
        Ok(Poisoned { pass, resource: output.resource, bytes, length, place: self.place, part, layout })
    }
}

impl Bad {
    /// One float of 32 bits (IEEE 754-2019, 3.4), then zeros.
    fn float(self) -> [u8; 16] {
        let value = match self {
            Self::Nan => f32::NAN,
            Self::Infinity => f32::INFINITY,
        };
        start(&value.to_le_bytes())
    }

    /// A pixel of this format; none where the format is bounded.
    fn pixel(self, format: Format) -> Option<[u8; 16]> {
        let half = || {
            let value = match self {
                Self::Nan => half::f16::NAN,
                Self::Infinity => half::f16::INFINITY,
            };
            start(&value.to_le_bytes())
        };
        match format {
            Format::R16Float | Format::Rg16Float | Format::Rgba16Float => Some(half()),
            Format::R32Float | Format::Rg32Float | Format::Rgba32Float | Format::D32Float => Some(self.float()),
            Format::R8Unorm
            | Format::Rg8Unorm
            | Format::Rgba8Unorm
            | Format::Rgba8Srgb
            | Format::Rgba16Snorm
            | Format::R32Uint
            | Format::Rg32Uint => None,
        }
    }
}

fn start(bytes: &[u8]) -> [u8; 16] {
    let mut all = [0; 16];
    all[..bytes.len()].copy_from_slice(bytes);
    all
}
