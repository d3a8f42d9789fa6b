//! The trees themselves: structure, boxes, time and depth on awkward input, and refusals.
use crate::oracle::Soup;
use crate::shapes::{Random, cube, random_soup, sphere};
use glam::{Affine3A, Mat3, Quat, Vec3};
use magpie::ray::{
    Bounds, COORDINATE_LIMIT, Child, MeshBvh, Placement, RayError, SceneBvh, children, object_from_world, placements,
};
use magpie_shaders::scene::{BvhNode, BvhPrimitive};
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

fn corners(soup: &Soup, primitive: &BvhPrimitive) -> [Vec3; 3] {
    primitive.corners.map(|i| soup.positions[i as usize])
}

fn boxes(bvh: &MeshBvh, soup: &Soup) -> Vec<Bounds> {
    bvh.primitives.iter().map(|p| Bounds::of_points(&corners(soup, p))).collect()
}

fn top(instances: &[(Affine3A, u32)], meshes: &[MeshBvh]) -> Result<SceneBvh, RayError> {
    SceneBvh::build(&placements(instances, meshes)?)
}

#[test]
fn boxes_hold_what_is_below_them() {
    let mut random = Random(11);
    for scale in [1e-25, 1e-6, 1.0, 12_345.678, 1e11] {
        for shift in [Vec3::ZERO, Vec3::new(0.3, -7.0, 1e3)] {
            let mut soup = random_soup(&mut random, 500);
            soup.positions.iter_mut().for_each(|p| *p = (*p + shift) * scale * 1e-3);
            let bvh = build(&soup);
            assert_eq!(check(&bvh.nodes, &boxes(&bvh, &soup)), bvh.bounds);
            assert_eq!(bvh.primitives.len(), 500);
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
        let triangle = |p: &BvhPrimitive| {
            let [v0, v1, v2] = corners(&soup, p).map(Into::into);
            Triangle { v0, v1, v2 }
        };
        let triangles: Vec<_> = bvh.primitives.iter().map(triangle).collect();
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
    let mut numbers: Vec<_> = bvh.primitives.iter().map(|p| p.primitive as usize).collect();
    for p in &bvh.primitives {
        assert_eq!(p.corners, soup.indices.as_chunks::<3>().0[p.primitive as usize]);
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
        check(&bvh.nodes, &boxes(&bvh, &soup));
        assert_eq!(bvh.primitives.len(), soup.indices.len() / 3, "{name}");
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

/// The box of each instance in the tree, which must be the one that the walk tests.
fn world_boxes(scene: &SceneBvh, mesh: &MeshBvh, instances: &[(Affine3A, u32)]) -> Vec<Bounds> {
    let world = |i: &magpie_shaders::scene::BvhInstance| {
        let bounds = mesh.bounds.transformed(&instances[i.instance as usize].0);
        assert_eq!((bounds.min.to_array(), bounds.max.to_array()), (i.min, i.max));
        bounds
    };
    scene.instances.iter().map(world).collect()
}

#[test]
fn the_scene_tree_leaves_out_what_no_ray_hits() {
    let meshes = [build(&cube()), build(&Soup { positions: Vec::new(), indices: Vec::new() })];
    let flat = Affine3A::from_scale(Vec3::new(1.0, 1.0, 0.0));
    let turned = Affine3A::from_rotation_translation(Quat::from_rotation_y(1.0), Vec3::X);
    let mut instances = vec![(turned, 0), (turned, 1), (flat, 0), (Affine3A::from_scale(Vec3::splat(-2.0)), 0)];
    instances.extend(std::iter::repeat_n((turned, 0), 5000));
    let scene = top(&instances, &meshes).unwrap();
    assert_eq!(scene.flat, [2]);
    assert_eq!(check(&scene.nodes, &world_boxes(&scene, &meshes[0], &instances)), scene.bounds);
    let mut order: Vec<_> = scene.instances.iter().map(|i| i.instance).collect();
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
    let refuse = |place, mesh| top(&[(Affine3A::IDENTITY, 0), (place, mesh)], &meshes).unwrap_err();
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
    assert!(top(&instances[..1], &meshes).is_ok());
    let error = top(&instances, &meshes).unwrap_err();
    assert!(matches!(error, RayError::Stack { needed: 49.., limit: 48 }), "{error}");
}

#[test]
fn building_twice_gives_the_same_bytes() {
    let soup = random_soup(&mut Random(14), 3000);
    let (a, b) = (build(&soup), build(&soup));
    assert_eq!(bytemuck::cast_slice::<_, u8>(&a.nodes), bytemuck::cast_slice::<_, u8>(&b.nodes));
    assert_eq!(a.primitives, b.primitives);
}

#[test]
fn levels_list_each_node_once_children_first() {
    for soup in [random_soup(&mut Random(15), 4000), cube(), Soup { positions: Vec::new(), indices: Vec::new() }] {
        let bvh = build(&soup);
        let levels = bvh.levels();
        let mut level_of = vec![usize::MAX; bvh.nodes.len()];
        for (level, ends) in levels.offsets.windows(2).enumerate() {
            for &node in &levels.nodes[ends[0] as usize..ends[1] as usize] {
                assert_eq!(level_of[node as usize], usize::MAX, "node {node} twice");
                level_of[node as usize] = level;
            }
        }
        assert_eq!(levels.nodes.last(), Some(&0));
        assert_eq!(levels.offsets.last(), Some(&(bvh.nodes.len() as u32)));
        for (at, node) in bvh.nodes.iter().enumerate() {
            for child in children(node) {
                if let Child::Node(child) = child {
                    assert_eq!(level_of[child] + 1, level_of[at], "node {at} and its child {child}");
                }
            }
        }
    }
}

#[test]
fn a_refit_holds_moved_instances_and_keeps_the_shape() {
    let mut random = Random(16);
    let meshes = [build(&cube())];
    let place = |v: Vec3, s: f32| (Affine3A::from_scale_rotation_translation(Vec3::splat(s), Quat::IDENTITY, v), 0);
    let mut instances: Vec<_> = (0..3000).map(|_| place(40.0 * random.vector(), 1.0)).collect();
    let mut scene = top(&instances, &meshes).unwrap();
    let shape = |s: &SceneBvh| {
        let nodes: Vec<_> = s.nodes.iter().map(|n| (n.child_base, n.primitive_base, n.meta)).collect();
        (nodes, s.instances.iter().map(|i| i.instance).collect::<Vec<_>>())
    };
    let before = shape(&scene);
    for step in 0..5 {
        instances.iter_mut().for_each(|i| i.0.translation += glam::Vec3A::from(random.vector()));
        scene.refit(&placements(&instances, &meshes).unwrap()).unwrap();
        assert_eq!(shape(&scene), before, "step {step}");
        assert_eq!(check(&scene.nodes, &world_boxes(&scene, &meshes[0], &instances)), scene.bounds);
    }

    // One loses its inverse, another comes in: as if built.
    instances[7] = place(Vec3::ONE, 0.0);
    instances.push(place(Vec3::ZERO, 2.0));
    let placed = placements(&instances, &meshes).unwrap();
    scene.refit(&placed).unwrap();
    let built = SceneBvh::build(&placed).unwrap();
    assert_eq!((shape(&scene), &scene.flat, scene.stack), (shape(&built), &vec![7], built.stack));

    // A bad one is refused, and the tree stays.
    let mut bad = placed;
    bad[3].world_from_object.translation.x = f32::NAN;
    assert!(matches!(scene.refit(&bad).unwrap_err(), RayError::Instance { instance: 3, .. }));
    assert_eq!(shape(&scene), shape(&built));
}

#[test]
fn a_refit_notices_a_mesh_that_needs_more_stack() {
    let place = |x: f32| Affine3A::from_translation(x * Vec3::X);
    let bounds = Bounds { min: Vec3::ZERO, max: Vec3::ONE };
    let mut placed: Vec<_> =
        (0..50).map(|i| Placement { world_from_object: place(2.0 * i as f32), bounds, stack: 3 }).collect();
    let mut scene = SceneBvh::build(&placed).unwrap();
    assert!((3..8).contains(&scene.stack), "{}", scene.stack);
    placed[20].stack = 99;
    assert!(matches!(scene.refit(&placed).unwrap_err(), RayError::Stack { needed: 99.., limit: 48 }));
}

#[test]
fn spheres_are_held_and_bad_ones_refused() {
    let mut random = Random(17);
    let spheres: Vec<_> = (0..500).map(|_| (1e3 * random.vector(), random.range(1e-4, 50.0))).collect();
    let bvh = MeshBvh::build_spheres(&spheres).unwrap();
    let around = |p: &BvhPrimitive| {
        let (centre, radius) = spheres[p.primitive as usize];
        let (c, r) = (centre.as_dvec3(), f64::from(radius));
        // The nearest f32 inside of the exact box.
        Bounds { min: (c - r).as_vec3().map(f32::next_up), max: (c + r).as_vec3().map(f32::next_down) }
    };
    check(&bvh.nodes, &bvh.primitives.iter().map(around).collect::<Vec<_>>());
    assert_eq!(bvh.primitives.len(), 500);
    assert!(MeshBvh::build_spheres(&[(Vec3::ONE, 0.0)]).unwrap().primitives.is_empty());
    for (centre, radius) in [
        (Vec3::NAN, 1.0),
        (Vec3::ONE, f32::NAN),
        (Vec3::ONE, -1.0),
        (Vec3::ZERO, f32::INFINITY),
        (Vec3::splat(1e12), 1e11),
    ] {
        let error = MeshBvh::build_spheres(&[(Vec3::ZERO, 1.0), (centre, radius)]).unwrap_err();
        assert!(matches!(error, RayError::Sphere { sphere: 1, .. }), "{error}");
    }
}

/// What the documentation of [`magpie::ray::Levels`] tells a shader to do: cell and planes of a child along one axis, in `f32`.
fn quantise_in_f32(node: [f32; 2], child: [f32; 2]) -> (f32, [u32; 2]) {
    let size = node[1] - node[0];
    let mut cell = 2.0_f32.powi(-60);
    while size * (1.0 + 2.0_f32.powi(-20)) > 255.0 * cell {
        cell *= 2.0;
    }
    let steps = |at: f32, factor: f32| (at - node[0]) / cell * factor;
    let least = u32::from(child[1] > node[0]);
    let margin = 2.0_f32.powi(-21);
    (cell, [steps(child[0], 1.0 - margin).floor() as u32, (steps(child[1], 1.0 + margin).ceil() as u32).max(least)])
}

#[test]
fn boxes_quantised_in_f32_hold_what_they_should() {
    let mut random = Random(18);
    for at in 0..200_000 {
        let scale = 10.0_f32.powf(random.range(-24.0, 11.0));
        let offset = if at % 2 == 0 { 0.0 } else { scale * 10.0_f32.powf(random.range(-6.0, 6.0)).min(1e12 / scale) };
        let mut ends = [random.unit(), random.unit(), random.unit(), random.unit()].map(|x| offset + scale * x);
        if at % 5 == 0 {
            ends[1] = ends[0].next_up();
        }
        if at % 7 == 0 {
            // A power of two of cells, to the last bit.
            ends[3] = ends[0] + 255.0 * 2.0_f32.powf(scale.log2().round());
        }
        ends.sort_unstable_by(f32::total_cmp);
        let [min, lower, upper, max] = ends;
        for child in [[min, lower], [lower, upper], [upper, max], [min, max], [max, max]] {
            let (cell, planes) = quantise_in_f32([min, max], child);
            assert!(planes[1] < 256, "{min} {max} {child:?} {planes:?}");
            let [low, high] = planes.map(|q| f64::from(min) + f64::from(cell) * f64::from(q));
            assert!(low <= f64::from(child[0]) && f64::from(child[1]) <= high, "{min} {max} {child:?} {planes:?}");
            let slack = 1.001 * f64::from(cell);
            assert!(f64::from(child[0]) - low <= slack && high - f64::from(child[1]) <= slack, "{child:?} {planes:?}");
        }
    }
}
