//! Paths of the repository and of built programs.

use crate::shell::Invocation;
use anyhow::{Context, Result};
use std::env;
use std::path::{Path, PathBuf};

/// The repository and the tools found at the start.
pub struct Workplace {
    /// Root of the repository.
    pub root: PathBuf,
    /// Folder of `cargo build --release`: the one that contains this program.
    programs: PathBuf,
    /// C++ compiler that the `cc` crate would not find by itself.
    compiler: Option<String>,
}

impl Workplace {
    /// Finds the repository from the environment that `cargo run` sets.
    pub fn find() -> Result<Workplace> {
        let manifest = env::var_os("CARGO_MANIFEST_DIR").context("start this through `cargo xtask`")?;
        let root = Path::new(&manifest).ancestors().nth(2).context("tests/xtask lies two folders below the root")?;
        let program = env::current_exe().context("where this program lies")?;
        let programs = program.parent().context("the folder of this program")?;
        Ok(Workplace { root: root.to_owned(), programs: programs.to_owned(), compiler: None })
    }

    /// Makes cargo compile C++ with `compiler` from now on.
    pub fn compile_with(&mut self, compiler: &str) {
        // `c++` is the cc crate's default; setting the variable to it would only cause rebuilds.
        self.compiler = (compiler != "c++" && env::var_os("CXX").is_none()).then(|| compiler.to_owned());
    }

    /// A cargo command in the root of the repository.
    pub fn cargo(&self, arguments: &[&str]) -> Invocation {
        let cargo = env::var("CARGO").unwrap_or_else(|_| "cargo".to_owned());
        let mut invocation = Invocation::new(&cargo, arguments).shown_as("cargo").within(&self.root);
        // Variables that describe this program to itself do not apply to the next cargo.
        for (name, _) in env::vars_os() {
            let Some(name) = name.to_str() else { continue };
            if ["CARGO_PKG_", "CARGO_MANIFEST_", "CARGO_BIN_"].iter().any(|prefix| name.starts_with(prefix)) {
                invocation = invocation.without_env(name);
            }
        }
        match &self.compiler {
            Some(compiler) => invocation.with_env("CXX", compiler),
            None => invocation,
        }
    }

    /// Path of the built `magpie`, which may not exist yet.
    pub fn magpie(&self) -> PathBuf {
        self.programs.join(format!("magpie{}", env::consts::EXE_SUFFIX))
    }

    /// Folder of the pictures of `cargo xtask demo`.
    pub fn pictures(&self) -> PathBuf {
        self.programs.parent().unwrap_or(&self.root).join("demo")
    }
}

/// Whether a program of this name is on the search path.
pub fn on_path(program: &str) -> bool {
    let file = format!("{program}{}", env::consts::EXE_SUFFIX);
    env::var_os("PATH").is_some_and(|path| env::split_paths(&path).any(|folder| folder.join(&file).is_file()))
}
