//! Converts glTF primitives to meshes.
use super::accessor::{Allowed, Data};
use super::nodes::target_count;
use super::{Import, MAX_DELTAS, MAX_INDICES, MAX_INFLUENCES, MAX_VERTICES, Of, label, refer, skin};
use crate::scene::error::Fault;
use crate::scene::{Influence, Mesh, MorphTarget};
use glam::{Vec2, Vec3, Vec4};
use gltf::json::mesh::{Mode, Primitive, Semantic};
use gltf::json::validation::Checked;

/// A primitive that has been read.
pub(super) struct Read {
    /// Its triangles, if it has any.
    pub mesh: Option<Mesh>,
    /// Index of its material; `None` is the default material of glTF.
    pub material: Option<usize>,
    pub notices: Vec<String>,
}

fn attribute(primitive: &Primitive, semantic: Semantic) -> Option<usize> {
    primitive.attributes.get(&Checked::Valid(semantic)).map(|i| i.value())
}

fn place(mesh: usize, primitive: usize, part: &str) -> String {
    format!("mesh {mesh} primitive {primitive}{}{part}", if part.is_empty() { "" } else { " " })
}

/// The accessors of joints and weights, at most two sets. It is a fault if a set has only one of the two.
fn joint_sets(primitive: &Primitive) -> Result<Vec<(usize, usize)>, Fault> {
    let mut sets = Vec::new();
    for (set, names) in (0..).zip([["JOINTS_0", "WEIGHTS_0"], ["JOINTS_1", "WEIGHTS_1"]]) {
        match (attribute(primitive, Semantic::Joints(set)), attribute(primitive, Semantic::Weights(set))) {
            (Some(joints), Some(weights)) => sets.push((joints, weights)),
            (Some(_), None) => return Err(Fault::Missing(names[1])),
            (None, Some(_)) => return Err(Fault::Missing(names[0])),
            (None, None) => break,
        }
    }
    Ok(sets)
}

/// Sums up vertices, indices, influences and morph deltas, before any is read, and checks the limits. A primitive may count up to three
/// vertices per index (flat normals) and three indices per index (strips). `skinned` tells which meshes of the file need joints.
pub(super) fn check_budget(data: &Data, primitives: &[(usize, usize)], skinned: &[bool]) -> Import<()> {
    let (mut vertices, mut indices, mut influences, mut deltas) = (0_u64, 0_u64, 0_u64, 0_u64);
    for (m, p) in primitives {
        let element = || place(*m, *p, "");
        let primitive = &data.root.meshes[*m].primitives[*p];
        let position = attribute(primitive, Semantic::Positions).ok_or(Fault::Missing("POSITION")).of(element)?;
        let count = data.count(position).of(|| place(*m, *p, "POSITION"))?;
        let index_count = match primitive.indices {
            Some(i) => data.count(i.value()).of(|| place(*m, *p, "indices"))?,
            None => count,
        };
        let corners = match primitive.mode {
            Checked::Valid(Mode::TriangleStrip | Mode::TriangleFan) => index_count.saturating_mul(3),
            _ => index_count,
        };
        let flat = attribute(primitive, Semantic::Normals).is_none();
        let own = if flat { count.max(corners) } else { count };
        vertices = vertices.saturating_add(own);
        indices = indices.saturating_add(corners);
        if skinned[*m] {
            let sets = joint_sets(primitive).of(element)?.len() as u64;
            influences = influences.saturating_add(own.saturating_mul(4 * sets));
        }
        let targets = primitive.targets.as_deref().unwrap_or_default();
        let wanted = target_count(&data.root.meshes[*m]);
        if targets.len() != wanted {
            let got = format!("{}, where primitive 0 has {wanted}", targets.len());
            return Err(Fault::Value { what: "the number of morph targets", got, wanted: "as many" }).of(element);
        }
        let tables: usize = targets.iter().map(|t| [t.positions, t.normals, t.tangents].iter().flatten().count()).sum();
        deltas = deltas.saturating_add(own.saturating_mul(tables as u64));
        for (what, got, limit) in [
            ("vertices", vertices, MAX_VERTICES),
            ("indices", indices, MAX_INDICES),
            ("influences of joints", influences, MAX_INFLUENCES),
            ("vectors of morph targets", deltas, MAX_DELTAS),
        ] {
            if got > limit {
                return Err(Fault::Limit { what, got, limit }).of(element);
            }
        }
    }
    Ok(())
}

