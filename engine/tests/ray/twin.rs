//! `shaders/lib/ray_software.glsl` and `shaders/lib/intersect.glsl`, line by line in Rust, on the same packed tables. Alpha is left out.
use glam::{Affine3A, UVec2, Vec3, Vec3Swizzles};
use magpie::ray::{MeshBvh, SceneBvh, object_from_world};
use magpie_shaders::scene::{BvhNode, TRAVERSAL_STACK};

pub const NO_HIT: u32 = u32::MAX;
const SMALLEST_COMPONENT: f32 = 1e-20;
const BOX_ROUNDING: f32 = 9.536_743e-7;
const NODE_HITS: u32 = 0xff00_0000;
const ROOT: UVec2 = UVec2::new(0, 0x8000_0000);
const NOTHING: UVec2 = UVec2::ZERO;

#[derive(Clone, Copy, Debug)]
pub struct Ray {
    pub origin: Vec3,
    pub t_min: f32,
    pub direction: Vec3,
    pub t_max: f32,
}

#[derive(Clone, Copy, Debug, PartialEq)]
pub struct Hit {
    pub t: f32,
    pub instance: u32,
    pub primitive: u32,
    pub barycentric: [f32; 2],
    pub front: bool,
}

/// How much a walk took.
#[derive(Default)]
pub struct Work {
    pub nodes: u32,
    pub primitives: u32,
    pub instances: u32,
    pub stack: u32,
}

#[derive(Clone, Copy)]
struct BoxRay {
    origin: Vec3,
    inverse: Vec3,
    octant: u32,
}

struct TriangleRay {
    origin: Vec3,
    axis: u32,
    shear: Vec3,
}

fn box_ray(origin: Vec3, direction: Vec3) -> BoxRay {
    let safe = direction.to_array().map(|d| match d {
        d if d.abs() >= SMALLEST_COMPONENT => d,
        d if d < 0.0 => -SMALLEST_COMPONENT,
        _ => SMALLEST_COMPONENT,
    });
    let octant = (0..3).map(|axis| if safe[axis] < 0.0 { 0 } else { 4 >> axis }).sum();
    BoxRay { origin, inverse: 1.0 / Vec3::from(safe), octant }
}

fn axis_to_z(v: Vec3, axis: u32) -> Vec3 {
    match axis {
        0 => v.yzx(),
        1 => v.zxy(),
        _ => v,
    }
}

fn triangle_ray(origin: Vec3, direction: Vec3) -> TriangleRay {
    let size = direction.abs();
    let axis = match (size.x > size.y, size.x > size.z, size.y > size.z) {
        (true, true, _) => 0,
        (false, _, true) => 1,
        _ => 2,
    };
    let d = axis_to_z(direction, axis);
    TriangleRay { origin, axis, shear: Vec3::new(d.x / d.z, d.y / d.z, 1.0 / d.z) }
}

fn hit_children(node: &BvhNode, ray: &BoxRay, t_min: f32, t_max: f32) -> u32 {
    let e = node.exponents_and_mask;
    let cell = Vec3::from([0, 8, 16].map(|shift| f32::from_bits(((e >> shift) & 255) << 23)));
    let scale = cell * ray.inverse;
    let base = (Vec3::from(node.origin) - ray.origin) * ray.inverse;
    let slack = BOX_ROUNDING * (base.abs() + 255.0 * scale.abs());
    let (near_base, far_base) = (base - slack, base + slack);
    let mut hits = 0;
    for half in 0..2 {
        if node.meta[half] == 0 {
            continue;
        }
        let lower = [node.min_x[half], node.min_y[half], node.min_z[half]];
        let upper = [node.max_x[half], node.max_y[half], node.max_z[half]];
        let backwards = ray.inverse.to_array().map(|d| d < 0.0);
        for shift in (0..32).step_by(8) {
            let plane = |low: bool| {
                Vec3::from(std::array::from_fn(|axis| {
                    let words = if low != backwards[axis] { lower[axis] } else { upper[axis] };
                    ((words >> shift) & 255) as f32
                }))
            };
            let near = plane(true) * scale + near_base;
            let far = plane(false) * scale + far_base;
            assert!(!near.is_nan() && !far.is_nan(), "near {near} far {far}");
            if near.max_element().max(t_min) <= far.min_element().min(t_max) {
                let meta = (node.meta[half] >> shift) & 255;
                let at = meta & 31;
                hits |= (meta >> 5) << if at >= 24 { at ^ ray.octant } else { at };
            }
        }
    }
    hits
}

