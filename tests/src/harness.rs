//! What GPU tests share: devices with the validation layers on, scenes, renders and goldens.
use anyhow::{Context, Result, anyhow, bail, ensure};
use glam::DVec3;
use magpie::config::Config;
use magpie::gpu::{Gpu, GpuOptions};
use magpie::pixels::Pixels;
use magpie::scene::{Scene, supply_missing};
use magpie_passes::{FrameRequest, FrameResult, RenderOptions, Renderer, Slots};
use std::cell::Cell;
use std::num::NonZero;
use std::ops::Deref;
use std::path::{Path, PathBuf};
use std::sync::{Condvar, Mutex, OnceLock, PoisonError};
use std::{env, thread};

/// A device with validation for the exclusive use of a test, or `None` if `MAGPIE_NO_GPU` is set. The absence of a device is an error.
pub fn gpu() -> Result<Option<BorrowedGpu>> {
    if env::var_os("MAGPIE_NO_GPU").is_some() {
        eprintln!("skipped: MAGPIE_NO_GPU is set");
        return Ok(None);
    }
    let devices =
        DEVICES.get_or_init(|| open().map(|free| Devices { free: Mutex::new(free), came_back: Condvar::new() }));
    let devices = devices.as_ref().map_err(|e| anyhow!("{e:#}"))?;
    Ok(Some(BorrowedGpu { gpu: devices.borrow(), devices }))
}

/// A device without validation, for tests of so many small frames that the layers would take nearly all of the time; other tests render the
/// same passes with every check on. `None` if `MAGPIE_NO_GPU` is set. A process must not use [`gpu`] too: see there.
pub fn gpu_without_validation() -> Result<Option<Gpu>> {
    if env::var_os("MAGPIE_NO_GPU").is_some() {
        eprintln!("skipped: MAGPIE_NO_GPU is set");
        return Ok(None);
    }
    let options = GpuOptions { device: env::var("MAGPIE_DEVICE").ok(), validation: false, ..GpuOptions::default() };
    Ok(Some(Gpu::new(&options).context("GPU tests need a device; `cargo xtask test --no-gpu` leaves them out")?))
}

/// The devices of this process: as many as tests run in parallel, at most four, all created before the first is used and none destroyed
/// before the process ends.
/// The validation layer looks up the device of every call in a map that it modifies, without a lock, when a device is created or destroyed.
/// A call on another thread and device at that time may crash (Vulkan-ValidationLayers, issue 4391).
static DEVICES: OnceLock<Result<Devices>> = OnceLock::new();

struct Devices {
    free: Mutex<Vec<Gpu>>,
    came_back: Condvar,
}

fn open() -> Result<Vec<Gpu>> {
    let options = GpuOptions { device: env::var("MAGPIE_DEVICE").ok(), validation: true, ..GpuOptions::default() };
    let count = thread::available_parallelism().map_or(1, NonZero::get).min(4);
    (0..count)
        .map(|_| Gpu::new(&options).context("GPU tests need a device; `cargo xtask test --no-gpu` leaves them out"))
        .collect()
}

thread_local! {
    static BORROWS: Cell<bool> = const { Cell::new(false) };
}

impl Devices {
    /// Waits for a free device.
    fn borrow(&self) -> Gpu {
        assert!(!BORROWS.replace(true), "a test that takes a second device may wait forever for it");
        let mut free = self.free.lock().unwrap_or_else(PoisonError::into_inner);
        loop {
            match free.pop() {
                Some(gpu) => return gpu,
                None => free = self.came_back.wait(free).unwrap_or_else(PoisonError::into_inner),
            }
        }
    }
}

/// A device, returned to the pool on drop. A test fails if it leaves behind validation messages that it did not ask for.
pub struct BorrowedGpu {
    gpu: Gpu,
    devices: &'static Devices,
}

impl Deref for BorrowedGpu {
    type Target = Gpu;

    fn deref(&self) -> &Gpu {
        &self.gpu
    }
}

