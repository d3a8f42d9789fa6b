//! Changes of how an inspected image is shown, as actions say them.

use magpie_passes::parts::inspect::{Channel, Colours, Inspection};
use serde::{Deserialize, Serialize};

use crate::exit::Failure;

/// What changes; all else stays.
#[derive(Clone, Debug, Default, Deserialize, PartialEq, Serialize)]
#[serde(default, deny_unknown_fields)]
pub(crate) struct LookChange {
    /// Stops by which values are brightened.
    exposure: Option<f32>,
    /// Name of a [`Channel`].
    channel: Option<String>,
    /// Values of the first and the last colour.
    range: Option<[f32; 2]>,
    /// Name of [`Colours`].
    colours: Option<String>,
    /// Whether colours are encoded as sRGB.
    srgb: Option<bool>,
    /// Mip.
    mip: Option<u32>,
    /// Layer.
    layer: Option<u32>,
    /// How much larger the image is shown than it fits.
    zoom: Option<f32>,
    /// What is then in the middle: 0 to 1 from the left and from above.
    centre: Option<[f32; 2]>,
    /// Whether the range is set to that of the values.
    pub(super) fit: bool,
}

impl LookChange {
    /// Makes the change.
    ///
    /// # Errors
    /// [`Failure::Input`] where there is no such channel or colours, or a number is out of range.
    pub(super) fn apply(&self, inspection: &mut Inspection) -> Result<(), Failure> {
        let mut new = inspection.clone();
        if let Some(name) = &self.channel {
            new.look.channel = named("channel", name, Channel::ALL, Channel::name)?;
        }
        if let Some(name) = &self.colours {
            new.look.colours = named("colours", name, Colours::ALL, Colours::name)?;
        }
        if let Some([low, high]) = self.range {
            if low >= high {
                return Err(Failure::bad(format!("range: {low} is not below {high}")));
            }
            new.look.range = [low, high];
        }
        if let Some(zoom) = self.zoom {
            if !(1.0..=MOST_ZOOM).contains(&zoom) {
                return Err(Failure::bad(format!("zoom: {zoom} is not within 1 to {MOST_ZOOM}")));
            }
            new.zoom = zoom;
        }
        new.look.exposure = self.exposure.unwrap_or(new.look.exposure);
        new.look.encodes = self.srgb.unwrap_or(new.look.encodes);
        new.mip = self.mip.unwrap_or(new.mip);
        new.layer = self.layer.unwrap_or(new.layer);
        new.centre = self.centre.unwrap_or(new.centre);
        *inspection = new;
        Ok(())
    }
}

/// How much larger than it fits an image can be shown.
pub(super) const MOST_ZOOM: f32 = 64.0;

/// The one of this name.
fn named<T: Copy, const N: usize>(
    what: &str,
    name: &str,
    all: [T; N],
    name_of: fn(T) -> &'static str,
) -> Result<T, Failure> {
    let unknown = || Failure::bad(format!("{what}: no `{name}`; there are {}", all.map(name_of).join(", ")));
    all.into_iter().find(|one| name_of(*one) == name).ok_or_else(unknown)
}

#[cfg(test)]
mod tests {
    use super::*;

    #[test]
    fn a_change_leaves_the_rest() {
        let change = |text: &str| serde_json::from_str::<LookChange>(text).unwrap();
        let mut inspection = Inspection::of("a.b", "c", None);
        change(r#"{"exposure": 2, "channel": "r", "range": [-1, 1], "colours": "false"}"#)
            .apply(&mut inspection)
            .unwrap();
        change(r#"{"mip": 3, "srgb": true, "zoom": 4}"#).apply(&mut inspection).unwrap();
        let look = inspection.look;
        assert_eq!((look.exposure, look.range, look.encodes), (2.0, [-1.0, 1.0], true));
        assert_eq!((look.channel, look.colours), (Channel::Red, Colours::False));
        assert_eq!((inspection.mip, inspection.layer, inspection.zoom), (3, 0, 4.0));
        let before = inspection.clone();
        for (mistake, wanted) in [
            (r#"{"exposure": 5, "channel": "x"}"#, "luminance"),
            (r#"{"exposure": 5, "colours": "red"}"#, "distinct"),
            (r#"{"exposure": 5, "range": [1, 1]}"#, "not below"),
            (r#"{"exposure": 5, "zoom": 0.5}"#, "1 to 64"),
        ] {
            let message = change(mistake).apply(&mut inspection).unwrap_err().message();
            assert!(message.contains(wanted), "{message}");
            assert_eq!(inspection, before);
        }
        assert!(serde_json::from_str::<LookChange>(r#"{"brightness": 1}"#).is_err());
    }
}
