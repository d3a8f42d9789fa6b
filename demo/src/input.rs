//! Reading text files, and looking up names.

use std::{io::Read, path::Path};

use magpie::{
    config::{Catalogue, Config, Suggestion},
    files::open_regular,
};

use crate::exit::Failure;

/// Largest text file that is read, bytes; a configuration takes a few thousand.
const MAX_TEXT: u64 = 1 << 20;

/// Reads a text file. Pipes and devices are refused, as reading them may block or never end.
pub(crate) fn read_text(path: &Path) -> Result<String, Failure> {
    let name = path.display();
    let mut bytes = Vec::new();
    open_regular(path)
        .and_then(|(file, _)| file.take(MAX_TEXT + 1).read_to_end(&mut bytes))
        .map_err(|error| Failure::bad(format!("{name}: cannot be read: {error}")))?;
    if bytes.len() as u64 > MAX_TEXT {
        return Err(Failure::bad(format!("{name}: wanted a text file of at most {MAX_TEXT} bytes, got a larger one")));
    }
    String::from_utf8(bytes).map_err(|error| {
        let at = error.utf8_error().valid_up_to();
        Failure::bad(format!("{name}: wanted UTF-8 text, got something else at byte {at}"))
    })
}

/// Loads the configuration from a file and assignments, checks each, and fills in the defaults.
pub(crate) fn configure(catalogue: &Catalogue, file: Option<&Path>, assignments: &[String]) -> Result<Config, Failure> {
    let mut config = Config::default();
    if let Some(path) = file {
        let origin = path.display().to_string();
        let read = || {
            let layer = Config::from_toml(&read_text(path)?, &origin)?;
            catalogue.check(&layer, &origin)?;
            Ok(layer)
        };
        config.merge(read().map_err(|failure: Failure| failure.context("--config"))?);
    }
    for assignment in assignments {
        let mut layer = Config::default();
        layer.set(assignment)?;
        catalogue.check(&layer, &format!("--set {assignment}"))?;
        config.merge(layer);
    }
    let full = catalogue.complete(&config);
    catalogue.check(&full, "the configuration as a whole")?;
    Ok(full)
}

/// Looks up a name; the failure lists the known ones.
pub(crate) fn find<'a, T>(what: &str, wanted: &str, all: &'a [T], name: impl Fn(&T) -> &str) -> Result<&'a T, Failure> {
    all.iter().find(|item| name(item) == wanted).ok_or_else(|| {
        let known: Vec<&str> = all.iter().map(&name).collect();
        let suggestion = Suggestion::find(wanted, known.iter().copied());
        Failure::bad(format!("unknown {what} \"{wanted}\"{suggestion}; known: {}", known.join(", ")))
    })
}

#[cfg(test)]
mod tests {
    use super::*;

    #[test]
    fn every_configuration_that_comes_along_suits_the_catalogue() {
        let folder = Path::new(env!("CARGO_MANIFEST_DIR")).join("configs");
        let mut seen = 0;
        for entry in std::fs::read_dir(folder).unwrap() {
            let path = entry.unwrap().path();
            configure(&crate::session::catalogue(), Some(&path), &[]).unwrap_or_else(|f| panic!("{}", f.message()));
            seen += 1;
        }
        assert!(seen >= 2, "{seen}");
    }

    #[test]
    fn the_default_file_says_what_holds_without_it() {
        let path = Path::new(env!("CARGO_MANIFEST_DIR")).join("configs/default.toml");
        let catalogue = crate::session::catalogue();
        assert_eq!(configure(&catalogue, Some(&path), &[]).unwrap(), catalogue.complete(&Config::default()));
    }

    #[test]
    fn assignments_win_over_the_file() {
        let catalogue = crate::session::catalogue();
        let folder = tempfile::tempdir().unwrap();
        let path = folder.path().join("c.toml");
        std::fs::write(&path, "[stages]\nshadows = \"ray-traced\"\n").unwrap();
        let config = configure(&catalogue, Some(&path), &["stages.shadows=off".to_owned()]).unwrap();
        assert_eq!(config.stages["shadows"], "off");
        let printed = config.to_toml().unwrap();
        std::fs::write(&path, &printed).unwrap();
        assert_eq!(configure(&catalogue, Some(&path), &[]).unwrap(), config, "{printed}");
    }

    #[test]
    fn files_are_text_of_a_sane_size() {
        let folder = tempfile::tempdir().unwrap();
        let path = folder.path().join("f");
        std::fs::write(&path, b"ab\xff").unwrap();
        assert!(read_text(&path).unwrap_err().message().contains("at byte 2"));
        std::fs::write(&path, vec![b' '; MAX_TEXT as usize + 1]).unwrap();
        assert!(read_text(&path).unwrap_err().message().contains("at most"));
        std::fs::write(&path, vec![b' '; MAX_TEXT as usize]).unwrap();
        assert!(read_text(&path).is_ok());
        assert!(read_text(folder.path()).unwrap_err().message().contains("cannot be read"));
    }
}
