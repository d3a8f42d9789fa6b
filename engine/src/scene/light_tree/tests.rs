//! Cones, bounds and builds of the light tree.
use super::bounds::{Cone, instance_leaf, node_above, triangle_leaf};
use super::build::{Built, MOST_DEPTH, build};
use glam::{Affine3A, Mat3, Quat, Vec3};
use magpie_shaders::light_tree::{LIGHT_NODE_INDEX, LIGHT_NODE_KIND, LIGHT_NODE_LAMP, LightNode, UNLIMITED_REACH};
use magpie_shaders::scene as shared;
use std::f32::consts::{FRAC_1_SQRT_2, PI};

/// Makes one light of a group.
type OneLight = dyn Fn(bool, &mut Numbers) -> (Vec3, Option<Vec3>);

fn cone(axis: Vec3, degrees: f32) -> Cone {
    Cone { axis, cos_normals: degrees.to_radians().cos(), cos_emission: 0.0, two_sided: false }
}

/// Random numbers in [0, 1).
struct Numbers(u64);

impl Numbers {
    fn next(&mut self) -> f32 {
        self.0 = self.0.wrapping_mul(6_364_136_223_846_793_005).wrapping_add(1_442_695_040_888_963_407);
        (self.0 >> 40) as f32 / (1 << 24) as f32
    }

    fn point(&mut self) -> Vec3 {
        Vec3::new(self.next(), self.next(), self.next()) * 2.0 - 1.0
    }

    fn direction(&mut self) -> Vec3 {
        loop {
            let point = self.point();
            if (0.01..1.0).contains(&point.length()) {
                return point.normalize();
            }
        }
    }
}

fn angle(a: Vec3, b: Vec3) -> f64 {
    let (a, b) = (a.as_dvec3().normalize(), b.as_dvec3().normalize());
    2.0 * (a - b).length().atan2((a + b).length())
}

fn half_angle(cone: &Cone) -> f64 {
    f64::from(cone.cos_normals).acos()
}

#[test]
fn cones_around_two_cones_by_hand() {
    // Two directions at a right angle: half of it, about the middle.
    let both = cone(Vec3::X, 0.0).union(cone(Vec3::Y, 0.0));
    assert!((both.cos_normals - FRAC_1_SQRT_2).abs() < 2e-6, "{both:?}");
    assert!(both.axis.abs_diff_eq(Vec3::new(FRAC_1_SQRT_2, FRAC_1_SQRT_2, 0.0), 1e-6), "{both:?}");
    // Opposite directions: a right angle, about an axis across them.
    let both = cone(Vec3::X, 0.0).union(cone(-Vec3::X, 0.0));
    assert!(both.cos_normals.abs() < 2e-6 && both.axis.x.abs() < 1e-6, "{both:?}");
    // One in the other, and one that just fits.
    let wide = cone(Vec3::Z, 40.0);
    assert_eq!(wide.union(cone(Vec3::new(0.1, 0.0, 1.0).normalize(), 10.0)), wide);
    assert_eq!(cone(Vec3::Z, 0.0).union(wide), wide);
    // 30 and 20 degrees about axes 60 degrees apart: (30 + 60 + 20) / 2, turned by 25 degrees from the first.
    let axis = Vec3::new(60_f32.to_radians().sin(), 0.0, 60_f32.to_radians().cos());
    let both = cone(Vec3::Z, 30.0).union(cone(axis, 20.0));
    assert!((half_angle(&both).to_degrees() - 55.0).abs() < 1e-3, "{both:?}");
    assert!((angle(both.axis, Vec3::Z).to_degrees() - 25.0).abs() < 1e-3, "{both:?}");
    // Too much for less than everything.
    assert_eq!(cone(Vec3::Z, 150.0).union(cone(-Vec3::Z, 60.0)).cos_normals, -1.0);
    assert_eq!(cone(Vec3::Z, 180.0).union(cone(Vec3::X, 90.0)).cos_normals, -1.0);
}

