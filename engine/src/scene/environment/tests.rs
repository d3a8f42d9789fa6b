//! Directions, interpolation, spherical harmonics and files.
use super::*;
use crate::scene::SceneError;
use image::{ImageFormat, Rgb32FImage, Rgba32FImage};
use proptest::prelude::*;
use std::f32::consts::FRAC_PI_2;
use std::io::Cursor;

fn made(width: u32, height: u32, texel: impl Fn(u32, u32) -> Vec3) -> Environment {
    let radiance = (0..height).flat_map(|y| (0..width).map(move |x| (x, y))).map(|(x, y)| texel(x, y)).collect();
    Environment { name: "made".to_owned(), width, height, radiance, scale: 1.0, turn: 0.0 }
}

/// Uniform directions over the sphere by a Fibonacci lattice.
fn sphere(n: usize) -> impl Iterator<Item = Vec3> {
    (0..n).map(move |i| {
        let y = 1.0 - 2.0 * (i as f64 + 0.5) / n as f64;
        let (s, c) = (i as f64 * PI * (3.0 - 5.0_f64.sqrt())).sin_cos();
        let r = (1.0 - y * y).sqrt();
        DVec3::new(r * c, y, r * s).as_vec3()
    })
}

#[test]
fn the_middle_is_ahead_and_the_top_is_up() {
    let mut e = made(8, 4, |_, _| Vec3::ONE);
    for (uv, wanted) in [
        (Vec2::new(0.5, 0.5), Vec3::NEG_Z),
        (Vec2::new(0.75, 0.5), Vec3::X),
        (Vec2::new(0.25, 0.5), Vec3::NEG_X),
        (Vec2::new(0.0, 0.5), Vec3::Z),
        (Vec2::new(0.3, 0.0), Vec3::Y),
        (Vec2::new(0.3, 1.0), Vec3::NEG_Y),
    ] {
        assert!(e.direction(uv).abs_diff_eq(wanted, 1e-6), "{uv}: {}", e.direction(uv));
    }
    // A quarter turn counter-clockwise as seen from above: what was ahead is now to the left.
    e.turn = FRAC_PI_2;
    assert!(e.direction(Vec2::splat(0.5)).abs_diff_eq(Vec3::NEG_X, 1e-6));
    assert!(e.uv(Vec3::NEG_X).abs_diff_eq(Vec2::splat(0.5), 1e-6));
}

#[test]
fn directions_and_coordinates_are_inverse() {
    for turn in [0.0, 0.7, -2.0, 20.0] {
        let e = Environment { turn, ..made(8, 4, |_, _| Vec3::ONE) };
        for d in sphere(5000) {
            let uv = e.uv(d * 3.0);
            assert!(uv.min_element() >= 0.0 && uv.max_element() <= 1.0, "{d}: {uv}");
            assert!(e.direction(uv).abs_diff_eq(d, 2e-6), "{d}: {uv}, {}", e.direction(uv));
        }
        assert_eq!((e.uv(Vec3::Y), e.uv(Vec3::NEG_Y)), (Vec2::new(0.5, 0.0), Vec2::new(0.5, 1.0)));
    }
}

#[test]
fn radiance_is_that_of_texels_and_blends_between_them() {
    let texel = |x: u32, y: u32| Vec3::new(x as f32, y as f32, 1.0);
    let e = Environment { scale: 2.0, turn: 0.4, ..made(8, 4, texel) };
    let at = |u: f32, v: f32| e.radiance(e.direction(Vec2::new(u / 8.0, v / 4.0)));
    for (u, v, wanted) in [
        (2.5, 1.5, Vec3::new(2.0, 1.0, 1.0)),
        (3.0, 1.5, Vec3::new(2.5, 1.0, 1.0)),
        (2.5, 2.0, Vec3::new(2.0, 1.5, 1.0)),
        (8.0, 1.5, Vec3::new(3.5, 1.0, 1.0)), // across the seam: the mean of 7 and 0
        (2.5, 0.1, Vec3::new(2.0, 0.0, 1.0)), // constant beyond the first row
        (2.5, 3.9, Vec3::new(2.0, 3.0, 1.0)),
    ] {
        assert!(at(u, v).abs_diff_eq(2.0 * wanted, 1e-4), "({u}, {v}): {}", at(u, v));
    }
}

