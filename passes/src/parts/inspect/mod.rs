//! Looking into an image of the frame: its values as colours, in the size of the picture, what they range over, and those of one pixel.
mod look;
mod lookout;

use magpie::gpu::{Buffer, BufferMemory, BufferUse, Gpu, GpuError, Kernel};
use magpie::graph::execute::Imports;
use magpie::graph::{Access, Domain, Part};
use magpie::prelude::*;
use magpie::slot::{Build, SlotError};
use magpie_shaders::inspect::{InspectMapParams, InspectMeasureParams, Measured};
use magpie_shaders::{INSPECT_MAP_COMP, INSPECT_MEASURE_COMP};
use std::sync::Arc;

pub use look::{Channel, Colours, Look};
pub(crate) use lookout::Lookout;

/// What is looked at, and how.
#[derive(Clone, Debug, PartialEq)]
pub struct Inspection {
    /// Name of the pass.
    pub pass: String,
    /// Name of the image among its outputs.
    pub output: String,
    /// Mip; the last one where the image has fewer.
    pub mip: u32,
    /// Layer; the last one where the image has fewer.
    pub layer: u32,
    /// How its values become colours.
    pub look: Look,
    /// How much larger it is shown than it fits into the picture, at least 1.
    pub zoom: f32,
    /// What is then in the middle: 0 to 1 from the left and from above.
    pub centre: [f32; 2],
    /// The pixel whose values are read.
    pub pick: Option<Pick>,
}

/// A pixel of an image.
#[derive(Clone, Copy, Debug, PartialEq)]
pub enum Pick {
    /// By its coordinates, from the left and from above.
    Pixel([u32; 2]),
    /// By its place in the picture: 0 to 1 from the left and from above.
    Under([f32; 2]),
}

impl Inspection {
    /// A look at an output of a pass, as is best for its format where that is known.
    #[must_use]
    pub fn of(pass: &str, output: &str, format: Option<Format>) -> Self {
        Self {
            pass: pass.to_owned(),
            output: output.to_owned(),
            mip: 0,
            layer: 0,
            look: format.map(Look::of).unwrap_or_default(),
            zoom: 1.0,
            centre: [0.5; 2],
            pick: None,
        }
    }

    /// Where an image of this size lies in a picture: left, top, width and height, pixels. It keeps its shape, unless it then misses the edges
    /// by less than one of its own pixels, as images in half the size of an odd one do.
    #[must_use]
    pub fn place(&self, size: Extent, picture: Extent) -> [f32; 4] {
        let [size, whole] = [size, picture].map(|e| [e.width as f32, e.height as f32]);
        let scale = (whole[0] / size[0]).min(whole[1] / size[1]);
        let zoom = self.zoom.max(1.0);
        let [(left, width), (top, height)] = [0, 1].map(|axis| {
            let (shown, most) = (size[axis] * scale, whole[axis]);
            let side = if most - shown < scale.max(1.0) { most } else { shown } * zoom;
            let centred = 0.5 * most - self.centre[axis] * side;
            // Nothing beside the image is shown where it is large enough.
            (if side < most { 0.5 * (most - side) } else { centred.clamp(most - side, 0.0) }, side)
        });
        [left, top, width, height]
    }
}

/// The pixel of an image in a place of the picture (0 to 1), if there is one.
fn pixel_under(at: [f32; 2], place: [f32; 4], size: Extent, picture: Extent) -> Option<[u32; 2]> {
    let [left, top, width, height] = place;
    let x = (at[0] * picture.width as f32 - left) / width * size.width as f32;
    let y = (at[1] * picture.height as f32 - top) / height * size.height as f32;
    let inside = x >= 0.0 && y >= 0.0 && x < size.width as f32 && y < size.height as f32;
    inside.then_some([x as u32, y as u32])
}

/// What was found in an image.
#[derive(Clone, Debug, PartialEq)]
pub struct Inspected {
    /// Name of the pass.
    pub pass: String,
    /// Name of the image among its outputs.
    pub output: String,
    /// Format of the image.
    pub format: Format,
    /// Size of the mip, pixels.
    pub extent: Extent,
    /// The mip.
    pub mip: u32,
    /// The layer.
    pub layer: u32,
    /// Number of mips that the image has.
    pub mips: u32,
    /// Number of layers that it has.
    pub layers: u32,
    /// Where it lies in the picture: left, top, width and height, pixels.
    pub place: [f32; 4],
    /// Size of the picture, pixels.
    pub picture: Extent,
    /// The pixel that was read, if it lies in the image.
    pub pixel: Option<PixelValue>,
    /// Least and greatest finite value of each channel; `None` where there is none.
    pub ranges: Vec<Option<[f64; 2]>>,
    /// Pixels with a NaN in any channel.
    pub nan: u32,
    /// Pixels with positive infinity.
    pub above: u32,
    /// Pixels with negative infinity.
    pub below: u32,
}

/// The values of a pixel.
#[derive(Clone, Copy, Debug, PartialEq, Eq)]
pub struct PixelValue {
    /// Its coordinates, from the left and from above.
    pub at: [u32; 2],
    /// Bits of its channels, as 32-bit floats, or as unsigned integers where the format has these.
    pub bits: [u32; 4],
}

/// Makes the passes `inspect.measure` and `inspect.map`.
#[derive(Clone)]
pub struct Inspector {
    gpu: Gpu,
    map: Kernel,
    measure: Kernel,
}

