//! Shaders of Magpie, compiled at build time and embedded as SPIR-V, and the structs that they share with Rust.
//!
//! The Rust modules here are the only source of a shared struct: the build script writes the GLSL twin of module `x` as
//! `shared/x.glsl`, and a test compares every offset with the SPIR-V.

mod compile;
mod sources;
mod types;

// Every file in this folder that holds shared structs.
include!(concat!(env!("OUT_DIR"), "/modules.rs"));

pub use compile::{CompileError, Includes, Rays, Stage, compile_with};
pub use sources::Sources;
pub use types::{Address, SampledImage, SamplerId, StorageImage};

/// A compiled shader.
#[derive(Clone, Copy, Debug)]
pub struct Shader {
    /// Path below `shaders`, such as `shadows/contact.comp`.
    pub name: &'static str,
    /// Its pipeline stage.
    pub stage: Stage,
    /// The backend that it was compiled for, if it is a ray pass.
    pub rays: Option<Rays>,
    /// SPIR-V 1.6, little endian.
    pub spirv: &'static [u8],
}

/// A ray pass, compiled for every backend.
#[derive(Clone, Copy, Debug)]
pub struct RayShader {
    /// Path below `shaders`, such as `shadows/trace.ray`.
    pub name: &'static str,
    /// One per [`Rays`], in the order of [`Rays::ALL`].
    pub ways: [Shader; 3],
}

impl RayShader {
    /// The shader for this backend.
    pub fn way(&self, rays: Rays) -> &Shader {
        &self.ways[rays as usize]
    }
}

include!(concat!(env!("OUT_DIR"), "/shaders.rs"));

struct Embedded;

impl Includes for Embedded {
    fn find(&mut self, name: &str) -> Option<String> {
        INCLUDES.iter().find(|(n, _)| *n == name).map(|(_, text)| (*text).to_owned())
    }
}

/// Compiles GLSL at run time. It may include everything under `lib/` and `shared/`.
///
/// # Errors
/// [`CompileError`] with glslang's message; a warning counts as an error.
pub fn compile(name: &str, source: &str, stage: Stage) -> Result<Vec<u32>, CompileError> {
    compile_with(name, source, stage, &[], &mut Embedded)
}

/// Compiles a ray pass at run time for one backend.
///
/// # Errors
/// As [`compile`].
pub fn compile_rays(name: &str, source: &str, rays: Rays) -> Result<Vec<u32>, CompileError> {
    compile_with(name, source, rays.stage(), &[(rays.define(), None)], &mut Embedded)
}
