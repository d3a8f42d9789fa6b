//! Supplies what a scene needs to be rendered: a camera that frames it, a sun, a sky.
use super::emissive::{MIN_LIT_FRACTION, lit_fraction};
use super::{Animator, Camera, Daylight, Material, Scene, deform};
use crate::ray::COORDINATE_LIMIT;
use glam::{DMat3, DVec3, Vec3};
use std::borrow::Cow;

/// Aspect ratio that a supplied camera fits.
const ASPECT: f64 = 16.0 / 9.0;
/// Vertical angle of view of a supplied camera, radians (35 degrees).
const FOV: f64 = 0.610_865_238_198_015_3;
/// Fraction of the picture's half width and height that the scene fills.
const FILLED_FRACTION: f64 = 0.94;
/// Directions of a supplied camera, degrees: azimuth from +z (the front of a glTF scene) towards +x, and elevation. The first is
/// used unless another sees clearly more.
const VIEWS: [[f64; 2]; 8] = [
    [35.0, 20.0],
    [-35.0, 20.0],
    [12.0, 30.0],
    [-12.0, 30.0],
    [145.0, 20.0],
    [-145.0, 20.0],
    [168.0, 30.0],
    [-168.0, 30.0],
];
/// Factor by which another view must see more instances; twice that if it looks from behind, which is only justified by walls in front.
const CLEARLY_MORE: f64 = 1.15;
const FROM_BEHIND: f64 = 2.0;
/// Elevation of a supplied sun, and its azimuth relative to the camera, degrees.
const SUN: [f32; 2] = [50.0, 50.0];
/// Resolution at which visible instances are counted, pixels.
const VISIBILITY_SIZE: [usize; 2] = [256, 144];

/// What is supplied to a scene that lacks it.
#[derive(Clone, Copy, Debug, Default, PartialEq, Eq)]
pub enum Supply {
    /// Nothing. A scene without lights is dark except for emission, and one without a camera needs one from elsewhere.
    Nothing,
    /// A camera only.
    Camera,
    /// A camera, a sun and a sky.
    #[default]
    All,
}

/// Supplies everything that is missing: [`supply`] with [`Supply::All`].
pub fn supply_missing(scene: &mut Scene) {
    supply(scene, Supply::All);
}

/// Supplies what is missing, as far as `wanted`, with a notice for each in [`Scene::supplied`]: a camera that frames the
/// geometry; and a sun and a sky if there are no lights, no daylight and no environment map, and emissive surfaces light less
/// than a quarter of the scene's surfaces. A scene without materials always gets the default one.
pub fn supply(scene: &mut Scene, wanted: Supply) {
    if scene.materials.is_empty() {
        scene.materials.push(Material::default());
    }
    if wanted != Supply::Nothing && scene.cameras.is_empty() {
        let camera = frame(scene);
        let eye = camera.eye();
        scene.supplied.push(format!("the scene has no camera: one at {eye:.2} frames it"));
        scene.cameras.push(camera);
    }
    if wanted == Supply::All && scene.lights.is_empty() && scene.daylight.is_none() && scene.environment.is_none() {
        supply_light(scene);
    }
}

/// Supplies a sun and a sky, unless emissive surfaces light the scene well enough.
fn supply_light(scene: &mut Scene) {
    let Some(camera) = scene.cameras.first() else { return };
    let to_sun = sun_for(camera);
    let lit = lit_fraction(scene);
    let percent = (100.0 * lit).round();
    if lit >= MIN_LIT_FRACTION {
        scene.supplied.push(format!("what emits lights {percent} % of the surfaces: no sun and no sky are supplied"));
        return;
    }
    let daylight = Daylight { to_sun, ..Daylight::default() };
    scene.lights.push(daylight.sun());
    scene.daylight = Some(daylight);
    let glow =
        if lit > 0.0 { format!(", and what emits lights only {percent} % of the surfaces") } else { String::new() };
    scene.supplied.push(format!("the scene has no light{glow}: a sun from {to_sun:.2} and a clear sky are supplied"));
}

