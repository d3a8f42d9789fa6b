//! The setting `precision` of effects that output radiance.
use magpie::graph::Format;
use magpie::slot::{SettingSpec, Settings, SlotError};

/// Describes the setting.
pub fn setting() -> SettingSpec {
    let about = "Bits per channel of the radiance that the slot writes. 32: no rounding. 16: half the memory and traffic; eleven \
                 significant bits, at most 65504.";
    SettingSpec::among("precision", "bits", about, 16, &[32, 16]).sweep_all()
}

/// The format of radiance that the setting selects: RGBA16F or RGBA32F.
pub fn format(settings: &Settings) -> Result<Format, SlotError> {
    Ok(if settings.u32("precision")? < 32 { Format::Rgba16Float } else { Format::Rgba32Float })
}
