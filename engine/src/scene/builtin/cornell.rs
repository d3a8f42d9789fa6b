//! The Cornell box, with the measured geometry that Cornell's Program of Computer Graphics published. Its millimetres are
//! centimetres here, so the box is 5.5 m wide. It is turned so that the camera looks along -z.
use super::shapes::Shape;
use super::stage::{Stage, dielectric, matte};
use crate::scene::{Light, Scene};
use glam::{Affine3A, Vec3};

/// Published reflectances, as linear Rec.709.
const WHITE: [f32; 3] = [0.73, 0.73, 0.73];
const RED: [f32; 3] = [0.63, 0.065, 0.05];
const GREEN: [f32; 3] = [0.14, 0.45, 0.091];
/// Radiance of the lamp: the published colour, scaled so that white surfaces have a radiance near 1.
const LAMP: Vec3 = Vec3::new(34.0, 24.0, 8.0);
/// Distance of the lamp from the ceiling, metres, so that they are not coplanar.
const GAP: f32 = 0.005;

/// Converts published coordinates (hundredths of a unit here) to metres, with x to the right and z towards the viewer.
fn point([x, y, z]: [f32; 3]) -> Vec3 {
    Vec3::new(278.0 - x, y, -z) * 0.01
}

fn quads(corners: &[[[f32; 3]; 4]]) -> Shape {
    let mut shape = Shape::default();
    for quad in corners {
        shape.quad(quad.map(point));
    }
    shape
}

/// A block from the corners of its top, counter-clockwise from above in the published coordinates.
fn block(top: [[f32; 2]; 4], height: f32) -> Shape {
    let at = |i: usize, y: f32| [top[i % 4][0], y, top[i % 4][1]];
    let mut faces = vec![
        [at(0, height), at(1, height), at(2, height), at(3, height)],
        [at(3, 0.0), at(2, 0.0), at(1, 0.0), at(0, 0.0)],
    ];
    faces.extend((0..4).map(|i| [at(i, height), at(i, 0.0), at(i + 1, 0.0), at(i + 1, height)]));
    quads(&faces)
}

pub(super) fn scene() -> Scene {
    let mut stage = Stage::new("cornell");
    let white = stage.material(matte("white", WHITE));
    let red = stage.material(matte("red", RED));
    let green = stage.material(matte("green", GREEN));
    let mut lamp = dielectric("lamp", [0.0; 3], 1.0);
    lamp.emission = LAMP;
    lamp.shows_light = true;
    let lamp = stage.material(lamp);

    let here = Affine3A::IDENTITY;
    let (w, h, d) = (552.8, 548.8, 559.2);
    let walls = [
        ("floor", white, [[w, 0.0, 0.0], [0.0, 0.0, 0.0], [0.0, 0.0, d], [549.6, 0.0, d]]),
        ("ceiling", white, [[556.0, h, 0.0], [556.0, h, d], [0.0, h, d], [0.0, h, 0.0]]),
        ("back wall", white, [[549.6, 0.0, d], [0.0, 0.0, d], [0.0, h, d], [556.0, h, d]]),
        ("right wall", green, [[0.0, 0.0, d], [0.0, 0.0, 0.0], [0.0, h, 0.0], [0.0, h, d]]),
        ("left wall", red, [[w, 0.0, 0.0], [549.6, 0.0, d], [556.0, h, d], [556.0, h, 0.0]]),
    ];
    for (name, material, corners) in walls {
        stage.add(name, quads(&[corners]), material, here);
    }
    let short = [[130.0, 65.0], [82.0, 225.0], [240.0, 272.0], [290.0, 114.0]];
    let tall = [[423.0, 247.0], [265.0, 296.0], [314.0, 456.0], [472.0, 406.0]];
    stage.add("short block", block(short, 165.0), white, here);
    stage.add("tall block", block(tall, 330.0), white, here);

    let y = h - 100.0 * GAP;
    let corners = [[343.0, y, 227.0], [343.0, y, 332.0], [213.0, y, 332.0], [213.0, y, 227.0]];
    stage.add("lamp", quads(&[corners]), lamp, here);
    let [a, b, c, d] = corners.map(point);
    stage.scene.lights.push(Light::Rectangle {
        // Slightly in front of the mesh that shows the light, which would otherwise block it.
        centre: (0.25 * (a + b + c + d) - Vec3::Y * 0.002).into(),
        half_u: 0.5 * (b - a),
        half_v: 0.5 * (d - a),
        radiance: LAMP,
    });
    stage.camera("default", [0.0, 2.73, 8.0], [0.0, 2.73, 0.0], 39.3);
    stage.scene
}
