//! Image test of openness.
use anyhow::Result;
use magpie_tests::harness::{builtin, compare_with_golden, config, gpu, linear, render};

const SIZE: [u32; 2] = [240, 135];
const LIMIT: f64 = 0.01;

#[test]
fn ao() -> Result<()> {
    let Some(gpu) = gpu()? else { return Ok(()) };
    let scene = builtin("courtyard")?;
    for (name, pass, changes) in [
        ("ao", "ao.filter", &["stages.ao=screen-space"][..]),
        ("ao.half", "ao.upsample", &["stages.ao=screen-space", "ao.resolution=half"]),
        ("ao.rays", "ao.trace", &["stages.ao=ray-traced", "ao.rays=8"]),
    ] {
        let image = linear(render(&gpu, &scene, &config(changes)?, SIZE, 2, Some((pass, "openness")))?)?;
        compare_with_golden(name, &image, LIMIT)?;
    }
    Ok(())
}
