//! The trees themselves: structure, boxes, time and depth on awkward input, and refusals.
use crate::oracle::Soup;
use crate::shapes::{Random, cube, random_soup, sphere};
use glam::{Affine3A, Mat3, Quat, Vec3};
use magpie::ray::{Bounds, COORDINATE_LIMIT, Child, MeshBvh, RayError, SceneBvh, children, object_from_world};
use magpie_shaders::scene::BvhNode;
use obvhs::aabb::Aabb;
use obvhs::cwbvh::CwBvh;
use obvhs::triangle::Triangle;
use std::time::{Duration, Instant};

fn build(soup: &Soup) -> MeshBvh {
    MeshBvh::build(&soup.positions, &soup.indices).unwrap()
}

/// `copies` triangles, each a function of its number.
fn row(copies: usize, triangle: impl Fn(f32) -> [Vec3; 3]) -> Soup {
    let positions: Vec<Vec3> = (0..copies).flat_map(|i| triangle(i as f32)).collect();
    Soup { indices: (0..positions.len() as u32).collect(), positions }
}

/// The eight boxes of a node, decoded as the shader does, in `f64`.
fn decode(node: &BvhNode, slot: usize) -> [[f64; 3]; 2] {
    let cell = |axis: usize| f64::from(f32::from_bits(((node.exponents_and_mask >> (8 * axis)) & 255) << 23));
    let plane = |axis: usize, words: [u32; 2]| {
        f64::from(node.origin[axis]) + cell(axis) * f64::from((words[slot / 4] >> (8 * (slot % 4))) & 255)
    };
    let lower = [node.min_x, node.min_y, node.min_z];
    let upper = [node.max_x, node.max_y, node.max_z];
    [std::array::from_fn(|a| plane(a, lower[a])), std::array::from_fn(|a| plane(a, upper[a]))]
}

/// Checks that each node is reached once, each primitive once, and that every decoded box holds what is below it.
fn check(nodes: &[BvhNode], primitives: &[Bounds]) -> Bounds {
    let (mut seen_nodes, mut seen_primitives) = (vec![0; nodes.len()], vec![0; primitives.len()]);
    seen_nodes[0] += 1;
    let mut bounds = vec![Bounds::EMPTY; nodes.len()];
    for at in (0..nodes.len()).rev() {
        for (slot, child) in children(&nodes[at]).into_iter().enumerate() {
            let inside = match child {
                Child::None => continue,
                Child::Node(node) => {
                    assert!(node > at, "node {at} has child {node}");
                    seen_nodes[node] += 1;
                    bounds[node]
                }
                Child::Primitives(range) => range.fold(Bounds::EMPTY, |b, p| {
                    seen_primitives[p] += 1;
                    b.union(primitives[p])
                }),
            };
            let [lower, upper] = decode(&nodes[at], slot);
            for axis in 0..3 {
                assert!(lower[axis] <= f64::from(inside.min[axis]), "node {at} slot {slot}: {lower:?} {inside:?}");
                assert!(upper[axis] >= f64::from(inside.max[axis]), "node {at} slot {slot}: {upper:?} {inside:?}");
            }
            bounds[at] = bounds[at].union(inside);
        }
    }
    assert!(seen_nodes.iter().all(|&n| n == 1) && seen_primitives.iter().all(|&n| n == 1));
    bounds[0]
}

fn boxes(bvh: &MeshBvh) -> Vec<Bounds> {
    bvh.triangles.iter().map(|t| Bounds::of_points(&[t.v0, t.v1, t.v2].map(Vec3::from))).collect()
}

#[test]
fn boxes_hold_what_is_below_them() {
    let mut random = Random(11);
    for scale in [1e-25, 1e-6, 1.0, 12_345.678, 1e11] {
        for shift in [Vec3::ZERO, Vec3::new(0.3, -7.0, 1e3)] {
            let mut soup = random_soup(&mut random, 500);
            soup.positions.iter_mut().for_each(|p| *p = (*p + shift) * scale * 1e-3);
            let bvh = build(&soup);
            assert_eq!(check(&bvh.nodes, &boxes(&bvh)), bvh.bounds);
            assert_eq!(bvh.triangles.len(), 500);
        }
    }
}

