//! The user interface over a picture: `overlay.draw` blends as it says, and changes nothing else.
use anyhow::{Context, Result, ensure};
use magpie::gpu::{Gpu, Image, ImageUse};
use magpie::graph::{Extent, Format};
use magpie::pixels::Pixels;
use magpie::prelude::{Handle, Rays};
use magpie::slot::Build;
use magpie_passes::parts::overlay::{Mesh, MeshImage, Overlay, OverlayVertex, TexturePart};
use magpie_passes::{FrameRequest, MOST_IN_FLIGHT, RenderOptions, Renderer, Slots};
use magpie_tests::harness::{builtin, config, gpu};
use std::collections::VecDeque;
use std::sync::Arc;

const SIZE: [u32; 2] = [32, 24];
const WHITE: [u8; 4] = [255; 4];
const GLYPHS: u64 = 7;

/// A window and what is drawn into it.
struct Window {
    renderer: Renderer,
    overlay: Overlay,
    target: Arc<Image>,
}

/// Images of a frame.
struct Seen {
    window: Pixels,
    picture: Pixels,
}

impl Window {
    fn open(gpu: &Gpu, frames_in_flight: u32) -> Result<Self> {
        let [width, height] = SIZE;
        let check = gpu.validates();
        let options = RenderOptions { width, height, check, frames_in_flight, ..RenderOptions::default() };
        let scene = builtin("cornell")?;
        let renderer = Renderer::new(gpu, &scene, &Slots::default(), &config(&["stages.gi=off"])?, options)?;
        let usage = ImageUse { attachment: true, ..ImageUse::default() };
        let target = Image::new(gpu, "window", Format::Rgba8Unorm, Extent::new(width, height), 1, usage)?;
        let overlay = Overlay::new(gpu, &Build::new(gpu, Rays::default()))?;
        Ok(Self { renderer, overlay, target: Arc::new(target) })
    }

    /// Draws frames, as many at once as may be in flight, each with the meshes that its number gives.
    fn draw(
        &mut self,
        frames: u32,
        meshes: impl Fn(u32, Handle<magpie::graph::Image>) -> Vec<Mesh<'static>>,
    ) -> Result<Vec<Seen>> {
        let scene = builtin("cornell")?;
        let (mut tickets, mut seen) = (VecDeque::new(), Vec::new());
        for frame in 0..frames {
            let request = FrameRequest { camera: &scene.cameras[0], time: 0.0, view: None, read_back: false };
            let (overlay, target) = (&mut self.overlay, &self.target);
            let ticket = self.renderer.submit_with(request, &mut |g, imports, made| {
                let window = overlay.add(g, imports, &meshes(frame, made.display), target)?;
                made.read_back(g, imports, "window", window);
                made.read_back(g, imports, "picture", made.display);
                Ok(())
            })?;
            tickets.push_back(ticket.context("a size of zero")?);
            let most = if frame + 1 == frames { 0 } else { MOST_IN_FLIGHT as usize - 1 };
            while tickets.len() > most {
                let mut copied = self.renderer.finish(tickets.pop_front().context("no ticket")?)?.copied.into_iter();
                let mut next = |wanted: &str| {
                    let (name, pixels) = copied.next().context("an image is missing")?;
                    ensure!(name == wanted, "{name} instead of {wanted}");
                    Ok(pixels)
                };
                seen.push(Seen { window: next("window")?, picture: next("picture")? });
            }
        }
        Ok(seen)
    }
}

/// A rectangle with the whole of an image.
fn rectangle([left, top, right, bottom]: [f32; 4], colour: [u8; 4], image: MeshImage) -> Mesh<'static> {
    let corner = |x: bool, y: bool| OverlayVertex {
        position: [if x { right } else { left }, if y { bottom } else { top }],
        uv: [f32::from(u8::from(x)), f32::from(u8::from(y))],
        colour: u32::from_le_bytes(colour),
    };
    Mesh {
        vertices: vec![corner(false, false), corner(true, false), corner(true, true), corner(false, true)].into(),
        indices: vec![0, 1, 2, 0, 2, 3].into(),
        scale: 1.0,
        clip: [0.0, 0.0, SIZE[0] as f32, SIZE[1] as f32],
        image,
    }
}

