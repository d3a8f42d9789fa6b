//! Simplified meshes for ray tracing.
use crate::scene::Mesh;

/// Meshes with fewer triangles are not simplified.
const MIN_TRIANGLES: usize = 64;

/// Largest deviation of a simplified surface, as a fraction of the mesh's diagonal. A mesh that exceeds it keeps more triangles.
const MAX_DEVIATION: f32 = 0.01;

/// A simplified mesh: other triangles over the same vertices.
pub(super) struct Reduced {
    /// Three indices per triangle.
    pub indices: Vec<u32>,
    /// Estimated deviation from the original surface, object space, by the quadric error metric (Garland and Heckbert 1997), with
    /// which `meshopt` simplifies.
    pub deviation: f32,
}

/// The mesh with a fraction `detail` of its triangles, 0 to 1; `None` if it is not simplified.
pub(super) fn reduce(mesh: &Mesh, detail: f32) -> Option<Reduced> {
    let triangles = mesh.indices.len() / 3;
    if detail >= 1.0 || triangles < MIN_TRIANGLES {
        return None;
    }
    let [min, max] = mesh.bounds()?;
    let wanted = (triangles as f32 * detail).ceil() as usize * 3;
    let furthest = (max - min).length() * MAX_DEVIATION;
    let positions = bytemuck::cast_slice(&mesh.positions);
    let vertices = meshopt::VertexDataAdapter::new(positions, size_of::<glam::Vec3>(), 0).ok()?;
    let mut deviation = 0.0;
    let options = meshopt::SimplifyOptions::ErrorAbsolute;
    let indices = meshopt::simplify(&mesh.indices, &vertices, wanted, furthest, options, Some(&mut deviation));
    // A mesh smaller than the error limit may be simplified to nothing.
    (!indices.is_empty() && indices.len() < mesh.indices.len()).then_some(Reduced { indices, deviation })
}

#[cfg(test)]
mod tests {
    use super::*;
    use glam::Vec3;

    /// A bumpy grid of `n` by `n` cells.
    fn sheet(n: u32) -> Mesh {
        let at = |i: u32| (i % (n + 1), i / (n + 1));
        let positions = (0..(n + 1) * (n + 1)).map(|i| {
            let (x, y) = at(i);
            let (x, y) = (x as f32 / n as f32, y as f32 / n as f32);
            Vec3::new(x, 0.02 * (6.0 * x).sin() * (5.0 * y).cos(), y)
        });
        let cells = (0..n * n).flat_map(|c| {
            let first = c / n * (n + 1) + c % n;
            let next = first + n + 1;
            [first, next, first + 1, first + 1, next, next + 1]
        });
        Mesh { positions: positions.collect(), indices: cells.collect(), ..Mesh::default() }
    }

    #[test]
    fn triangles_go_and_the_surface_stays() {
        let mesh = sheet(40);
        let reduced = reduce(&mesh, 0.25).expect("a smooth sheet can be coarser");
        assert!(
            reduced.indices.len() <= mesh.indices.len() * 3 / 10,
            "{} of {}",
            reduced.indices.len(),
            mesh.indices.len()
        );
        let diagonal = 2.0_f32.sqrt() * 1.01;
        assert!(reduced.deviation <= MAX_DEVIATION * diagonal, "{}", reduced.deviation);
        assert!(reduced.indices.iter().all(|i| (*i as usize) < mesh.positions.len()));
    }

    #[test]
    fn what_need_not_be_coarser_stays() {
        assert!(reduce(&sheet(40), 1.0).is_none());
        assert!(reduce(&sheet(3), 0.1).is_none());
        assert!(reduce(&Mesh::default(), 0.1).is_none());
    }
}
