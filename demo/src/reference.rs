//! `magpie reference`.

use std::path::{Path, PathBuf};
use std::time::{Duration, Instant};

use magpie::gpu::{Gpu, GpuOptions};
use magpie::scene::ResidentError;
use magpie_passes::Slots;
use magpie_passes::reference::{
    Estimate, EstimateFileError, Reference, ReferenceError, ReferenceOptions, single_scattering,
};

use crate::{
    args::{Loudness, ReferenceArguments},
    console::{self, Progress},
    exit::Failure,
    input,
    output::{Output, keep_apart},
    picture, session,
};

/// Samples per batch, and the interval at which the estimate is saved.
const STEP: u32 = 16;
const SAVE_EVERY: Duration = Duration::from_secs(30);

/// Traces the reference image, continues where an earlier run stopped, and writes the result.
///
/// # Errors
/// [`Failure`] of the kind that gives the right exit status.
pub fn reference(arguments: &ReferenceArguments, loudness: &Loudness) -> Result<(), Failure> {
    let output = Output::plan("--out", &arguments.out, &["exr"])?;
    let out = output.file()?;
    let inputs: Vec<(&str, &Path)> = [
        ("scene", Some(&arguments.scene)),
        ("camera file", arguments.camera.as_ref()),
        ("environment", arguments.lighting.environment.environment.as_ref()),
    ]
    .into_iter()
    .filter_map(|(what, path)| Some((what, path?.as_path())))
    .chain(arguments.merge.iter().map(|path| ("estimate to merge", path.as_path())))
    .collect();
    let shown = arguments.png.as_deref().map(|path| Output::plan("--png", path, &["png"])).transpose()?;
    keep_apart(&[&output].into_iter().chain(&shown).collect::<Vec<_>>(), &inputs)?;
    let config = input::configure(&session::catalogue(), None, &arguments.set)?;
    let scene =
        session::load_scene(&arguments.scene, Some(&arguments.lighting.environment), arguments.lighting.supply)?;
    let camera = session::camera(&scene, arguments.camera.as_deref())?;
    let (only, extent) = (arguments.only.which(), arguments.size);
    let options = ReferenceOptions {
        width: extent.width,
        height: extent.height,
        seed: arguments.seed,
        depth: arguments.depth,
        only,
        pixel: arguments.pixel(),
        ao_range: arguments.ao_range,
        time: f64::from(arguments.time),
        check: arguments.check,
        light_tree: arguments.lights.light_tree(),
        single_scattering: single_scattering(&config),
        ..ReferenceOptions::default()
    };
    let subject = options.subject(&scene, &camera);

    // The estimate of earlier runs.
    let mut begun = Estimate::new(extent.width, extent.height);
    let earlier = out.exists() && !arguments.restart;
    for path in earlier.then_some(out).into_iter().chain(arguments.merge.iter().map(PathBuf::as_path)) {
        let found = Estimate::load(path, Some(&subject)).map_err(|error| foreign(error, path == out))?;
        log::info!("{}: {} samples", path.display(), found.samples);
        begun.merge(&found).map_err(Failure::input)?;
    }
    let missing = u64::from(arguments.samples).saturating_sub(begun.samples);

    let mut done = begun;
    if missing > 0 || shown.is_some() {
        let gpu = Gpu::new(&GpuOptions {
            device: arguments.device.clone(),
            validation: arguments.check,
            ..GpuOptions::default()
        })?;
        let rays = session::choose_rays(&gpu, arguments.rays)?;
        let mut reference =
            Reference::new(&gpu, &scene, &camera, ReferenceOptions { rays, ..options }).map_err(failure)?;
        reference.resume(&done).map_err(failure)?;
        let progress = Progress::of(missing, "samples", loudness);
        let (start, mut saved, mut left) = (Instant::now(), Instant::now(), missing);
        while left > 0 {
            let step = left.min(u64::from(STEP));
            reference.add(step as u32).map_err(failure)?;
            left -= step;
            progress.advance(step);
            if saved.elapsed() > SAVE_EVERY && left > 0 {
                save(reference.estimate(), out, &subject)?;
                saved = Instant::now();
            }
        }
        drop(progress);
        let [closest, any] = reference.rays();
        log::info!(
            "{missing} samples in {:.1} s, {:.1} million rays",
            start.elapsed().as_secs_f64(),
            (closest + any) as f64 * 1e-6
        );
        done = reference.estimate().clone();
        if let Some(shown) = shown {
            let picture = reference.display(&Slots::default(), &config).map_err(failure)?;
            shown.write(|file| picture::write_png(file, &picture))?;
        }
    }
    save(&done, out, &subject)?;
    console::print(&summary(&done, only.name()))
}

fn save(estimate: &Estimate, path: &Path, subject: &str) -> Result<(), Failure> {
    let kept = path.metadata().map(|meta| meta.permissions());
    estimate.save(path, subject).map_err(|error| Failure::running(error).context("--out"))?;
    let restored = kept.map_or(Ok(()), |permissions| std::fs::set_permissions(path, permissions));
    restored.map_err(|error| Failure::running(error).context("--out"))
}

/// The result in one line.
fn summary(estimate: &Estimate, name: &str) -> String {
    let pixels = estimate.mean.len() as f64;
    let mean = estimate.mean.iter().copied().sum::<glam::DVec3>() / pixels;
    let square: f64 = estimate.standard_error().iter().map(|e| e.length_squared() / 3.0).sum::<f64>() / pixels;
    format!(
        "{name}: {} samples per pixel, mean {:.6} {:.6} {:.6}, root mean square of the standard error {:.6}\n",
        estimate.samples,
        mean.x,
        mean.y,
        mean.z,
        square.sqrt()
    )
}

fn foreign(error: EstimateFileError, is_out: bool) -> Failure {
    let hint = if is_out { "--out (--restart begins anew in its place)" } else { "--merge" };
    Failure::input(error).context(hint)
}

fn failure(error: ReferenceError) -> Failure {
    match error {
        ReferenceError::Gpu(error) => error.into(),
        ReferenceError::Stage(error) => error.into(),
        ReferenceError::Scene(ResidentError::Ray(error)) => Failure::input(error),
        other => Failure::running(other),
    }
}
