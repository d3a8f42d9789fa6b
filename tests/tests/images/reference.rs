//! The truth as a picture.
use anyhow::Result;
use magpie_passes::Slots;
use magpie_passes::reference::{Reference, ReferenceOptions};
use magpie_tests::harness::{builtin, compare_with_golden, config, gpu};

/// The same random numbers on every device: what differs is what paths that graze an edge see.
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