#[test]
fn cones_with_two_sides_turn_round() {
    let both_sides = |axis, degrees| Cone { two_sided: true, ..cone(axis, degrees) };
    let both = cone(Vec3::Y, 0.0).union(both_sides(-Vec3::Y, 0.0));
    assert!(both.two_sided && both.cos_normals > 1.0 - 2e-6 && both.axis.y > 0.999_999, "{both:?}");
    let both = both_sides(-Vec3::Y, 20.0).union(cone(Vec3::Y, 10.0));
    assert!((half_angle(&both).to_degrees() - 20.0).abs() < 1e-3 && both.axis.y > 0.999_999, "{both:?}");
}

#[test]
fn cones_hold_what_they_are_around_and_no_more() {
    let mut numbers = Numbers(1);
    for _ in 0..20_000 {
        let degrees = [0, 1].map(|_| 180.0 * numbers.next().powi(3));
        let parts = degrees.map(|degrees| cone(numbers.direction(), degrees));
        let both = parts[0].union(parts[1]);
        let ([a, b], whole) = (parts.map(|part| half_angle(&part)), half_angle(&both));
        let apart = angle(parts[0].axis, parts[1].axis);
        let wanted = (0.5 * (a + apart + b)).max(a).max(b).min(std::f64::consts::PI);
        // A cosine near 1 tells angles to a thousandth.
        assert!((whole - wanted).abs() < 3e-3, "{parts:?}: {whole}, not {wanted}");
        for (part, own) in parts.iter().zip([a, b]) {
            let farthest = (angle(both.axis, part.axis) + own).min(std::f64::consts::PI);
            assert!(farthest.cos() > f64::from(both.cos_normals) - 2e-6, "{parts:?}: {both:?}");
        }
    }
}

/// The integral of 1 over all normals, and of the cosine beyond.
#[test]
fn the_measure_of_directions_is_its_integral() {
    assert!((cone(Vec3::X, 0.0).measure() - PI).abs() < 1e-5);
    assert!((cone(Vec3::X, 180.0).measure() - 4.0 * PI).abs() < 1e-4);
    for normals in [0.0_f64, 10.0, 45.0, 90.0, 120.0, 170.0] {
        for emission in [5.0_f64, 30.0, 90.0] {
            let (normal, whole) = (normals.to_radians(), (normals + emission).min(180.0).to_radians());
            let steps = 20_000;
            let mut sum = 0.0;
            for i in 0..steps {
                let at = whole * (f64::from(i) + 0.5) / f64::from(steps);
                sum += at.sin() * if at < normal { 1.0 } else { (at - normal).cos() } * whole / f64::from(steps);
            }
            let wanted = 2.0 * std::f64::consts::PI * sum;
            let cos_emission = if emission == 90.0 { 0.0 } else { emission.to_radians().cos() as f32 };
            let found = f64::from(Cone { cos_emission, ..cone(Vec3::X, normals as f32) }.measure());
            assert!((found - wanted).abs() < 1e-3 + 1e-3 * wanted, "{normals}, {emission}: {found}, not {wanted}");
        }
    }
}

/// A lamp of no size that shines everywhere, or along an axis.
fn lamp(position: Vec3, intensity: f32, axis: Option<Vec3>, index: u32) -> LightNode {
    LightNode {
        min: position.to_array(),
        max: position.to_array(),
        intensity,
        reach: UNLIMITED_REACH,
        axis: axis.unwrap_or(Vec3::Z).to_array(),
        cos_normals: if axis.is_some() { 1.0 } else { -1.0 },
        cos_emission: 0.0,
        spread: 0.0,
        count: u32::from(intensity > 0.0),
        child: LIGHT_NODE_LAMP | index,
    }
}