#[test]
fn the_harmonics_of_plain_light_are_exact() {
    // Under uniform radiance, every surface receives pi times it.
    let c = Environment { scale: 3.0, ..made(2, 1, |_, _| Vec3::new(1.0, 2.0, 4.0)) }.irradiance_sh();
    let wanted = Vec3::new(1.0, 2.0, 4.0) * 3.0 * PI as f32 / 0.282_095;
    assert!(((c[0] - wanted) / wanted).abs().max_element() < 1e-5, "{}", c[0]);
    assert!(c[1..].iter().all(|rest| (*rest / c[0]).abs().max_element() < 3e-5), "{c:?}");
}

#[test]
fn the_harmonics_agree_with_brute_force() {
    for (width, height, turn) in [(4, 2, 0.0), (16, 8, 1.1), (300, 150, -0.6)] {
        // A smooth sky with a bright area, and a darker ground.
        let base = made(width, height, |_, _| Vec3::ONE);
        let texel = |x: u32, y: u32| {
            let uv = Vec2::new((x as f32 + 0.5) / width as f32, (y as f32 + 0.5) / height as f32);
            let d = base.direction(uv);
            Vec3::new(1.2 + d.y, 1.0 + 0.5 * d.x.max(0.0), 0.8 + 0.3 * d.z)
        };
        let e = Environment { turn, ..made(width, height, texel) };
        let (c, n) = (e.irradiance_sh(), 40_000);
        let radiance: Vec<(Vec3, Vec3)> = sphere(n).map(|d| (d, e.radiance(d))).collect();
        for normal in sphere(40) {
            let brute: DVec3 = radiance.iter().map(|(d, r)| (*r * d.dot(normal).max(0.0)).as_dvec3()).sum();
            let brute = (brute * 4.0 * PI / n as f64).as_vec3();
            let ours: Vec3 = c.iter().zip(sh_basis(normal.as_dvec3())).map(|(c, y)| *c * y as f32).sum();
            let error = ((ours - brute) / brute).abs().max_element();
            assert!(error < 0.02, "{width}x{height}, normal {normal}: {ours} against {brute}");
        }
    }
}

#[test]
fn faulty_maps_are_named() {
    let good = made(4, 2, |_, _| Vec3::ONE);
    assert_eq!(good.validate(), Ok(()));
    let with = |bad: Vec3| {
        let e = made(4, 2, |x, y| if (x, y) == (3, 1) { bad } else { Vec3::ONE });
        e.validate().unwrap_err().to_string()
    };
    for bad in [Vec3::NAN, Vec3::new(1.0, f32::INFINITY, 0.0), Vec3::new(0.0, 0.0, -1e-9), Vec3::splat(2e18)] {
        assert!(with(bad).starts_with("pixel (3, 1) has the radiance"), "{}", with(bad));
    }
    let said = |e: Environment| e.validate().unwrap_err().to_string();
    assert!(said(Environment { scale: 1e19, ..good.clone() }).contains("pixel (0, 0)"));
    assert!(said(Environment { scale: -1.0, ..good.clone() }).contains("scale is -1"));
    assert!(said(Environment { scale: f32::NAN, ..good.clone() }).contains("scale is NaN"));
    assert!(said(Environment { turn: f32::INFINITY, ..good.clone() }).contains("turn is inf"));
    assert!(said(Environment { width: 5, ..good.clone() }).contains("5x2 texels holds 8"));
    assert!(said(Environment { height: 0, radiance: Arc::new([]), ..good }).contains("4x0"));
}

fn exr(bad: Option<f32>) -> Vec<u8> {
    let mut bytes = Cursor::new(Vec::new());
    let texel = |x: u32, y: u32| match bad {
        Some(bad) if (x, y) == (1, 0) => image::Rgba([1.0, bad, 1.0, 1.0]),
        _ => image::Rgba([x as f32 * 1000.5, y as f32 * 0.125, 7.0, 0.5]),
    };
    Rgba32FImage::from_fn(4, 2, texel).write_to(&mut bytes, ImageFormat::OpenExr).unwrap();
    bytes.into_inner()
}

fn hdr() -> Vec<u8> {
    let mut bytes = Cursor::new(Vec::new());
    // Numbers that need only 8 bits of mantissa.
    let texel = |x: u32, y: u32| image::Rgb([x as f32 * 1024.0, y as f32 * 0.5 + 512.0, 2048.0]);
    Rgb32FImage::from_fn(9, 4, texel).write_to(&mut bytes, ImageFormat::Hdr).unwrap();
    bytes.into_inner()
}

