//! How the numbers of an image become colours to look at, where [`Pixels::presentable`] does not show what matters.
use super::{Pixels, srgb_encode};
use std::fmt;
use std::str::FromStr;

/// Black, blue, cyan, green, yellow, red, white: the false colours of a number from 0 to 1.
const RAMP: [[f32; 3]; 7] =
    [[0.0; 3], [0.0, 0.0, 1.0], [0.0, 1.0, 1.0], [0.0, 1.0, 0.0], [1.0, 1.0, 0.0], [1.0, 0.0, 0.0], [1.0; 3]];

/// What is shown of a pixel.
#[derive(Clone, Copy, Debug, PartialEq, Eq)]
pub enum Quantity {
    /// Red, green and blue, encoded as sRGB.
    Rgb,
    /// One channel, 0 to 3.
    Channel(usize),
    /// Luminance of red, green and blue, Rec.709.
    Luminance,
    /// Alpha over luminance. Denoised radiance has the standard deviation of its luminance in alpha, so this is the relative one.
    Relative,
}

/// How numbers within the range are spread over colours.
#[derive(Clone, Copy, Debug, Default, PartialEq, Eq)]
pub enum Scale {
    /// In proportion.
    #[default]
    Linear,
    /// By their logarithm.
    Logarithmic,
}

/// A way to show an image. As text: words with commas between, in any order, each kind once at most:
///
/// - `rgb`, `r`, `g`, `b`, `a`, `luminance` or `relative`;
/// - `linear` or `log`;
/// - `false` for false colours, of one number: black, blue, cyan, green, yellow, red, white;
/// - `LO..HI`, the numbers that get the first and the last colour, `LO` below `HI`, and above 0 with `log`.
#[derive(Clone, Copy, Debug, Default, PartialEq)]
pub struct Mapping {
    /// What is shown. `None`: of one-channel images that channel, of others colours, with false colours their luminance.
    pub quantity: Option<Quantity>,
    /// How.
    pub scale: Scale,
    /// Numbers of the first and the last colour. `None`: the least and the greatest finite number of the image, with a logarithmic scale
    /// of those above 0.
    pub range: Option<[f32; 2]>,
    /// False colours instead of grey.
    pub false_colours: bool,
}

/// A text is no [`Mapping`].
#[derive(Clone, Debug, PartialEq, Eq)]
pub struct NoMapping(String);

impl fmt::Display for NoMapping {
    fn fmt(&self, f: &mut fmt::Formatter<'_>) -> fmt::Result {
        f.write_str(&self.0)
    }
}

impl std::error::Error for NoMapping {}

/// Two numbers with two dots between.
fn range_of(word: &str) -> Option<[f32; 2]> {
    let (low, high) = word.split_once("..")?;
    let range = [low.parse::<f32>().ok()?, high.parse::<f32>().ok()?];
    (range.iter().all(|x| x.is_finite()) && range[0] < range[1]).then_some(range)
}

impl FromStr for Mapping {
    type Err = NoMapping;

