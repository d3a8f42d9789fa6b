//! Shapes of a scene in world space, and ray intersection in double precision.
//!
//! The BVH is built by `obvhs` from boxes that are rounded outwards; all intersection tests are in `f64`.
use glam::{DAffine3, DMat3, DVec2, DVec3, DVec4, Vec3A};
use magpie::scene::{Animator, Pose, Scene, deform};
use obvhs::BvhBuildParams;
use obvhs::aabb::Aabb;
use obvhs::bvh2::Bvh2;
use obvhs::bvh2::builder::build_bvh2;
use std::time::Duration;

/// Greatest depth of the BVH.
const STACK: usize = 256;

/// A ray; distances count in lengths of `direction`, which need not be a unit vector.
#[derive(Clone, Copy, Debug)]
pub struct Ray {
    /// World, metres.
    pub origin: DVec3,
    /// Not zero.
    pub direction: DVec3,
    /// Lower limit of a hit's distance, exclusive.
    pub from: f64,
    /// Upper limit of a hit's distance, exclusive.
    pub to: f64,
}

/// A triangle or a sphere.
#[derive(Clone, Copy, Debug)]
pub enum Shape {
    /// Vertex indices in the instance.
    Triangle([u32; 3]),
    /// Centre and radius in object space.
    Sphere(DVec3, f64),
}

/// A shape of an instance.
#[derive(Clone, Copy, Debug)]
pub struct Primitive {
    /// Index of the instance.
    pub instance: u32,
    /// The triangle or sphere.
    pub shape: Shape,
}

/// A vertex in world space.
#[derive(Clone, Copy, Debug)]
pub struct Vertex {
    /// World, metres.
    pub position: DVec3,
    /// Unit.
    pub normal: DVec3,
    /// Unit or zero; `w` is the sign of the bitangent in the world.
    pub tangent: DVec4,
    /// Texture coordinates, two sets.
    pub uv: [DVec2; 2],
    /// Linear vertex colour and alpha.
    pub colour: DVec4,
}

/// An instance at one time.
#[derive(Clone, Debug)]
pub struct Placed {
    /// Index of the material.
    pub material: u32,
    /// World from object.
    pub world: DAffine3,
    /// Object from world.
    pub inverse: DAffine3,
    /// Vertices of its triangles; empty for spheres.
    pub vertices: Vec<Vertex>,
}

/// A hit of a ray.
#[derive(Clone, Copy, Debug)]
pub struct Hit {
    /// Index of the primitive.
    pub primitive: u32,
    /// Distance in lengths of the direction.
    pub t: f64,
    /// Barycentric weights of the second and third vertex.
    pub barycentric: DVec2,
    /// Geometric normal, unit, outwards: on the side from which the vertices run counter-clockwise in object space.
    pub outward: DVec3,
    /// Whether that side was hit.
    pub front: bool,
}

/// All primitives and their BVH.
pub struct Geometry {
    /// The instances of the scene.
    pub placed: Vec<Placed>,
    /// All non-degenerate triangles, and all spheres.
    pub primitives: Vec<Primitive>,
    tree: Bvh2,
}

impl Geometry {
    /// The geometry of a scene at a time in seconds, and its pose.
    pub fn new(scene: &Scene, time: f64) -> (Self, Pose) {
        let pose = Animator::new(scene).pose(time);
        let placed: Vec<_> = (0..scene.instances.len()).map(|i| place(scene, &pose, i)).collect();
        let mut primitives = Vec::new();
        for (i, (here, instance)) in placed.iter().zip(&scene.instances).enumerate() {
            if here.world.matrix3.determinant() == 0.0 {
                continue;
            }
            let mesh = &scene.meshes[instance.mesh as usize];
            let mut add = |shape| primitives.push(Primitive { instance: i as u32, shape });
            mesh.spheres.iter().for_each(|s| add(Shape::Sphere(s.centre.as_dvec3(), s.radius.into())));
            for t in mesh.indices.as_chunks::<3>().0 {
                let [a, b, c] = t.map(|i| here.vertices[i as usize].position);
                if (b - a).cross(c - a) != DVec3::ZERO {
                    add(Shape::Triangle(*t));
                }
            }
        }
        let boxes: Vec<Aabb> = primitives.iter().map(|p| bounds(&placed[p.instance as usize], p)).collect();
        let mut took = Duration::ZERO;
        let tree = build_bvh2(&boxes, BvhBuildParams::medium_build(), &mut took);
        (Self { placed, primitives, tree }, pose)
    }

