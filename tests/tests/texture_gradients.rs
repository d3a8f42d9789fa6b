//! Textures whose coordinates change very little, not at all, or by huge amounts: raster and rays read the same. Some drivers return NaN
//! for anisotropic filtering with zero gradients.
use anyhow::{Result, ensure};
use glam::{Affine3A, Mat2, Quat, Vec2, Vec3};
use magpie::gpu::Gpu;
use magpie::graph::Extent;
use magpie::scene::{AlphaMode, ColourSpace, Material, Sampler, Scene, Texture, TextureUse, Wrap};
use magpie_passes::reference::{Only, PixelSampling, Reference, ReferenceOptions};
use magpie_tests::fixtures::{add, block, camera, material, mesh, plane, scene};
use magpie_tests::harness::{config, gpu, linear, render};
use magpie_tests::oracle::gbuffer::Eye;

const SIZE: [u32; 2] = [320, 180];
const TEXELS: u32 = 64;
/// Tolerance for 8-bit texels, 8-bit filter weights, and rounding of mips.
const ROUNDING: f32 = 0.01;
const PLAIN: [Vec3; 2] = [Vec3::X, Vec3::Y];
const COLUMNS: usize = 16;

/// Red increases with u, green with v, each from 0 to 1: every filter of every mip gives the same away from the border.
fn ramp() -> Texture {
    let byte = |i: u32| ((i as f32 + 0.5) / TEXELS as f32 * 255.0).round() as u8;
    let rgba = (0..TEXELS * TEXELS).flat_map(|i| [byte(i % TEXELS), byte(i / TEXELS), 128, 255]).collect();
    Texture::new("ramp".to_owned(), [TEXELS; 2], ColourSpace::Linear, rgba)
}

fn used(rows: [Vec3; 2]) -> Option<TextureUse> {
    Some(TextureUse { texture: 0, sampler: 0, uv_set: 0, rows })
}

/// A scene with that texture, anisotropic where the device supports it.
fn with_texture(name: &str, camera: magpie::scene::Camera, texture: Texture, wrap: Wrap) -> Scene {
    let mut s = scene(name, camera);
    s.textures.push(texture);
    s.samplers.push(Sampler { wrap: [wrap; 2], ..Sampler::default() });
    s
}

/// Squares of one metre side by side, whose texture coordinates start at `from` and change by these matrices.
fn squares(changes: &[Mat2], from: f32) -> Scene {
    let mut squares = with_texture("squares", camera([8.0, 4.5, 12.4], [8.0, 4.5, 0.0]), ramp(), Wrap::Clamp);
    for (at, change) in changes.iter().enumerate() {
        let corners = [[0.0, 0.0], [1.0, 0.0], [1.0, 1.0], [0.0, 1.0]].map(Vec2::from);
        let positions = corners.iter().map(|c| c.extend(0.0)).collect();
        let mut shape = mesh("square", positions, vec![Vec3::Z; 4], vec![0, 1, 2, 0, 2, 3]);
        shape.uv0 = corners.iter().map(|c| Vec2::splat(from) + *change * *c).collect();
        let place = Vec3::new((at % COLUMNS) as f32, (at / COLUMNS) as f32, 0.0);
        let painted = Material { base_colour_texture: used(PLAIN), ..material([1.0; 3], 0.0, 1.0) };
        add(&mut squares, shape, painted, Affine3A::from_translation(place));
    }
    squares
}

/// An output of the G-buffer, with every check on.
fn gbuffer(gpu: &Gpu, scene: &Scene, output: &str) -> Result<Vec<Vec3>> {
    let config = config(&["gbuffer.precision=full"])?;
    let values = linear(render(gpu, scene, &config, SIZE, 1, Some(("gbuffer.draw", output)))?)?.values();
    Ok(values.into_iter().map(|v| Vec3::new(v[0], v[1], v[2])).collect())
}

/// The instance visible at each pixel.
fn instances(gpu: &Gpu, scene: &Scene) -> Result<Vec<Option<usize>>> {
    Ok(gbuffer(gpu, scene, "ids")?.iter().map(|v| (v.x as usize).checked_sub(1)).collect())
}

/// Gradients of the coordinates with entries of `g`, some with a larger one beside it.
fn ways(g: f32) -> [Mat2; 9] {
    const MUCH: f32 = 0.4;
    let ways = [[g, 0.0, 0.0, 0.0], [0.0, 0.0, g, 0.0], [0.0, g, 0.0, 0.0], [0.0, 0.0, 0.0, g], [g, 0.0, 0.0, g]];
    let [a, b, c, d, e] = ways.map(|m| Mat2::from_cols_array(&m));
    let mixed = [[0.25 * g, 0.5 * g, 0.5 * g, g], [MUCH, 0.0, 0.0, g], [g, 0.0, 0.0, MUCH], [0.5 * MUCH, MUCH, g, 0.0]];
    let [f, h, i, j] = mixed.map(|m| Mat2::from_cols_array(&m));
    [a, b, c, d, e, f, h, i, j]
}

