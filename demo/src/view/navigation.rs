//! Moving the camera: flying, looking around, and turning about a point.
use std::f64::consts::FRAC_PI_2;

use glam::{DAffine3, DMat3, DVec3};
use magpie::{graph::Extent, pixels::Pixels, scene::Camera};

/// Steepest angle up and down, radians: at the zenith itself there is no left and right.
const STEEPEST: f64 = FRAC_PI_2 - 1e-3;
/// Radians per pixel that the pointer is dragged.
const TURN: f64 = 0.003;
/// Factor on the distance or the speed per notch of the wheel.
const NOTCH: f64 = 1.15;
/// Factor on the speed while hurrying.
const HURRY: f64 = 5.0;
/// Least distance to the point that is turned about, in near planes.
const NEAREST: f64 = 4.0;

/// Directions in which the camera flies, each -1 to 1.
#[derive(Clone, Copy, Debug, Default, PartialEq)]
pub struct Flight {
    /// Right.
    pub right: f64,
    /// Up, along the world's y.
    pub up: f64,
    /// Ahead.
    pub ahead: f64,
    /// Faster.
    pub hurries: bool,
}

/// A camera that is moved by hand. Its horizon is level: a roll of the camera that it starts from is lost when it is turned.
#[derive(Clone, Debug)]
pub struct Navigation {
    camera: Camera,
    /// Angle about y, counter-clockwise from -z as seen from above, radians.
    yaw: f64,
    /// Angle above the horizon, radians.
    pitch: f64,
    /// Distance of the point that [`Navigation::orbit`] turns about, metres.
    distance: f64,
    /// Speed of flight, metres per second.
    speed: f64,
}

impl Navigation {
    /// Starts at a camera that looks at something so many metres away.
    pub fn new(camera: &Camera, distance: f64) -> Self {
        let ahead = camera.forward().as_dvec3();
        let distance = distance.max(NEAREST * f64::from(camera.near));
        Self {
            yaw: (-ahead.x).atan2(-ahead.z),
            pitch: ahead.y.clamp(-1.0, 1.0).asin().clamp(-STEEPEST, STEEPEST),
            distance,
            speed: 0.5 * distance,
            camera: camera.clone(),
        }
    }

    /// The camera as it stands.
    pub fn camera(&self) -> &Camera {
        &self.camera
    }

    /// Distance of the point that is turned about, metres.
    pub fn distance(&self) -> f64 {
        self.distance
    }

    /// Speed of flight, metres per second.
    pub fn speed(&self) -> f64 {
        self.speed
    }

    /// Turns the camera where it stands, by a drag of the pointer in pixels.
    pub fn look(&mut self, [right, down]: [f64; 2]) {
        self.turn(right, down);
        self.place(self.camera.eye());
    }

    /// Turns it about the point ahead, by a drag of the pointer in pixels.
    pub fn orbit(&mut self, [right, down]: [f64; 2]) {
        let centre = self.centre();
        self.turn(right, down);
        let eye = centre - self.distance * self.ahead();
        self.place(eye);
    }

    /// Moves it across the line of sight by a drag of the pointer in pixels of a picture of this height: what is at the distance of the point
    /// ahead stays under the pointer.
    pub fn pan(&mut self, [right, down]: [f64; 2], height: f64) {
        let metres = 2.0 * self.distance * (0.5 * f64::from(self.camera.vertical_fov)).tan() / height.max(1.0);
        let DMat3 { x_axis, y_axis, .. } = self.camera.world_from_camera.matrix3;
        self.place(self.camera.eye() + metres * (down * y_axis - right * x_axis));
    }

    /// Moves it towards the point ahead, or away from it with negative notches of the wheel.
    pub fn zoom(&mut self, notches: f64) {
        let centre = self.centre();
        self.distance = (self.distance * NOTCH.powf(-notches)).max(NEAREST * f64::from(self.camera.near));
        self.place(centre - self.distance * self.ahead());
    }

    /// Makes it fly faster, or slower with negative notches of the wheel.
    pub fn change_speed(&mut self, notches: f64) {
        self.speed = (self.speed * NOTCH.powf(notches)).clamp(1e-6, 1e9);
    }

