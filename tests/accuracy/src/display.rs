//! Conversion of linear pictures to display values: the exposure and tone curve of `post`, on the CPU.
use crate::metrics::Picture;
use magpie::config::{Config, Value};

/// Exposure and curve, as `shaders/post/tone_map.comp` has them.
#[derive(Clone, Copy, Debug, PartialEq)]
pub struct Display {
    /// Factor of the radiance.
    pub exposure: f32,
    /// Tone curve.
    pub curve: Curve,
}

/// A tone curve.
#[derive(Clone, Copy, Debug, PartialEq, Eq)]
pub enum Curve {
    /// Clamps to 0..1.
    Clip,
    /// AgX (Troy Sobotka 2022), by the fit of Benjamin Wrensch 2023, "Minimal AgX Implementation".
    AgX,
    /// ACES, by the fit of Stephen Hill in the "BakingLab" sources (Pettineo, Neubelt 2016).
    Aces,
}

/// Lower and upper end of AgX's range, stops.
const AGX_RANGE: [f32; 2] = [-12.47393, 4.026069];

impl Display {
    /// No conversion but clamping, for visibility and openness.
    pub const PLAIN: Self = Self { exposure: 1.0, curve: Curve::Clip };

    /// Taken from the settings of `post`, with defaults for missing ones.
    pub fn of(config: &Config) -> Self {
        let settings = config.settings.get("post");
        let value = |key: &str| settings.and_then(|s| s.get(key));
        let stops = match value("exposure") {
            Some(Value::Float(stops)) => *stops as f32,
            Some(Value::Integer(stops)) => *stops as f32,
            _ => 0.0,
        };
        let curve = match value("tone_map") {
            Some(Value::Text(name)) if name == "none" => Curve::Clip,
            Some(Value::Text(name)) if name == "aces" => Curve::Aces,
            _ => Curve::AgX,
        };
        Self { exposure: stops.exp2(), curve }
    }

    /// The display's linear light for a picture, 0 to 1.
    pub fn show(&self, picture: &Picture) -> Picture {
        let show = |p: &[f32; 3]| {
            let exposed = p.map(|x| x * self.exposure);
            match self.curve {
                Curve::Clip => exposed.map(|x| x.clamp(0.0, 1.0)),
                Curve::AgX => agx(exposed),
                Curve::Aces => aces(exposed),
            }
        };
        Picture { pixels: picture.pixels.iter().map(show).collect(), ..*picture }
    }
}

/// Product of a matrix, given by rows, and a vector.
fn times(rows: &[[f32; 3]; 3], v: [f32; 3]) -> [f32; 3] {
    rows.map(|row| row[0] * v[0] + row[1] * v[1] + row[2] * v[2])
}

fn agx(colour: [f32; 3]) -> [f32; 3] {
    const INSET: [[f32; 3]; 3] = [
        [0.842_479_06, 0.078_433_6, 0.079_223_745],
        [0.042_328_242, 0.878_468_64, 0.079_166_13],
        [0.042_375_655, 0.078_433_6, 0.879_143],
    ];
    const OUTSET: [[f32; 3]; 3] = [
        [1.196_879, -0.098_020_88, -0.099_029_74],
        [-0.052_896_85, 1.151_903_1, -0.098_961_18],
        [-0.052_971_635, -0.098_043_45, 1.151_073_7],
    ];
    let [least, most] = AGX_RANGE;
    let curved = times(&INSET, colour).map(|c| {
        let x = (c.max(least.exp2()).log2().clamp(least, most) - least) / (most - least);
        let (x2, x4) = (x * x, x * x * x * x);
        15.5 * x4 * x2 - 40.14 * x4 * x + 31.96 * x4 - 6.868 * x2 * x + 0.4298 * x2 + 0.1191 * x - 0.00232
    });
    times(&OUTSET, curved).map(|c| c.clamp(0.0, 1.0).powf(2.2))
}

fn aces(colour: [f32; 3]) -> [f32; 3] {
    const IN: [[f32; 3]; 3] = [[0.59719, 0.35458, 0.04823], [0.07600, 0.90834, 0.01566], [0.02840, 0.13383, 0.83777]];
    const OUT: [[f32; 3]; 3] =
        [[1.60475, -0.53108, -0.07367], [-0.10208, 1.10813, -0.00605], [-0.00327, -0.07276, 1.07602]];
    let fitted = times(&IN, colour).map(|x| {
        let x = x.min(65504.0);
        (x * (x + 0.024_578_6) - 0.000_090_537) / (x * (0.983_729 * x + 0.432_951) + 0.238_081)
    });
    times(&OUT, fitted).map(|c| c.clamp(0.0, 1.0))
}

#[cfg(test)]
mod tests {
    use super::*;

    #[test]
    fn curves_rise_from_black_to_white() {
        for curve in [Curve::Clip, Curve::AgX, Curve::Aces] {
            let display = Display { exposure: 1.0, curve };
            let values: Vec<f32> = (0..40).map(|i| 1e-3 * 1.4_f32.powi(i)).collect();
            let shown = display.show(&Picture::grey(40, 1, &values));
            for pair in shown.pixels.windows(2) {
                assert!(pair[0][1] <= pair[1][1], "{curve:?}: {pair:?}");
            }
            let [black, white] = [0.0, 1e6].map(|x| display.show(&Picture::grey(1, 1, &[x])).pixels[0][1]);
            assert!(black < 1e-3 && white > 0.9, "{curve:?}: {black} {white}");
        }
        // Greys stay grey, as the rows of each matrix sum to 1.
        let [r, g, b] = Display { exposure: 1.0, curve: Curve::AgX }.show(&Picture::grey(1, 1, &[0.18])).pixels[0];
        assert!((r - g).abs() < 1e-3 && (b - g).abs() < 1e-3, "{r} {g} {b}");
    }

    #[test]
    fn the_settings_of_post_are_followed() {
        let mut config = Config::default();
        assert_eq!(Display::of(&config), Display { exposure: 1.0, curve: Curve::AgX });
        config.set("post.exposure=2").unwrap();
        config.set("post.tone_map=none").unwrap();
        let display = Display::of(&config);
        assert_eq!(display, Display { exposure: 4.0, curve: Curve::Clip });
        assert_eq!(display.show(&Picture::grey(2, 1, &[0.125, 0.5])).pixels, [[0.5; 3], [1.0; 3]]);
    }
}