/// Reads a primitive. `normal_uv` is the set of texture coordinates that the normal map of each material uses; `skinned` tells
/// whether joints are read. Both indices must be in range.
pub(super) fn read(
    data: &Data,
    m: usize,
    p: usize,
    normal_uv: &(dyn Fn(Option<usize>) -> u32 + Sync),
    skinned: bool,
) -> Import<Read> {
    let primitive = &data.root.meshes[m].primitives[p];
    let at = |part: &'static str| move || place(m, p, part);
    let mut notices = Vec::new();
    let material = primitive.material.map(|i| i.value());
    if let Some(material) = material {
        refer(&data.root.materials, material, "material").of(at(""))?;
    }
    let skip = |reason: &str| {
        Ok(Read { mesh: None, material, notices: vec![format!("{}: {reason}: skipped", place(m, p, ""))] })
    };
    let mode = match primitive.mode {
        Checked::Valid(mode) => mode,
        Checked::Invalid => {
            let wanted = "0 to 6";
            return Err(Fault::Value { what: "mode", got: "unknown".to_owned(), wanted }).of(at(""));
        }
    };
    match mode {
        Mode::Triangles | Mode::TriangleStrip | Mode::TriangleFan => {}
        Mode::Points => return skip("points are not supported"),
        Mode::Lines | Mode::LineLoop | Mode::LineStrip => return skip("lines are not supported"),
    }

    let position = attribute(primitive, Semantic::Positions).ok_or(Fault::Missing("POSITION")).of(at(""))?;
    let positions: Vec<Vec3> = vectors(data, position, Allowed::Geometry, None).of(at("POSITION"))?;
    let count = positions.len();
    let three = |semantic, part| -> Import<Option<Vec<Vec3>>> {
        attribute(primitive, semantic)
            .map(|a| vectors(data, a, Allowed::Geometry, Some(count)).of(at(part)))
            .transpose()
    };
    let normals = three(Semantic::Normals, "NORMAL")?;
    let tangents: Option<Vec<Vec4>> = attribute(primitive, Semantic::Tangents)
        .map(|a| vectors(data, a, Allowed::Geometry, Some(count)).of(at("TANGENT")))
        .transpose()?;
    let coordinates = |set, part| -> Import<Option<Vec<Vec2>>> {
        attribute(primitive, Semantic::TexCoords(set))
            .map(|a| vectors(data, a, Allowed::TextureCoordinates, Some(count)).of(at(part)))
            .transpose()
    };
    let uv0 = coordinates(0, "TEXCOORD_0")?.unwrap_or_else(|| vec![Vec2::ZERO; count]);
    let uv1 = coordinates(1, "TEXCOORD_1")?.unwrap_or_else(|| vec![Vec2::ZERO; count]);
    let colours = match attribute(primitive, Semantic::Colors(0)) {
        None => vec![Vec4::ONE; count],
        Some(a) if data.is_vec4(a) => vectors(data, a, Allowed::Colour, Some(count)).of(at("COLOR_0"))?,
        Some(a) => vectors::<3, Vec3>(data, a, Allowed::Colour, Some(count))
            .of(at("COLOR_0"))?
            .into_iter()
            .map(|c| c.extend(1.0))
            .collect(),
    };

    let corners = match primitive.indices {
        Some(i) => data.indices(i.value()).of(at("indices"))?,
        None => (0..count as u32).collect(),
    };
    if let Some(wrong) = corners.iter().position(|i| *i as usize >= count) {
        return Err(Fault::IndexValue { at: wrong, value: corners[wrong], count }).of(at("indices"));
    }
    let indices = triangles(mode, corners).of(at("indices"))?;
    if indices.is_empty() {
        return skip("no triangles");
    }

    let name = label(data.root.meshes[m].name.as_deref(), || format!("mesh {m}"));
    let name = if data.root.meshes[m].primitives.len() > 1 { format!("{name}/{p}") } else { name };
    let mut mesh = Mesh { name, positions, uv0, uv1, colours, indices, ..Mesh::default() };
    if skinned {
        mesh.influences = influences(data, m, p, count, &mut notices)?;
    }
    mesh.targets = targets(data, m, p, count, [normals.is_some(), normals.is_some() && tangents.is_some()])?;
    mesh.weights = data.root.meshes[m].weights.clone().unwrap_or_default();
    match normals {
        Some(normals) => {
            mesh.normals = normals;
            mesh.tangents = tangents.unwrap_or_default();
            let repaired = mesh.repair_normals();
            if repaired > 0 {
                notices.push(format!("{}: {repaired} normals of no length were repaired", place(m, p, "NORMAL")));
            }
        }
        None => mesh.flat_normals(),
    }
    if mesh.tangents.is_empty() {
        mesh.make_tangents(normal_uv(material) == 1);
    } else {
        mesh.repair_tangents();
    }
    Ok(Read { mesh: Some(mesh), material, notices })
}