/// An image that is looked at in a frame.
pub struct Inspecting {
    /// Display values, RGBA8, in the size of the picture. Values that are not finite are squares of magenta and black (NaN), yellow (positive
    /// infinity) or cyan (negative infinity).
    pub image: Handle<Image>,
    found: Inspected,
    measured: Arc<Buffer>,
}

impl Inspector {
    /// Format of the result.
    pub const FORMAT: Format = Format::Rgba8Unorm;

    /// Describes the pipelines.
    ///
    /// # Errors
    /// None of its own.
    pub fn new(gpu: &Gpu, build: &Build<'_>) -> Result<Self, SlotError> {
        Ok(Self {
            gpu: gpu.clone(),
            map: build.kernel(&INSPECT_MAP_COMP)?,
            measure: build.kernel(&INSPECT_MEASURE_COMP)?,
        })
    }

    /// Adds `inspect.measure`, and `inspect.map`, which runs if its result is used. `image` must be the newest version, and an imported one must
    /// have sampled usage. `picture` is the size of the result.
    ///
    /// # Errors
    /// [`GpuError::OutOfMemory`].
    pub fn add(
        &self,
        g: &mut FrameGraph,
        imports: &mut Imports,
        image: Handle<Image>,
        inspection: &Inspection,
        picture: Extent,
    ) -> Result<Inspecting, GpuError> {
        let ImageDesc { format, mips, layers, .. } = g.desc(image);
        let (mip, layer) = (inspection.mip.min(mips - 1), inspection.layer.min(layers - 1));
        let extent = g.extent(image).mip(mip);
        let place = inspection.place(extent, picture);
        let pixel = inspection.pick.and_then(|pick| match pick {
            Pick::Pixel([x, y]) => (x < extent.width && y < extent.height).then_some([x, y]),
            Pick::Under(at) => pixel_under(at, place, extent, picture),
        });
        let part = Part { mips: 1, layers: 1, mip: mip as u16, layer: layer as u16 };
        let (is_uint, channels, size) = (u32::from(format.is_uint()), format.channels(), [extent.width, extent.height]);

        let bytes = size_of::<Measured>() as u64;
        let mut measured =
            Buffer::new(&self.gpu, "inspect.measured", bytes, BufferMemory::ReadBack, BufferUse::Storage)?;
        measured.write(0, bytemuck::bytes_of(&Measured { least: [u32::MAX; 4], ..Measured::default() }))?;
        let measured = Arc::new(measured);
        let key = imports.buffer(&measured);
        let target = g.import_buffer("inspect.measured", BufferDesc::new(bytes), Access::HostRead, key);
        let kernel = self.measure;
        let target = g.pass("inspect.measure", Queue::Graphics, |p| {
            let source = p.sample_part(image, part);
            let (target, words) = p.write_buffer(target);
            (target, move |c: &mut Record<'_>| {
                let (image, measured) = (c.id(source), c.id(words));
                let pixel = pixel.unwrap_or([u32::MAX; 2]);
                c.dispatch(kernel, &InspectMeasureParams { image, is_uint, size, pixel, channels, measured }, extent);
            })
        });
        g.leave(target.read(), Access::HostRead, Domain::Compute);

        let (kernel, look) = (self.map, inspection.look);
        let shown = g.pass("inspect.map", Queue::Graphics, |p| {
            let source = p.sample_part(image, part);
            let (shown, target) = p.create("image", ImageDesc::fixed(Self::FORMAT, picture));
            (shown.read(), move |c: &mut Record<'_>| {
                let [gain, bias] = look.gain_and_bias();
                let params = InspectMapParams {
                    image: c.id(source),
                    target: c.id(target),
                    size,
                    target_size: [picture.width, picture.height],
                    place,
                    gain,
                    bias,
                    is_uint,
                    channels,
                    channel: look.channel.code(),
                    colours: look.colours.code(),
                    encodes: look.encodes.into(),
                };
                c.dispatch(kernel, &params, picture);
            })
        });
        let found = Inspected {
            pass: inspection.pass.clone(),
            output: inspection.output.clone(),
            format,
            extent,
            mip,
            layer,
            mips,
            layers,
            place,
            picture,
            pixel: pixel.map(|at| PixelValue { at, bits: [0; 4] }),
            ranges: Vec::new(),
            nan: 0,
            above: 0,
            below: 0,
        };
        Ok(Inspecting { image: shown, found, measured })
    }
}

impl Inspecting {
    /// What was found, after the frame has run.
    #[must_use]
    pub fn finish(self) -> Inspected {
        let Measured { bits, least, greatest, nan, above, below } =
            bytemuck::pod_read_unaligned(&self.measured.contents()[..size_of::<Measured>()]);
        let format = self.found.format;
        let value = |key: u32| match key {
            _ if format.is_uint() => f64::from(key),
            _ if key & SIGN == 0 => f32::from_bits(!key).into(),
            _ => f32::from_bits(key ^ SIGN).into(),
        };
        let range = |channel: usize| {
            let (least, greatest) = (least[channel], greatest[channel]);
            (least <= greatest).then(|| [value(least), value(greatest)])
        };
        Inspected {
            pixel: self.found.pixel.map(|pixel| PixelValue { bits, ..pixel }),
            ranges: (0..format.channels() as usize).map(range).collect(),
            nan,
            above,
            below,
            ..self.found
        }
    }
}

/// The sign of a float.
const SIGN: u32 = 1 << 31;