    /// Flies for so many seconds.
    pub fn fly(&mut self, flight: Flight, seconds: f64) {
        let Flight { right, up, ahead, hurries } = flight;
        let matrix = self.camera.world_from_camera.matrix3;
        let direction = right * matrix.x_axis + up * DVec3::Y - ahead * matrix.z_axis;
        let Some(direction) = direction.try_normalize() else { return };
        let speed = self.speed * if hurries { HURRY } else { 1.0 };
        let eye = self.camera.eye() + speed * seconds * direction;
        self.camera.world_from_camera.translation = eye;
    }

    /// Looks at a point from where it stands, and turns about that from now on.
    pub fn look_at(&mut self, point: DVec3) {
        let way = point - self.camera.eye();
        let Some(ahead) = way.try_normalize() else { return };
        self.yaw = (-ahead.x).atan2(-ahead.z);
        self.pitch = ahead.y.asin().clamp(-STEEPEST, STEEPEST);
        self.distance = way.length().max(NEAREST * f64::from(self.camera.near));
        self.place(self.camera.eye());
    }

    fn turn(&mut self, right: f64, down: f64) {
        self.yaw -= TURN * right;
        self.pitch = (self.pitch - TURN * down).clamp(-STEEPEST, STEEPEST);
    }

    fn ahead(&self) -> DVec3 {
        let (sin, cos) = self.pitch.sin_cos();
        DVec3::new(-self.yaw.sin() * cos, sin, -self.yaw.cos() * cos)
    }

    fn centre(&self) -> DVec3 {
        self.camera.eye() + self.distance * -self.camera.world_from_camera.matrix3.z_axis
    }

    fn place(&mut self, eye: DVec3) {
        let rotation = DMat3::from_rotation_y(self.yaw) * DMat3::from_rotation_x(self.pitch);
        self.camera.world_from_camera = DAffine3 { matrix3: rotation, translation: eye };
    }
}

/// The point of the world that is seen in a place of the picture; `None` where that is the sky.
pub(super) fn point_at(depth: &Pixels, [x, y]: [f32; 2], camera: &Camera, aspect: f64) -> Option<DVec3> {
    let Extent { width, height } = depth.extent;
    let texel = |at: f32, side: u32| ((at * side as f32) as u32).min(side.saturating_sub(1));
    let index = texel(y, height) as usize * width as usize + texel(x, width) as usize;
    let bytes = depth.bytes.get(4 * index..4 * index + 4)?;
    let depth = f32::from_le_bytes(bytes.try_into().ok()?);
    if depth <= 0.0 {
        return None;
    }
    let ahead = f64::from(camera.near) / f64::from(depth);
    let slope = (0.5 * f64::from(camera.vertical_fov)).tan();
    let right = (2.0 * f64::from(x) - 1.0) * slope * aspect;
    let up = (1.0 - 2.0 * f64::from(y)) * slope;
    Some(camera.world_from_camera.transform_point3(ahead * DVec3::new(right, up, -1.0)))
}

#[cfg(test)]
mod tests {
    use super::*;
    use glam::Vec3;

    fn start() -> Navigation {
        let camera = Camera::look_at("t", Vec3::new(1.0, 2.0, 3.0), Vec3::new(-2.0, 1.0, -1.0), Vec3::Y, 0.8).unwrap();
        Navigation::new(&camera, 5.0)
    }

    fn is_near(a: DVec3, b: DVec3) -> bool {
        a.distance(b) < 1e-6
    }

    #[test]
    fn depth_gives_the_point_that_is_seen() {
        let camera = start().camera().clone();
        let point = DVec3::new(-1.2, 1.1, 0.3);
        // Where the projection puts the point, and which depth it has there.
        let (extent, aspect) = (Extent::new(64, 32), 2.0);
        let clip = camera.clip_from_view(aspect as f32) * camera.view_from_world(DVec3::ZERO);
        let seen = clip.project_point3(point.as_vec3());
        let at = [0.5 * seen.x + 0.5, 0.5 * seen.y + 0.5];
        let bytes = std::iter::repeat_n(seen.z.to_le_bytes(), 64 * 32).flatten().collect();
        let depth = Pixels { extent, format: magpie::graph::Format::D32Float, bytes };
        let found = point_at(&depth, at, &camera, aspect).unwrap();
        assert!(found.distance(point) < 1e-3, "{found}");
        let sky = Pixels { bytes: vec![0; 4 * 64 * 32], ..depth };
        assert_eq!(point_at(&sky, at, &camera, aspect), None);
    }