fn influences(data: &Data, m: usize, p: usize, count: usize, notices: &mut Vec<String>) -> Import<Vec<Influence>> {
    let primitive = &data.root.meshes[m].primitives[p];
    let sets = joint_sets(primitive).of(|| place(m, p, ""))?;
    if sets.is_empty() {
        notices.push(format!("{}: shown with a skin, but has no joints: follows its node", place(m, p, "")));
        return Ok(Vec::new());
    }
    if attribute(primitive, Semantic::Joints(2)).is_some() {
        notices.push(format!("{}: more than eight joints for a vertex: the others are ignored", place(m, p, "")));
    }
    let (influences, loose) = skin::influences(data, &sets, count, &|part| place(m, p, part))?;
    if loose > 0 {
        let at = place(m, p, "WEIGHTS_0");
        notices.push(format!("{at}: {loose} vertices without weights follow their first joint"));
    }
    Ok(influences)
}

/// Reads morph targets. Deltas of normals or tangents are read only if the primitive has those attributes.
fn targets(data: &Data, m: usize, p: usize, count: usize, [normals, tangents]: [bool; 2]) -> Import<Vec<MorphTarget>> {
    let mut all = Vec::new();
    for (t, from) in data.root.meshes[m].primitives[p].targets.iter().flatten().enumerate() {
        let deltas = |accessor: Option<gltf::json::Index<_>>, part: &str| match accessor {
            None => Ok(Vec::new()),
            Some(a) => vectors(data, a.value(), Allowed::Geometry, Some(count))
                .of(|| format!("{} target {t} {part}", place(m, p, ""))),
        };
        all.push(MorphTarget {
            positions: deltas(from.positions, "POSITION")?,
            normals: deltas(from.normals.filter(|_| normals), "NORMAL")?,
            tangents: deltas(from.tangents.filter(|_| tangents), "TANGENT")?,
        });
    }
    Ok(all)
}

fn vectors<const N: usize, V: From<[f32; N]>>(
    data: &Data,
    accessor: usize,
    allowed: Allowed,
    count: Option<usize>,
) -> Result<Vec<V>, Fault> {
    let got = data.count(accessor)?;
    if let Some(wanted) = count
        && got != wanted as u64
    {
        return Err(Fault::Count { accessor, got, wanted: wanted as u64 });
    }
    Ok(data.vectors::<N>(accessor, allowed)?.into_iter().map(V::from).collect())
}

/// Three indices per triangle. Degenerate triangles of strips and fans are left out.
fn triangles(mode: Mode, corners: Vec<u32>) -> Result<Vec<u32>, Fault> {
    let whole = |t: &[u32; 3]| t[0] != t[1] && t[1] != t[2] && t[2] != t[0];
    match mode {
        Mode::TriangleStrip => Ok(corners
            .windows(3)
            .enumerate()
            .map(|(i, w)| if i % 2 == 0 { [w[0], w[1], w[2]] } else { [w[0], w[2], w[1]] })
            .filter(whole)
            .flatten()
            .collect()),
        Mode::TriangleFan => Ok(corners
            .get(1..)
            .unwrap_or_default()
            .windows(2)
            .map(|w| [w[0], w[1], corners[0]])
            .filter(whole)
            .flatten()
            .collect()),
        _ if !corners.len().is_multiple_of(3) => Err(Fault::Value {
            what: "the number of corners",
            got: corners.len().to_string(),
            wanted: "a multiple of 3",
        }),
        _ => Ok(corners),
    }
}