#[test]
fn however_little_coordinates_change() -> Result<()> {
    let Some(gpu) = gpu()? else { return Ok(()) };
    let steps = [0.0, 1e-38, 1e-30, 1e-24, 1e-20, 1e-16, 1e-12, 1e-9, 1e-7, 1e-6, 1e-5, 1e-4, 1e-3, 0.01, 0.1, 0.4];
    let changes: Vec<Mat2> = (0..9).flat_map(|row| steps.map(|g| ways(g)[row])).collect();
    // Added to 0.3 the smallest are rounded away, added to 0 they are not.
    for from in [0.3_f32, 0.0] {
        let scene = squares(&changes, from);
        let (colours, shown) = (gbuffer(&gpu, &scene, "base_colour")?, instances(&gpu, &scene)?);
        let eye = Eye::new(&scene.cameras[0], Extent::new(SIZE[0], SIZE[1]));
        let (mut off, mut counts) = (vec![0.0_f32; changes.len()], vec![0; changes.len()]);
        for (pixel, (colour, shown)) in colours.iter().zip(shown).enumerate() {
            let Some(at) = shown else { continue };
            let ray = eye.pixel_ray(pixel);
            let met = (eye.position - ray * (eye.position.z / ray.z)).as_vec3().truncate();
            let place = met - Vec2::new((at % COLUMNS) as f32, (at / COLUMNS) as f32);
            let wanted = (Vec2::splat(from) + changes[at] * place).extend(128.0 / 255.0);
            off[at] = off[at].max((*colour - wanted).abs().max_element());
            counts[at] += 1;
        }
        let worst = off.iter().copied().fold(0.0, f32::max);
        println!("from {from}: {worst:.4} off");
        ensure!(counts.iter().all(|n| *n > 100), "{counts:?}");
        ensure!(worst < ROUNDING, "from {from}: {off:.3?}");
    }
    Ok(())
}

/// Footprints of a whole image and far larger: the mean, and never NaN.
#[test]
fn however_much_coordinates_change() -> Result<()> {
    let Some(gpu) = gpu()? else { return Ok(()) };
    let steps = [1e3, 1e4, 1e5, 1e6, 1e8, 1e10, 1e12, 1e15, 1e18, 1e19, 1e20, 1e25, 1e30, 1e34, 1e37, 3e38];
    let changes: Vec<Mat2> = (0..5).flat_map(|row| steps.map(|g| ways(g)[row])).collect();
    let mut scene = squares(&changes, 0.0);
    scene.samplers[0].wrap = [Wrap::Repeat; 2];
    let (colours, shown) = (gbuffer(&gpu, &scene, "base_colour")?, instances(&gpu, &scene)?);
    let mut counts = vec![0; changes.len()];
    for (colour, shown) in colours.iter().zip(shown) {
        let Some(at) = shown else { continue };
        counts[at] += 1;
        // The filter averages in the directions in which coordinates change; in the other the seam of the ramp may lie.
        let [along_u, along_v] = [changes[at].row(0), changes[at].row(1)].map(|row| row != Vec2::ZERO);
        let whole = |v: f32, along: bool| !along || (v - 0.5).abs() < 0.05;
        ensure!(whole(colour.x, along_u) && whole(colour.y, along_v), "{}: {colour}", changes[at]);
    }
    ensure!(counts.iter().all(|n| *n > 100), "{counts:?}");
    Ok(())
}

/// A texture of sixteen coloured squares, four by four; alpha is 0 in the first only.
fn palette() -> Texture {
    let of = |x: u32, y: u32| {
        [40 + 60 * x as u8, 220 - 50 * y as u8, 30 + 50 * ((x + y) % 4) as u8, if x + y > 0 { 255 } else { 0 }]
    };
    let rgba = (0..64 * 64).flat_map(|i| of(i % 64 / 16, i / 64 / 16)).collect();
    Texture::new("palette".to_owned(), [64; 2], ColourSpace::Linear, rgba)
}

fn colour_of(texture: &Texture, uv: Vec2) -> Vec3 {
    let at = (uv * texture.size[0] as f32).as_uvec2();
    let first = 4 * (at.y * texture.size[0] + at.x) as usize;
    Vec3::from_array([0, 1, 2].map(|c| f32::from(texture.mips[0][first + c]) / 255.0))
}

