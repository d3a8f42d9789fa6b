//! Scenes with known reflections, and an effect that marches rays of a test's choice.
use anyhow::{Context, Result, ensure};
use bytemuck::{Pod, Zeroable};
use glam::{Affine3A, DVec2, DVec3, Quat, Vec3};
use magpie::config::Config;
use magpie::gpu::{Gpu, Kernel};
use magpie::prelude::*;
use magpie::scene::{Camera, Material, Scene, SceneFacts};
use magpie::slot::{Build, Needs, SlotError};
use magpie_passes::contracts::{GEOMETRY, LightingIn, LightingOut};
use magpie_passes::parts::pyramid::{Content, Pyramid};
use magpie_passes::{FrameRequest, RenderOptions, Renderer, Slots};
use magpie_shaders::gbuffer::GBufferImages;
use magpie_shaders::screen_march::ScreenMarch;
use magpie_shaders::{Address, SampledImage, Stage, StorageImage};
use magpie_tests::fixtures::{add, block, material, plane};
use magpie_tests::harness::config;

/// Levels of the pyramid of depths.
const LEVELS: u32 = 6;
/// Most pixels of one ray that are listed.
pub const LISTED: u32 = 256;

const GLSL: &str = r#"#version 460
#extension GL_GOOGLE_include_directive : require
#include "lib/bindless.glsl"
void looked_at(ivec2 pixel);
#define SCREEN_MARCH_LOOKS_AT(pixel) looked_at(pixel)
#include "lib/screen_march.glsl"
layout(local_size_x = 8, local_size_y = 8) in;
layout(push_constant, scalar) uniform Push {
    uvec2 view_address; GBufferImages gbuffer; ScreenMarch march; vec3 direction; float stride; float jitter; uint result; uint list; uint frame;
};
int listed = 0;
int row = 0;
void looked_at(ivec2 pixel) {
    if (listed < 256) store(list, ivec2(listed, row), vec4(vec2(pixel), 1.0, 0.0));
    listed++;
}
void main() {
    ViewBuffer view = ViewBuffer(view_address);
    ivec2 pixel = ivec2(gl_GlobalInvocationID.xy);
    if (!inside(pixel, view.at[0].size)) return;
    row = pixel.y * int(view.at[0].size.x) + pixel.x;
    for (int i = 0; i < 256; i++) store(list, ivec2(i, row), vec4(0.0));
    Surface s = load_geometry(view, pixel, gbuffer);
    vec4 found = vec4(0.0);
    // Half a turn of the direction over the picture, where it is to be different everywhere.
    vec3 way = direction == vec3(0.0) ? s.geometric_normal + 0.9 * vec3(cos(float(row) * 2.4), 0.0, sin(float(row) * 2.4)) : direction;
    // A negative jitter stands for one of each pixel and frame.
    uint word = (uint(row) * 747796405u + frame * 2891336453u) * 277803737u;
    float start = jitter < 0.0 ? float(((word >> 22u) ^ word) & 0xffffu) / 65536.0 : jitter;
    if (s.exists) {
        ScreenHit hit = march_screen(view, march, gbuffer, march_origin(view, s), normalize(way), stride, start);
        found = vec4(hit.met ? 1.0 : 0.0, hit.place, float(hit.steps));
    }
    store(result, pixel, found);
}
"#;

#[repr(C)]
#[derive(Clone, Copy, Pod, Zeroable)]
struct Params {
    view: Address,
    gbuffer: GBufferImages,
    march: ScreenMarch,
    direction: [f32; 3],
    stride: f32,
    jitter: f32,
    result: StorageImage,
    list: StorageImage,
    frame: u32,
}

/// Rays of one direction from every pixel.
#[derive(Clone, Copy, Debug)]
pub struct Rays {
    /// World, of any length; zero for another one in each pixel.
    pub direction: Vec3,
    /// Steps of this many pixels; `None` for the pyramid.
    pub stride: Option<f32>,
    /// Share of the stride before the first step, below 0 for another one in each pixel and frame.
    pub jitter: f32,
    pub thickness: f32,
    pub distance: f32,
}

impl Rays {
    pub fn towards(direction: Vec3) -> Self {
        Self { direction, stride: None, jitter: 0.0, thickness: 0.1, distance: 100.0 }
    }

    /// Both ways to march.
    pub fn ways(self, stride: f32) -> [Self; 2] {
        [self, Self { stride: Some(stride), ..self }]
    }
}