fn meets_box(ray: &BoxRay, lower: Vec3, upper: Vec3, t_min: f32, t_max: f32) -> bool {
    let (a, b) = ((lower - ray.origin) * ray.inverse, (upper - ray.origin) * ray.inverse);
    let slack = BOX_ROUNDING * a.abs().max(b.abs());
    let (near, far) = (a.min(b) - slack, a.max(b) + slack);
    assert!(!near.is_nan() && !far.is_nan(), "near {near} far {far}");
    near.max_element().max(t_min) <= far.min_element().min(t_max)
}

fn hit_triangle(ray: &TriangleRay, corners: [Vec3; 3], t_min: f32, t_max: f32) -> Option<(f32, [f32; 2], bool)> {
    let [a, b, c] = corners.map(|corner| axis_to_z(corner - ray.origin, ray.axis));
    let [p, q, r] = [a, b, c].map(|corner| corner.xy() - ray.shear.xy() * corner.z);
    let u = r.x * q.y - r.y * q.x;
    let v = p.x * r.y - p.y * r.x;
    let w = q.x * p.y - q.y * p.x;
    let inside = !(u.min(v.min(w)) < 0.0 && u.max(v.max(w)) > 0.0);
    let determinant = u + v + w;
    let has_area = determinant.abs() >= f32::MIN_POSITIVE;
    let t = ray.shear.z * (u * a.z + v * b.z + w * c.z) / determinant;
    (inside && has_area && t > t_min && t < t_max)
        .then(|| (t, [v / determinant, w / determinant], (determinant > 0.0) == (ray.shear.z > 0.0)))
}

fn hit_sphere(
    origin: Vec3,
    direction: Vec3,
    (centre, radius): (Vec3, f32),
    t_min: f32,
    t_max: f32,
) -> Option<(f32, [f32; 2], bool)> {
    let f = origin - centre;
    let a = direction.dot(direction);
    let b = -f.dot(direction);
    let beside = f + (b / a) * direction;
    let discriminant = radius * radius - beside.dot(beside);
    if !matches!(discriminant, d if d >= 0.0) {
        return None;
    }
    let c = f.dot(f) - radius * radius;
    let q = b + if b < 0.0 { -1.0 } else { 1.0 } * (a * discriminant).sqrt();
    let (first, second) = (c / q, q / a);
    let (near, far) = (first.min(second), first.max(second));
    let outside = near > t_min && near < t_max;
    let t = if outside { near } else { far };
    (t > t_min && t < t_max).then_some((t, [0.0; 2], outside))
}

/// What a mesh's table of positions holds.
pub enum Shapes<'a> {
    Triangles(&'a [Vec3]),
    Spheres(&'a [(Vec3, f32)]),
}

/// Everything that the shader reaches through `Scene`.
pub struct Tables<'a> {
    pub scene: &'a SceneBvh,
    pub meshes: &'a [MeshBvh],
    pub shapes: &'a [Shapes<'a>],
    pub instances: &'a [(Affine3A, u32)],
}

