//! GLSL to SPIR-V through glslang. The build script and the running program (hot reload, a user's own pass) share this file.
use glslang::error::GlslangError;
use glslang::include::{IncludeHandler, IncludeResult, IncludeType};
use glslang::{
    Compiler, CompilerOptions, ShaderInput, ShaderMessage, ShaderSource, ShaderStage, SourceLanguage, SpirvVersion,
    Target, VulkanVersion,
};

/// The pipeline stage that a shader runs in.
#[derive(Clone, Copy, Debug, PartialEq, Eq, Hash)]
pub enum Stage {
    /// Vertex shader (`.vert`).
    Vertex,
    /// Fragment shader (`.frag`).
    Fragment,
    /// Compute shader (`.comp`).
    Compute,
    /// Ray-generation shader: a ray pass (`.ray`) as the pipeline backend compiles it.
    RayGeneration,
    /// Closest-hit shader (`.rchit`).
    ClosestHit,
    /// Any-hit shader (`.rahit`).
    AnyHit,
    /// Intersection shader (`.rint`).
    Intersection,
    /// Miss shader (`.rmiss`).
    Miss,
}

impl Stage {
    /// The stage of a file name's extension; none for other files.
    pub fn of_file(name: &str) -> Option<Self> {
        match name.rsplit_once('.')?.1 {
            "vert" => Some(Self::Vertex),
            "frag" => Some(Self::Fragment),
            "comp" => Some(Self::Compute),
            "rchit" => Some(Self::ClosestHit),
            "rahit" => Some(Self::AnyHit),
            "rint" => Some(Self::Intersection),
            "rmiss" => Some(Self::Miss),
            _ => None,
        }
    }
}

/// Backends for ray tracing.
#[derive(Clone, Copy, Debug, Default, PartialEq, Eq, PartialOrd, Ord, Hash)]
pub enum Rays {
    /// Magpie's own BVH, traversed in compute shaders; works on every device.
    #[default]
    Software,
    /// The driver's ray queries, in compute shaders.
    Query,
    /// The driver's ray-tracing pipeline.
    Pipeline,
}

impl Rays {
    /// All backends.
    pub const ALL: [Self; 3] = [Self::Software, Self::Query, Self::Pipeline];

    /// Its name on the command line and in reports.
    pub fn name(self) -> &'static str {
        match self {
            Self::Software => "software",
            Self::Query => "query",
            Self::Pipeline => "pipeline",
        }
    }

    /// The stage that a ray pass (`*.ray`) is compiled as.
    pub fn stage(self) -> Stage {
        if self == Self::Pipeline { Stage::RayGeneration } else { Stage::Compute }
    }

    /// The macro that is defined while a ray pass is compiled.
    pub fn define(self) -> &'static str {
        match self {
            Self::Software => "RAYS_SOFTWARE",
            Self::Query => "RAYS_QUERY",
            Self::Pipeline => "RAYS_PIPELINE",
        }
    }
}

impl std::fmt::Display for Rays {
    fn fmt(&self, f: &mut std::fmt::Formatter<'_>) -> std::fmt::Result {
        f.write_str(self.name())
    }
}

/// Why a shader did not compile.
#[derive(Debug, thiserror::Error)]
pub enum CompileError {
    /// glslang could not be started.
    #[error("glslang could not be initialised")]
    NoCompiler,
    /// The source holds a NUL byte.
    #[error("{name}: the source holds a NUL byte")]
    Source {
        /// Name of the shader.
        name: String,
    },
    /// A file of the source cannot be read.
    #[error("{name}: {reason}")]
    Unreadable {
        /// Name of the file.
        name: String,
        /// Message of the system.
        reason: String,
    },
    /// glslang refused the source. Warnings count as errors.
    #[error("{name}: {log}")]
    Refused {
        /// Name of the shader.
        name: String,
        /// glslang's messages.
        log: String,
    },
}

/// Resolves `#include` by name (`lib/brdf.glsl`, `shared/scene.glsl`).
pub trait Includes {
    /// The text of `name`, or `None` when there is no such file.
    fn find(&mut self, name: &str) -> Option<String>;
}

struct Handler<'a>(&'a mut dyn Includes);

impl IncludeHandler for Handler<'_> {
    fn include(&mut self, _: IncludeType, header: &str, _: &str, _: usize) -> Option<IncludeResult> {
        let data = self.0.find(header)?;
        if data.contains('\0') {
            return None;
        }
        Some(IncludeResult { name: header.to_owned(), data })
    }
}

/// Compiles one GLSL entry point (`main`) for Vulkan 1.3 to SPIR-V 1.6 words. Every warning is an error.
pub fn compile_with(
    name: &str,
    source: &str,
    stage: Stage,
    defines: &[(&str, Option<&str>)],
    includes: &mut dyn Includes,
) -> Result<Vec<u32>, CompileError> {
    if source.contains('\0') {
        return Err(CompileError::Source { name: name.to_owned() });
    }
    // glslang names the main source "0" in its messages.
    let refused = |log: &str| CompileError::Refused {
        name: name.to_owned(),
        log: log
            .trim()
            .replace("ERROR: 0:", &format!("ERROR: {name}:"))
            .replace("WARNING: 0:", &format!("WARNING: {name}:")),
    };
    let failed = |error: GlslangError| match &error {
        GlslangError::PreprocessError(log)
        | GlslangError::ParseError(log)
        | GlslangError::MapIoError(log)
        | GlslangError::LinkError(log) => refused(&log.log),
        other => refused(&other.to_string()),
    };
    let compiler = Compiler::acquire().ok_or(CompileError::NoCompiler)?;
    let text = ShaderSource::from(source);
    let options = CompilerOptions {
        source_language: SourceLanguage::GLSL,
        target: Target::Vulkan { version: VulkanVersion::Vulkan1_3, spirv_version: SpirvVersion::SPIRV1_6 },
        version_profile: None,
        messages: ShaderMessage::DEFAULT,
    };
    let glslang_stage = match stage {
        Stage::Vertex => ShaderStage::Vertex,
        Stage::Fragment => ShaderStage::Fragment,
        Stage::Compute => ShaderStage::Compute,
        Stage::RayGeneration => ShaderStage::RayGeneration,
        Stage::ClosestHit => ShaderStage::ClosestHit,
        Stage::AnyHit => ShaderStage::AnyHit,
        Stage::Intersection => ShaderStage::Intersect,
        Stage::Miss => ShaderStage::Miss,
    };
    let mut handler = Handler(includes);
    let input = ShaderInput::new(&text, glslang_stage, &options, Some(defines), Some(&mut handler)).map_err(failed)?;
    let shader = compiler.create_shader(input).map_err(failed)?;
    let log = shader.get_log();
    if log.contains("WARNING") {
        return Err(refused(&log));
    }
    shader.compile().map_err(failed)
}