/// Checks places, trails and parents, and every node against its children. Returns the depth of the deepest leaf.
fn check(built: &Built, leaves: &[LightNode]) -> u32 {
    assert_eq!((built.nodes.len(), built.places.len()), (2 * leaves.len() - 1, leaves.len()));
    let mut deepest = 0;
    for (leaf, place) in leaves.iter().zip(&built.places) {
        assert_eq!(built.nodes[place.node as usize], *leaf);
        let (mut node, mut depth) = (0, 0);
        while built.nodes[node].child & LIGHT_NODE_KIND == 0 {
            assert!(depth < MOST_DEPTH);
            node = (built.nodes[node].child & LIGHT_NODE_INDEX) as usize + (place.trail >> depth & 1) as usize;
            depth += 1;
        }
        assert_eq!(node, place.node as usize);
        deepest = deepest.max(depth);
    }
    for (pair, parent) in built.parents.iter().enumerate() {
        let (first, above) = (1 + 2 * pair, &built.nodes[*parent as usize]);
        assert_eq!(above.child & LIGHT_NODE_INDEX, first as u32);
        let [a, b] = [built.nodes[first], built.nodes[first + 1]];
        assert_eq!(*above, node_above(&a, &b, first as u32));
        for child in [a, b].iter().filter(|child| child.intensity > 0.0) {
            let inside = (0..3).all(|axis| above.min[axis] <= child.min[axis] && above.max[axis] >= child.max[axis]);
            assert!(inside && above.reach >= child.reach && above.cos_emission <= child.cos_emission);
            assert!(above.cos_normals <= child.cos_normals);
        }
        assert_eq!(above.count, a.count + b.count);
    }
    assert!(built.nodes.iter().all(|node| node.spread.is_finite() && Vec3::from(node.axis).is_normalized()));
    deepest
}

/// Lamps where they are hard to tell apart, or far out of proportion.
#[test]
fn every_light_is_found_by_its_trail() {
    let mut numbers = Numbers(2);
    let count = 5000;
    let mut made = |name: &str, one: &dyn Fn(u32, &mut Numbers) -> LightNode| {
        let leaves: Vec<LightNode> = (0..count).map(|i| one(i, &mut numbers)).collect();
        let depth = check(&build(leaves.clone()), &leaves);
        println!("{name}: {depth} levels");
        depth
    };
    let spread = made("spread", &|i, n| lamp(n.point() * 100.0, 1.0 + n.next(), None, i));
    assert!(spread < 24, "{spread} levels where 13 would do");
    made("one point", &|i, _| lamp(Vec3::ONE, 1.0, None, i));
    let turned = made("one point, all directions", &|i, n| lamp(Vec3::ONE, 1.0, Some(n.direction()), i));
    assert!(turned < 24, "{turned}");
    made("a row", &|i, _| lamp(Vec3::X * i as f32, 1.0, None, i));
    made("each twice as far", &|i, _| lamp(Vec3::X * 1.01_f32.powi(i as i32), 1.0, None, i));
    made("each weaker", &|i, n| lamp(n.point(), 1e8 * 0.99_f32.powi(i as i32).max(1e-18), None, i));
    made("dark", &|i, n| lamp(n.point(), 0.0, None, i));
    made("nearly all dark", &|i, n| lamp(n.point(), if i == 77 { 1.0 } else { 0.0 }, None, i));
    made("at the ends of the world", &|i, n| lamp(n.point() * 3e38, 1.0, None, i));
    for count in [1, 2, 3] {
        let leaves: Vec<LightNode> = (0..count).map(|i| lamp(numbers.point(), 1.0, None, i)).collect();
        check(&build(leaves.clone()), &leaves);
    }
}

#[test]
fn the_first_split_is_where_it_matters() {
    let mut numbers = Numbers(3);
    let mut groups = |one: &OneLight| {
        let leaves: Vec<LightNode> = (0..100)
            .map(|i| {
                let (position, axis) = one(i % 2 == 1, &mut numbers);
                lamp(position, 1.0, axis, i)
            })
            .collect();
        let built = build(leaves);
        let side = |i: usize| built.places[i].trail & 1;
        (0..100).all(|i| side(i) == side(i % 2)) && side(0) != side(1)
    };
    assert!(groups(&|second, n| (n.point() + if second { 30.0 } else { 0.0 } * Vec3::Y, None)), "two rooms");
    assert!(groups(&|second, _| (Vec3::ONE, Some(if second { Vec3::X } else { -Vec3::X }))), "two directions");
    // Lamps on two sides of a thin wall: by direction too, since the wall's long side has no order in it.
    let wall = |second: bool, n: &mut Numbers| {
        let side = if second { 1.0 } else { -1.0 };
        let place = n.point() * Vec3::new(0.0, 2.0, 2.0) + Vec3::X * 0.5 * side;
        (place, Some(Vec3::X * side))
    };
    assert!(groups(&wall), "two sides of a wall");
}

