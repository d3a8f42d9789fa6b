//! Makes a module of every file of shared structs, writes their GLSL twins, compiles every shader to SPIR-V and embeds both in the crate.
use std::collections::BTreeMap;
use std::fmt::Write as _;
use std::path::{Path, PathBuf};
use std::{env, fs};

#[path = "src/compile.rs"]
#[allow(dead_code)]
mod compile;
#[path = "src/twin.rs"]
mod twin;

type Result<T> = std::result::Result<T, Box<dyn std::error::Error>>;

/// Rust files in `src` that hold no shared structs.
const NOT_SHARED: [&str; 5] = ["lib", "compile", "sources", "twin", "types"];

struct Texts(BTreeMap<String, String>);

impl compile::Includes for Texts {
    fn find(&mut self, name: &str) -> Option<String> {
        self.0.get(name).cloned()
    }
}

fn main() {
    if let Err(error) = build() {
        // glslang's message has line breaks; `Termination` would print them escaped.
        eprintln!("{error}");
        std::process::exit(1);
    }
}

fn build() -> Result<()> {
    println!("cargo:rerun-if-changed=.");
    let out = PathBuf::from(env::var("OUT_DIR")?);
    let mut texts = Texts(BTreeMap::new());
    let (mut layouts, mut modules) = (String::new(), String::new());
    for file in files(Path::new("src"), "rs")? {
        let module = stem(&file);
        if !NOT_SHARED.contains(&module.as_str()) {
            let source = fs::read_to_string(&file)?;
            texts.0.insert(format!("shared/{module}.glsl"), twin::glsl(&module, &source)?);
            layouts.push_str(&twin::layouts(&module, &source)?);
            let _ = writeln!(modules, "#[path = {:?}]\npub mod {module};", fs::canonicalize(&file)?);
        }
    }
    for file in files(Path::new("lib"), "glsl")? {
        texts.0.insert(format!("lib/{}.glsl", stem(&file)), fs::read_to_string(&file)?);
    }

    let mut code =
        String::from("/// Every file that a shader can include, by name.\npub static INCLUDES: &[(&str, &str)] = &[\n");
    for (name, text) in &texts.0 {
        let _ = writeln!(code, "    ({name:?}, {text:?}),");
    }
    code.push_str("];\n");

    let mut listed = String::new();
    for folder in folders()? {
        for file in files(&folder, "")? {
            let file_name = file.file_name().unwrap_or_default().to_string_lossy().into_owned();
            let effect = stem(&folder);
            let name = format!("{effect}/{file_name}");
            let source = || fs::read_to_string(&file);
            let constant = format!("{effect}_{}", file_name.replace('.', "_")).to_uppercase();
            let mut embed = |stage: compile::Stage, rays: Option<compile::Rays>| -> Result<String> {
                let defines: Vec<_> = rays.iter().map(|rays| (rays.define(), None)).collect();
                let way = rays.map_or(String::new(), |rays| format!(".{rays}"));
                let ways = rays.map_or("None".to_owned(), |rays| format!("Some(Rays::{rays:?})"));
                let words = compile::compile_with(&name, &source()?, stage, &defines, &mut texts)?;
                let spv = out.join(format!("{effect}.{file_name}{way}.spv"));
                fs::write(&spv, words.iter().flat_map(|w| w.to_le_bytes()).collect::<Vec<u8>>())?;
                Ok(format!(
                    "Shader {{ name: {name:?}, stage: Stage::{stage:?}, rays: {ways}, spirv: include_bytes!({spv:?}) }}"
                ))
            };
            if file_name.ends_with(".ray") {
                let mut ways = String::new();
                for (at, rays) in compile::Rays::ALL.into_iter().enumerate() {
                    let shader = embed(rays.stage(), Some(rays))?;
                    let _ = write!(ways, "{shader}, ");
                    let _ = write!(listed, "&{constant}.ways[{at}], ");
                }
                let _ = writeln!(
                    code,
                    "/// `{name}`\npub static {constant}: RayShader = RayShader {{ name: {name:?}, ways: [{ways}] }};"
                );
            } else if let Some(stage) = compile::Stage::of_file(&file_name) {
                let shader = embed(stage, None)?;
                let _ = writeln!(code, "/// `{name}`\npub static {constant}: Shader = {shader};");
                let _ = write!(listed, "&{constant}, ");
            }
        }
    }
    let _ = writeln!(code, "/// Every shader of the crate.\npub static ALL: &[&Shader] = &[{listed}];");
    fs::write(out.join("shaders.rs"), code)?;
    fs::write(out.join("modules.rs"), modules)?;
    // Included by tests/layout.rs.
    fs::write(out.join("layouts.rs"), format!("&[\n{layouts}]\n"))?;
    Ok(())
}

/// The effect folders: all but the crate's own sources and the shared library.
fn folders() -> Result<Vec<PathBuf>> {
    let mut found = Vec::new();
    for entry in fs::read_dir(".")? {
        let path = entry?.path();
        if path.is_dir() && !["src", "lib", "tests", "target"].contains(&stem(&path).as_str()) {
            found.push(path);
        }
    }
    found.sort();
    Ok(found)
}

/// Files of a folder with this extension (any, if empty), in the order of their names.
fn files(folder: &Path, extension: &str) -> Result<Vec<PathBuf>> {
    let mut found = Vec::new();
    for entry in fs::read_dir(folder)? {
        let path = entry?.path();
        if path.is_file() && (extension.is_empty() || path.extension().is_some_and(|e| e == extension)) {
            found.push(path);
        }
    }
    found.sort();
    Ok(found)
}

fn stem(path: &Path) -> String {
    path.file_stem().unwrap_or_default().to_string_lossy().into_owned()
}
