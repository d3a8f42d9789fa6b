//! `magpie plan`.

use std::{fmt::Write, path::Path};

use magpie::{
    config::Config,
    gpu::{Gpu, GpuOptions},
    graph::Extent as PixelExtent,
    measure::{SlotReport, slot_table},
    pixels::Pixels,
    prelude::Rays,
    scene::{Camera, Scene, SceneFacts},
};
use magpie_accuracy::worth::{ProbeOptions, Worth, worth};
use magpie_passes::{FramePlan, PlanError, RenderOptions, Slots, plan_frame};
use serde::Serialize;
use serde_json::Value;

use crate::{
    args::{Extent, PlanArguments},
    console,
    exit::Failure,
    input,
    output::{Output, keep_apart},
    picture, session,
};

/// Sizes where none is given: of a plan, and of measured probes.
const SIZES: [Extent; 2] = [Extent { width: 1280, height: 720 }, Extent { width: 192, height: 108 }];
/// Frames of a probe: as many as the longest history of a denoiser by default.
const FRAMES: u32 = 32;

/// What `--json` prints.
#[derive(Serialize)]
struct Report<'a> {
    scene: String,
    size: [u32; 2],
    facts: &'a SceneFacts,
    slots: Vec<Row<'a>>,
    memory: Memory,
    /// Bytes that the frame reads and writes as declared, over the pixels of the picture.
    bytes_per_pixel: f64,
    #[serde(skip_serializing_if = "Option::is_none")]
    measured: Option<&'a Worth>,
}

#[derive(Serialize)]
struct Row<'a> {
    #[serde(flatten)]
    report: &'a SlotReport,
    /// Of the frame's time, 0 to 1.
    #[serde(skip_serializing_if = "Option::is_none")]
    share: Option<f64>,
}

#[derive(Serialize)]
struct Memory {
    transient_bytes: u64,
    history_bytes: u64,
}

/// `magpie plan`.
pub(crate) fn plan(arguments: &PlanArguments) -> Result<(), Failure> {
    let output = arguments.out.as_ref().map(|path| Output::plan("--out", path, &["toml"])).transpose()?;
    let inputs = [("scene", Some(&arguments.scene)), ("configuration", arguments.frame.config.as_ref())];
    let inputs: Vec<(&str, &Path)> =
        inputs.iter().filter_map(|(what, path)| Some((*what, path.as_ref()?.as_path()))).collect();
    keep_apart(&output.iter().collect::<Vec<_>>(), &inputs)?;
    let config = input::configure(&session::catalogue(), arguments.frame.config.as_deref(), &arguments.frame.set)?;
    let shares = arguments.report.as_deref().map(Shares::read).transpose()?;
    let scene =
        session::load_scene(&arguments.scene, Some(&arguments.lighting.environment), arguments.lighting.supply)?;
    let camera = session::camera(&scene, arguments.frame.camera.as_deref())?;
    let size = arguments.size.unwrap_or(SIZES[usize::from(arguments.measure)]);
    let slots = Slots::default();
    let extent = PixelExtent::new(size.width, size.height);
    let planned = plan_frame(&scene, &camera, &slots, &config, Rays::Software, extent).map_err(failure)?;
    let measured = arguments.measure.then(|| measure(arguments, &scene, &camera, &config, size)).transpose()?;

    let pixels = u64::from(size.width) * u64::from(size.height);
    let share = |slot: &str| shares.as_ref().and_then(|shares| shares.of(slot));
    if arguments.json {
        let FramePlan { facts, slots, plan, .. } = &planned;
        let report = Report {
            scene: arguments.scene.display().to_string(),
            size: [size.width, size.height],
            facts,
            slots: slots.iter().map(|report| Row { report, share: share(&report.slot) }).collect(),
            memory: Memory {
                transient_bytes: plan.memory.aliased,
                history_bytes: slots.iter().map(|slot| slot.history_bytes).sum(),
            },
            bytes_per_pixel: slots.iter().map(|slot| slot.bytes).sum::<u64>() as f64 / pixels as f64,
            measured: measured.as_ref(),
        };
        console::print(&(serde_json::to_string_pretty(&report).map_err(Failure::running)? + "\n"))?;
    } else {
        console::print(&describe(&planned.facts))?;
        console::print(&slot_table(&planned.slots, pixels, share))?;
        console::print(&totals(&planned, pixels))?;
        if let Some(worth) = &measured {
            console::print(&format!("\n{}", contributions(worth, arguments.worth)))?;
        }
    }
    if let Some(worth) = &measured {
        if let Some(folder) = &arguments.pictures {
            write_pictures(folder, worth)?;
        }
        if let Some(output) = &output {
            output.write_text(&proposal(worth, &config, arguments)?)?;
        }
    }
    Ok(())
}