    #[test]
    fn it_starts_where_the_camera_is() {
        let mut navigation = start();
        let before = navigation.camera().clone();
        assert_eq!(*navigation.camera(), before);
        navigation.look([0.0, 0.0]);
        let after = navigation.camera();
        assert!(is_near(after.eye(), before.eye()));
        assert!(after.forward().distance(before.forward()) < 1e-5, "{} {}", after.forward(), before.forward());
    }

    #[test]
    fn orbits_keep_their_centre_and_their_distance() {
        let mut navigation = start();
        let centre = navigation.centre();
        for drag in [[100.0, 0.0], [-40.0, 300.0], [7.0, -5000.0], [1e4, 3.0]] {
            navigation.orbit(drag);
            assert!(is_near(navigation.centre(), centre), "{drag:?}");
            assert!((navigation.camera().eye().distance(centre) - 5.0).abs() < 1e-6);
        }
    }

    #[test]
    fn drags_turn_towards_the_pointer() {
        let mut navigation = start();
        let right = navigation.camera().world_from_camera.matrix3.x_axis;
        let before = navigation.camera().forward().as_dvec3();
        navigation.look([50.0, 0.0]);
        assert!(navigation.camera().forward().as_dvec3().dot(right) > before.dot(right));
        navigation.look([0.0, -50.0]);
        assert!(navigation.camera().forward().y > before.as_vec3().y);
    }

    #[test]
    fn the_horizon_stays_level_and_the_zenith_is_not_passed() {
        let mut navigation = start();
        for _ in 0..100 {
            navigation.look([13.0, -400.0]);
        }
        let matrix = navigation.camera().world_from_camera.matrix3;
        assert!(matrix.x_axis.y.abs() < 1e-9 && matrix.y_axis.y > 0.0, "{matrix}");
        assert!((matrix.determinant() - 1.0).abs() < 1e-9);
    }

    #[test]
    fn panning_keeps_the_point_under_the_pointer() {
        // A drag over the whole height of the picture moves by the height that is seen at that distance.
        let mut navigation = start();
        let (before, up) = (navigation.camera().eye(), navigation.camera().world_from_camera.matrix3.y_axis);
        navigation.look([0.0, 0.0]);
        navigation.pan([0.0, 200.0], 200.0);
        let moved = navigation.camera().eye() - before;
        let height = 2.0 * 5.0 * 0.4_f64.tan();
        assert!((moved.dot(up) - height).abs() < 1e-4, "{moved} {height}");
    }

    #[test]
    fn zooming_never_passes_the_point() {
        let mut navigation = start();
        let centre = navigation.centre();
        for _ in 0..500 {
            navigation.zoom(3.0);
        }
        let left = navigation.camera().eye().distance(centre);
        assert!(left > 0.0 && left < 0.1, "{left}");
        assert!(is_near(navigation.centre(), centre));
    }

    #[test]
    fn flight_is_as_fast_in_every_direction() {
        for flight in [
            Flight { ahead: 1.0, ..Flight::default() },
            Flight { ahead: 1.0, right: -1.0, up: 1.0, ..Flight::default() },
        ] {
            let mut navigation = start();
            let before = navigation.camera().eye();
            navigation.fly(flight, 2.0);
            assert!((navigation.camera().eye().distance(before) - 2.0 * navigation.speed()).abs() < 1e-9);
        }
        let mut navigation = start();
        let before = navigation.camera().clone();
        navigation.fly(Flight::default(), 1.0);
        assert_eq!(*navigation.camera(), before);
    }

    #[test]
    fn looking_at_a_point_puts_it_ahead() {
        let mut navigation = start();
        let point = DVec3::new(4.0, -1.0, 7.0);
        navigation.look_at(point);
        assert!(is_near(navigation.centre(), point));
        let eye = navigation.camera().eye();
        navigation.look_at(eye);
        assert!(is_near(navigation.camera().eye(), eye) && navigation.camera().forward().is_finite());
    }
}
