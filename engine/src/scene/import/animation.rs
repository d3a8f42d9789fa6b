//! Animations: keys of translations, rotations, scales and morph weights.
use super::accessor::{Allowed, Data};
use super::nodes::{Placed, target_count};
use super::{Import, MAX_KEY_NUMBERS, Of, label, refer};
use crate::scene::error::Fault;
use crate::scene::{Animation, Channel, Interpolation, Local, Property};
use gltf::json;
use json::animation::{Interpolation as JsonInterpolation, Property as JsonProperty};
use json::validation::Checked;
use std::collections::HashSet;

/// Counts of the channels of one animation that are ignored, for one notice each.
#[derive(Default)]
struct Ignored {
    outside: usize,
    matrices: usize,
    repeated: usize,
    unknown: usize,
    shapeless: usize,
}

/// Reads every animation that changes anything in the scene.
pub(super) fn read(data: &Data, placed: &Placed, notices: &mut Vec<String>) -> Import<Vec<Animation>> {
    let mut numbers = 0_u64;
    let mut animations = Vec::new();
    for (a, from) in data.root.animations.iter().enumerate() {
        let name = label(from.name.as_deref(), || format!("animation {a}"));
        let mut ignored = Ignored::default();
        let mut taken = HashSet::new();
        let mut channels = Vec::new();
        for c in 0..from.channels.len() {
            let read = channel(data, placed, a, c, &mut numbers, &mut ignored)?;
            if let Some(channel) = read {
                if taken.insert((channel.node, channel.property as u8)) {
                    channels.push(channel);
                } else {
                    ignored.repeated += 1;
                }
            }
        }
        for (count, why) in [
            (ignored.outside, "for nodes that are not in the scene"),
            (ignored.matrices, "for nodes with a matrix"),
            (ignored.repeated, "for what another channel moves"),
            (ignored.unknown, "for unknown properties"),
            (ignored.shapeless, "for nodes without morph targets"),
        ] {
            if count > 0 {
                let channels = if count == 1 { "channel" } else { "channels" };
                notices.push(format!("animation {name}: {count} {channels} {why}: ignored"));
            }
        }
        if channels.is_empty() {
            notices.push(format!("animation {name} moves nothing in the scene: ignored"));
            continue;
        }
        let last = channels.iter().filter_map(|c| c.times.last()).fold(0.0_f32, |a, b| a.max(*b));
        animations.push(Animation { name, duration: last.into(), channels });
    }
    Ok(animations)
}

fn channel(
    data: &Data,
    placed: &Placed,
    a: usize,
    c: usize,
    numbers: &mut u64,
    ignored: &mut Ignored,
) -> Import<Option<Channel>> {
    let (from, element) = (&data.root.animations[a], || format!("animation {a} channel {c}"));
    let (target, sampler) = (&from.channels[c].target, from.channels[c].sampler.value());
    let sampler = refer(&from.samplers, sampler, "sampler").of(element)?;
    let file_node = target.node.value();
    let node = refer(&data.root.nodes, file_node, "node").of(element)?;
    let property = match target.path {
        Checked::Valid(JsonProperty::Translation) => Property::Translation,
        Checked::Valid(JsonProperty::Rotation) => Property::Rotation,
        Checked::Valid(JsonProperty::Scale) => Property::Scale,
        Checked::Valid(JsonProperty::MorphTargetWeights) => Property::Weights,
        Checked::Invalid => {
            ignored.unknown += 1;
            return Ok(None);
        }
    };
    let interpolation = match sampler.interpolation {
        Checked::Valid(JsonInterpolation::Step) => Interpolation::Step,
        Checked::Valid(JsonInterpolation::Linear) => Interpolation::Linear,
        Checked::Valid(JsonInterpolation::CubicSpline) => Interpolation::CubicSpline,
        Checked::Invalid => {
            let (what, got) = ("interpolation", "unknown".to_owned());
            return Err(Fault::Value { what, got, wanted: "LINEAR, STEP or CUBICSPLINE" }).of(element);
        }
    };
    let Some(place) = placed.places[file_node] else {
        ignored.outside += 1;
        return Ok(None);
    };
    if property != Property::Weights && matches!(placed.nodes[place as usize].local, Local::Matrix(_)) {
        ignored.matrices += 1;
        return Ok(None);
    }
    let width = match property {
        Property::Translation | Property::Scale => 3,
        Property::Rotation => 4,
        Property::Weights => {
            let mesh = node.mesh.and_then(|m| data.root.meshes.get(m.value()));
            let targets = mesh.map_or(0, target_count);
            if targets == 0 {
                ignored.shapeless += 1;
                return Ok(None);
            }
            targets
        }
    };

    let (input, output) = (sampler.input.value(), sampler.output.value());
    let (input_at, output_at) = (|| format!("{} input", element()), || format!("{} output", element()));
    let keys = data.count(input).of(input_at)?;
    let parts = if interpolation == Interpolation::CubicSpline { 3 } else { 1 };
    let elements = if property == Property::Weights { width as u64 } else { 1 };
    let wanted = keys.saturating_mul(parts * elements);
    let got = data.count(output).of(output_at)?;
    if got != wanted {
        return Err(Fault::Count { accessor: output, got, wanted }).of(output_at);
    }
    let components = if property == Property::Weights { 1 } else { width as u64 };
    *numbers = numbers.saturating_add(keys).saturating_add(wanted.saturating_mul(components));
    if *numbers > MAX_KEY_NUMBERS {
        let (what, got, limit) = ("numbers in keys", *numbers, MAX_KEY_NUMBERS);
        return Err(Fault::Limit { what, got, limit }).of(element);
    }
    if keys == 0 {
        return Err(Fault::Missing("a key")).of(input_at);
    }

    let times = times(data, input).of(input_at)?;
    let values = match property {
        Property::Translation | Property::Scale => {
            data.vectors::<3>(output, Allowed::Float).of(output_at)?.into_flattened()
        }
        Property::Weights => data.vectors::<1>(output, Allowed::Unit).of(output_at)?.into_flattened(),
        Property::Rotation => {
            let rotations = data.vectors::<4>(output, Allowed::Unit).of(output_at)?;
            let none = |q: &[f32; 4]| glam::Vec4::from(*q).as_dvec4().length() < 1e-6;
            // Tangents may be zero, but values may not.
            let values = rotations.iter().skip(usize::from(parts == 3)).step_by(parts as usize);
            if let Some(at) = values.into_iter().position(none) {
                let got = format!("{:?} at key {at}", [0.0; 4]);
                return Err(Fault::Value { what: "rotation", got, wanted: "a unit quaternion" }).of(output_at);
            }
            rotations.into_flattened()
        }
    };
    Ok(Some(Channel { node: place, property, interpolation, times, values }))
}

fn times(data: &Data, accessor: usize) -> Result<Vec<f32>, Fault> {
    let times = data.vectors::<1>(accessor, Allowed::Float)?.into_flattened();
    let wanted = "at least 0, and no key before the last";
    if times[0] < 0.0 {
        return Err(Fault::Value { what: "the time of key 0", got: times[0].to_string(), wanted });
    }
    match times.windows(2).position(|t| t[1] < t[0]) {
        Some(at) => {
            let got = format!("{} after {}", times[at + 1], times[at]);
            Err(Fault::Value { what: "the time of a key", got, wanted })
        }
        None => Ok(times),
    }
}
