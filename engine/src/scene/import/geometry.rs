//! glTF primitives to meshes.
use super::accessor::{Allowed, Data};
use super::{Import, MAX_INDICES, MAX_VERTICES, Of, label, refer};
use crate::scene::Mesh;
use crate::scene::error::Fault;
use glam::{Vec2, Vec3, Vec4};
use gltf::json::mesh::{Mode, Primitive, Semantic};
use gltf::json::validation::Checked;

/// A primitive that was read.
pub(super) struct Read {
    /// Its triangles, if it has any.
    pub mesh: Option<Mesh>,
    /// Its material; `None` is glTF's default one.
    pub material: Option<usize>,
    pub notices: Vec<String>,
}

fn attribute(primitive: &Primitive, semantic: Semantic) -> Option<usize> {
    primitive.attributes.get(&Checked::Valid(semantic)).map(|i| i.value())
}

fn place(mesh: usize, primitive: usize, part: &str) -> String {
    format!("mesh {mesh} primitive {primitive}{}{part}", if part.is_empty() { "" } else { " " })
}

/// Adds up vertices and indices before any is read. A primitive may count for up to three vertices per index (flat
/// normals), and for three indices per index (strips).
pub(super) fn check_budget(data: &Data, primitives: &[(usize, usize)]) -> Import<()> {
    let (mut vertices, mut indices) = (0_u64, 0_u64);
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
        vertices = vertices.saturating_add(if flat { count.max(corners) } else { count });
        indices = indices.saturating_add(corners);
        for (what, got, limit) in [("vertices", vertices, MAX_VERTICES), ("indices", indices, MAX_INDICES)] {
            if got > limit {
                return Err(Fault::Limit { what, got, limit }).of(element);
            }
        }
    }
    Ok(())
}

/// Reads a primitive; `normal_uv` tells which coordinates the normal map of a material uses. Both indices must be in range.
pub(super) fn read(data: &Data, m: usize, p: usize, normal_uv: &(dyn Fn(Option<usize>) -> u32 + Sync)) -> Import<Read> {
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
    if primitive.targets.as_ref().is_some_and(|t| !t.is_empty()) {
        notices.push(format!("{}: morph targets are not supported: ignored", place(m, p, "")));
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

/// Three indices per triangle; those of a strip or fan that name a vertex twice are left out.
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