impl Tables<'_> {
    pub fn trace(&self, ray: &Ray, any_hit: bool, work: &mut Work) -> Hit {
        let mut hit = Hit { t: ray.t_max, instance: NO_HIT, primitive: NO_HIT, barycentric: [0.0; 2], front: false };
        let mut stack = [NOTHING; TRAVERSAL_STACK as usize];
        let mut height = 0;
        let mut top = NOTHING;
        let mut nodes_left = ROOT;
        let mut instances = NOTHING;

        let world_ray = box_ray(ray.origin, ray.direction);
        let mut level_ray = world_ray;
        let mut nodes = &self.scene.nodes;
        let mut instance = NO_HIT;
        let mut mesh_height = 0;
        let mut mesh_ray = TriangleRay { origin: Vec3::ZERO, axis: 0, shear: Vec3::ZERO };
        let mut mesh_direction = Vec3::ZERO;
        let mut mesh = usize::MAX;

        loop {
            let mut primitives = NOTHING;
            if nodes_left.y & NODE_HITS != 0 {
                let bit = 31 - nodes_left.y.leading_zeros();
                nodes_left.y &= !(1 << bit);
                if nodes_left.y & NODE_HITS != 0 {
                    if top.y != 0 {
                        stack[height - 1] = top;
                    }
                    top = nodes_left;
                    height += 1;
                }
                let slot = (bit - 24) ^ level_ray.octant;
                let before = (nodes_left.y & ((1 << slot) - 1)).count_ones();
                let node = &nodes[(nodes_left.x + before) as usize];
                work.nodes += 1;
                let hits = hit_children(node, &level_ray, ray.t_min, hit.t);
                nodes_left = UVec2::new(node.child_base, (hits & NODE_HITS) | (node.exponents_and_mask >> 24));
                primitives = UVec2::new(node.primitive_base, hits & !NODE_HITS);
                if instance == NO_HIT {
                    instances = primitives;
                    primitives = NOTHING;
                }
            }

            while primitives.y != 0 {
                let bit = primitives.y.trailing_zeros();
                primitives.y &= primitives.y - 1;
                let candidate = &self.meshes[mesh].primitives[(primitives.x + bit) as usize];
                work.primitives += 1;
                let found = match self.shapes[mesh] {
                    Shapes::Spheres(spheres) => {
                        let sphere = spheres[candidate.primitive as usize];
                        hit_sphere(mesh_ray.origin, mesh_direction, sphere, ray.t_min, hit.t)
                    }
                    Shapes::Triangles(positions) => {
                        let corners = candidate.corners.map(|corner| positions[corner as usize]);
                        hit_triangle(&mesh_ray, corners, ray.t_min, hit.t)
                    }
                };
                if let Some((t, barycentric, front)) = found {
                    hit = Hit { t, instance, primitive: candidate.primitive, barycentric, front };
                    if any_hit {
                        nodes_left = NOTHING;
                        instances = NOTHING;
                        height = 0;
                        mesh_height = 0;
                        break;
                    }
                }
            }

            let level_done = nodes_left.y & NODE_HITS == 0;
            if level_done && instance != NO_HIT && height == mesh_height {
                instance = NO_HIT;
                nodes = &self.scene.nodes;
                level_ray = world_ray;
            }
            if instance == NO_HIT && instances.y != 0 {
                if !level_done {
                    if top.y != 0 {
                        stack[height - 1] = top;
                    }
                    top = nodes_left;
                    height += 1;
                    nodes_left = NOTHING;
                }
                let bit = instances.y.trailing_zeros();
                instances.y &= instances.y - 1;
                let candidate = &self.scene.instances[(instances.x + bit) as usize];
                let (lower, upper) = (candidate.min.into(), candidate.max.into());
                if meets_box(&world_ray, lower, upper, ray.t_min, hit.t) {
                    instance = candidate.instance;
                    mesh_height = height;
                    work.instances += 1;
                    let (world_from_object, mesh_index) = self.instances[instance as usize];
                    let inverse = object_from_world(&world_from_object).unwrap();
                    let mesh_origin = inverse.transform_point3(ray.origin);
                    mesh_direction = inverse.transform_vector3(ray.direction);
                    level_ray = box_ray(mesh_origin, mesh_direction);
                    mesh_ray = triangle_ray(mesh_origin, mesh_direction);
                    mesh = mesh_index as usize;
                    nodes = &self.meshes[mesh].nodes;
                    nodes_left = ROOT;
                }
            } else if level_done {
                if height == 0 {
                    break;
                }
                height -= 1;
                if top.y != 0 {
                    nodes_left = top;
                    top = NOTHING;
                } else {
                    nodes_left = stack[height];
                }
            }
            work.stack = work.stack.max(height as u32);
        }
        hit
    }
}
