//! The error of one image against another on the device: squared, relative and symmetric error of each pixel, and their mean.
//!
//! This is not a slot of the frame. A viewer or a test adds it to compare two images.
use magpie::gpu::Kernel;
use magpie::prelude::*;
use magpie::slot::SlotError;
use magpie_shaders::metrics::{
    ErrorParams, ErrorSums, READ_COLOUR, READ_DISPLAY, READ_GREY, SumParams, TILE_HEIGHT, TILE_WIDTH,
};
use magpie_shaders::{METRICS_ERROR_COMP, METRICS_SUM_COMP};

/// Two images of the same size, of any format except integers.
#[derive(Clone, Copy, Debug)]
pub struct MetricsIn {
    /// The image under test. If its size is not that of the reference, every error is NaN.
    pub test: Handle<Image>,
    /// The reference.
    pub reference: Handle<Image>,
}

/// Errors per pixel and of the picture.
#[derive(Clone, Copy, Debug)]
pub struct MetricsOut {
    /// RGBA32F: squared error in red, relative squared error in green, symmetric error in blue, 1 in alpha. Each is the mean over the channels
    /// of the pixel.
    pub error: Handle<Image>,
    /// One [`ErrorSums`], the mean over all pixels; [`Errors::read`] decodes it.
    pub errors: Handle<Buffer>,
}

/// Mean errors of a picture.
#[derive(Clone, Copy, Debug, PartialEq)]
pub struct Errors {
    /// Mean squared error, in the squared unit of the images.
    pub mse: f32,
    /// Relative mean squared error.
    pub relmse: f32,
    /// Symmetric mean absolute percentage error, from 0 to 1.
    pub smape: f32,
}

impl Errors {
    /// From the bytes of [`MetricsOut::errors`]; `None` if they are too few.
    pub fn read(bytes: &[u8]) -> Option<Self> {
        let field = |at: usize| Some(f32::from_le_bytes(bytes.get(4 * at..4 * at + 4)?.try_into().ok()?));
        Some(Self { mse: field(0)?, relmse: field(1)?, smape: field(2)? })
    }

    /// Root mean squared error, in the unit of the images.
    pub fn rmse(&self) -> f32 {
        self.mse.sqrt()
    }

    /// Peak signal-to-noise ratio, decibels: infinite if the images are equal. `peak` is the greatest possible value of the images.
    pub fn psnr(&self, peak: f32) -> f32 {
        10.0 * (peak * peak / self.mse).log10()
    }
}

/// The pipelines of both passes.
pub struct Metrics {
    error: Kernel,
    sum: Kernel,
}

impl Metrics {
    /// Creates the pipelines.
    ///
    /// # Errors
    /// [`SlotError`] if the device cannot create them.
    pub fn new(gpu: &Gpu) -> Result<Self, SlotError> {
        let kernel = |shader| gpu.kernel(shader).map_err(SlotError::other);
        Ok(Self { error: kernel(&METRICS_ERROR_COMP)?, sum: kernel(&METRICS_SUM_COMP)? })
    }

    /// Adds the passes. Unlike [`Effect::add`] it needs no view.
    pub fn declare(&self, g: &mut FrameGraph, i: MetricsIn) -> MetricsOut {
        let (error, sum) = (self.error, self.sum);
        let (extent, test_extent) = (g.extent(i.reference), g.extent(i.test));
        let read = [i.test, i.reference].map(|image| read_mode(g.desc(image).format));
        let groups = [extent.width.div_ceil(TILE_WIDTH), extent.height.div_ceil(TILE_HEIGHT), 1];
        let (count, bytes) = (groups[0] * groups[1], size_of::<ErrorSums>() as u64);

        let (error, tiles) = g.pass("metrics.error", Queue::AsyncCompute, |p| {
            let (test, reference) = (p.sample(i.test), p.sample(i.reference));
            let (image, target) = p.create("error", ImageDesc::like(Format::Rgba32Float, i.reference));
            let (tiles, sums) = p.create_buffer("tiles", BufferDesc::new(u64::from(count) * bytes).of_floats());
            ((image.read(), tiles.read()), move |c: &mut Record<'_>| {
                let params = ErrorParams {
                    test: c.id(test),
                    reference: c.id(reference),
                    error: c.id(target),
                    read_test: read[0],
                    read_reference: read[1],
                    size: [extent.width, extent.height],
                    test_size: [test_extent.width, test_extent.height],
                    tiles: c.id(sums),
                };
                c.dispatch_groups(error, &params, groups);
            })
        });
        let errors = g.pass("metrics.sum", Queue::AsyncCompute, |p| {
            let tiles = p.read(tiles);
            let (errors, target) = p.create_buffer("errors", BufferDesc::new(bytes).of_floats());
            (errors.read(), move |c: &mut Record<'_>| {
                let pixels = extent.width * extent.height;
                let params = SumParams { tiles: c.id(tiles), errors: c.id(target), count, pixels };
                c.dispatch_groups(sum, &params, [1, 1, 1]);
            })
        });
        MetricsOut { error, errors }
    }
}

impl Effect for Metrics {
    type In = MetricsIn;
    type Out = MetricsOut;

    fn add(&mut self, g: &mut FrameGraph, _: &View, i: MetricsIn) -> MetricsOut {
        self.declare(g, i)
    }
}

/// `READ_*` of a format, as `Picture::from_pixels` of the library reads images on the host: images of one channel are grey, and RGBA8 without
/// an sRGB format holds sRGB-encoded display values.
fn read_mode(format: Format) -> u32 {
    match (format, format.channels()) {
        (Format::Rgba8Unorm, _) => READ_DISPLAY,
        (_, 1) => READ_GREY,
        _ => READ_COLOUR,
    }
}

#[cfg(test)]
mod tests {
    use super::*;

    #[test]
    fn errors_are_read_from_bytes() {
        let bytes: Vec<u8> = [0.25_f32, 0.5, 0.125].iter().flat_map(|x| x.to_le_bytes()).collect();
        let errors = Errors::read(&bytes).expect("twelve bytes");
        assert_eq!(errors, Errors { mse: 0.25, relmse: 0.5, smape: 0.125 });
        assert_eq!(errors.rmse(), 0.5);
        assert!((errors.psnr(5.0) - 20.0).abs() < 1e-5, "{}", errors.psnr(5.0));
        assert_eq!(Errors { mse: 0.0, ..errors }.psnr(1.0), f32::INFINITY);
        assert_eq!(Errors::read(&bytes[..11]), None);
    }
}