#[test]
fn files_are_read_texel_by_texel() {
    let folder = tempfile::tempdir().unwrap();
    let path = folder.path().join("noon.exr");
    std::fs::write(&path, exr(None)).unwrap();
    let e = Environment::load(&path).unwrap();
    assert_eq!((e.name.as_str(), e.width, e.height, e.scale, e.turn), ("noon", 4, 2, 1.0, 0.0));
    let wanted: Vec<Vec3> = (0..8).map(|i| Vec3::new((i % 4) as f32 * 1000.5, (i / 4) as f32 * 0.125, 7.0)).collect();
    assert_eq!(e.radiance[..], wanted[..]);

    // The file name does not matter, and both magic words are accepted.
    let rgbe = [b"#?RGBE", &hdr()[10..]].concat();
    for bytes in [hdr(), rgbe] {
        let path = folder.path().join("dusk.exr");
        std::fs::write(&path, bytes).unwrap();
        let e = Environment::load(&path).unwrap();
        assert_eq!((e.width, e.height), (9, 4));
        for (i, texel) in e.radiance.iter().enumerate() {
            let wanted = Vec3::new((i % 9) as f32 * 1024.0, (i / 9) as f32 * 0.5 + 512.0, 2048.0);
            // A shared exponent: each component has eight bits, relative to the largest.
            assert!((*texel - wanted).abs().max_element() <= wanted.max_element() / 128.0, "{i}: {texel} not {wanted}");
        }
    }
}

#[test]
fn faulty_files_are_named() {
    let folder = tempfile::tempdir().unwrap();
    let said = |bytes: &[u8]| {
        let path = folder.path().join("bad.hdr");
        std::fs::write(&path, bytes).unwrap();
        let error = Environment::load(&path).unwrap_err().to_string();
        assert!(error.contains("bad.hdr"), "{error}");
        error
    };
    for bad in [f32::NAN, f32::INFINITY, -1.0] {
        assert!(said(&exr(Some(bad))).contains("pixel (1, 0) has the radiance"), "{bad}");
    }
    assert!(said(b"").contains("neither Radiance HDR nor OpenEXR"));
    assert!(said(b"\x89PNG\r\n").contains("neither"));
    assert!(said(&exr(None)[..100]).contains("cannot be decoded"));
    assert!(said(&hdr()[..60]).contains("cannot be decoded"));
    let large = b"#?RADIANCE\nFORMAT=32-bit_rle_rgbe\n\n-Y 4 +X 20000\n";
    assert!(said(large).contains("20000 texels along an edge, the limit is 16384"));
    let many = b"#?RADIANCE\nFORMAT=32-bit_rle_rgbe\n\n-Y 16384 +X 16384\n";
    assert!(said(many).contains("268435456 texels, the limit is"));
    assert!(matches!(Environment::load(folder.path()), Err(SceneError::Read { .. })));
    assert!(matches!(Environment::load(&folder.path().join("none.exr")), Err(SceneError::Read { .. })));
}

proptest! {
    #![proptest_config(ProptestConfig { cases: 400, failure_persistence: None, ..ProptestConfig::default() })]

    /// Any bytes give an error or a valid map.
    #[test]
    fn no_bytes_make_it_panic(changes in prop::collection::vec((any::<prop::sample::Index>(), any::<u8>()), 0..6), cut in 0_usize..40, is_exr in any::<bool>()) {
        let mut bytes = if is_exr { exr(None) } else { hdr() };
        for (at, to) in changes {
            let at = at.index(bytes.len());
            bytes[at] = to;
        }
        let keep = if cut > 20 { bytes.len() * cut / 40 } else { bytes.len() };
        if let Ok(e) = file::decode(String::new(), &bytes[..keep]) {
            prop_assert_eq!(e.radiance.len() as u64, u64::from(e.width) * u64::from(e.height));
        }
    }
}

#[test]
fn the_studio_that_comes_along_is_a_map() {
    let path = std::path::Path::new(env!("CARGO_MANIFEST_DIR")).join("../demo/environments/studio.hdr");
    let studio = Environment::load(&path).unwrap();
    studio.validate().unwrap();
    assert_eq!((studio.width, studio.height), (256, 128));
    let brightest = studio.radiance.iter().map(|r| r.max_element()).fold(0.0, f32::max);
    let darkest = studio.radiance.iter().map(|r| r.min_element()).fold(f32::MAX, f32::min);
    assert!(brightest > 5.0 && darkest > 0.05, "{darkest} to {brightest}");
}