#[test]
fn obvhs_finds_the_trees_valid() {
    let mut random = Random(12);
    let soups =
        [random_soup(&mut random, 1), random_soup(&mut random, 3), random_soup(&mut random, 5000), cube(), sphere(20)];
    for soup in soups {
        let bvh = build(&soup);
        let triangles: Vec<_> = bvh
            .triangles
            .iter()
            .map(|t| Triangle { v0: Vec3::from(t.v0).into(), v1: Vec3::from(t.v1).into(), v2: Vec3::from(t.v2).into() })
            .collect();
        let tree = CwBvh {
            nodes: bytemuck::cast_slice(&bvh.nodes).to_vec(),
            primitive_indices: (0..triangles.len() as u32).collect(),
            total_aabb: Aabb::new(bvh.bounds.min.into(), bvh.bounds.max.into()),
            ..CwBvh::default()
        };
        let result = tree.validate(&triangles, true);
        assert_eq!(result.discovered_primitives.len(), soup.indices.len() / 3);
        assert!(result.max_depth >= bvh.stack, "depth {} stack {}", result.max_depth, bvh.stack);
    }
}

#[test]
fn the_order_of_the_tree_keeps_each_triangle() {
    let soup = sphere(9);
    let bvh = build(&soup);
    let mut numbers: Vec<_> = bvh.triangles.iter().map(|t| t.triangle as usize).collect();
    for t in &bvh.triangles {
        let corners = [0, 1, 2].map(|c| soup.positions[soup.indices[3 * t.triangle as usize + c] as usize].to_array());
        assert_eq!([t.v0, t.v1, t.v2], corners);
    }
    numbers.sort_unstable();
    assert!(numbers.into_iter().eq(0..soup.indices.len() / 3));
}

#[test]
fn awkward_rows_are_built_quickly_and_stay_shallow() {
    let corner = |at: Vec3, size: f32| [at, at + size * Vec3::X, at + size * Vec3::Z];
    let shapes: [(&str, Soup); 6] = [
        ("copies", row(50_000, |_| corner(Vec3::ZERO, 1.0))),
        ("two places", row(50_000, |i| corner((i % 2.0) * 9.0 * Vec3::X, 1.0))),
        ("nested", row(50_000, |i| corner(Vec3::splat(-i), 2.0 * i + 2.0))),
        ("a line", row(50_000, |i| corner(i * Vec3::X, 1.0))),
        ("growing", row(50_000, |i| corner(1.5_f32.powf(i % 60.0) * Vec3::X, 0.3 * 1.5_f32.powf(i % 60.0)))),
        ("shrinking", row(60, |i| corner(0.25_f32.powf(i) * Vec3::X, 0.5 * 0.25_f32.powf(i)))),
    ];
    for (name, soup) in shapes {
        let start = Instant::now();
        let bvh = build(&soup);
        check(&bvh.nodes, &boxes(&bvh));
        assert_eq!(bvh.triangles.len(), soup.indices.len() / 3, "{name}");
        assert!(bvh.stack <= 24, "{name} needs {} entries", bvh.stack);
        assert!(start.elapsed() < Duration::from_secs(5), "{name} took {:?}", start.elapsed());
    }
}

#[test]
fn world_boxes_hold_moved_corners() {
    let mut random = Random(13);
    for _ in 0..1000 {
        let (a, b) = (random.vector(), random.vector());
        let bounds = Bounds::of_points(&[100.0 * a, 100.0 * b]);
        let matrix = Mat3::from_cols(random.vector(), random.vector(), random.vector());
        let place = Affine3A::from_mat3_translation(matrix, 1e4 * random.vector());
        let world = bounds.transformed(&place);
        for corner in 0..8 {
            let pick = |axis: usize| if corner >> axis & 1 == 0 { bounds.min[axis] } else { bounds.max[axis] };
            let moved = place.transform_point3(Vec3::new(pick(0), pick(1), pick(2)));
            assert!(moved.cmpge(world.min).all() && moved.cmple(world.max).all(), "{moved} {world:?}");
        }
        assert!((world.max - world.min).max_element() < 600.0, "{world:?}");
    }
    assert!(Bounds::EMPTY.transformed(&Affine3A::IDENTITY).is_empty());
}

#[test]
fn the_scene_tree_leaves_out_what_no_ray_hits() {
    let meshes = [build(&cube()), build(&Soup { positions: Vec::new(), indices: Vec::new() })];
    let flat = Affine3A::from_scale(Vec3::new(1.0, 1.0, 0.0));
    let turned = Affine3A::from_rotation_translation(Quat::from_rotation_y(1.0), Vec3::X);
    let mut instances = vec![(turned, 0), (turned, 1), (flat, 0), (Affine3A::from_scale(Vec3::splat(-2.0)), 0)];
    instances.extend(std::iter::repeat_n((turned, 0), 5000));
    let scene = SceneBvh::build(&instances, &meshes).unwrap();
    assert_eq!(scene.flat, [2]);
    let boxes: Vec<_> =
        scene.instances.iter().map(|&i| meshes[0].bounds.transformed(&instances[i as usize].0)).collect();
    assert_eq!(check(&scene.nodes, &boxes), scene.bounds);
    let mut order = scene.instances.clone();
    order.sort_unstable();
    assert!(order.into_iter().eq((0..5004).filter(|i| ![1, 2].contains(i))));
    assert!((meshes[0].stack + 1..=24).contains(&scene.stack), "{}", scene.stack);
}

