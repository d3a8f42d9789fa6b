//! Reads reflection probes from the `extras` of nodes.
use crate::scene::error::Fault;
use crate::scene::{Camera, MAX_PROBES, ReflectionProbe};
use glam::{DAffine3, DMat3, Vec3};
use serde::Deserialize;

/// `{"half_size": [x, y, z], "fade": metres, "centre": [x, y, z]}`, in the units and along the axes of the node. Only `half_size` is
/// required.
#[derive(Deserialize)]
struct Extras {
    half_size: [f32; 3],
    fade: Option<f32>,
    #[serde(default)]
    centre: [f32; 3],
}

/// The probe that a node's extras ask for; `None` if they do not. `known`: number of probes before it; `limit`: greatest coordinate.
pub(super) fn probe_at(
    extras: &str,
    world: &DAffine3,
    known: usize,
    limit: f64,
) -> Result<Option<ReflectionProbe>, Fault> {
    // Extras are anyone's: whatever is not an object with this key is not meant here.
    let Ok(serde_json::Value::Object(mut all)) = serde_json::from_str(extras) else { return Ok(None) };
    let Some(own) = all.remove("magpie_probe") else { return Ok(None) };
    let text = |value: &serde_json::Value| value.to_string().chars().take(80).collect::<String>();
    let wrong = |got: String, wanted: &'static str| Fault::Value { what: "magpie_probe", got, wanted };
    let got = text(&own);
    let Ok(Extras { half_size, fade, centre }) = serde_json::from_value(own) else {
        return Err(wrong(
            got,
            "an object with half_size: three numbers, and perhaps fade: a number, centre: three numbers",
        ));
    };
    if known == MAX_PROBES {
        let (got, limit) = (known as u64 + 1, MAX_PROBES as u64);
        return Err(Fault::Limit { what: "reflection probes", got, limit });
    }
    let DMat3 { x_axis, y_axis, z_axis } = world.matrix3;
    let scale = Vec3::new(x_axis.length() as f32, y_axis.length() as f32, z_axis.length() as f32);
    let (half_size, centre) = (Vec3::from(half_size) * scale, Vec3::from(centre) * scale);
    let Some(rotation) = Camera::rigid(world.matrix3) else {
        return Err(wrong(got, "a node whose transform is not singular"));
    };
    // NaN fails these comparisons too.
    if !(half_size.min_element() > 0.0 && f64::from(half_size.max_element()) <= limit) {
        return Err(wrong(got, "a half_size above 0 and at most 1e12 metres"));
    }
    if !(half_size - centre.abs()).cmpgt(Vec3::ZERO).all() {
        return Err(wrong(got, "a centre inside of the box"));
    }
    let fade = fade.unwrap_or(0.25 * half_size.min_element());
    if !(fade >= 0.0 && fade.is_finite()) {
        return Err(wrong(got, "a fade of at least 0"));
    }
    let translation = world.translation;
    // Transforms that are not finite are refused before.
    if translation.abs().max_element() > limit {
        return Err(wrong(translation.to_string(), "a place within 1e12 metres of the origin"));
    }
    let world_from_box = DAffine3 { matrix3: rotation, translation };
    Ok(Some(ReflectionProbe { world_from_box, half_size, centre, fade }))
}

#[cfg(test)]
mod tests {
    use super::*;
    use glam::DVec3;

    fn read(extras: &str) -> Result<Option<ReflectionProbe>, Fault> {
        let turn = DAffine3::from_rotation_y(0.5) * DAffine3::from_scale(DVec3::new(2.0, 1.0, 1.0));
        probe_at(extras, &(DAffine3::from_translation(DVec3::Y) * turn), 0, 1e12)
    }

    #[test]
    fn a_probe_has_the_scale_of_its_node() {
        let probe =
            read(r#"{"magpie_probe": {"half_size": [1, 2, 3], "centre": [0.5, 0, -1], "fade": 0.25}, "other": 1}"#);
        let probe = probe.unwrap().unwrap();
        assert!(probe.half_size.distance(Vec3::new(2.0, 2.0, 3.0)) < 1e-6);
        assert!(probe.centre.distance(Vec3::new(1.0, 0.0, -1.0)) < 1e-6);
        // Rotations are rounded to 32 bits.
        assert!((probe.world_from_box.matrix3.determinant() - 1.0).abs() < 1e-6 && probe.fade == 0.25);
        assert_eq!(probe.world_from_box.translation, DVec3::Y);
    }

    #[test]
    fn other_extras_are_no_probe_and_bad_ones_are_refused() {
        for other in ["7", "null", "[1]", "{}", r#"{"probe": {}}"#, "{", "\"magpie_probe\""] {
            assert!(read(other).unwrap().is_none(), "{other}");
        }
        for bad in [
            "1",
            "{}",
            r#"{"half_size": 1}"#,
            r#"{"half_size": [1, 1]}"#,
            r#"{"half_size": [1, 1, 0]}"#,
            r#"{"half_size": [1, -1, 1]}"#,
            r#"{"half_size": [1e30, 1, 1]}"#,
            r#"{"half_size": [1e60, 1, 1]}"#,
            r#"{"half_size": [1, 1, 1], "fade": -1}"#,
            r#"{"half_size": [1, 1, 1], "fade": "x"}"#,
            r#"{"half_size": [1, 1, 1], "centre": [0, 2, 0]}"#,
        ] {
            let error = read(&format!(r#"{{"magpie_probe": {bad}}}"#)).expect_err(bad).to_string();
            assert!(error.contains("magpie_probe"), "{bad}: {error}");
        }
        let one = r#"{"magpie_probe": {"half_size": [1, 1, 1]}}"#;
        assert!(matches!(probe_at(one, &DAffine3::IDENTITY, MAX_PROBES, 1e12), Err(Fault::Limit { .. })));
        let flat = DAffine3::from_scale(DVec3::new(1.0, 0.0, 1.0));
        assert!(probe_at(one, &flat, 0, 1e12).is_err());
    }
}