impl Drop for BorrowedGpu {
    fn drop(&mut self) {
        let left = self.gpu.wait_idle().and_then(|()| self.gpu.check_validation());
        BORROWS.set(false);
        self.devices.free.lock().unwrap_or_else(PoisonError::into_inner).push(self.gpu.clone());
        self.devices.came_back.notify_one();
        if let Err(error) = left
            && !thread::panicking()
        {
            panic!("left behind: {error}");
        }
    }
}

/// A built-in scene with camera and lights supplied where missing.
pub fn builtin(name: &str) -> Result<Scene> {
    let mut scene = magpie::scene::builtin(name).with_context(|| format!("built-in scene {name}"))?;
    supply_missing(&mut scene);
    Ok(scene)
}

/// A scene from the folder of real scenes: `MAGPIE_ASSETS`, else `../shared/assets` beside the checkout. `None`, with a message, if the
/// folder does not exist.
pub fn asset(file: &str) -> Result<Option<Scene>> {
    let beside = Path::new(env!("CARGO_MANIFEST_DIR")).join("../../shared/assets");
    let folder = env::var_os("MAGPIE_ASSETS").map_or(beside, PathBuf::from);
    if !folder.is_dir() {
        eprintln!("skipped: {file} (no folder of real scenes: set MAGPIE_ASSETS)");
        return Ok(None);
    }
    let mut scene = magpie::scene::load(&folder.join(file))?;
    supply_missing(&mut scene);
    Ok(Some(scene))
}

/// File names of the real scenes, for [`asset`].
pub const REAL_SCENES: [&str; 4] = [
    "damaged_helmet/DamagedHelmet.glb",
    "flight_helmet/FlightHelmet.gltf",
    "pica_pica_mini_diorama/scene.gltf",
    "pica_pica_robot/robot_01.glb",
];

/// The default configuration with these `KEY=VALUE` changes.
pub fn config(changes: &[&str]) -> Result<Config> {
    let mut config = Config::default();
    for change in changes {
        config.set(change)?;
    }
    Slots::default().catalogue().check(&config, "test")?;
    Ok(config)
}

/// As [`config`], with the light of the sky alone for `gi`: for tests of other slots, which need not wait for surfels.
pub fn config_without_bounces(changes: &[&str]) -> Result<Config> {
    config(&[&["stages.gi=sky"], changes].concat())
}

/// Renders `frames` frames with every check on; any finding is an error. The last frame is read back.
pub fn render(
    gpu: &Gpu,
    scene: &Scene,
    config: &Config,
    size: [u32; 2],
    frames: u32,
    view: Option<(&str, &str)>,
) -> Result<FrameResult> {
    let options = RenderOptions { width: size[0], height: size[1], seed: 0, check: true, ..RenderOptions::default() };
    let mut renderer = Renderer::new(gpu, scene, &Slots::default(), config, options)?;
    for frame in 1.. {
        let read_back = frame == frames;
        let result = renderer.frame(FrameRequest { camera: &scene.cameras[0], time: 0.0, view, read_back })?;
        let result = result.context("a size of zero")?;
        ensure!(result.findings.is_empty(), "frame {frame}: {}", result.findings[0]);
        if read_back {
            return Ok(result);
        }
    }
    bail!("no frame was asked for")
}

/// The linear image of a render.
pub fn linear(result: FrameResult) -> Result<Pixels> {
    Ok(result.images.context("no image was read back")?.linear)
}

/// The display image of a render.
pub fn display(result: FrameResult) -> Result<Pixels> {
    result.images.and_then(|i| i.display).context("no display image was read back")
}

