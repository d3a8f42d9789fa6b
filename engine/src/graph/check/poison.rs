//! Fault injection: writes a NaN or infinity into an output, so that tests can check that it is found.

use super::{
    super::{
        access::Layout,
        declaration::{Declaration, Shape},
        desc::{Format, Part},
    },
    Place,
};

/// The value to write.
#[derive(Clone, Copy, Debug, PartialEq, Eq)]
pub enum PoisonValue {
    /// A quiet NaN.
    Nan,
    /// Positive infinity.
    Infinity,
}

/// One pixel or element of one output, to be overwritten at the end of the pass that writes it.
#[derive(Clone, Debug, PartialEq, Eq)]
pub struct Poison {
    /// Name of the pass.
    pub pass: String,
    /// Name of its output.
    pub output: String,
    /// The pixel or element. Its first channel gets `value`, the others become zero.
    pub place: Place,
    /// The value to write.
    pub value: PoisonValue,
}

/// Why an output cannot be poisoned.
#[derive(Clone, Debug, PartialEq, Eq, thiserror::Error)]
#[error("cannot poison {pass}:{output}: {why}")]
pub struct PoisonError {
    /// Name of the pass.
    pub pass: String,
    /// Name of its output.
    pub output: String,
    /// The reason: no such pass runs, no such output, the place is outside it, or its format cannot hold the value.
    pub why: String,
}

/// A [`Poison`] resolved against a declaration.
pub(in super::super) struct Poisoned {
    /// Index of the pass.
    pub pass: u32,
    /// Index of the resource.
    pub resource: u32,
    /// The pixel or element to write, padded with zeros.
    pub bytes: [u8; 16],
    /// How many of those bytes are written.
    pub length: u64,
    pub place: Place,
    /// The mip and layer, for an image.
    pub part: Part,
    /// Layout of the image at the end of the pass.
    pub layout: Layout,
}

impl Poison {
    /// Resolves the names, among the passes that run (`order`).
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

impl PoisonValue {
    /// An `f32` (IEEE 754-2019, 3.4) as little-endian bytes, padded with zeros.
    fn float(self) -> [u8; 16] {
        let value = match self {
            Self::Nan => f32::NAN,
            Self::Infinity => f32::INFINITY,
        };
        start(&value.to_le_bytes())
    }

    /// A pixel of this format whose first channel is the value; `None` where the format cannot hold it.
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
            | Format::R16Unorm
            | Format::Rg16Unorm
            | Format::Rgba16Unorm
            | Format::A2Rgb10Unorm
            | Format::Rg8Unorm
            | Format::Rgba8Unorm
            | Format::Rgba8Srgb
            | Format::Rg16Snorm
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
