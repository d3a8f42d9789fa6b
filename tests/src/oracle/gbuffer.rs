//! Camera and G-buffer decoding in double precision.

use glam::{DMat3, DVec3};
use magpie::graph::Extent;
use magpie::scene::Camera;

/// A camera in double precision.
#[derive(Clone, Copy, Debug)]
pub struct Eye {
    /// Its position, world, metres.
    pub position: DVec3,
    rotation: DMat3,
    scale: [f64; 2],
    size: [f64; 2],
    near: f64,
}

impl Eye {
    /// For an image of this size.
    pub fn new(camera: &Camera, extent: Extent) -> Self {
        let rotation = camera.world_from_camera.matrix3;
        let half = (0.5 * f64::from(camera.vertical_fov)).tan();
        let size = [f64::from(extent.width), f64::from(extent.height)];
        let position = camera.eye();
        Self { position, rotation, scale: [half * size[0] / size[1], half], size, near: camera.near.into() }
    }

    /// Direction through a point of the image, pixels from its upper left corner; of unit view depth.
    pub fn ray(&self, x: f64, y: f64) -> DVec3 {
        let (u, v) = (x / self.size[0] * 2.0 - 1.0, y / self.size[1] * 2.0 - 1.0);
        self.rotation * DVec3::new(u * self.scale[0], -v * self.scale[1], -1.0)
    }

    /// Direction through the centre of a pixel, given by its index row by row.
    pub fn pixel_ray(&self, pixel: usize) -> DVec3 {
        let width = self.size[0] as usize;
        self.ray((pixel % width) as f64 + 0.5, (pixel / width) as f64 + 0.5)
    }

    /// View depth of a reversed depth; 0 for background.
    pub fn view_depth(&self, depth: f32) -> f64 {
        if depth > 0.0 { self.near / f64::from(depth) } else { 0.0 }
    }

    /// uv of a point, 0 to 1 from the upper left corner; `None` behind the camera.
    pub fn project(&self, world: DVec3) -> Option<[f64; 2]> {
        let seen = self.rotation.transpose() * (world - self.position);
        let depth = -seen.z;
        (depth > 0.0).then(|| [0.5 + 0.5 * seen.x / depth / self.scale[0], 0.5 - 0.5 * seen.y / depth / self.scale[1]])
    }

    /// World position of a pixel's centre at a reversed depth.
    pub fn world_position(&self, pixel: usize, depth: f32) -> DVec3 {
        self.position + self.pixel_ray(pixel) * self.view_depth(depth)
    }
}

/// A unit vector from two 16-bit signed numbers as [`Pixels::values`](magpie::pixels::Pixels::values) gives them
/// (Cigolle et al. 2014).
pub fn octahedral(x: f32, y: f32) -> DVec3 {
    let exact = |v: f32| (f64::from(v) * 32767.0).round() / 32767.0;
    let (x, y) = (exact(x), exact(y));
    let z = 1.0 - x.abs() - y.abs();
    let folded = |a: f64, b: f64| (1.0 - b.abs()).copysign(a);
    let v = if z < 0.0 { DVec3::new(folded(x, y), folded(y, x), z) } else { DVec3::new(x, y, z) };
    v.normalize()
}
