//! `new_pass` against its formula, worked out on the CPU.
use anyhow::Result;
use magpie::pixels::Pixels;
use magpie_tests::harness::{builtin, config, gpu, linear, render};

const SIZE: [u32; 2] = [240, 135];

/// The radiance behind the lens.
fn behind(exposure: f32, falloff: f32) -> Result<Option<Pixels>> {
    let (exposure, falloff) = (format!("new_pass.exposure={exposure:?}"), format!("new_pass.falloff={falloff:?}"));
    let Some(gpu) = gpu()? else { return Ok(None) };
    let config = config(&["stages.new_pass=example", &exposure, &falloff])?;
    let shown = Some(("new_pass.apply", "colour"));
    linear(render(&gpu, &builtin("courtyard")?, &config, SIZE, 2, shown)?).map(Some)
}

#[test]
fn new_pass_falls_with_the_fourth_power_of_the_cosine() -> Result<()> {
    let (Some(even), Some(lens)) = (behind(0.0, 0.0)?, behind(1.0, 0.75)?) else { return Ok(()) };
    let tangent = (0.5 * f64::from(builtin("courtyard")?.cameras[0].vertical_fov)).tan();
    let [width, height] = SIZE.map(f64::from);
    let mut lit = 0;
    for (i, (before, after)) in even.values().into_iter().zip(lens.values()).enumerate() {
        let (x, y) = ((i as u32 % SIZE[0]) as f64 + 0.5, (i as u32 / SIZE[0]) as f64 + 0.5);
        // The point of the plane one metre in front of the eye that the pixel's centre shows.
        let (x, y) = ((2.0 * x - width) / height * tangent, (2.0 * y - height) / height * tangent);
        let cos2 = 1.0 / (1.0 + x * x + y * y);
        let light = 2.0 * (0.25 + 0.75 * cos2 * cos2);
        for c in 0..3 {
            let expected = f64::from(before[c]) * light;
            let got = f64::from(after[c]);
            assert!((got - expected).abs() <= 1e-4 * expected.abs(), "pixel {i}, channel {c}: {got} is not {expected}");
        }
        lit += usize::from(before[1] > 0.0);
    }
    assert!(lit > even.values().len() / 2, "only {lit} pixels show anything");
    Ok(())
}

#[test]
fn new_pass_is_off_unless_it_is_asked_for() -> Result<()> {
    let Some(even) = behind(0.0, 0.0)? else { return Ok(()) };
    let Some(gpu) = gpu()? else { return Ok(()) };
    let frame = render(&gpu, &builtin("courtyard")?, &config(&[])?, SIZE, 2, None)?;
    let mut passes = frame.sample.passes.iter().map(|pass| &pass.name);
    assert!(!passes.any(|name| name.starts_with("new_pass.")), "it ran");
    assert_eq!(linear(frame)?.values(), even.values(), "a lens without exposure and fall changes nothing");
    Ok(())
}
