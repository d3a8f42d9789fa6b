//! Frames of a test's own, run with every check, and read-back of any of their images and buffers.
use anyhow::{Context, Result, ensure};
use magpie::config::Config;
use magpie::frame::{View, ViewDesc};
use magpie::gpu::{Buffer, BufferMemory, BufferUse, Gpu, GpuError, Kernel, RayKernel, Staging};
use magpie::graph::check::{Finding, FindingTracker, Poison, Scan, Unscanned};
use magpie::graph::execute::{Executed, Executor, Imports};
use magpie::graph::{Access, BufferDesc, Domain, Extent, FrameGraph, MipCopy, Produced, Queue, Record, WriteHandle};
use magpie::pixels::Pixels;
use magpie::scene::{Camera, Policy, SharedScene};
use magpie_passes::contracts::{AccelerationIn, SceneHandles};
use magpie_passes::frame::{FrameOut, frame};
use magpie_passes::slots::merged;
use magpie_passes::{Frame, Slots};
use magpie_shaders::Rays;
use std::cell::RefCell;
use std::collections::HashMap;
use std::rc::Rc;
use std::sync::Arc;

/// Runs a test's frames on one device.
pub struct Bench {
    /// The device.
    pub gpu: Gpu,
    /// Executes the frames.
    pub executor: Executor,
    scan: Scan,
    /// Origins of all non-finite values so far; frames count from 0.
    pub tracker: FindingTracker,
    frame: u32,
}

/// A view of a scene.
#[derive(Clone, Copy)]
pub struct Shot<'a> {
    /// The scene on the device.
    pub scene: &'a SharedScene,
    /// The camera.
    pub camera: &'a Camera,
    /// Size of the picture, pixels.
    pub extent: Extent,
}

/// Results of a frame that ran without a validation message.
pub struct Ran {
    /// The requested images by `pass:output`.
    images: HashMap<String, Pixels>,
    /// Non-finite values found by the scan.
    pub findings: Vec<Finding>,
    /// Outputs that the scan could not read.
    pub unscanned: Vec<Unscanned>,
    /// Declaration, plan and times.
    pub executed: Executed,
}

impl Ran {
    /// A requested image.
    pub fn image(&self, name: &str) -> Result<&Pixels> {
        self.images.get(name).with_context(|| format!("no pass wrote {name}"))
    }

    /// Its pixels as floats.
    pub fn values(&self, name: &str) -> Result<Vec<[f32; 4]>> {
        Ok(self.image(name)?.values())
    }

    /// Fails if the scan found anything.
    pub fn clean(self) -> Result<Self> {
        ensure!(self.findings.is_empty(), "{}", self.findings[0]);
        Ok(self)
    }

    /// Number of closest-hit and any-hit rays of a pass.
    pub fn rays(&self, pass: &str) -> Result<[u64; 2]> {
        let found = self.executed.sample.passes.iter().find(|p| p.name == pass);
        found.map(|p| [p.rays_closest, p.rays_any]).with_context(|| format!("{pass} did not run"))
    }
}

/// Resources that a frame imports; the scan and the copies add to them during declaration.
pub type Shared = Rc<RefCell<Imports>>;

impl Bench {
    /// A bench on this device.
    pub fn new(gpu: &Gpu) -> Result<Self> {
        Ok(Self {
            gpu: gpu.clone(),
            executor: Executor::new(gpu)?,
            scan: Scan::new(gpu)?,
            tracker: FindingTracker::default(),
            frame: 0,
        })
    }

    /// Number of frames so far, which is the number of the next one.
    pub fn frames(&self) -> u32 {
        self.frame
    }

    /// A compute pipeline from GLSL, which may include Magpie's `lib/` and `shared/`.
    pub fn kernel(&self, name: &str, glsl: &str) -> Result<Kernel> {
        let words = magpie_shaders::compile(name, glsl, magpie_shaders::Stage::Compute)?;
        Ok(self.gpu.kernel_from_words(name, &words)?)
    }

    /// The pipeline of a ray pass from GLSL.
    pub fn ray_kernel(&self, name: &str, glsl: &str, rays: Rays) -> Result<RayKernel> {
        let words = magpie_shaders::compile_rays(name, glsl, rays)?;
        Ok(self.gpu.ray_kernel_from_words(name, &words, rays)?)
    }

