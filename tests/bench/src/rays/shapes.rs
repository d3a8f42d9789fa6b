//! The shapes of the three set-ups: spheres, spheres with a rough surface, a rounded cube.
use super::{Random, Shape};
use glam::Vec3;
use std::f32::consts::{PI, TAU};

/// Exponent of the norm whose unit ball is the rounded cube: its corners are 1.6 from the centre.
const CUBE_NORM: f32 = 14.0;
/// Sectors and rings of the rounded cube: 396 triangles.
const CUBE: (u32, u32) = (18, 12);
/// Scale of the rough sphere, so that it covers about as much of a picture as the smooth one.
const ROUGH_SCALE: f32 = 0.7;

/// A closed unit sphere with `2 * sectors * (rings - 1)` triangles. `radius` returns each vertex's distance from the centre.
fn ball(sectors: u32, rings: u32, mut radius: impl FnMut(Vec3) -> f32) -> Shape {
    let mut positions = vec![Vec3::Y * radius(Vec3::Y)];
    for ring in 1..rings {
        let down = PI * ring as f32 / rings as f32;
        for sector in 0..sectors {
            let round = TAU * sector as f32 / sectors as f32;
            let direction = Vec3::new(down.sin() * round.cos(), down.cos(), down.sin() * round.sin());
            positions.push(direction * radius(direction));
        }
    }
    positions.push(Vec3::NEG_Y * radius(Vec3::NEG_Y));
    let last = positions.len() as u32 - 1;
    let vertex = |ring: u32, sector: u32| match ring {
        0 => 0,
        r if r == rings => last,
        r => 1 + (r - 1) * sectors + sector % sectors,
    };
    let mut indices = Vec::new();
    for ring in 0..rings {
        for sector in 0..sectors {
            let [a, b] = [vertex(ring, sector), vertex(ring, sector + 1)];
            let [c, d] = [vertex(ring + 1, sector), vertex(ring + 1, sector + 1)];
            if ring > 0 {
                indices.extend([a, b, c]);
            }
            if ring + 1 < rings {
                indices.extend([b, d, c]);
            }
        }
    }
    Shape { positions, indices }
}

/// A unit sphere with `2 n (n - 1)` triangles.
pub fn sphere(n: u32) -> Shape {
    ball(n, n, |_| 1.0)
}

/// The same with random vertex distances from 0.5 to 1.5, then scaled by 0.7.
pub fn rough_sphere(n: u32, seed: u64) -> Shape {
    let mut random = Random::new(seed);
    ball(n, n, |_| ROUGH_SCALE * (0.5 + random.unit()))
}

/// A cube of edge 2 with rounded edges, 396 triangles, within 1.6 of its centre.
pub fn rounded_cube() -> Shape {
    let norm = |d: Vec3| d.abs().to_array().iter().map(|x| x.powf(CUBE_NORM)).sum::<f32>().powf(1.0 / CUBE_NORM);
    ball(CUBE.0, CUBE.1, |direction| 1.0 / norm(direction))
}

#[cfg(test)]
mod tests {
    use super::*;
    use std::collections::HashMap;

    fn check(shape: &Shape, triangles: usize) {
        assert_eq!(shape.indices.len(), 3 * triangles);
        // Closed: every directed edge occurs once, and so does its opposite.
        let mut edges = HashMap::new();
        for t in shape.indices.chunks_exact(3) {
            for k in 0..3 {
                *edges.entry((t[k], t[(k + 1) % 3])).or_insert(0) += 1;
            }
            let [a, b, c] = [0, 1, 2].map(|k| shape.positions[t[k] as usize]);
            let normal = (b - a).cross(c - a);
            assert!(normal.dot(a + b + c) > 0.0, "a triangle faces inwards: {t:?}");
        }
        assert!(edges.iter().all(|(&(a, b), &n)| n == 1 && edges.get(&(b, a)) == Some(&1)));
    }

    #[test]
    fn shapes_are_closed_and_have_as_many_triangles_as_they_say() {
        check(&sphere(10), 180);
        check(&sphere(109), 23_544);
        check(&rounded_cube(), 396);
        assert_eq!(rough_sphere(10, 1).indices.len(), 3 * 180);
    }

    #[test]
    fn the_cube_is_as_large_as_the_documents() {
        let reach = rounded_cube().positions.iter().map(|p| p.length()).fold(0.0, f32::max);
        // No vertex of the mesh lies exactly in a corner of the cube.
        assert!((1.45..1.6).contains(&reach), "{reach}");
        let half = rounded_cube().positions.iter().map(|p| p.abs().max_element()).fold(0.0, f32::max);
        assert!((0.97..=1.001).contains(&half), "{half}");
    }

    #[test]
    fn rough_spheres_keep_to_their_shell() {
        let lengths: Vec<f32> = rough_sphere(20, 3).positions.iter().map(|p| p.length()).collect();
        assert!(lengths.iter().all(|l| (0.34..=1.06).contains(l)));
        assert!(lengths.iter().any(|l| *l < 0.45) && lengths.iter().any(|l| *l > 0.95));
    }
}