    /// The instance of a primitive.
    pub fn instance_of(&self, primitive: u32) -> &Placed {
        &self.placed[self.primitives[primitive as usize].instance as usize]
    }

    /// The vertices of a triangle.
    pub fn vertices(&self, instance: u32, corners: [u32; 3]) -> [&Vertex; 3] {
        corners.map(|c| &self.placed[instance as usize].vertices[c as usize])
    }

    /// The nearest hit that `counts` accepts.
    pub fn nearest(&self, ray: &Ray, mut counts: impl FnMut(&Hit) -> bool) -> Option<Hit> {
        let mut best: Option<Hit> = None;
        self.walk(ray, |primitive, to| match self.meet(primitive, &Ray { to, ..*ray }, &mut counts) {
            Some(hit) => {
                best = Some(hit);
                hit.t
            }
            None => to,
        });
        best
    }

    /// Calls `go_on` with every hit until it returns false.
    pub fn all(&self, ray: &Ray, mut go_on: impl FnMut(&Hit) -> bool) {
        self.walk(ray, |primitive, to| {
            let mut on = true;
            self.meet(primitive, ray, &mut |hit| {
                on = on && go_on(hit);
                false
            });
            if on { to } else { f64::NEG_INFINITY }
        });
    }

    /// Traverses the BVH; `meet` returns the ray's new upper limit.
    fn walk(&self, ray: &Ray, mut meet: impl FnMut(u32, f64) -> f64) {
        let (mut stack, mut height, mut to) = ([(0_u32, 0.0); STACK], 1, ray.to);
        if self.primitives.is_empty() {
            return;
        }
        while height > 0 {
            height -= 1;
            let (index, enters) = stack[height];
            if enters > to {
                continue;
            }
            let node = &self.tree.nodes[index as usize];
            let first = node.first_index;
            if node.is_leaf() {
                for i in first..first + node.prim_count {
                    to = meet(self.tree.primitive_indices[i as usize], to);
                }
                continue;
            }
            let mut children = [first, first + 1].map(|c| (c, enters_box(&self.tree.nodes[c as usize].aabb, ray, to)));
            if children[0].1 < children[1].1 {
                children.reverse();
            }
            for (child, enters) in children {
                if enters < f64::INFINITY {
                    stack[height] = (child, enters);
                    height += 1;
                }
            }
        }
    }

    /// The nearest accepted hit of one primitive in the ray's range.
    fn meet(&self, primitive: u32, ray: &Ray, counts: &mut impl FnMut(&Hit) -> bool) -> Option<Hit> {
        let Primitive { instance, shape } = self.primitives[primitive as usize];
        let in_range = |t: f64| t > ray.from && t < ray.to;
        match shape {
            Shape::Triangle(corners) => {
                let [a, b, c] = self.vertices(instance, corners).map(|v| v.position);
                let (u, v) = (b - a, c - a);
                let normal = u.cross(v);
                let slope = normal.dot(ray.direction);
                // Möller and Trumbore 1997, "Fast, Minimum Storage Ray-Triangle Intersection".
                let from = ray.origin - a;
                let t = -normal.dot(from) / slope;
                if slope == 0.0 || !in_range(t) {
                    return None;
                }
                let across = ray.direction.cross(from);
                let barycentric = DVec2::new(v.dot(across), -u.dot(across)) / slope;
                if barycentric.min_element() < 0.0 || barycentric.element_sum() > 1.0 {
                    return None;
                }
                let mirrored = self.placed[instance as usize].world.matrix3.determinant() < 0.0;
                let outward = if mirrored { -normal } else { normal }.normalize();
                let hit = Hit { primitive, t, barycentric, outward, front: outward.dot(ray.direction) < 0.0 };
                counts(&hit).then_some(hit)
            }
            Shape::Sphere(centre, radius) => {
                let placed = &self.placed[instance as usize];
                let o = placed.inverse.transform_point3(ray.origin) - centre;
                let d = placed.inverse.transform_vector3(ray.direction);
                let (a, b) = (d.length_squared(), o.dot(d));
                let beside = o - d * (b / a);
                let half = (radius * radius - beside.length_squared()) / a;
                if half < 0.0 {
                    return None;
                }
                [-half.sqrt(), half.sqrt()].into_iter().find_map(|side| {
                    let t = side - b / a;
                    let outward = normal_of(&placed.inverse, (o + d * t).normalize());
                    let hit = Hit { primitive, t, barycentric: DVec2::ZERO, outward, front: side < 0.0 };
                    (in_range(t) && counts(&hit)).then_some(hit)
                })
            }
        }
    }
}

