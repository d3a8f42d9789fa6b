//! GPU times of passes add up to the frame's, and grow with the work.
use anyhow::{Context, Result};
use magpie::measure::FrameSample;
use magpie_passes::{FrameRequest, RenderOptions, Renderer, Slots};
use magpie_tests::harness::{builtin, config, gpu};

fn frames(size: [u32; 2], count: usize) -> Result<Option<Vec<FrameSample>>> {
    let Some(gpu) = gpu()? else { return Ok(None) };
    let scene = builtin("courtyard")?;
    let options = RenderOptions { width: size[0], height: size[1], seed: 0, check: false, ..RenderOptions::default() };
    let mut renderer = Renderer::new(&gpu, &scene, &Slots::default(), &config(&[])?, options)?;
    let request = FrameRequest { camera: &scene.cameras[0], time: 0.0, view: None, read_back: false };
    let samples =
        (0..count).map(|_| Ok(renderer.frame(request)?.context("a size of zero")?.sample)).collect::<Result<_>>()?;
    gpu.check_validation()?;
    Ok(Some(samples))
}

fn pass(frame: &FrameSample, name: &str) -> Result<u64> {
    let found = frame.passes.iter().find(|p| p.name == name).with_context(|| format!("pass {name}"))?;
    found.gpu_ns.context("a time")
}

#[test]
fn passes_add_up_to_the_frame() -> Result<()> {
    let Some(frames) = frames([320, 180], 4)? else { return Ok(()) };
    for frame in &frames[1..] {
        let whole = frame.gpu_ns.context("a time")?;
        let sum: u64 = frame.passes.iter().filter_map(|p| p.gpu_ns).sum();
        assert!(sum <= whole, "{sum} ns of passes in a frame of {whole} ns");
        assert!(sum * 10 >= whole * 6, "{sum} ns of passes in a frame of {whole} ns: time is lost between them");
        assert!(whole <= frame.cpu_ns, "the GPU took {whole} ns of {} ns", frame.cpu_ns);
        if let (Some(begin), Some(start)) = (frame.gpu_begin_ns, frame.start_ns) {
            assert!((start..start + frame.cpu_ns).contains(&begin), "the GPU began at {begin}, the frame at {start}");
        }
    }
    Ok(())
}

#[test]
fn more_pixels_take_more_time() -> Result<()> {
    let (Some(small), Some(large)) = (frames([40, 24], 4)?, frames([320, 192], 4)?) else { return Ok(()) };
    let least = |frames: &[FrameSample], name: &str| -> Result<u64> {
        frames.iter().map(|f| pass(f, name)).collect::<Result<Vec<_>>>()?.into_iter().min().context("a frame")
    };
    // 64 times the pixels; a dispatch has a fixed cost, so no exact ratio is required.
    for name in ["shadows.trace", "direct.shade", "reflections.sky"] {
        let (small, large) = (least(&small, name)?, least(&large, name)?);
        assert!(large > 4 * small, "{name}: {small} ns at 40x24, {large} ns at 320x192");
    }
    Ok(())
}