/// Direction towards the sun: behind the camera, to its left and above. Front faces are lit, and shadows fall to the right and
/// away, where they are visible.
fn sun_for(camera: &Camera) -> Vec3 {
    let forward = camera.forward();
    // For a camera that looks straight down, its up direction is ahead.
    let flat = Vec3::new(forward.x, 0.0, forward.z);
    let ahead = flat.try_normalize().unwrap_or_else(|| {
        let up = camera.world_from_camera.matrix3.y_axis.as_vec3();
        Vec3::new(up.x, 0.0, up.z).normalize_or(Vec3::NEG_Z)
    });
    let [elevation, side] = SUN.map(f32::to_radians);
    let left = Vec3::Y.cross(ahead);
    let around = -ahead * side.cos() + left * side.sin();
    (around * elevation.cos() + Vec3::Y * elevation.sin()).normalize()
}

/// A camera under construction: a rotation (camera axes in columns), an eye, and the largest depth of a vertex.
struct Framing {
    axes: DMat3,
    eye: DVec3,
    depth: f64,
}

/// An instance at the start of the animation.
pub(super) struct PosedInstance<'a> {
    pub world: glam::DAffine3,
    pub positions: Cow<'a, [Vec3]>,
    pub indices: Cow<'a, [u32]>,
    /// Spheres: centre in the world, and transform of the unit sphere to world space.
    pub spheres: Vec<(DVec3, DMat3)>,
    double_sided: bool,
}

impl PosedInstance<'_> {
    fn vertices(&self) -> impl Iterator<Item = DVec3> {
        self.positions.iter().map(|p| self.world.transform_point3(p.as_dvec3())).filter(|p| reachable(*p))
    }
}

/// Geometry that an animation moves out of range is not framed.
fn reachable(p: DVec3) -> bool {
    p.is_finite() && p.abs().max_element() <= f64::from(COORDINATE_LIMIT)
}

/// All instances of a scene, in order.
pub(super) fn posed_instances(scene: &Scene) -> Vec<PosedInstance<'_>> {
    let pose = Animator::new(scene).pose(0.0);
    let posed = |(i, instance): (usize, &super::Instance)| {
        let (mesh, world) = (&scene.meshes[instance.mesh as usize], pose.instances[i]);
        let positions = match pose.bounds[i] {
            Some(_) => Cow::Owned(deform(mesh, &pose.joints[i], &pose.weights[i]).positions),
            None => Cow::Borrowed(&mesh.positions[..]),
        };
        let ball =
            |s: &super::Sphere| (world.transform_point3(s.centre.as_dvec3()), world.matrix3 * f64::from(s.radius));
        let spheres = mesh.spheres.iter().map(ball).filter(|(c, m)| reachable(*c) && m.is_finite()).collect();
        let double_sided = scene.materials[instance.material as usize].double_sided;
        PosedInstance { world, positions, indices: Cow::Borrowed(&mesh.indices), spheres, double_sided }
    };
    scene.instances.iter().enumerate().map(posed).collect()
}

/// The nearest camera in one of the directions of [`VIEWS`] that has all geometry in the picture.
fn frame(scene: &Scene) -> Camera {
    let posed_instances = posed_instances(scene);
    let mut best: Option<(f64, Framing)> = None;
    for [azimuth, elevation] in VIEWS {
        let view = fit(&posed_instances, azimuth.to_radians(), elevation.to_radians());
        let seen = visible_instances(&posed_instances, &view);
        let more = if azimuth.abs() > 90.0 { FROM_BEHIND } else { CLEARLY_MORE };
        if best.as_ref().is_none_or(|(most, _)| seen > most * more) {
            best = Some((seen, view));
        }
    }
    let view = best.map_or_else(|| fit(&posed_instances, 0.6, 0.35), |(_, view)| view);
    let world_from_camera = glam::DAffine3 { matrix3: view.axes.as_mat3().as_dmat3(), translation: view.eye };
    let near = ((view.depth * 1e-3) as f32).max(f32::MIN_POSITIVE);
    Camera { name: "supplied".to_owned(), world_from_camera, vertical_fov: FOV as f32, near }
}