/// Transforms a normal to world space; unit.
pub fn normal_of(inverse: &DAffine3, normal: DVec3) -> DVec3 {
    (inverse.matrix3.transpose() * normal).normalize()
}

/// Distance at which a ray enters a box; infinity if not before `to`.
fn enters_box(bounds: &Aabb, ray: &Ray, to: f64) -> f64 {
    let (lower, upper) = (bounds.min.as_dvec3(), bounds.max.as_dvec3());
    let (a, b) = ((lower - ray.origin) / ray.direction, (upper - ray.origin) / ray.direction);
    let (mut enter, mut leave) = (ray.from, to);
    for axis in 0..3 {
        // A ray in a face's plane gives NaN, which min and max ignore.
        enter = enter.max(a[axis].min(b[axis]));
        leave = leave.min(a[axis].max(b[axis]));
    }
    if enter <= leave { enter } else { f64::INFINITY }
}

fn place(scene: &Scene, pose: &Pose, i: usize) -> Placed {
    let instance = &scene.instances[i];
    let (mesh, world) = (&scene.meshes[instance.mesh as usize], pose.instances[i]);
    let deformed = pose.bounds[i].map(|_| deform(mesh, &pose.joints[i], &pose.weights[i]));
    let (positions, normals, tangents) = match &deformed {
        Some(d) => (&d.positions, &d.normals, &d.tangents),
        None => (&mesh.positions, &mesh.normals, &mesh.tangents),
    };
    let inverse = world.inverse();
    let mirror = if world.matrix3.determinant() < 0.0 { -1.0 } else { 1.0 };
    let vertex = |v: usize| Vertex {
        position: world.transform_point3(positions[v].as_dvec3()),
        normal: normal_of(&inverse, normals[v].as_dvec3()),
        tangent: world
            .transform_vector3(tangents[v].truncate().as_dvec3())
            .normalize_or_zero()
            .extend(f64::from(tangents[v].w) * mirror),
        uv: [mesh.uv0[v].as_dvec2(), mesh.uv1[v].as_dvec2()],
        colour: mesh.colours[v].as_dvec4(),
    };
    Placed { material: instance.material, world, inverse, vertices: (0..positions.len()).map(vertex).collect() }
}

/// Bounds of a primitive, rounded outwards.
fn bounds(placed: &Placed, primitive: &Primitive) -> Aabb {
    let (lower, upper) = match primitive.shape {
        Shape::Triangle(corners) => {
            let [a, b, c] = corners.map(|c| placed.vertices[c as usize].position);
            (a.min(b).min(c), a.max(b).max(c))
        }
        Shape::Sphere(centre, radius) => {
            // The half extent of an ellipsoid along an axis is the length of that row of its matrix.
            let rows: DMat3 = placed.world.matrix3.transpose();
            let reach = DVec3::new(rows.x_axis.length(), rows.y_axis.length(), rows.z_axis.length()) * radius;
            let middle = placed.world.transform_point3(centre);
            (middle - reach, middle + reach)
        }
    };
    let margin = 1e-6 * (upper - lower).length();
    let down = |v: f64| ((v - margin) as f32).next_down();
    let up = |v: f64| ((v + margin) as f32).next_up();
    Aabb::new(
        Vec3A::new(down(lower.x), down(lower.y), down(lower.z)),
        Vec3A::new(up(upper.x), up(upper.y), up(upper.z)),
    )
}
