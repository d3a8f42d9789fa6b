//! The setting `precision` of the slots that give radiance.
use magpie::graph::Format;
use magpie::slot::{SettingSpec, Settings, SlotError};

/// Describes it.
pub fn setting() -> SettingSpec {
    let about = "Bits of each channel of the radiance that the slot writes. 32: as exact as it was computed. 16: half the memory and \
                 its traffic; eleven significant bits, and nothing above 65504.";
    SettingSpec::among("precision", "bits", about, 16, &[32, 16]).sweep_all()
}

/// The format that it asks for.
pub fn format(settings: &Settings) -> Result<Format, SlotError> {
    Ok(if settings.u32("precision")? < 32 { Format::Rgba16Float } else { Format::Rgba32Float })
}
