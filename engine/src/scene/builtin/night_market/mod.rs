//! A market street at night after rain: lanterns and bulbs against cold neon, all of it once more in the puddles.
//!
//! The street runs along -z and bends to the left, so that house fronts close the view. Stalls stand on both pavements; lanterns and strings
//! of lamps hang above. `lights` says how many lamps there are: more lamps are weaker and closer together, and together as strong.
use super::stage::Stage;
use crate::scene::{Environment, Scene};
use batch::Batch;
use glam::{Affine3A, Quat, Vec3};
use lamps::Sites;
use palette::Palette;

mod batch;
mod clutter;
mod goods;
mod houses;
mod lamps;
mod lettering;
mod moving;
mod neon;
mod palette;
mod stalls;
mod street;
mod textures;

/// Ends of the street, metres along its middle.
const BEGIN: f32 = -10.0;
const END: f32 = 46.0;
/// Where the bend begins, metres along the street, and its radius.
const BEND: f32 = 11.0;
const RADIUS: f32 = 46.0;
/// From the middle of the street to the kerbs and to the house fronts, metres.
const KERB: f32 = 2.7;
const FRONT: f32 = 4.4;
/// Height of the pavements, metres.
const PAVEMENT: f32 = 0.10;
/// Depth to which things are sunk into the ground, metres, so that no bottom face is coplanar with it.
const SUNK: f32 = 0.004;

/// A place in the street: metres along its middle, to the right of it, and up. Its x axis points to the right, its -z axis along the street.
fn along(s: f32, across: f32, up: f32) -> Affine3A {
    let turn = (s - BEND).max(0.0) / RADIUS;
    let turned = Quat::from_rotation_y(turn);
    let middle = if turn > 0.0 {
        Vec3::new(-RADIUS * (1.0 - turn.cos()), 0.0, -BEND - RADIUS * turn.sin())
    } else {
        Vec3::NEG_Z * s
    };
    Affine3A::from_rotation_translation(turned, middle + turned * Vec3::X * across + Vec3::Y * up)
}

/// The point of [`along`].
fn point(s: f32, across: f32, up: f32) -> Vec3 {
    along(s, across, up).translation.into()
}

/// A rotation about y, degrees.
fn turn(degrees: f32) -> Affine3A {
    Affine3A::from_rotation_y(degrees.to_radians())
}

/// A side of the street.
#[derive(Clone, Copy, PartialEq)]
enum Side {
    Left,
    Right,
}

impl Side {
    const BOTH: [Self; 2] = [Self::Left, Self::Right];

    /// -1 to the left, 1 to the right.
    fn sign(self) -> f32 {
        if self == Self::Left { -1.0 } else { 1.0 }
    }

    /// A place so far from the middle that looks at the street: z points to its middle, x to the right as seen from there.
    fn facing(self, s: f32, from_middle: f32, up: f32) -> Affine3A {
        along(s, self.sign() * from_middle, up) * turn(-90.0 * self.sign())
    }
}

/// The market under construction.
struct Market {
    stage: Stage,
    batch: Batch,
    paint: Palette,
    /// Where lamps may hang.
    sites: Sites,
}

/// The market with this many lamps, 10 and more.
pub(super) fn scene(lights: u32) -> Scene {
    let mut stage = Stage::new("night-market");
    let paint = palette::palette(&mut stage);
    let mut market = Market { stage, batch: Batch::default(), paint, sites: Sites::default() };
    street::street(&mut market);
    houses::houses(&mut market);
    stalls::stalls(&mut market);
    neon::signs(&mut market);
    clutter::clutter(&mut market);
    lamps::cables(&mut market);
    lamps::lamps(&mut market, lights);
    let Market { mut stage, batch, .. } = market;
    batch.build(&mut stage);
    stage.scene.environment = Some(sky());
    stage.camera("default", [-0.55, 1.28, 4.6], [0.12, 1.78, -8.0], 46.0);
    stage.camera("close", [-0.45, 1.33, -0.2], [2.65, 1.02, -2.9], 44.0);
    stage.camera("above", [-1.3, 9.8, 10.0], [0.35, 0.6, -7.5], 44.0);
    stage.scene
}

/// A sky without a moon, a little lighter above the roofs, where the city shines on the haze.
fn sky() -> Environment {
    const ROWS: [[f32; 3]; 8] = [
        [0.0040, 0.0075, 0.0190],
        [0.0044, 0.0080, 0.0200],
        [0.0056, 0.0092, 0.0220],
        [0.0110, 0.0130, 0.0260],
        [0.0030, 0.0030, 0.0040],
        [0.0020, 0.0020, 0.0025],
        [0.0020, 0.0020, 0.0025],
        [0.0020, 0.0020, 0.0025],
    ];
    const WIDTH: u32 = 16;
    let radiance = ROWS.iter().flat_map(|row| [Vec3::from(*row); WIDTH as usize]).collect();
    Environment { name: "night".to_owned(), width: WIDTH, height: ROWS.len() as u32, radiance, scale: 1.0, turn: 0.0 }
}

#[cfg(test)]
mod tests;
