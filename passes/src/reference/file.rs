//! Estimates as OpenEXR files: the mean in R, G, B, its standard error in error.R, error.G, error.B, and number of samples and subject in the
//! header.
use super::Estimate;
use exr::prelude::*;
use glam::DVec3;
use magpie::files::open_regular;
use std::path::Path;
use std::time::SystemTime;

/// Names of the channels: those of the mean, then those of the standard error.
const CHANNELS: [&str; 6] = ["R", "G", "B", "error.R", "error.G", "error.B"];
/// Header attribute with the number of samples per pixel.
const SAMPLES: &str = "magpie samples";
/// Header attribute with the subject, which identifies what the estimate shows.
const SUBJECT: &str = "magpie subject";

/// Why an estimate could not be read or written.
#[derive(Debug, thiserror::Error)]
pub enum EstimateFileError {
    /// The file could not be read or written.
    #[error("{path}: {source}")]
    File {
        /// Path of the file.
        path: String,
        /// The cause.
        source: Error,
    },
    /// An EXR file, but not one that the reference wrote.
    #[error("{path}: not written by the reference: {lacks} is missing")]
    Foreign {
        /// Path of the file.
        path: String,
        /// The missing channel or attribute.
        lacks: String,
    },
    /// The file holds an estimate of another subject.
    #[error("{path}: an estimate of something else: {got}; wanted {wanted}")]
    Subject {
        /// Path of the file.
        path: String,
        /// Subject of the file.
        got: String,
        /// The expected subject.
        wanted: String,
    },
}

impl Estimate {
    /// Writes the estimate to a file. `subject` identifies what it shows, so that only estimates of the same subject are merged.
    ///
    /// # Errors
    /// [`EstimateFileError::File`].
    pub fn save(&self, path: &Path, subject: &str) -> std::result::Result<(), EstimateFileError> {
        let errors = self.standard_error();
        let channel = |at: usize| {
            let (values, axis) = if at < 3 { (&self.mean, at) } else { (&errors, at - 3) };
            let samples: Vec<f32> = values.iter().map(|v| v[axis] as f32).collect();
            AnyChannel::new(CHANNELS[at], FlatSamples::F32(samples))
        };
        let channels = AnyChannels::sort((0..CHANNELS.len()).map(channel).collect());
        let mut layer = Layer::new(
            (self.width as usize, self.height as usize),
            LayerAttributes::default(),
            Encoding::SMALL_LOSSLESS,
            channels,
        );
        let text = |t: &str| AttributeValue::Text(Text::from(t));
        layer.attributes.other.insert(Text::from(SAMPLES), text(&self.samples.to_string()));
        layer.attributes.other.insert(Text::from(SUBJECT), text(subject));
        // Written to a temporary file and renamed: an interrupted run leaves the previous file intact. The name of the temporary file is unique,
        // as several processes may write the same estimate.
        let now = SystemTime::now().duration_since(SystemTime::UNIX_EPOCH).map_or(0, |d| d.as_nanos());
        let part = path.with_extension(format!("exr.{}-{now}.part", std::process::id()));
        let written = Image::from_layer(layer).write().non_parallel().to_file(&part);
        let moved = written.and_then(|()| std::fs::rename(&part, path).map_err(Error::from));
        moved.map_err(|source| EstimateFileError::File { path: path.display().to_string(), source })
    }

    /// Reads a file that [`Estimate::save`] wrote. It must have this `subject`; `None` accepts any.
    ///
    /// # Errors
    /// [`EstimateFileError`].
    pub fn load(path: &Path, subject: Option<&str>) -> std::result::Result<Self, EstimateFileError> {
        let name = path.display().to_string();
        let failed =
            |source: std::io::Error| EstimateFileError::File { path: name.clone(), source: Error::from(source) };
        open_regular(path).map_err(failed)?;
        let image = read_first_flat_layer_from_file(path)
            .map_err(|source| EstimateFileError::File { path: name.clone(), source })?;
        let foreign = |lacks: &str| EstimateFileError::Foreign { path: name.clone(), lacks: lacks.to_owned() };
        let layer = &image.layer_data;
        let text = |key: &str| match layer.attributes.other.get(&Text::from(key)) {
            Some(AttributeValue::Text(text)) => Ok(text.to_string()),
            _ => Err(foreign(key)),
        };
        let (got, samples) = (text(SUBJECT)?, text(SAMPLES)?.parse::<u64>().map_err(|_| foreign(SAMPLES))?);
        if let Some(wanted) = subject.filter(|wanted| *wanted != got) {
            return Err(EstimateFileError::Subject { path: name, got, wanted: wanted.to_owned() });
        }
        let mut channels = Vec::new();
        for wanted in CHANNELS {
            let found =
                layer.channel_data.list.iter().find(|c| c.name.eq_case_insensitive(wanted) && c.name.eq(wanted));
            let values: Option<Vec<f32>> = found.map(|c| c.sample_data.values_as_f32().collect());
            channels.push(values.ok_or_else(|| foreign(wanted))?);
        }
        let pick = |first: usize, at: usize| DVec3::from([0, 1, 2].map(|axis| f64::from(channels[first + axis][at])));
        let (width, height) = (layer.size.0 as u32, layer.size.1 as u32);
        let mut estimate = Self::new(width, height);
        estimate.samples = samples;
        let spread = samples as f64 * (samples as f64 - 1.0);
        for at in 0..estimate.mean.len() {
            estimate.mean[at] = pick(0, at);
            if samples > 1 {
                let error = pick(3, at);
                estimate.squares[at] = error * error * spread;
            }
        }
        Ok(estimate)
    }
}

#[cfg(test)]
mod tests {
    use super::*;

    fn some() -> Estimate {
        let mut estimate = Estimate::new(5, 3);
        estimate.samples = 17;
        for (at, (mean, squares)) in estimate.mean.iter_mut().zip(&mut estimate.squares).enumerate() {
            *mean = DVec3::new(at as f64, 0.25, 1e6);
            *squares = DVec3::new(0.0, 2.0, at as f64 * 7.0);
        }
        estimate
    }

    #[test]
    fn a_file_gives_back_what_was_saved() {
        let folder = tempfile::tempdir().unwrap();
        let path = folder.path().join("e.exr");
        let saved = some();
        saved.save(&path, "a ball").unwrap();
        let read = Estimate::load(&path, Some("a ball")).unwrap();
        assert_eq!((read.width, read.height, read.samples), (5, 3, 17));
        for (a, b) in saved.mean.iter().chain(&saved.squares).zip(read.mean.iter().chain(&read.squares)) {
            assert!((*a - *b).abs().max_element() <= 1e-6 * a.abs().max_element(), "{a} {b}");
        }
        assert_eq!(std::fs::read_dir(folder.path()).unwrap().count(), 1);
    }

    #[test]
    fn what_does_not_belong_is_refused() {
        let folder = tempfile::tempdir().unwrap();
        let path = folder.path().join("e.exr");
        some().save(&path, "a ball").unwrap();
        let message = Estimate::load(&path, Some("a cube")).unwrap_err().to_string();
        assert!(message.contains("a ball") && message.contains("a cube"), "{message}");
        write_rgb_file(&path, 4, 4, |_, _| (0.5_f32, 0.5_f32, 0.5_f32)).unwrap();
        assert!(matches!(Estimate::load(&path, None), Err(EstimateFileError::Foreign { .. })));
        std::fs::write(&path, "no picture").unwrap();
        assert!(matches!(Estimate::load(&path, None), Err(EstimateFileError::File { .. })));
    }
}
