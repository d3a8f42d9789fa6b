//! Reads skins, and the joint influences of vertices.
use super::accessor::{Allowed, Data};
use super::nodes::Placed;
use super::{Import, MAX_SKIN_JOINTS, Of, label, refer};
use crate::scene::error::Fault;
use crate::scene::{Influence, Skin};
use glam::{DAffine3, DMat3, DMat4, Vec4};

/// Tolerance for the last row of an inverse bind matrix, (0, 0, 0, 1), because files have rounding errors.
const ROW_TOLERANCE: f32 = 1e-4;

/// Reads every skin that a node of the scene uses. Returns the index in the scene of each skin of the file; `None` for a skin
/// with a joint outside the scene.
pub(super) fn read(
    data: &Data,
    placed: &Placed,
    skins: &mut Vec<Skin>,
    notices: &mut Vec<String>,
) -> Import<Vec<Option<u32>>> {
    let mut used = vec![false; data.root.skins.len()];
    for shown in &placed.shown {
        if let Some(skin) = shown.skin {
            refer(&data.root.skins, skin, "skin").of(|| format!("node {}", shown.node))?;
            used[skin] = true;
        }
    }
    let mut places = vec![None; used.len()];
    for skin in (0..used.len()).filter(|s| used[*s]) {
        if let Some(read) = one(data, skin, placed, notices)? {
            places[skin] = Some(skins.len() as u32);
            skins.push(read);
        }
    }
    Ok(places)
}

fn one(data: &Data, skin: usize, placed: &Placed, notices: &mut Vec<String>) -> Import<Option<Skin>> {
    let from = &data.root.skins[skin];
    let element = || format!("skin {skin}");
    let name = label(from.name.as_deref(), element);
    let count = from.joints.len();
    if count == 0 {
        return Err(Fault::Missing("a joint")).of(element);
    }
    if count > MAX_SKIN_JOINTS {
        let (got, limit) = (count as u64, MAX_SKIN_JOINTS as u64);
        return Err(Fault::Limit { what: "joints", got, limit }).of(element);
    }
    let mut joints = Vec::with_capacity(count);
    for joint in &from.joints {
        let joint = joint.value();
        refer(&data.root.nodes, joint, "node").of(element)?;
        match placed.places[joint] {
            Some(place) => joints.push(place),
            None => {
                notices.push(format!("skin {name}: its joint, node {joint}, is not in the scene: ignored"));
                return Ok(None);
            }
        }
    }
    let inverse_bind = match from.inverse_bind_matrices {
        None => vec![DAffine3::IDENTITY; count],
        Some(accessor) => matrices(data, accessor.value(), count).of(|| format!("skin {skin} inverseBindMatrices"))?,
    };
    Ok(Some(Skin { name, joints, inverse_bind }))
}

fn matrices(data: &Data, accessor: usize, count: usize) -> Result<Vec<DAffine3>, Fault> {
    let got = data.count(accessor)?;
    if got > MAX_SKIN_JOINTS as u64 {
        return Err(Fault::Limit { what: "matrices", got, limit: MAX_SKIN_JOINTS as u64 });
    }
    // The accessor may have more matrices than joints.
    if got < count as u64 {
        return Err(Fault::Count { accessor, got, wanted: count as u64 });
    }
    let matrices = data.vectors::<16>(accessor, Allowed::Float)?;
    let affine = |m: &[f32; 16]| {
        let row = Vec4::new(m[3], m[7], m[11], m[15]);
        if !row.abs_diff_eq(Vec4::W, ROW_TOLERANCE) {
            let (what, got) = ("the last row of a matrix", row.to_string());
            return Err(Fault::Value { what, got, wanted: "[0, 0, 0, 1]" });
        }
        let m = DMat4::from_cols_array(&m.map(f64::from));
        Ok(DAffine3 { matrix3: DMat3::from_mat4(m), translation: m.w_axis.truncate() })
    };
    matrices[..count].iter().map(affine).collect()
}

/// Reads one or two sets of joints and weights for `count` vertices, and scales the weights of each vertex to sum to 1. A vertex
/// without weights follows its first joint; the number of those is returned as well.
pub(super) fn influences(
    data: &Data,
    sets: &[(usize, usize)],
    count: usize,
    at: &dyn Fn(&'static str) -> String,
) -> Import<(Vec<Influence>, usize)> {
    const NAMES: [(&str, &str); 2] = [("JOINTS_0", "WEIGHTS_0"), ("JOINTS_1", "WEIGHTS_1")];
    let per_vertex = 4 * sets.len();
    let mut all = vec![Influence::default(); count * per_vertex];
    for (set, ((joints, weights), (joints_name, weights_name))) in sets.iter().zip(NAMES).enumerate() {
        let same = |accessor: usize| match data.count(accessor)? {
            got if got == count as u64 => Ok(()),
            got => Err(Fault::Count { accessor, got, wanted: count as u64 }),
        };
        same(*joints).of(|| at(joints_name))?;
        same(*weights).of(|| at(weights_name))?;
        let joints = data.joints(*joints).of(|| at(joints_name))?;
        let weights = data.vectors::<4>(*weights, Allowed::Colour).of(|| at(weights_name))?;
        for (vertex, (joints, weights)) in joints.iter().zip(&weights).enumerate() {
            for k in 0..4 {
                if weights[k] < 0.0 {
                    let (what, got) = ("a weight", weights[k].to_string());
                    return Err(Fault::Value { what, got, wanted: "at least 0" }).of(|| at(weights_name));
                }
                // The joint of an influence without weight may be anything.
                let used = weights[k] > 0.0 || (set == 0 && k == 0);
                all[vertex * per_vertex + 4 * set + k] =
                    Influence { joint: if used { joints[k] } else { 0 }, weight: weights[k] };
            }
        }
    }
    let mut loose = 0;
    for vertex in all.chunks_exact_mut(per_vertex) {
        let sum: f64 = vertex.iter().map(|i| f64::from(i.weight)).sum();
        if sum > 0.0 {
            for i in vertex.iter_mut() {
                i.weight = (f64::from(i.weight) / sum) as f32;
            }
        } else {
            vertex[0].weight = 1.0;
            loose += 1;
        }
    }
    Ok((all, loose))
}