    fn from_str(text: &str) -> Result<Self, NoMapping> {
        let (mut quantity, mut scale, mut range, mut false_colours) = (None, None, None, None);
        for word in text.split(',') {
            let shown = match word {
                "rgb" => Some(Quantity::Rgb),
                "r" => Some(Quantity::Channel(0)),
                "g" => Some(Quantity::Channel(1)),
                "b" => Some(Quantity::Channel(2)),
                "a" => Some(Quantity::Channel(3)),
                "luminance" => Some(Quantity::Luminance),
                "relative" => Some(Quantity::Relative),
                _ => None,
            };
            let again = match (shown, word, range_of(word)) {
                (Some(shown), ..) => quantity.replace(shown).is_some(),
                (_, "linear", _) => scale.replace(Scale::Linear).is_some(),
                (_, "log", _) => scale.replace(Scale::Logarithmic).is_some(),
                (_, "false", _) => false_colours.replace(true).is_some(),
                (_, _, Some(found)) => range.replace(found).is_some(),
                _ => {
                    let wanted = "wanted rgb, r, g, b, a, luminance, relative, linear, log, false or LO..HI";
                    return Err(NoMapping(format!("`{word}`: {wanted}, with commas between")));
                }
            };
            if again {
                return Err(NoMapping(format!("`{word}`: another word says the same or the opposite")));
            }
        }
        let scale = scale.unwrap_or_default();
        if scale == Scale::Logarithmic && range.is_some_and(|[low, _]| low <= 0.0) {
            return Err(NoMapping("log: the range has to begin above 0".to_owned()));
        }
        if quantity == Some(Quantity::Rgb) && false_colours.is_some() {
            return Err(NoMapping("false: wanted one number, not rgb".to_owned()));
        }
        Ok(Self { quantity, scale, range, false_colours: false_colours.is_some() })
    }
}

fn luminance(v: [f32; 4]) -> f32 {
    0.2126 * v[0] + 0.7152 * v[1] + 0.0722 * v[2]
}

impl Mapping {
    /// 8-bit RGBA of an image, and the range that was shown. Numbers that are NaN become black; where the numbers have no range, as all are
    /// equal, the range is widened by 1.
    #[must_use]
    pub fn apply(&self, pixels: &Pixels) -> (Vec<u8>, [f32; 2]) {
        let quantity = self.quantity.unwrap_or(match pixels.format.channels() {
            1 => Quantity::Channel(0),
            2 if self.false_colours => Quantity::Channel(0),
            _ if self.false_colours => Quantity::Luminance,
            _ => Quantity::Rgb,
        });
        let numbers: Vec<[f32; 3]> = pixels
            .values()
            .into_iter()
            .map(|v| match quantity {
                Quantity::Rgb => [v[0], v[1], v[2]],
                Quantity::Channel(channel) => [v[channel]; 3],
                Quantity::Luminance => [luminance(v); 3],
                Quantity::Relative if v[3] == 0.0 => [0.0; 3],
                Quantity::Relative => [v[3] / luminance(v); 3],
            })
            .collect();
        let range = self.range.unwrap_or_else(|| self.range_of(&numbers));
        let [low, high] = range.map(|x| self.scaled(x));
        let colour = |number: [f32; 3]| {
            let shares = number.map(|x| ((self.scaled(x) - low) / (high - low)).clamp(0.0, 1.0));
            match quantity {
                Quantity::Rgb => shares.map(srgb_encode),
                _ if self.false_colours => false_colour(shares[0]),
                _ => shares,
            }
        };
        let byte = |x: f32| (x * 255.0 + 0.5) as u8; // of NaN 0
        let bytes = numbers.into_iter().map(colour).flat_map(|[r, g, b]| [byte(r), byte(g), byte(b), 255]).collect();
        (bytes, range)
    }

    fn scaled(&self, x: f32) -> f32 {
        if self.scale == Scale::Logarithmic { x.ln() } else { x }
    }

    fn range_of(&self, numbers: &[[f32; 3]]) -> [f32; 2] {
        let is_shown = |x: &f32| x.is_finite() && (self.scale == Scale::Linear || *x > 0.0);
        let all = numbers.iter().flatten().copied().filter(is_shown);
        let [low, high] = all.fold([f32::INFINITY, f32::NEG_INFINITY], |[low, high], x| [low.min(x), high.max(x)]);
        match low {
            _ if low < high => [low, high],
            _ if low.is_finite() => [low, low + 1.0],
            _ => [1.0, 2.0],
        }
    }
}

/// The false colour of a number from 0 to 1.
fn false_colour(share: f32) -> [f32; 3] {
    let at = share * (RAMP.len() - 1) as f32;
    let index = (at as usize).min(RAMP.len() - 2);
    let part = at - index as f32;
    std::array::from_fn(|c| RAMP[index][c] + (RAMP[index + 1][c] - RAMP[index][c]) * part)
}

