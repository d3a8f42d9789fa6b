//! The commands that only list something.

use std::fmt::Write;

use magpie::{
    config::Catalogue,
    gpu::{DeviceReport, GpuError},
    scene::BuiltinParameter,
    slot::{Range, SettingSpec},
};
use serde::Serialize;

use crate::{console, exit::Failure, session};

fn json(value: &impl Serialize) -> Result<String, Failure> {
    serde_json::to_string_pretty(value).map(|text| text + "\n").map_err(Failure::running)
}

/// `magpie devices`: fails with "no usable device" after the list when none is accepted.
pub(crate) fn devices(as_json: bool) -> Result<(), Failure> {
    let devices = session::devices()?;
    console::print(&if as_json { json(&devices)? } else { devices.iter().map(describe_device).collect() })?;
    if devices.iter().any(|d| d.accepted) {
        return Ok(());
    }
    let refusals = devices.iter().map(|d| format!("{}: {}", d.name, d.refusals.join(", "))).collect();
    Err(GpuError::NoDevice { refusals }.into())
}

fn describe_device(device: &DeviceReport) -> String {
    let DeviceReport { index, name, driver, kind, api, .. } = device;
    let mut text = format!("{index}: {name}\n   {kind}, Vulkan {api}, {driver}\n");
    let mut line = |label: &str, value: String| {
        // Writing to a String cannot fail.
        let _ = writeln!(text, "   {label:<10}{value}");
    };
    if device.accepted {
        line("accepted", "yes".to_owned());
    }
    for refusal in &device.refusals {
        line("refused", refusal.clone());
    }
    line("rays", device.rays.join(", "));
    if !device.filters_float32 {
        line("filters", "no 32-bit floats: shaders blend them texel by texel".to_owned());
    }
    for queue in &device.queues {
        let timed = if queue.timestamp_bits > 0 { "timed" } else { "without timestamps" };
        line("queues", format!("family {}: {} x {}, {timed}", queue.family, queue.count, queue.can.join(" + ")));
    }
    let limits: Vec<_> = device.limits.iter().map(|(name, limit)| format!("{name} {limit}")).collect();
    line("limits", limits.join(", "));
    text
}

/// `magpie scenes`.
pub(crate) fn scenes() -> Result<(), Failure> {
    let scenes = session::scenes();
    let width = scenes.iter().map(|(name, _)| name.chars().count()).max().unwrap_or(0);
    let mut text = String::new();
    for (name, about) in &scenes {
        // Writing to a String cannot fail.
        let _ = writeln!(text, "{name:<width$}  {about}");
        for BuiltinParameter { key, about, least, most, default } in session::scene_parameters(name) {
            let _ = writeln!(text, "{:<width$}  {name}?{key}={default}: {about}, {least} to {most}", "");
        }
    }
    console::print(&text)
}

/// `magpie stages`.
pub(crate) fn stages(as_json: bool) -> Result<(), Failure> {
    let catalogue = session::catalogue();
    console::print(&if as_json { json(&catalogue)? } else { describe_stages(&catalogue) })
}

fn describe_stages(catalogue: &Catalogue) -> String {
    let mut text = String::new();
    for (at, slot) in catalogue.slots.iter().enumerate() {
        if at > 0 {
            text.push('\n');
        }
        text += &format!("{}: {}\n", slot.name, slot.about);
        for implementation in &slot.implementations {
            let default = if implementation.name == slot.default { " (default)" } else { "" };
            text += &format!("  {}{default}: {}\n", implementation.name, implementation.about);
            for spec in &implementation.settings {
                text += &describe_setting(&slot.name, spec);
            }
        }
        for preset in &slot.presets {
            let settings: Vec<String> = preset.settings.iter().map(|(key, value)| format!("{key} {value}")).collect();
            let with = if settings.is_empty() { String::new() } else { format!(", {}", settings.join(", ")) };
            text += &format!("  {} (preset): {}{with}\n", preset.name, preset.implementation);
        }
    }
    text
}

fn describe_setting(slot: &str, spec: &SettingSpec) -> String {
    let unit = if spec.unit.is_empty() { String::new() } else { format!(" {}", spec.unit) };
    let range = match &spec.range {
        Range::Any => spec.default.kind().to_owned(),
        range => range.to_string(),
    };
    format!("    {slot}.{} = {}{unit} ({range})\n      {}\n", spec.key, spec.default, spec.about)
}

#[cfg(test)]
mod tests {
    use magpie::slot::{ImplementationInfo, Preset, SlotInfo};

    use super::*;

    #[test]
    fn stages_show_unit_range_and_default() {
        let settings = vec![
            SettingSpec::float("cone_degrees", "degrees", "Higher is softer.", 0.27, 0.0..=10.0),
            SettingSpec::switch("jitter", "Moves the samples.", true),
        ];
        let about = "One ray per pixel.".to_owned();
        let text = describe_stages(&Catalogue::new(vec![SlotInfo {
            name: "shadows".to_owned(),
            about: "Blocked light.".to_owned(),
            default: "ray-traced".to_owned(),
            implementations: vec![ImplementationInfo { name: "ray-traced".to_owned(), about, settings }],
            presets: vec![Preset { name: "low", implementation: "ray-traced", settings: &[("jitter", "false")] }],
        }]));
        let wanted = "\
shadows: Blocked light.
  ray-traced (default): One ray per pixel.
    shadows.cone_degrees = 0.27 degrees (0 to 10)
      Higher is softer.
    shadows.jitter = true (switch (true or false))
      Moves the samples.
  low (preset): ray-traced, jitter false
";
        assert_eq!(text, wanted);
    }

    #[test]
    fn the_catalogue_has_no_mistakes() {
        let catalogue = session::catalogue();
        assert!(!catalogue.slots.is_empty());
        let mistakes: Vec<_> = catalogue.slots.iter().flat_map(SlotInfo::mistakes).collect();
        assert!(mistakes.is_empty(), "{mistakes:#?}");
        let names: Vec<_> = session::scenes().into_iter().map(|(name, _)| name).collect();
        assert!(names.contains(&"builtin:cornell".to_owned()), "{names:?}");
    }
}