/// Moves the eye back until all geometry is inside the four side planes of the frustum. Each plane gives a linear bound: for
/// camera coordinates `q` and a slope `s`, `q.x - e.x <= s (e.z - q.z)`, so only the largest `q.x + s q.z` counts. For an
/// ellipsoid `c + M u` (`u` in the unit ball), the largest `f . q` is `f . c + |M^T f|`.
fn fit(posed_instances: &[PosedInstance<'_>], azimuth: f64, elevation: f64) -> Framing {
    let back = DVec3::new(azimuth.sin() * elevation.cos(), elevation.sin(), azimuth.cos() * elevation.cos());
    let right = DVec3::Y.cross(back).normalize();
    let axes = DMat3::from_cols(right, back.cross(right), back);
    let into_camera = axes.transpose();
    let sy = (0.5 * FOV).tan() * FILLED_FRACTION;
    let sx = sy * ASPECT;
    let v = DVec3::new;
    let planes = [v(1.0, 0.0, sx), v(-1.0, 0.0, sx), v(0.0, 1.0, sy), v(0.0, -1.0, sy), DVec3::Z, DVec3::NEG_Z];
    let mut most = [f64::NEG_INFINITY; 6];
    for posed in posed_instances {
        for p in posed.vertices() {
            let q = into_camera * p;
            for (most, plane) in most.iter_mut().zip(planes) {
                *most = most.max(plane.dot(q));
            }
        }
        for (centre, ball) in &posed.spheres {
            let (q, reach) = (into_camera * *centre, (into_camera * *ball).transpose());
            for (most, plane) in most.iter_mut().zip(planes) {
                *most = most.max(plane.dot(q) + (reach * plane).length());
            }
        }
    }
    let [right, left, top, bottom, front, behind] = most;
    let least_z = -behind;
    if !least_z.is_finite() {
        // There is nothing to frame.
        return Framing { axes, eye: back * 5.0, depth: 5.0 };
    }
    let z = (0.5 * (right + left) / sx).max(0.5 * (top + bottom) / sy);
    // A single point, or a flat object seen from the side, has no extent to step back from.
    let extent = (front - least_z).max(z - front).max(front.abs() * 1e-6).max(1e-6);
    let z = z.max(front + 0.05 * extent);
    let eye = axes * DVec3::new(0.5 * (right - left), 0.5 * (top - bottom), z);
    Framing { axes, eye, depth: z - least_z }
}

/// The faces of an octahedron in the unit sphere, counter-clockwise from outside. Good enough for counting visible spheres.
fn octahedron() -> impl Iterator<Item = [DVec3; 3]> {
    (0..8).map(|i| {
        let sign = |bit: usize| if i >> bit & 1 == 0 { 1.0 } else { -1.0 };
        let [a, b, c] = [DVec3::X * sign(0), DVec3::Y * sign(1), DVec3::Z * sign(2)];
        if sign(0) * sign(1) * sign(2) > 0.0 { [a, b, c] } else { [a, c, b] }
    })
}

/// How much of the scene a view shows: the number of instances with at least a few visible pixels.
fn visible_instances(posed_instances: &[PosedInstance<'_>], view: &Framing) -> f64 {
    const MIN_PIXELS: u32 = 3;
    let [width, height] = VISIBILITY_SIZE;
    let mut nearest = vec![(f64::INFINITY, u32::MAX); width * height];
    let into_camera = view.axes.transpose();
    let scale = height as f64 * 0.5 / (0.5 * FOV).tan();
    let corner = |p: DVec3| {
        let q = into_camera * (p - view.eye);
        let depth = (-q.z).max(1e-9);
        DVec3::new(width as f64 * 0.5 + q.x / depth * scale, height as f64 * 0.5 + q.y / depth * scale, depth)
    };
    for (id, posed) in posed_instances.iter().enumerate() {
        let turned = posed.world.matrix3.determinant() < 0.0;
        let corners: Vec<DVec3> =
            posed.positions.iter().map(|p| corner(posed.world.transform_point3(p.as_dvec3()))).collect();
        let triangles = posed.indices.chunks_exact(3).map(|t| [0, 1, 2].map(|k| corners[t[k] as usize]));
        let spheres = posed.spheres.iter().flat_map(|(c, m)| octahedron().map(|t| t.map(|p| corner(*c + *m * p))));
        for t in triangles.chain(spheres) {
            rasterize(t, !posed.double_sided, turned, |at, depth| {
                if depth < nearest[at].0 {
                    nearest[at] = (depth, id as u32);
                }
            });
        }
    }
    let mut pixels = vec![0_u32; posed_instances.len()];
    for (_, id) in nearest {
        if let Some(n) = pixels.get_mut(id as usize) {
            *n += 1;
        }
    }
    pixels.iter().filter(|n| **n >= MIN_PIXELS).count() as f64
}

/// Calls `put` with each pixel whose centre a triangle covers, and its depth (interpolated as 1/depth).
fn rasterize([a, b, c]: [DVec3; 3], culled: bool, turned: bool, mut put: impl FnMut(usize, f64)) {
    let [width, height] = VISIBILITY_SIZE;
    let area = (b - a).truncate().perp_dot((c - a).truncate());
    if area == 0.0 || !area.is_finite() || (culled && (area > 0.0) == turned) {
        return;
    }
    let range = |axis: usize, size: usize| {
        let lo = (a[axis].min(b[axis]).min(c[axis]) - 0.5).ceil().max(0.0) as usize;
        let hi = (a[axis].max(b[axis]).max(c[axis]) - 0.5).floor().min(size as f64 - 1.0);
        lo..(hi + 1.0).max(0.0) as usize
    };
    for y in range(1, height) {
        for x in range(0, width) {
            let p = glam::DVec2::new(x as f64 + 0.5, y as f64 + 0.5);
            let weight = |u: DVec3, v: DVec3| (v - u).truncate().perp_dot(p - u.truncate()) / area;
            let (wa, wb, wc) = (weight(b, c), weight(c, a), weight(a, b));
            if wa >= 0.0 && wb >= 0.0 && wc >= 0.0 {
                put(y * width + x, 1.0 / (wa / a.z + wb / b.z + wc / c.z));
            }
        }
    }
}

#[cfg(test)]
mod tests {
    use super::*;
    use crate::scene::{Environment, Instance, Light, Mesh, Sphere};
    use glam::{Affine3A, Vec4};

    fn cloud(points: Vec<Vec3>) -> Scene {
        let n = points.len() as u32;
        let mesh = Mesh {
            positions: points,
            colours: vec![Vec4::ONE; n as usize],
            indices: (0..n).flat_map(|i| [i, (i + 1) % n, (i + 2) % n]).collect(),
            ..Mesh::default()
        };
        let instance = Instance::fixed("i", 0, 0, Affine3A::from_scale(Vec3::splat(2.0)));
        Scene { meshes: vec![mesh], instances: vec![instance], ..Scene::default() }
    }

    fn corners(half: Vec3, centre: Vec3) -> Vec<Vec3> {
        (0..8)
            .map(|i| centre + half * Vec3::new([-1.0, 1.0][i & 1], [-1.0, 1.0][i >> 1 & 1], [-1.0, 1.0][i >> 2]))
            .collect()
    }

    #[test]
    fn the_supplied_camera_frames_tightly() {
        for (half, centre) in [
            (Vec3::ONE, Vec3::ZERO),
            (Vec3::new(50.0, 1.0, 1.0), Vec3::splat(1000.0)),
            (Vec3::new(1e-3, 2e-3, 1e-3), Vec3::ZERO),
            (Vec3::new(1.0, 40.0, 1.0), Vec3::NEG_X),
        ] {
            let mut scene = cloud(corners(half, centre));
            supply_missing(&mut scene);
            let camera = &scene.cameras[0];
            let clip = camera.clip_from_view(ASPECT as f32) * camera.view_from_world(DVec3::ZERO);
            let mut most = 0.0_f32;
            for p in posed_instances(&scene)[0].vertices() {
                let p = clip * p.as_vec3().extend(1.0);
                assert!(p.w > camera.near, "in front of the near plane: {half} {p}");
                most = most.max((p.x / p.w).abs()).max((p.y / p.w).abs());
            }
            assert!(most > 0.90 && most < 0.98, "{half}: {most}");
        }
    }

    #[test]
    fn spheres_are_framed_to_their_rims() {
        let mut scene = cloud(Vec::new());
        let ball = |x: f32, radius| Sphere { centre: Vec3::X * x, radius };
        scene.meshes[0].spheres = vec![ball(-3.0, 1.0), ball(2.0, 0.5)];
        scene.instances[0].world_from_object.matrix3.y_axis *= 2.0;
        supply_missing(&mut scene);
        let camera = &scene.cameras[0];
        let clip = camera.clip_from_view(ASPECT as f32) * camera.view_from_world(DVec3::ZERO);
        let mut most = 0.0_f32;
        let place = scene.instances[0].world_from_object;
        for s in &scene.meshes[0].spheres {
            for i in 0..20_000_u32 {
                let (y, around) = ((i as f32 + 0.5) / 10_000.0 - 1.0, i as f32 * 2.399_963);
                let flat = (1.0 - y * y).sqrt();
                let on = s.centre + s.radius * Vec3::new(flat * around.cos(), y, flat * around.sin());
                let p = clip * place.transform_point3(on.as_dvec3()).as_vec3().extend(1.0);
                assert!(p.w > camera.near);
                most = most.max((p.x / p.w).abs()).max((p.y / p.w).abs());
            }
        }
        assert!(most > 0.90 && most < 0.98, "{most}");
    }

    #[test]
    fn the_sun_lights_what_the_camera_sees() {
        let mut scene = cloud(corners(Vec3::ONE, Vec3::ZERO));
        supply_missing(&mut scene);
        let Light::Directional { direction, .. } = scene.lights[0] else { panic!("not a sun") };
        let to_sun = scene.daylight.as_ref().unwrap().to_sun;
        assert!(to_sun.abs_diff_eq(-direction, 1e-6) && (to_sun.length() - 1.0).abs() < 1e-5);
        assert!((to_sun.y.asin().to_degrees() - 50.0).abs() < 0.1);
        let forward = scene.cameras[0].forward();
        assert!(direction.dot(forward) > 0.3, "from behind the camera");
        let right = scene.cameras[0].world_from_camera.matrix3.x_axis.as_vec3();
        assert!(direction.dot(right) > 0.3, "from its left");
        assert_eq!(scene.supplied.len(), 2, "{:?}", scene.supplied);
    }

    #[test]
    fn what_is_there_is_kept() {
        let mut scene = cloud(corners(Vec3::ONE, Vec3::ZERO));
        let camera = Camera::look_at("own", Vec3::Y * 5.0, Vec3::ZERO, Vec3::X, 1.0).unwrap();
        scene.cameras.push(camera.clone());
        scene.lights.push(Light::Point { position: DVec3::Y, intensity: Vec3::ONE, range: None });
        supply_missing(&mut scene);
        assert_eq!(scene.cameras, [camera]);
        assert!(scene.daylight.is_none() && scene.lights.len() == 1 && scene.supplied.is_empty());
    }

    #[test]
    fn only_what_is_wanted_is_supplied() {
        for (wanted, cameras, lights) in [(Supply::Nothing, 0, 0), (Supply::Camera, 1, 0), (Supply::All, 1, 1)] {
            let mut scene = cloud(corners(Vec3::ONE, Vec3::ZERO));
            supply(&mut scene, wanted);
            assert_eq!((scene.cameras.len(), scene.lights.len()), (cameras, lights), "{wanted:?}");
            assert_eq!((scene.daylight.iter().count(), scene.supplied.len()), (lights, cameras + lights), "{wanted:?}");
            assert_eq!(scene.materials.len(), 1, "{wanted:?}: a material in any case");
        }
    }

    #[test]
    fn an_environment_map_is_light_enough() {
        let mut surrounded = cloud(corners(Vec3::ONE, Vec3::ZERO));
        let name = "grey".to_owned();
        let radiance = [Vec3::ONE].into();
        surrounded.environment = Some(Environment { name, width: 1, height: 1, radiance, scale: 1.0, turn: 0.0 });
        supply_missing(&mut surrounded);
        assert!(surrounded.lights.is_empty() && surrounded.daylight.is_none(), "{:?}", surrounded.supplied);
        assert_eq!(surrounded.supplied.len(), 1, "the camera");
    }

    #[test]
    fn points_and_nothing_are_framed_too() {
        for points in [vec![], vec![Vec3::splat(3.0); 3], corners(Vec3::new(1.0, 0.0, 0.0), Vec3::ZERO)] {
            let mut scene = cloud(points);
            supply_missing(&mut scene);
            let camera = &scene.cameras[0];
            assert!(camera.world_from_camera.is_finite() && camera.near > 0.0);
        }
    }

    #[test]
    fn a_wall_in_front_is_walked_around() {
        // Many small objects behind a wall that hides them from the front.
        let mut scene = cloud(corners(Vec3::new(4.0, 3.0, 0.1), Vec3::new(0.0, 0.0, 3.0)));
        scene.meshes[0].indices =
            (0..8).flat_map(|a| (0..8).flat_map(move |b| (0..8).flat_map(move |c| [a, b, c]))).collect();
        scene.materials.push(Material { double_sided: true, ..Material::default() });
        scene.meshes.push(cloud(corners(Vec3::splat(0.3), Vec3::ZERO)).meshes.remove(0));
        for i in 0..12 {
            let at = Affine3A::from_translation(Vec3::new(i as f32 - 6.0, -4.0, -5.0));
            scene.instances.push(Instance::fixed("small", 1, 0, at));
        }
        supply_missing(&mut scene);
        assert!(scene.cameras[0].eye().z < 0.0, "{}", scene.cameras[0].eye());
    }
}
