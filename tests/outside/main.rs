//! Renders with and without the effect, under all checks, and says what it adds.
mod bounce;

use magpie::config::Config;
use magpie::gpu::GpuOptions;
use magpie::prelude::*;
use magpie_passes::{FrameRequest, RenderOptions, Renderer, Slots};

fn main() -> anyhow::Result<()> {
    let mut slots = Slots::default();
    bounce::register(&mut slots);
    let gpu = Gpu::new(&GpuOptions { validation: true, ..GpuOptions::default() })?;
    let mut scene = magpie::scene::builtin("courtyard")?;
    // A thing that shines, for the light table to hold.
    let shining = scene.instances[scene.instances.len() - 1].material;
    scene.materials[shining as usize].emission = [2.0, 1.5, 1.0].into();
    for gi in ["off", "bounce"] {
        let mut config = Config::default();
        config.set(&format!("stages.gi={gi}"))?;
        let options = RenderOptions { width: 96, height: 54, check: true, ..RenderOptions::default() };
        let mut renderer = Renderer::new(&gpu, &scene, &slots, &config, options)?;
        for frame in 0..8 {
            let camera = &scene.cameras[0];
            let result = renderer.frame(FrameRequest { camera, time: 0.0, view: None, read_back: frame == 7 })?;
            let result = result.ok_or_else(|| anyhow::anyhow!("no frame"))?;
            anyhow::ensure!(result.findings.is_empty(), "{}", result.findings[0]);
            let Some(images) = result.images else { continue };
            let values = images.linear.values();
            let mean = values.iter().map(|v| v[1]).sum::<f32>() / values.len() as f32;
            let own = |name: &&str| name.starts_with("gi.") || name.starts_with("previous_radiance.");
            let passes: Vec<&str> = result.sample.passes.iter().map(|p| p.name.as_str()).filter(own).collect();
            println!("{gi}: {mean:.4} {}", passes.join(" "));
        }
    }
    Ok(())
}
