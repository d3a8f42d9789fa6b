//! Swaps implementations while frames go on, and prints what each costs on the GPU. Slots that are not swapped keep their histories.
//!
//! `cargo run --release -p magpie-demo --example swap_at_runtime -- ao shadows`
use anyhow::Context;
use magpie::gpu::{Gpu, GpuOptions};
use magpie::scene::{self, Scene};
use magpie_passes::{FrameRequest, RenderError, RenderOptions, Renderer, Slots};

/// Frames over which times are averaged, after one in which pipelines are made.
const FRAMES: u32 = 3;

/// A renderer at work.
pub struct Running {
    /// It renders the scene with what is in its slots.
    pub renderer: Renderer,
    /// What is seen.
    pub scene: Scene,
}

impl Running {
    /// The default configuration, for pictures of this size in pixels.
    pub fn new(gpu: &Gpu, scene: Scene, [width, height]: [u32; 2]) -> Result<Self, RenderError> {
        let options = RenderOptions { width, height, ..RenderOptions::default() };
        let renderer = Renderer::new(gpu, &scene, &Slots::default(), &Default::default(), options)?;
        Ok(Self { renderer, scene })
    }

    /// Mean time of a slot's passes per frame, milliseconds.
    pub fn milliseconds(&mut self, slot: &str) -> anyhow::Result<f64> {
        let mut nanoseconds = 0;
        for frame in 0..=FRAMES {
            let camera = &self.scene.cameras[0];
            let request = FrameRequest { camera, time: 0.0, view: None, read_back: false };
            let sample = self.renderer.frame(request)?.context("a size of zero shows nothing")?.sample;
            let of_slot = sample.passes.iter().filter(|pass| pass.stage == slot && frame > 0);
            nanoseconds += of_slot.filter_map(|pass| pass.gpu_ns).sum::<u64>();
        }
        Ok(nanoseconds as f64 / f64::from(FRAMES) / 1e6)
    }

    /// Puts every implementation of a slot in its place, one after another, and then the one that was there. Returns names and times.
    pub fn try_all(&mut self, slot: &str) -> anyhow::Result<Vec<(String, f64)>> {
        let before = self.renderer.config().clone();
        let infos = Slots::default().infos();
        let info = infos.iter().find(|info| info.name == slot).with_context(|| format!("there is no slot {slot}"))?;
        let mut times = Vec::new();
        for implementation in &info.implementations {
            self.renderer.swap(slot, &implementation.name)?;
            times.push((implementation.name.clone(), self.milliseconds(slot)?));
        }
        self.renderer.configure(&before)?;
        Ok(times)
    }
}

fn main() -> anyhow::Result<()> {
    let named: Vec<String> = std::env::args().skip(1).collect();
    let slots = if named.is_empty() { vec!["ao".to_owned(), "shadows".to_owned()] } else { named };
    let gpu = Gpu::new(&GpuOptions::default())?;
    let scene = scene::builtin("courtyard").context("no such scene")?;
    let mut running = Running::new(&gpu, scene, [160, 90])?;
    for slot in &slots {
        for (implementation, milliseconds) in running.try_all(slot)? {
            println!("{slot:12} {implementation:16} {milliseconds:8.3} ms");
        }
    }

    // A setting is changed with the whole configuration. Only the slot that it belongs to starts anew.
    let mut config = running.renderer.config().clone();
    config.set("ao.slices=4")?;
    running.renderer.configure(&config)?;
    println!("{:12} {:16} {:8.3} ms", "ao", "with 4 slices", running.milliseconds("ao")?);

    // A mistake is an error that names what there is. Frames go on with what was there.
    if let Err(error) = running.renderer.swap("ao", "screen-spice") {
        println!("{error}");
    }
    println!("{:12} {:16} {:8.3} ms", "ao", "as before", running.milliseconds("ao")?);
    Ok(())
}