/// Boxes of a single colour, seen at an angle: with the same coordinates at all corners, with constant coordinates and an offset, and with
/// a transform of scale 0. Returned with their colours.
fn painted(change: fn(Material) -> Material) -> (Scene, Vec<Vec3>) {
    let eye = camera([3.1, 4.3, 7.7], [0.2, 0.0, 0.1]);
    let mut s = with_texture("palette", eye, palette(), Wrap::Repeat);
    let mut colours = Vec::new();
    for i in 0..48_u32 {
        let uv = (Vec2::new((i % 4) as f32, (i / 4 % 4) as f32) + 0.5) / 4.0;
        let mut shape = block(Vec3::splat(0.32));
        let rows = match i / 16 {
            0 => {
                shape.uv0.fill(uv);
                PLAIN
            }
            1 => [Vec3::new(1.0, 0.0, uv.x), Vec3::new(0.0, 1.0, uv.y)],
            _ => {
                shape.uv0 = shape.positions.iter().map(|p| Vec2::new(7.0 * p.x, p.y - 3.0 * p.z)).collect();
                [Vec3::Z * uv.x, Vec3::Z * uv.y]
            }
        };
        let place = Vec3::new((i % 8) as f32 - 3.5, 0.1 * (i % 5) as f32, (i / 8) as f32 - 2.5);
        let turned = Affine3A::from_rotation_translation(Quat::from_rotation_y(i as f32), place);
        let paint = Material { base_colour_texture: used(rows), ..material([1.0; 3], 0.0, 1.0) };
        add(&mut s, shape, change(paint), turned);
        colours.push(colour_of(&s.textures[0], uv));
    }
    add(
        &mut s,
        plane(9.0),
        change(Material { base_colour_texture: used([Vec3::Z * 0.6; 2]), ..material([1.0; 3], 0.0, 1.0) }),
        Affine3A::from_translation(Vec3::NEG_Y),
    );
    colours.push(colour_of(&s.textures[0], Vec2::splat(0.6)));
    (s, colours)
}

/// Equal up to half a step of 8 bits and the driver's filter precision.
fn is_near(a: Vec3, b: Vec3) -> bool {
    (a - b).abs().max_element() < 2e-3
}

/// Number of pixels whose colour is wrong, and of all that were compared.
fn wrong(found: &[Vec3], shown: &[Option<usize>], wanted: &[Vec3]) -> [usize; 2] {
    let pixels = || found.iter().zip(shown).filter_map(|(colour, at)| Some((*colour, wanted[(*at)?])));
    [pixels().filter(|(a, b)| !is_near(*a, *b)).count(), pixels().count()]
}

#[test]
fn palettes_have_their_colours() -> Result<()> {
    let Some(gpu) = gpu()? else { return Ok(()) };
    let (scene, colours) = painted(|paint| paint);
    let shown = instances(&gpu, &scene)?;
    let [off, all] = wrong(&gbuffer(&gpu, &scene, "base_colour")?, &shown, &colours);
    println!("base colour: {off} of {all} pixels are wrong");
    ensure!(all > 20_000 && off == 0, "{off} of {all} pixels");
    ensure!((0..colours.len()).all(|i| shown.contains(&Some(i))), "not all are seen");

    // Materials' other textures use the same code path.
    let (scene, colours) = painted(|paint| Material {
        emission: Vec3::ONE,
        emission_texture: paint.base_colour_texture,
        metalness: 1.0,
        metallic_roughness_texture: paint.base_colour_texture,
        ..paint
    });
    let [off, _] = wrong(&gbuffer(&gpu, &scene, "emission")?, &shown, &colours);
    let surfaces: Vec<Vec3> = colours.iter().map(|c| Vec3::new(c.z, c.y, 0.0)).collect();
    let material: Vec<Vec3> = gbuffer(&gpu, &scene, "material")?.iter().map(|v| Vec3::new(v.x, v.y, 0.0)).collect();
    let [also, _] = wrong(&material, &shown, &surfaces);
    ensure!(off == 0 && also == 0, "emission {off}, metalness and roughness {also} of {all} pixels");
    Ok(())
}

/// Unlit, so that a ray of the reference returns the colour only, and alpha-tested where the palette's alpha is 0.
#[test]
fn rays_read_the_same() -> Result<()> {
    let Some(gpu) = gpu()? else { return Ok(()) };
    let (scene, colours) = painted(|paint| Material { unlit: true, alpha: AlphaMode::Mask(0.5), ..paint });
    let raster = gbuffer(&gpu, &scene, "emission")?;
    let [width, height] = SIZE;
    for pixel in [PixelSampling::Centre, PixelSampling::Area] {
        let options =
            ReferenceOptions { width, height, only: Only::All, pixel, check: true, ..ReferenceOptions::default() };
        let mut reference = Reference::new(&gpu, &scene, &scene.cameras[0], options)?;
        reference.add(1)?;
        let traced: Vec<Vec3> = reference.estimate().mean.iter().map(|v| v.as_vec3()).collect();
        // Every hit returns one of the colours.
        let known = |c: &Vec3| *c == Vec3::ZERO || colours.iter().any(|k| is_near(*k, *c));
        let strange = traced.iter().filter(|c| !known(c)).count();
        let apart = raster.iter().zip(&traced).filter(|(a, b)| !is_near(**a, **b)).count();
        println!("{pixel:?}: {strange} strange colours; {apart} pixels are not those of the raster");
        ensure!(strange == 0, "{pixel:?}: {strange} pixels");
        ensure!(pixel == PixelSampling::Area || apart < 60, "{apart} pixels differ");
    }
    let gone = instances(&gpu, &scene)?;
    ensure!([0, 16, 32].iter().all(|i| !gone.contains(&Some(*i))), "what alpha takes away is there");
    Ok(())
}