/// Compares an image with the golden `tests/images/NAME.png`.
///
/// Fails if the golden is missing, the size differs, the root mean square difference (0 to 1) exceeds `limit`, or the golden has so little
/// contrast that some image of one flat colour, black included, would come within five times the limit. The actual image and the
/// difference, amplified eight times, are written to `target/images`. `MAGPIE_BLESS=1` writes the golden instead: look at it before you
/// commit it.
pub fn compare_with_golden(name: &str, actual: &Pixels, limit: f64) -> Result<()> {
    let root = Path::new(env!("CARGO_MANIFEST_DIR"));
    let golden_file = root.join("images").join(format!("{name}.png"));
    let (width, height) = (actual.extent.width, actual.extent.height);
    let seen = image::RgbaImage::from_raw(width, height, actual.presentable()).context("pixels")?;
    if env::var_os("MAGPIE_BLESS").is_some() {
        seen.save(&golden_file)?;
        return Ok(());
    }
    let golden = image::open(&golden_file)
        .with_context(|| format!("golden {} (MAGPIE_BLESS=1 makes it)", golden_file.display()))?
        .into_rgba8();
    ensure!(golden.dimensions() == (width, height), "{name}: the golden is {:?}", golden.dimensions());
    let from_flat = distance_from_flat(&golden);
    ensure!(
        from_flat > 5.0 * limit,
        "{name}: the golden is within {from_flat:.4} of one flat colour, too near for {limit}"
    );

    let mut sum = 0.0;
    let mut difference = image::RgbaImage::new(width, height);
    for (x, y, pixel) in difference.enumerate_pixels_mut() {
        let (a, b) = (seen.get_pixel(x, y).0, golden.get_pixel(x, y).0);
        for c in 0..3 {
            let d = f64::from(a[c]) - f64::from(b[c]);
            sum += d * d / (255.0 * 255.0);
            pixel.0[c] = (d.abs() * 8.0).min(255.0) as u8;
        }
        pixel.0[3] = 255;
    }
    let rmse = (sum / (f64::from(width) * f64::from(height) * 3.0)).sqrt();
    if rmse > limit {
        let folder = root.join("../target/images");
        std::fs::create_dir_all(&folder)?;
        seen.save(folder.join(format!("{name}.actual.png")))?;
        difference.save(folder.join(format!("{name}.difference.png")))?;
        bail!("{name}: RMSE {rmse:.5} is over {limit}; see target/images/{name}.*.png");
    }
    Ok(())
}

/// Writes pictures of the same width, their radiance as it looks in sRGB, side by side to `target/images/NAME.png`, for a look at what a test
/// found. `across`: how many in a row.
pub fn save_picture(name: &str, width: u32, across: u32, images: &[Vec<DVec3>]) -> Result<()> {
    let height = images.first().context("no picture")?.len() as u32 / width;
    let rows = (images.len() as u32).div_ceil(across);
    let mut sheet = image::RgbImage::new(width * across, height * rows);
    for (k, values) in (0..).zip(images) {
        for (at, value) in (0..).zip(values) {
            let encode = |v: f64| {
                let v = v.clamp(0.0, 1.0);
                let encoded = if v <= 0.003_130_8 { 12.92 * v } else { 1.055 * v.powf(1.0 / 2.4) - 0.055 };
                (encoded * 255.0).round() as u8
            };
            let (x, y) = (k % across * width + at % width, k / across * height + at / width);
            sheet.put_pixel(x, y, image::Rgb(value.to_array().map(encode)));
        }
    }
    let folder = Path::new(env!("CARGO_MANIFEST_DIR")).join("../target/images");
    std::fs::create_dir_all(&folder)?;
    Ok(sheet.save(folder.join(format!("{name}.png")))?)
}

/// Root mean square difference from the nearest image of one colour, which is the mean colour.
fn distance_from_flat(image: &image::RgbaImage) -> f64 {
    let count = f64::from(image.width()) * f64::from(image.height());
    let variance = |c: usize| {
        let values = || image.pixels().map(|p| f64::from(p.0[c]) / 255.0);
        let mean = values().sum::<f64>() / count;
        values().map(|v| (v - mean).powi(2)).sum::<f64>() / count
    };
    ((variance(0) + variance(1) + variance(2)) / 3.0).sqrt()
}