const ALL: [f32; 4] = [0.0, 0.0, SIZE[0] as f32, SIZE[1] as f32];

fn texels(pixels: &Pixels) -> Vec<[u8; 4]> {
    pixels.bytes.as_chunks().0.to_vec()
}

fn at(pixels: &Pixels, x: u32, y: u32) -> [u8; 4] {
    texels(pixels)[(y * SIZE[0] + x) as usize]
}

fn is_near(found: [u8; 4], wanted: [u8; 4]) -> bool {
    found.iter().zip(wanted).all(|(a, b)| a.abs_diff(b) <= 1)
}

#[test]
fn the_picture_comes_through_unchanged() -> Result<()> {
    let Some(gpu) = gpu()? else { return Ok(()) };
    let seen = Window::open(&gpu, 2)?.draw(3, |_, display| vec![rectangle(ALL, WHITE, MeshImage::OfFrame(display))])?;
    for Seen { window, picture } in &seen {
        let colour = |texel: [u8; 4]| [texel[0], texel[1], texel[2]];
        let (window, picture): (Vec<_>, Vec<_>) =
            (texels(window).into_iter().map(colour).collect(), texels(picture).into_iter().map(colour).collect());
        ensure!(window == picture, "the window shows something else");
        ensure!(picture.iter().any(|texel| *texel != picture[0]), "the picture is of one colour");
    }
    Ok(())
}

#[test]
fn triangles_blend_in_their_order_inside_of_their_rectangles() -> Result<()> {
    let Some(gpu) = gpu()? else { return Ok(()) };
    let mut window = Window::open(&gpu, 2)?;
    let white = TexturePart { at: None, extent: Extent::new(1, 1), pixels: &WHITE };
    window.overlay.set_texture(GLYPHS, &white)?;
    let own = || MeshImage::Own(GLYPHS);
    let seen = window.draw(1, |_, _| {
        let clipped = Mesh { clip: [8.0, 6.0, 16.0, 12.0], ..rectangle(ALL, [0, 0, 200, 255], own()) };
        vec![
            rectangle([4.0, 4.0, 28.0, 20.0], [100, 50, 20, 255], own()),
            // Half transparent: the colour is multiplied by its alpha.
            rectangle([4.0, 4.0, 28.0, 20.0], [60, 0, 30, 128], own()),
            clipped,
            rectangle(ALL, WHITE, MeshImage::Own(99)), // not known: not drawn
        ]
    })?;
    let window = &seen[0].window;
    ensure!(at(window, 1, 1) == [0, 0, 0, 255], "outside: {:?}", at(window, 1, 1));
    // 100 * 127/255 + 60, 50 * 127/255, 20 * 127/255 + 30.
    let blended = [110, 25, 40, 255];
    ensure!(is_near(at(window, 20, 15), blended), "{:?}", at(window, 20, 15));
    for (x, y, inside) in [(8, 6, true), (15, 11, true), (7, 6, false), (16, 6, false), (8, 5, false), (8, 12, false)] {
        let wanted = if inside { [0, 0, 200, 255] } else { blended };
        ensure!(is_near(at(window, x, y), wanted), "{x} {y}: {:?}", at(window, x, y));
    }
    Ok(())
}