fn placed(world_from_object: Affine3A) -> shared::Instance {
    let rows = |m: Affine3A| {
        let (a, t) = (m.matrix3, m.translation);
        [0, 1, 2].map(|r| [a.x_axis[r], a.y_axis[r], a.z_axis[r], t[r]])
    };
    let inverse =
        if world_from_object.matrix3.determinant() == 0.0 { Affine3A::ZERO } else { world_from_object.inverse() };
    shared::Instance {
        world_from_object: rows(world_from_object),
        object_from_world: rows(inverse),
        ..Default::default()
    }
}

/// Bounds of a placed mesh hold its triangles as they are in the world, however it is stretched, sheared or mirrored.
#[test]
fn bounds_of_instances_hold_their_triangles() {
    let mut numbers = Numbers(4);
    for round in 0..400 {
        // Normals about one direction, within an angle that differs from mesh to mesh.
        let (axis, wide) = (numbers.direction(), numbers.next());
        let triangles: Vec<[Vec3; 3]> = (0..20)
            .map(|_| {
                let normal = (axis + wide * numbers.point()).normalize();
                let (u, v) = normal.any_orthonormal_pair();
                let at = numbers.point();
                [at, at + u * (0.1 + numbers.next()), at + v * (0.1 + numbers.next())]
            })
            .collect();
        let leaves: Vec<LightNode> = triangles.iter().map(|corners| triangle_leaf(*corners, 2.0, 0)).collect();
        let root = leaves[1..].iter().fold(leaves[0], |a, b| node_above(&a, b, 1));
        let turned = Mat3::from_quat(Quat::from_axis_angle(numbers.direction(), 3.0 * numbers.next()));
        let uniform = round % 2 == 0;
        let scale = if uniform { Vec3::splat(3.0) } else { Vec3::new(0.4, 1.0, 2.5) };
        let mirror = if round % 3 == 0 { Vec3::new(-1.0, 1.0, 1.0) } else { Vec3::ONE };
        let matrix = turned * Mat3::from_diagonal(scale * mirror) * turned.transpose();
        let world = Affine3A::from_mat3_translation(matrix, numbers.point() * 50.0);
        let bounds = instance_leaf(&root, &placed(world), 7);
        assert_eq!((bounds.child, bounds.count), (7, root.count));
        let sign = matrix.determinant().signum();
        let mut intensity = 0.0;
        for corners in &triangles {
            let [a, b, c] = corners.map(|corner| world.transform_point3(corner));
            let across = sign * (b - a).cross(c - a);
            intensity += across.length();
            for corner in [a, b, c].map(|corner| corner.to_array()) {
                assert!((0..3).all(|k| bounds.min[k] <= corner[k] && corner[k] <= bounds.max[k]), "{corner:?}");
            }
            let cosine = across.normalize().dot(bounds.axis.into());
            assert!(cosine > bounds.cos_normals - 1e-5, "{cosine} below {}, {scale} {mirror}", bounds.cos_normals);
        }
        let off = bounds.intensity / intensity;
        assert!(if uniform { (off - 1.0).abs() < 1e-4 } else { (0.3..3.0).contains(&off) }, "{off}");
        if uniform {
            assert!(
                (bounds.cos_normals - root.cos_normals).abs() < 1e-3,
                "{} {}",
                bounds.cos_normals,
                root.cos_normals
            );
        }
    }
    let root = triangle_leaf([Vec3::ZERO, Vec3::X, Vec3::Y], 1.0, 0);
    let flat = placed(Affine3A::from_scale(Vec3::new(1.0, 1.0, 0.0)));
    assert_eq!(instance_leaf(&root, &flat, 0).intensity, 0.0, "a singular transform shows nothing");
}

/// Light nodes are what one cache line of most devices holds, at most.
#[test]
fn a_node_has_64_bytes() {
    assert_eq!(size_of::<LightNode>(), 64);
}
