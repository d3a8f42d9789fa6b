//! Where probes are, and which of their faces are captured in a frame.
use glam::DVec3;
use magpie_shaders::probe::PROBE_FACES;

/// All faces, a bit each.
pub const ALL: u32 = (1 << PROBE_FACES) - 1;
/// Places of the camera's probe: one is shown, another is captured while the camera goes on.
pub const CAMERA: usize = 2;
/// Frames over which a new probe of the camera replaces the last one.
const FADE: u32 = 8;
/// Cells from the centre of the camera's probe, in the direction of an axis, beyond which it is captured anew elsewhere; above a half, so that
/// a camera at the border of two cells does not go back and forth.
const HYSTERESIS: f64 = 0.75;
/// The same beyond which the old one is of no use, as after a cut.
const JUMP: f64 = 3.0;

/// One probe.
#[derive(Clone, Debug)]
pub struct Place {
    /// Where it captures, absolute, metres.
    pub centre: DVec3,
    /// It is looked up, or being made ready for that.
    pub is_used: bool,
    /// A number for its centre, which changes with that.
    pub generation: u64,
    /// Captures of each face since.
    pub captures: [u32; PROBE_FACES as usize],
    /// For each face the generation that it holds.
    pub holds: [u64; PROBE_FACES as usize],
}

impl Place {
    fn new(centre: DVec3, is_used: bool) -> Self {
        Self { centre, is_used, generation: 1, captures: [0; PROBE_FACES as usize], holds: [0; PROBE_FACES as usize] }
    }

    /// All faces are captured.
    pub fn is_complete(&self) -> bool {
        self.captures.iter().all(|captures| *captures > 0)
    }

    fn go(&mut self, centre: DVec3) {
        (self.centre, self.is_used, self.captures) = (centre, true, [0; PROBE_FACES as usize]);
        self.generation += 1;
    }
}

/// Faces of a probe that a frame captures.
#[derive(Clone, Copy, Debug, Default, PartialEq, Eq)]
pub struct Work {
    /// A bit for each face.
    pub faces: u32,
    /// Those without earlier captures.
    pub fresh: u32,
}

/// All probes: those of the camera first, then those of the scene.
#[derive(Clone, Debug, Default)]
pub struct Places {
    /// The probes.
    pub all: Vec<Place>,
    /// Of the camera's, the one that is shown.
    shown: usize,
    /// Frames since the other was complete.
    faded: u32,
    /// The face after which the next frame goes on.
    cursor: usize,
}

impl Places {
    /// Those of a scene.
    pub fn new(scene: impl Iterator<Item = DVec3>) -> Self {
        let mut all = vec![Place::new(DVec3::ZERO, false); CAMERA];
        all.extend(scene.map(|centre| Place::new(centre, true)));
        Self { all, ..Self::default() }
    }

    /// Weights of the camera's probes.
    pub fn camera_weights(&self) -> [f32; CAMERA] {
        let other =
            if self.all[1 - self.shown].is_complete() && self.all[1 - self.shown].is_used { self.faded } else { 0 };
        let share = other as f32 / FADE as f32;
        let share = share * share * (3.0 - 2.0 * share);
        let mut weights = [share; CAMERA];
        weights[self.shown] = 1.0 - share;
        weights
    }

    /// Follows the camera, on a grid of this spacing, metres.
    pub fn follow(&mut self, eye: DVec3, spacing: f64) {
        let (shown, other) = (self.shown, 1 - self.shown);
        let target = (eye / spacing).round() * spacing;
        let away = |place: &Place| (eye - place.centre).abs().max_element() / spacing;
        if self.all[other].is_used && self.all[other].is_complete() {
            self.faded += 1;
            if self.faded >= FADE {
                self.all[shown].is_used = false;
                (self.shown, self.faded) = (other, 0);
            }
        }
        let (shown, other) = (self.shown, 1 - self.shown);
        if !self.all[shown].is_used || away(&self.all[shown]) > JUMP {
            self.all[other].is_used = false;
            self.all[shown].go(target);
            self.faded = 0;
        } else if !self.all[other].is_used && away(&self.all[shown]) > HYSTERESIS {
            self.all[other].go(target);
            self.faded = 0;
        }
    }

    /// The faces of this frame: those of probes that are shown but not captured yet, all at once; then `budget` others, first of what is to be
    /// shown next, then in turns of all with fewer than `limit` captures.
    pub fn plan(&mut self, budget: u32, limit: u32) -> Vec<Work> {
        let mut work = vec![Work::default(); self.all.len()];
        let incoming = 1 - self.shown;
        let mut left = budget;
        for (at, place) in self.all.iter().enumerate().filter(|(_, place)| place.is_used) {
            for face in (0..PROBE_FACES).filter(|face| place.captures[*face as usize] == 0) {
                if at == incoming {
                    if left == 0 {
                        continue;
                    }
                    left -= 1;
                }
                work[at].faces |= 1 << face;
                work[at].fresh |= 1 << face;
            }
        }
        let faces = self.all.len() * PROBE_FACES as usize;
        let start = self.cursor;
        for step in 0..faces {
            if left == 0 {
                break;
            }
            let face = (start + step) % faces;
            let (place, bit) = (face / PROBE_FACES as usize, face % PROBE_FACES as usize);
            let of = &self.all[place];
            let is_open = of.is_used && of.captures[bit] > 0 && of.captures[bit] < limit;
            if is_open && work[place].faces & 1 << bit == 0 {
                work[place].faces |= 1 << bit;
                self.cursor = face + 1;
                left -= 1;
            }
        }
        work
    }