fn failure(error: PlanError) -> Failure {
    match error {
        PlanError::Slot(error) => error.into(),
        other => Failure::running(other),
    }
}

fn measure(
    arguments: &PlanArguments,
    scene: &Scene,
    camera: &Camera,
    config: &Config,
    size: Extent,
) -> Result<Worth, Failure> {
    let gpu = Gpu::new(&GpuOptions { device: arguments.device.device.clone(), ..GpuOptions::default() })?;
    log::info!("device: {}", gpu.report().name);
    let rays = session::choose_rays(&gpu, arguments.device.rays)?;
    let render = RenderOptions { width: size.width, height: size.height, rays, ..RenderOptions::default() };
    let options = ProbeOptions { render, frames: FRAMES, min_flip: arguments.worth };
    Ok(worth(&gpu, scene, camera, config, options)?)
}

/// Shares of the slots in the time of the frame, of a run.
struct Shares(Vec<(String, f64)>);

impl Shares {
    fn read(path: &Path) -> Result<Self, Failure> {
        let wrong = |what: &str| {
            Failure::bad(format!("--report {}: {what}; wanted the JSON of `render --timings`", path.display()))
        };
        let json: Value = serde_json::from_str(&input::read_text(path)?).map_err(|e| wrong(&e.to_string()))?;
        let passes = json["passes"].as_array().ok_or_else(|| wrong("it has no list `passes`"))?;
        let time = |pass: &Value| Some((pass["stage"].as_str()?.to_owned(), pass["gpu_ms"]["median"].as_f64()?));
        let times: Vec<(String, f64)> =
            passes.iter().map(time).collect::<Option<_>>().ok_or_else(|| wrong("a pass has no stage or no time"))?;
        let all: f64 = times.iter().map(|(_, ms)| ms).sum();
        if all <= 0.0 {
            return Err(wrong("its passes took no time"));
        }
        Ok(Self(times.into_iter().map(|(stage, ms)| (stage, ms / all)).collect()))
    }

    fn of(&self, slot: &str) -> Option<f64> {
        let of_slot: Vec<f64> = self.0.iter().filter(|(stage, _)| stage == slot).map(|(_, share)| *share).collect();
        (!of_slot.is_empty()).then(|| of_slot.iter().sum())
    }
}

/// What the scene is made of, in a few lines.
fn describe(facts: &SceneFacts) -> String {
    let percent = |share: f64| format!("{:.1} %", 100.0 * share);
    let lights = kinds_of_lights(facts);
    let sky = if facts.has_sky { "with sky" } else { "without sky" };
    let mut text = format!("lights: {lights}; {sky}\n");
    // Writing to a String cannot fail.
    let _ = writeln!(
        text,
        "surface: {:.3} m2 of {} instances, {} triangles, {} spheres; emissive {:.3} m2",
        facts.area, facts.instances, facts.triangles, facts.spheres, facts.emissive_area
    );
    let shares = [
        ("diffuse", facts.diffuse),
        ("specular", facts.specular),
        ("metal", facts.metalness.from(0.5)),
        ("rougher than 0.5", facts.roughness.from(0.5)),
        ("alpha-tested", facts.alpha_tested),
        ("blended", facts.blended),
        ("transmissive", facts.transmissive),
        ("moving", facts.moving),
    ];
    let shares: Vec<String> = shares.iter().map(|(name, share)| format!("{name} {}", percent(*share))).collect();
    let _ = writeln!(text, "shares: {}\n", shares.join(", "));
    text
}

