//! Image test of the reference.
use anyhow::Result;
use magpie_passes::Slots;
use magpie_passes::reference::{Reference, ReferenceOptions};
use magpie_tests::harness::{builtin, compare_with_golden, config, gpu};

/// Greatest difference from the golden. Random numbers are the same on every device; only paths that graze an edge differ.
const LIMIT: f64 = 0.02;

#[test]
fn reference() -> Result<()> {
    let Some(gpu) = gpu()? else { return Ok(()) };
    let scene = builtin("courtyard")?;
    let options = ReferenceOptions { width: 160, height: 90, check: true, ..ReferenceOptions::default() };
    let mut reference = Reference::new(&gpu, &scene, &scene.cameras[0], options)?;
    reference.add(48)?;
    compare_with_golden("reference", &reference.display(&Slots::default(), &config(&[])?)?, LIMIT)
}