    /// Runs the frame that `declare` makes, with the scan for NaN and infinity on every pass, and copies of the `wanted` images
    /// (`pass:output`) directly after their pass. Validation messages are errors.
    pub fn run(
        &mut self,
        extent: Extent,
        wanted: &[&str],
        declare: impl FnOnce(&mut FrameGraph, &Shared) -> Result<()>,
    ) -> Result<Ran> {
        let imports = Shared::default();
        let mut g = self.executor.begin(extent);
        let (scanned, mut scan) = self.scan.observer(&self.gpu, &imports);
        let mut wanted: Vec<String> = wanted.iter().map(|w| (*w).to_owned()).collect();
        let copies = Rc::<RefCell<Vec<(Produced, Arc<Buffer>)>>>::default();
        let failed = Rc::<RefCell<Option<GpuError>>>::default();
        let (gpu, seen, problem, keys) = (self.gpu.clone(), copies.clone(), failed.clone(), imports.clone());
        g.observe_passes(move |g, pass| {
            scan(g, pass);
            for produced in g.images_of(pass) {
                let name = format!("{}:{}", produced.pass, produced.output);
                if let Some(at) = wanted.iter().position(|w| *w == name) {
                    wanted.swap_remove(at);
                    match copy(&gpu, g, &keys, &produced) {
                        Ok(buffer) => seen.borrow_mut().push((produced, buffer)),
                        Err(error) => *problem.borrow_mut() = Some(error),
                    }
                }
            }
        });
        declare(&mut g, &imports)?;
        if let Some(error) = failed.borrow_mut().take() {
            return Err(error.into());
        }
        let executed = self.executor.run(g, &imports.borrow())?;
        self.gpu.check_validation()?;
        let images = copies.take().into_iter().map(|(p, buffer)| {
            let bytes = (p.extent.width * p.extent.height * p.format.bytes_per_pixel()) as usize;
            let pixels = Pixels { extent: p.extent, format: p.format, bytes: buffer.contents()[..bytes].to_vec() };
            (format!("{}:{}", p.pass, p.output), pixels)
        });
        let images = images.collect();
        let (findings, unscanned) = (scanned.findings(), scanned.unscanned());
        let Executed { declaration, plan, .. } = &executed;
        self.tracker.follow(self.frame, declaration, &plan.order, &findings, &unscanned);
        self.frame += 1;
        Ok(Ran { images, findings, unscanned, executed })
    }

    /// Marks a camera cut: the next frame discards all histories.
    pub fn cut(&mut self) {
        self.executor.cut();
    }

    /// Runs the whole frame of Magpie, as [`frame`] declares it.
    pub fn frame(&mut self, shot: Shot<'_>, config: &Config, wanted: &[&str]) -> Result<Ran> {
        self.frame_with(shot, config, wanted, |_| ())
    }

    /// The same with one output overwritten by `poison`.
    pub fn poisoned_frame(&mut self, shot: Shot<'_>, config: &Config, poison: Poison) -> Result<Ran> {
        self.frame_with(shot, config, &[], |g| g.poison(poison))
    }

    fn frame_with(
        &mut self,
        shot: Shot<'_>,
        config: &Config,
        wanted: &[&str],
        first: impl FnOnce(&mut FrameGraph),
    ) -> Result<Ran> {
        let mut stages = Frame::new(&magpie::slot::Build::new(&self.gpu, Rays::Software), &Slots::default(), config)?;
        let gpu = self.gpu.clone();
        self.run(shot.extent, wanted, |g, imports| {
            first(g);
            let out = shot.frame(&gpu, &mut stages, g, imports)?;
            g.output(out.display);
            Ok(())
        })
    }
}

impl Shot<'_> {
    /// Imports the camera into a frame.
    pub fn view(&self, gpu: &Gpu, g: &mut FrameGraph, imports: &Shared) -> Result<View> {
        let Self { scene, camera, extent } = *self;
        let desc = ViewDesc::new(camera, extent);
        Ok(desc.declare(&mut Staging::new(gpu, "view"), &scene.borrow(), g, &mut imports.borrow_mut())?)
    }

    /// Declares the whole frame.
    pub fn frame(&self, gpu: &Gpu, stages: &mut Frame, g: &mut FrameGraph, imports: &Shared) -> Result<FrameOut> {
        let view = self.view(gpu, g, imports)?;
        let (scene, camera) = (self.scene.clone(), self.camera.clone());
        Ok(frame(
            stages,
            g,
            &view,
            &merged(&stages.needs(&view.facts)),
            AccelerationIn::Resident { scene, imports: imports.clone(), camera },
        )?)
    }

    /// Imports camera and scene into a frame.
    pub fn declare(&self, gpu: &Gpu, g: &mut FrameGraph, imports: &Shared) -> Result<(View, SceneHandles)> {
        let view = self.view(gpu, g, imports)?;
        let policy = Policy::default();
        let scene = self.scene.borrow_mut().declare(g, &mut imports.borrow_mut(), Some(self.camera), &policy)?;
        Ok((view, scene))
    }
}

/// A buffer that the CPU can read after the frame.
pub fn results(
    gpu: &Gpu,
    g: &mut FrameGraph,
    imports: &Shared,
    name: &str,
    bytes: u64,
) -> Result<(WriteHandle<magpie::graph::Buffer>, Arc<Buffer>), GpuError> {
    let buffer = Arc::new(Buffer::new(gpu, name, bytes, BufferMemory::ReadBack, BufferUse::Storage)?);
    let key = imports.borrow_mut().buffer(&buffer);
    Ok((g.import_buffer(name, BufferDesc::new(bytes), Access::HostRead, key), buffer))
}

fn copy(gpu: &Gpu, g: &mut FrameGraph, imports: &Shared, produced: &Produced) -> Result<Arc<Buffer>, GpuError> {
    let extent = produced.extent;
    let bytes = u64::from(extent.width * extent.height * produced.format.bytes_per_pixel());
    let name = format!("copy.{}.{}", produced.pass, produced.output);
    let (target, buffer) = results(gpu, g, imports, &name, bytes)?;
    let image = produced.image;
    let target = g.pass(&name, Queue::Transfer, |p| {
        let from = p.copy_from(image);
        let (target, to) = p.copy_to(target);
        (target, move |c: &mut Record<'_>| c.copy_from_image(from, to, MipCopy { offset: 0, mip: 0 }))
    });
    g.leave(target.read(), Access::HostRead, Domain::Copy);
    Ok(buffer)
}