#[test]
fn the_inverse_is_an_inverse_or_nothing() {
    let place = Affine3A::from_scale_rotation_translation(
        Vec3::new(1e-3, 2.0, -30.0),
        Quat::from_rotation_x(0.7),
        Vec3::new(5.0, -1e3, 2.0),
    );
    let back = object_from_world(&place).unwrap();
    let p = Vec3::new(0.5, -2.0, 0.25);
    assert!((back.transform_point3(place.transform_point3(p)) - p).length() < 0.05);
    for scale in [Vec3::ZERO, Vec3::new(1.0, 0.0, 1.0), Vec3::splat(1e-39)] {
        assert_eq!(object_from_world(&Affine3A::from_scale(scale)), None);
    }
}

#[test]
fn bad_meshes_are_refused_by_name() {
    let cube = cube();
    let with = |vertex: usize, value: f32| {
        let mut positions = cube.positions.clone();
        positions[vertex].y = value;
        MeshBvh::build(&positions, &cube.indices).unwrap_err()
    };
    for value in [f32::NAN, f32::INFINITY, f32::NEG_INFINITY, 2.0 * COORDINATE_LIMIT, f32::MAX] {
        let error = with(5, value);
        assert!(matches!(error, RayError::Position { vertex: 5, .. }), "{error}");
        let text = error.in_mesh("crate").to_string();
        assert!(text.starts_with("mesh `crate`: vertex 5 lies at [1.0, "), "{text}");
    }
    assert!(
        MeshBvh::build(&cube.positions.iter().map(|p| *p * COORDINATE_LIMIT).collect::<Vec<_>>(), &cube.indices)
            .is_ok()
    );
    let partial = MeshBvh::build(&cube.positions, &cube.indices[..5]).unwrap_err();
    assert_eq!(partial, RayError::PartialTriangle { count: 5 });
    let beyond = MeshBvh::build(&cube.positions, &[0, 1, 8]).unwrap_err();
    assert_eq!(beyond, RayError::Index { at: 2, vertex: 8, vertices: 8 });
}

#[test]
fn bad_instances_are_refused_by_number() {
    let meshes = [build(&cube())];
    let refuse = |place, mesh| SceneBvh::build(&[(Affine3A::IDENTITY, 0), (place, mesh)], &meshes).unwrap_err();
    assert_eq!(refuse(Affine3A::IDENTITY, 1), RayError::Mesh { instance: 1, mesh: 1, meshes: 1 });
    for place in [
        Affine3A::from_translation(Vec3::new(0.0, f32::NAN, 0.0)),
        Affine3A::from_scale(Vec3::new(1.0, f32::INFINITY, 1.0)),
        Affine3A::from_translation(Vec3::splat(2.0 * COORDINATE_LIMIT)),
    ] {
        assert!(matches!(refuse(place, 0), RayError::Instance { instance: 1, .. }));
    }
}

#[test]
fn two_levels_too_deep_for_the_stack_are_refused() {
    let mut meshes = vec![build(&cube())];
    meshes[0].stack = magpie_shaders::scene::TRAVERSAL_STACK - 1;
    let instances: Vec<_> = (0..200).map(|i| (Affine3A::from_translation(3.0 * i as f32 * Vec3::X), 0)).collect();
    assert!(SceneBvh::build(&instances[..1], &meshes).is_ok());
    let error = SceneBvh::build(&instances, &meshes).unwrap_err();
    assert!(matches!(error, RayError::Stack { needed: 49.., limit: 48 }), "{error}");
}

#[test]
fn building_twice_gives_the_same_bytes() {
    let soup = random_soup(&mut Random(14), 3000);
    let (a, b) = (build(&soup), build(&soup));
    assert_eq!(bytemuck::cast_slice::<_, u8>(&a.nodes), bytemuck::cast_slice::<_, u8>(&b.nodes));
    assert_eq!(bytemuck::cast_slice::<_, u8>(&a.triangles), bytemuck::cast_slice::<_, u8>(&b.triangles));
}