/// The kinds of lights in the order in which they first occur, with their numbers where there are several.
fn kinds_of_lights(facts: &SceneFacts) -> String {
    let mut kinds: Vec<(String, usize)> = Vec::new();
    for light in &facts.lights {
        let name = format!("{:?}", light.kind).to_lowercase();
        match kinds.iter_mut().find(|(known, _)| *known == name) {
            Some((_, count)) => *count += 1,
            None => kinds.push((name, 1)),
        }
    }
    if kinds.is_empty() {
        return "none".to_owned();
    }
    let one = |(name, count): &(String, usize)| if *count > 1 { format!("{name} ({count})") } else { name.clone() };
    kinds.iter().map(one).collect::<Vec<_>>().join(", ")
}

fn totals(planned: &FramePlan, pixels: u64) -> String {
    let mib = |bytes: u64| bytes as f64 / f64::from(1 << 20);
    let (memory, slots) = (&planned.plan.memory, &planned.slots);
    format!(
        "{} passes, {} culled; {:.0} B/px; transient {:.2} MiB ({:.2} MiB unshared), kept {:.2} MiB\n",
        planned.plan.order.len(),
        planned.plan.culled.len(),
        slots.iter().map(|slot| slot.bytes).sum::<u64>() as f64 / pixels as f64,
        mib(memory.aliased),
        mib(memory.unaliased),
        mib(slots.iter().map(|slot| slot.history_bytes).sum()),
    )
}

fn contributions(worth: &Worth, least: f64) -> String {
    let width = worth.contributions.iter().map(|c| c.effect.len()).max().unwrap_or(0).max(6);
    let mut text = format!("{:<width$}  {:>8}  {:>9}  without\n", "effect", "FLIP", "ms");
    for c in &worth.contributions {
        let verdict = if c.flip < least { "not worth it" } else { "" };
        let line = format!("{:<width$}  {:>8.5}  {:>9.3}  {}  {verdict}", c.effect, c.flip, c.ms, c.without);
        text += line.trim_end();
        text.push('\n');
    }
    let _ = match &worth.proposal {
        None => writeln!(text, "every effect changes the picture by {least} or more; of {:.3} ms", worth.ms),
        Some(p) => writeln!(
            text,
            "proposed: {}; together FLIP {:.5}, {:.3} of {:.3} ms less",
            p.without.join(" "),
            p.flip,
            p.ms,
            worth.ms
        ),
    };
    text
}

/// The proposed configuration as a file that says why.
fn proposal(worth: &Worth, config: &Config, arguments: &PlanArguments) -> Result<String, Failure> {
    let mut text = format!("# magpie plan --measure: {}\n", arguments.scene.display());
    for c in &worth.contributions {
        let _ = writeln!(text, "# {}: FLIP {:.5}, {:.3} ms", c.effect, c.flip, c.ms);
    }
    let _ = match &worth.proposal {
        None => writeln!(text, "# all of them change the picture by {} or more\n", arguments.worth),
        Some(p) => writeln!(text, "# without {}: FLIP {:.5}, {:.3} ms less\n", p.without.join(" "), p.flip, p.ms),
    };
    Ok(text + &worth.proposal.as_ref().map_or(config, |p| &p.config).to_toml()?)
}

fn write_pictures(folder: &Path, worth: &Worth) -> Result<(), Failure> {
    let failed = |error: std::io::Error| Failure::bad(format!("--pictures {}: {error}", folder.display()));
    std::fs::create_dir_all(folder).map_err(failed)?;
    let write = |name: &str, pixels: &Pixels| {
        Output::plan("--pictures", &folder.join(format!("{name}.png")), &["png"])?
            .write(|file| picture::write_png(file, pixels))
    };
    write("all", &worth.picture)?;
    for c in &worth.contributions {
        write(&format!("without-{}", c.effect), &c.picture)?;
    }
    worth.proposal.as_ref().map_or(Ok(()), |p| write("proposed", &p.picture))
}