    /// A number for what each layer holds after this frame.
    pub fn keys(&self, work: &[Work]) -> Vec<u64> {
        let of = |(place, work): (&Place, &Work)| {
            let (place, faces) = (place.clone(), work.faces);
            (0..PROBE_FACES as usize)
                .map(move |face| if faces & 1 << face > 0 { place.generation } else { place.holds[face] })
        };
        self.all.iter().zip(work).flat_map(of).collect()
    }

    /// Adds layers whose contents were lost, and counts what is captured.
    pub fn settle(&mut self, work: &mut [Work], stale: &[u32]) {
        for layer in stale {
            let (place, bit) = ((layer / PROBE_FACES) as usize, layer % PROBE_FACES);
            let is_lost = self.all[place].is_used && self.all[place].captures[bit as usize] > 0;
            if is_lost {
                work[place].faces |= 1 << bit;
                work[place].fresh |= 1 << bit;
            }
        }
        for (place, work) in self.all.iter_mut().zip(work) {
            for face in (0..PROBE_FACES as usize).filter(|face| work.faces & 1 << face > 0) {
                let before = if work.fresh & 1 << face > 0 { 0 } else { place.captures[face] };
                place.captures[face] = before.saturating_add(1);
                place.holds[face] = place.generation;
            }
        }
    }

    /// Captures go on, whatever the limit: the light has changed.
    pub fn disturb(&mut self) {
        let all = self.all.iter_mut().flat_map(|place| &mut place.captures);
        all.for_each(|captures| *captures = (*captures).min(1));
    }
}

#[cfg(test)]
mod tests {
    use super::*;

    fn frame(places: &mut Places, x: f64, budget: u32) -> Vec<Work> {
        places.follow(DVec3::X * x, 1.0);
        let mut work = places.plan(budget, u32::MAX);
        places.settle(&mut work, &[]);
        work
    }

    fn count(work: &[Work]) -> u32 {
        work.iter().map(|w| w.faces.count_ones()).sum()
    }

    #[test]
    fn the_first_frame_captures_all_and_later_ones_take_turns() {
        for budget in [1, 2, 3, 6] {
            let mut places = Places::new([DVec3::Y].into_iter());
            assert_eq!(count(&frame(&mut places, 0.1, budget)), 12);
            let mut seen = [0; 3];
            for _ in 0..12 / budget {
                let work = frame(&mut places, 0.1, budget);
                assert_eq!(count(&work), budget);
                seen.iter_mut().zip(&work).for_each(|(seen, work)| *seen |= work.faces);
            }
            assert_eq!(seen, [ALL, 0, ALL], "each face once in so many frames");
        }
    }

    #[test]
    fn a_camera_that_moves_back_and_forth_moves_no_probe() {
        let mut places = Places::new(std::iter::empty());
        frame(&mut places, 0.4, 2);
        for k in 0..50 {
            frame(&mut places, 0.4 + 0.3 * f64::from(k % 2), 2);
        }
        assert!(!places.all[1].is_used && places.all[0].centre == DVec3::ZERO);
    }

    #[test]
    fn a_probe_is_replaced_without_a_jump() {
        let mut places = Places::new(std::iter::empty());
        frame(&mut places, 0.0, 2);
        let mut last = places.camera_weights();
        for _ in 0..20 {
            frame(&mut places, 0.8, 2);
            let now = places.camera_weights();
            assert!((now[0] - last[0]).abs() < 0.25 && (now[0] + now[1] - 1.0).abs() < 1e-6, "{last:?} {now:?}");
            assert!(now[1] == 0.0 || places.all[1].is_complete());
            last = now;
        }
        assert_eq!(last, [0.0, 1.0]);
        assert!(!places.all[0].is_used && places.all[1].centre == DVec3::X);
        // After a jump all is captured in one frame.
        let work = frame(&mut places, 50.0, 2);
        assert_eq!((work[1].fresh, places.camera_weights()), (ALL, [0.0, 1.0]));
    }

    #[test]
    fn lost_contents_are_captured_anew_and_settled_ones_are_left() {
        let mut places = Places::new(std::iter::empty());
        frame(&mut places, 0.0, 6);
        let mut work = places.plan(0, u32::MAX);
        assert_eq!(count(&work), 0);
        places.settle(&mut work, &[3, 9]);
        assert_eq!(work[0], Work { faces: 1 << 3, fresh: 1 << 3 });
        assert_eq!(count(&work), 1, "nobody looks at the other");
        assert_eq!(count(&places.plan(6, 1)), 0);
        places.disturb();
        assert_eq!(count(&places.plan(6, 2)), 6);
    }
}
