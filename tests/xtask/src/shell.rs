//! Commands as values, which can be printed, run, or both.

use anyhow::{Context, Result, bail};
use std::fmt;
use std::io::Write;
use std::path::{Path, PathBuf};
use std::process::{Command, Output, Stdio};

/// A command with arguments, environment and input.
#[derive(Clone, Debug, PartialEq, Eq)]
pub struct Invocation {
    program: String,
    shown: String,
    arguments: Vec<String>,
    env: Vec<(String, Option<String>)>,
    folder: Option<PathBuf>,
    input: Option<String>,
    quiet: bool,
}

impl Invocation {
    /// `program` with `arguments`.
    pub fn new(program: &str, arguments: &[&str]) -> Invocation {
        Invocation {
            program: program.to_owned(),
            shown: program.to_owned(),
            arguments: arguments.iter().map(|&a| a.to_owned()).collect(),
            env: Vec::new(),
            folder: None,
            input: None,
            quiet: false,
        }
    }

    /// Prints another name instead of the full path.
    pub fn shown_as(self, shown: &str) -> Invocation {
        Invocation { shown: shown.to_owned(), ..self }
    }

    /// Runs in `folder`.
    pub fn within(self, folder: &Path) -> Invocation {
        Invocation { folder: Some(folder.to_owned()), ..self }
    }

    /// With a variable set.
    pub fn with_env(mut self, name: &str, value: &str) -> Invocation {
        self.env.push((name.to_owned(), Some(value.to_owned())));
        self
    }

    /// With a variable removed.
    pub fn without_env(mut self, name: &str) -> Invocation {
        self.env.push((name.to_owned(), None));
        self
    }

    /// Passes `input` on standard input.
    pub fn fed(self, input: &str) -> Invocation {
        Invocation { input: Some(input.to_owned()), ..self }
    }

    /// Discards standard output; standard error is still shown.
    pub fn quietly(self) -> Invocation {
        Invocation { quiet: true, ..self }
    }

    /// The same command run by `prefix`, for example `sudo`. `env` sets the variables after it, because sudo clears inherited ones.
    pub fn through(self, prefix: &[String]) -> Invocation {
        let Some((program, rest)) = prefix.split_first() else { return self };
        let mut arguments = rest.to_vec();
        if !self.env.is_empty() {
            arguments.push("env".to_owned());
        }
        arguments.extend(self.env.iter().filter_map(|(name, value)| Some(format!("{name}={}", value.as_ref()?))));
        arguments.push(self.program);
        arguments.extend(self.arguments);
        Invocation { program: program.clone(), shown: program.clone(), arguments, env: Vec::new(), ..self }
    }

    fn command(&self) -> Command {
        let mut command = Command::new(&self.program);
        command.args(&self.arguments);
        for (name, value) in &self.env {
            match value {
                Some(value) => command.env(name, value),
                None => command.env_remove(name),
            };
        }
        if let Some(folder) = &self.folder {
            command.current_dir(folder);
        }
        command
    }

    /// Prints the command, runs it and returns its exit status: `None` if a signal ended it.
    pub fn status(&self) -> Result<Option<i32>> {
        println!("  $ {self}");
        let mut command = self.command();
        if self.input.is_some() {
            command.stdin(Stdio::piped());
        }
        if self.quiet {
            command.stdout(Stdio::null());
        }
        let mut child = command.spawn().with_context(|| format!("{} could not be started", self.shown))?;
        if let (Some(input), Some(mut pipe)) = (&self.input, child.stdin.take()) {
            pipe.write_all(input.as_bytes()).with_context(|| format!("writing to {}", self.shown))?;
        }
        Ok(child.wait().with_context(|| format!("waiting for {}", self.shown))?.code())
    }

    /// Prints the command and runs it; any status but 0 is an error.
    pub fn run(&self) -> Result<()> {
        match self.status()? {
            Some(0) => Ok(()),
            Some(code) => bail!("`{self}` ended with status {code}"),
            None => bail!("`{self}` was ended by a signal"),
        }
    }

    /// Runs the command silently and returns its output.
    pub fn output(&self) -> Result<Output> {
        self.command().stdin(Stdio::null()).output().with_context(|| format!("{} could not be started", self.shown))
    }
}

impl fmt::Display for Invocation {
    fn fmt(&self, f: &mut fmt::Formatter<'_>) -> fmt::Result {
        for (name, value) in &self.env {
            if let Some(value) = value {
                write!(f, "{name}={} ", quoted(value))?;
            }
        }
        f.write_str(&quoted(&self.shown))?;
        self.arguments.iter().try_for_each(|argument| write!(f, " {}", quoted(argument)))
    }
}

/// `word` quoted for a POSIX shell if needed.
fn quoted(word: &str) -> String {
    let plain = |c: char| c.is_ascii_alphanumeric() || "-_./=:,+@%~".contains(c);
    if !word.is_empty() && word.chars().all(plain) {
        word.to_owned()
    } else {
        format!("'{}'", word.replace('\'', r"'\''"))
    }
}

#[cfg(test)]
mod tests {
    use super::*;

    #[test]
    fn a_command_is_shown_as_a_shell_takes_it() {
        let command = Invocation::new("cargo", &["test", "a b", "it's", ""]).with_env("RUSTDOCFLAGS", "-D warnings");
        assert_eq!(command.to_string(), r"RUSTDOCFLAGS='-D warnings' cargo test 'a b' 'it'\''s' ''");
    }

    #[test]
    fn sudo_gets_the_variables_as_arguments() {
        let prefix = ["sudo".to_owned(), "-n".to_owned()];
        let command = Invocation::new("apt-get", &["update"]).with_env("DEBIAN_FRONTEND", "noninteractive");
        assert_eq!(
            command.clone().through(&prefix).to_string(),
            "sudo -n env DEBIAN_FRONTEND=noninteractive apt-get update"
        );
        assert_eq!(command.clone().through(&[]), command);
    }

    #[test]
    fn a_status_that_is_not_zero_is_an_error_with_the_command() {
        let cargo = std::env::var("CARGO").unwrap();
        let error = Invocation::new(&cargo, &["no-such-command"]).shown_as("cargo").run().unwrap_err();
        assert_eq!(error.to_string(), "`cargo no-such-command` ended with status 101");
    }

    #[test]
    fn a_program_that_is_not_there_is_an_error_with_its_name() {
        let error = Invocation::new("no-such-program-of-magpie", &[]).run().unwrap_err();
        assert_eq!(error.to_string(), "no-such-program-of-magpie could not be started");
    }
}