#[test]
fn textures_change_in_part() -> Result<()> {
    let Some(gpu) = gpu()? else { return Ok(()) };
    let mut window = Window::open(&gpu, 2)?;
    let (red, green, blue) = ([200, 0, 0, 255], [0, 200, 0, 255], [0, 0, 200, 255]);
    let whole = [red, red, red, red].concat();
    let shown = |_: u32, _| vec![rectangle(ALL, WHITE, MeshImage::Own(GLYPHS))];
    window.overlay.set_texture(GLYPHS, &TexturePart { at: None, extent: Extent::new(2, 2), pixels: &whole })?;
    ensure!(at(&window.draw(1, shown)?[0].window, 16, 12) == red);
    // Two texels of which one lies outside.
    let two = [green, blue].concat();
    window.overlay.set_texture(GLYPHS, &TexturePart { at: Some([1, 0]), extent: Extent::new(2, 1), pixels: &two })?;
    let window_now = window.draw(1, shown)?.pop().context("no frame")?.window;
    for (x, y, wanted) in [(2, 2, red), (30, 2, green), (2, 22, red), (30, 22, red)] {
        ensure!(is_near(at(&window_now, x, y), wanted), "{x} {y}: {:?}", at(&window_now, x, y));
    }
    window.overlay.remove_texture(GLYPHS);
    ensure!(at(&window.draw(1, shown)?[0].window, 16, 12) == [0, 0, 0, 255]);
    Ok(())
}

/// The target of one renderer's overlay in that of another one, from frame to frame.
#[test]
fn another_renderer_is_shown_beside() -> Result<()> {
    let Some(gpu) = gpu()? else { return Ok(()) };
    let (mut left, mut right) = (Window::open(&gpu, 2)?, Window::open(&gpu, 2)?);
    let usage = ImageUse { sampled: true, attachment: true, ..ImageUse::default() };
    let shared = Arc::new(Image::new(&gpu, "shared", Format::Rgba8Unorm, Extent::new(SIZE[0], SIZE[1]), 1, usage)?);
    right.target = shared.clone();
    for frame in 0..4_u8 {
        let colour = [60 * frame, 20, 90, 255];
        let own = right.draw(1, |_, display| {
            vec![
                rectangle([0.0, 0.0, 9.0, 9.0], colour, MeshImage::OfFrame(display)),
                rectangle(ALL, colour, MeshImage::Own(GLYPHS)),
            ]
        })?;
        let beside = MeshImage::OfAnother(shared.clone());
        let seen = left
            .draw(1, |_, _| vec![rectangle(ALL, WHITE, beside.clone()), rectangle([0.0; 4], WHITE, beside.clone())])?;
        ensure!(seen[0].window.bytes == own[0].window.bytes, "frame {frame}: it shows something else");
        ensure!(at(&own[0].window, 4, 4) != [0, 0, 0, 255] && at(&own[0].window, 20, 20) == [0, 0, 0, 255]);
    }
    Ok(())
}

/// Frames in flight do not see each other's triangles, and nothing is left over of many of them.
#[test]
fn each_frame_has_its_own() -> Result<()> {
    let Some(gpu) = gpu()? else { return Ok(()) };
    let mut windows = Vec::new();
    for in_flight in 1..=MOST_IN_FLIGHT {
        let mut window = Window::open(&gpu, in_flight)?;
        let meshes = |frame: u32, display| {
            let left = frame as f32;
            let mark = [left, 0.0, left + 4.0, SIZE[1] as f32];
            // More triangles from frame to frame, so that buffers grow.
            let marks = (0..=frame * 40).map(|_| rectangle(mark, [255, 0, 255, 255], MeshImage::OfFrame(display)));
            std::iter::once(rectangle(ALL, WHITE, MeshImage::OfFrame(display))).chain(marks).collect()
        };
        let seen = window.draw(12, meshes)?;
        let used = gpu.in_use();
        window.renderer.restart();
        let again = window.draw(12, meshes)?;
        ensure!(gpu.in_use() == used, "{in_flight} in flight: {used:?}, then {:?}", gpu.in_use());
        let bytes: Vec<Vec<u8>> = seen.into_iter().map(|seen| seen.window.bytes).collect();
        ensure!(again.into_iter().zip(&bytes).all(|(seen, first)| seen.window.bytes == *first));
        windows.push(bytes);
    }
    ensure!(windows.iter().all(|window| *window == windows[0]), "the windows differ");
    ensure!(windows[0][0] != windows[0][5], "all frames are alike");
    Ok(())
}