struct Marcher {
    kernel: Kernel,
    pyramid: Pyramid,
    rays: Rays,
}

impl Marcher {
    fn new(build: &Build<'_>, rays: Rays) -> Result<Self, SlotError> {
        let words = magpie_shaders::compile("marcher.comp", GLSL, Stage::Compute).map_err(SlotError::other)?;
        let kernel = build.kernel_from_words("marcher.comp", &words)?;
        Ok(Self { kernel, pyramid: Pyramid::new(build, "reflections", Content::MinMax)?, rays })
    }
}

impl Effect for Marcher {
    type In = LightingIn;
    type Out = LightingOut;

    fn needs(&self, _: &SceneFacts) -> Needs {
        Needs::default()
    }

    fn add(&mut self, g: &mut FrameGraph, view: &View, i: LightingIn) -> LightingOut {
        let Rays { direction, stride, jitter, thickness, distance } = self.rays;
        let pyramid = stride.is_none().then(|| self.pyramid.add(g, i.gbuffer.depth, LEVELS));
        let (kernel, block, frame) = (self.kernel, view.block, view.frame);
        g.pass("reflections.march", Queue::Graphics, |p| {
            let (block, gbuffer, pyramid) =
                (p.read(block), i.gbuffer.read(p, GEOMETRY), pyramid.map(|image| p.sample(image)));
            let extent = p.extent(i.gbuffer.depth);
            let (result, target) = p.create("found", ImageDesc::like(Format::Rgba32Float, i.gbuffer.depth));
            let rows = Extent::new(LISTED, extent.width * extent.height);
            let (_, list) = p.create("list", ImageDesc::fixed(Format::Rgba16Float, rows));
            (LightingOut::radiance(result.read()), move |c: &mut Record<'_>| {
                let pyramid = pyramid.map_or(SampledImage::NONE, |token| c.id(token));
                let march = ScreenMarch { pyramid, levels: LEVELS, steps: LISTED, thickness, distance };
                let params = Params {
                    view: c.id(block),
                    gbuffer: gbuffer.images(c),
                    march,
                    direction: direction.to_array(),
                    stride: stride.unwrap_or(1.0),
                    jitter,
                    result: c.id(target),
                    list: c.id(list),
                    frame,
                };
                c.dispatch(kernel, &params, extent);
            })
        })
    }
}

/// What the ray of a pixel found.
#[derive(Clone, Copy, Debug)]
pub struct Found {
    pub met: bool,
    pub place: DVec2,
    pub steps: u32,
}

/// Images of some frames: what the rays of every pixel found, or with `list` which pixels they looked at.
pub fn marched(gpu: &Gpu, scene: &Scene, size: [u32; 2], rays: Rays, frames: u32) -> Result<Vec<Vec<Found>>> {
    let images = images(gpu, scene, size, rays, frames, "found")?;
    let found = |v: &[f32; 4]| Found {
        met: v[0] > 0.5,
        place: DVec2::new(f64::from(v[1]), f64::from(v[2])),
        steps: v[3] as u32,
    };
    Ok(images.iter().map(|image| image.iter().map(found).collect()).collect())
}

/// The pixels that the rays of the first frame looked at, in rows of [`LISTED`].
pub fn looked_at(gpu: &Gpu, scene: &Scene, size: [u32; 2], rays: Rays) -> Result<Vec<[f32; 4]>> {
    images(gpu, scene, size, rays, 1, "list")?.pop().context("no frame")
}

fn images(
    gpu: &Gpu,
    scene: &Scene,
    size: [u32; 2],
    rays: Rays,
    frames: u32,
    output: &str,
) -> Result<Vec<Vec<[f32; 4]>>> {
    let mut slots = Slots::default();
    slots
        .reflections
        .register("marcher", "Rays of a test.", &[], move |build, _| Ok(Box::new(Marcher::new(build, rays)?)));
    let mut config = Config::default();
    config.set("stages.reflections=marcher")?;
    config.set("gbuffer.precision=full")?;
    let options = RenderOptions { width: size[0], height: size[1], check: true, ..RenderOptions::default() };
    let mut renderer = Renderer::new(gpu, scene, &slots, &config, options)?;
    (0..frames)
        .map(|_| {
            let view = Some(("reflections.march", output));
            let request = FrameRequest { camera: &scene.cameras[0], time: 0.0, view, read_back: true };
            let result = renderer.frame(request)?.context("no frame")?;
            ensure!(result.findings.is_empty(), "{}", result.findings[0]);
            Ok(result.images.context("no picture")?.linear.values())
        })
        .collect()
}