#[cfg(test)]
mod tests {
    use super::*;
    use crate::graph::{Extent, Format};

    fn image(values: &[[f32; 4]]) -> Pixels {
        let bytes = values.iter().flatten().flat_map(|x| x.to_le_bytes()).collect();
        Pixels { extent: Extent::new(values.len() as u32, 1), format: Format::Rgba32Float, bytes }
    }

    fn shown(mapping: &str, values: &[[f32; 4]]) -> (Vec<[u8; 3]>, [f32; 2]) {
        let (bytes, range) = mapping.parse::<Mapping>().unwrap().apply(&image(values));
        (bytes.chunks_exact(4).map(|p| [p[0], p[1], p[2]]).collect(), range)
    }

    #[test]
    fn words_stand_in_any_order_once_each() {
        let wanted = Mapping {
            quantity: Some(Quantity::Channel(3)),
            scale: Scale::Logarithmic,
            range: Some([0.01, 10.0]),
            false_colours: true,
        };
        assert_eq!("a,log,false,0.01..10".parse(), Ok(wanted));
        assert_eq!("1e-2..1e1,false,a,log".parse(), Ok(wanted));
        assert_eq!("linear".parse(), Ok(Mapping::default()));
        for (bad, why) in [
            ("", "``: wanted"),
            ("x", "`x`: wanted"),
            ("a,b", "`b`: another word"),
            ("log,linear", "`linear`: another word"),
            ("1..0", "`1..0`: wanted"),
            ("0..inf", "`0..inf`: wanted"),
            ("nan..1", "`nan..1`: wanted"),
            ("log,0..1", "begin above 0"),
            ("rgb,false", "one number"),
        ] {
            let error = bad.parse::<Mapping>().unwrap_err().to_string();
            assert!(error.contains(why), "{bad}: {error}");
        }
    }

    #[test]
    fn ranges_are_given_or_found() {
        let values = [0.5, 1.5, 2.5, f32::INFINITY, f32::NAN].map(|x| [x, 9.0, 0.0, 1.0]);
        let grey = |x: u8| [x; 3];
        assert_eq!(shown("r", &values), ([0, 128, 255, 255, 0].map(grey).to_vec(), [0.5, 2.5]));
        assert_eq!(shown("r,0..1", &values).0[..3], [128, 255, 255].map(grey));
        assert_eq!(shown("r,log,0.5..12.5", &values).0[2], grey(128), "2.5 is the geometric middle");
        // A logarithm has no number for 0 and less.
        let some = [-1.0, 0.0, 1e-3, 1e3].map(|x| [x, 0.0, 0.0, 1.0]);
        assert_eq!(shown("r,log", &some), ([0, 0, 0, 255].map(grey).to_vec(), [1e-3, 1e3]));
        // Where there is no range.
        assert_eq!(shown("g", &values), (vec![grey(0); 5], [9.0, 10.0]));
        assert_eq!(shown("r,log", &[[f32::NAN; 4]]), (vec![grey(0)], [1.0, 2.0]));
    }

    #[test]
    fn false_colours_run_from_black_to_white() {
        let values: Vec<[f32; 4]> = (0..=6).map(|k| [k as f32; 4]).collect();
        let wanted = RAMP.map(|c| c.map(|x| (x * 255.0) as u8));
        assert_eq!(shown("r,false", &values), (wanted.to_vec(), [0.0, 6.0]));
        assert_eq!(shown("false,0..6", &values).0, wanted, "the luminance of grey is that of each channel");
    }

    #[test]
    fn deviations_over_the_luminance_are_unpacked() {
        let values = [[2.0, 2.0, 2.0, 1.0], [0.0; 4], [4.0, 4.0, 4.0, 4.0]];
        assert_eq!(shown("relative,0..1", &values).0, [128, 0, 255].map(|x| [x; 3]));
    }
}