/// The frames of the effect itself, with other indirect light off: an image of each.
pub fn shown(
    gpu: &Gpu,
    scene: &Scene,
    changes: &[&str],
    size: [u32; 2],
    frames: u32,
    view: (&str, &str),
) -> Result<Vec<Vec<[f32; 4]>>> {
    let mut all = vec!["stages.reflections=screen-space", "stages.gi=off", "stages.ao=off"];
    all.extend(changes);
    let options = RenderOptions { width: size[0], height: size[1], check: true, ..RenderOptions::default() };
    let mut renderer = Renderer::new(gpu, scene, &Slots::default(), &config(&all)?, options)?;
    (0..frames)
        .map(|frame| {
            let request = FrameRequest { camera: &scene.cameras[0], time: 0.0, view: Some(view), read_back: true };
            let result = renderer.frame(request)?.context("no frame")?;
            ensure!(result.findings.is_empty(), "frame {frame}: {}", result.findings[0]);
            Ok(result.images.context("no picture")?.linear.values())
        })
        .collect()
}

/// What a camera does, in double precision.
pub struct Seen {
    eye: DVec3,
    right: DVec3,
    up: DVec3,
    forward: DVec3,
    /// Half the height and width of the picture at a distance of 1.
    half: DVec2,
    size: DVec2,
}

impl Seen {
    pub fn new(camera: &Camera, size: [u32; 2]) -> Self {
        let m = camera.world_from_camera.matrix3;
        let size = DVec2::new(f64::from(size[0]), f64::from(size[1]));
        let tan = (0.5 * f64::from(camera.vertical_fov)).tan();
        let half = DVec2::new(tan * size.x / size.y, tan);
        Self { eye: camera.eye(), right: m.x_axis, up: m.y_axis, forward: -m.z_axis, half, size }
    }

    /// Where a point is seen, pixels.
    pub fn project(&self, point: DVec3) -> DVec2 {
        let to = point - self.eye;
        let depth = to.dot(self.forward);
        let ndc = DVec2::new(to.dot(self.right), -to.dot(self.up)) / (depth * self.half);
        (ndc * 0.5 + 0.5) * self.size
    }

    /// Direction through a place on the screen, of length 1 along the view.
    pub fn direction(&self, place: DVec2) -> DVec3 {
        let ndc = (place / self.size * 2.0 - 1.0) * self.half;
        self.forward + ndc.x * self.right - ndc.y * self.up
    }

    /// Where the ray of a pixel meets a plane through `point`.
    pub fn on_plane(&self, place: DVec2, point: DVec3, normal: DVec3) -> DVec3 {
        let way = self.direction(place);
        self.eye + way * ((point - self.eye).dot(normal) / way.dot(normal))
    }

    /// Width of a pixel at a point, metres.
    pub fn width_at(&self, point: DVec3) -> f64 {
        2.0 * self.half.y / self.size.y * (point - self.eye).dot(self.forward)
    }
}

/// An upright square that faces +z, with its middle here.
pub fn upright(z: f32, y: f32) -> Affine3A {
    Affine3A::from_rotation_translation(Quat::from_rotation_x(std::f32::consts::FRAC_PI_2), Vec3::new(0.0, y, z))
}

/// A floor, as large as the eye can see.
pub fn floor(scene: &mut Scene, of: Material) {
    add(scene, plane(40.0), of, Affine3A::IDENTITY);
}

/// A box of this half size around a place.
pub fn pillar(scene: &mut Scene, half: Vec3, at: Vec3, of: Material) {
    add(scene, block(half), of, Affine3A::from_translation(at));
}

/// A surface that only shows its colour.
pub fn unlit(colour: [f32; 3]) -> Material {
    Material { unlit: true, ..material(colour, 0.0, 1.0) }
}

/// The pixel at a place.
pub fn at(place: DVec2, size: [u32; 2]) -> usize {
    place.y as usize * size[0] as usize + place.x as usize
}

/// Sum of the three channels.
pub fn light(v: &[f32; 4]) -> f64 {
    f64::from(v[0]) + f64::from(v[1]) + f64::from(v[2])
}
