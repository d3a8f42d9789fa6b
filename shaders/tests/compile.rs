//! Compiling at run time: messages name file and line, warnings are errors, includes are found.
use magpie_shaders::{ALL, CompileError, INCLUDES, Includes, Rays, Stage, compile, compile_rays, compile_with};

const HEAD: &str = "#version 460\n#extension GL_GOOGLE_include_directive : require\n";

fn message(source: &str) -> String {
    match compile("mine.comp", source, Stage::Compute) {
        Ok(_) => panic!("it compiled:\n{source}"),
        Err(e) => e.to_string(),
    }
}

#[test]
fn an_error_names_file_and_line() {
    let text = message(&format!("{HEAD}void main() {{\n    float x = missing;\n}}\n"));
    assert!(text.contains("mine.comp:4") && text.contains("missing"), "{text}");
}

#[test]
fn an_error_in_an_included_file_names_that_file() {
    struct Broken;
    impl Includes for Broken {
        fn find(&mut self, name: &str) -> Option<String> {
            (name == "lib/broken.glsl").then(|| "\nfloat f() { return nothing; }\n".to_owned())
        }
    }
    let source = format!("{HEAD}#include \"lib/broken.glsl\"\nvoid main() {{}}\n");
    let error = compile_with("mine.comp", &source, Stage::Compute, &[], &mut Broken).expect_err("broken");
    let text = error.to_string();
    assert!(text.contains("lib/broken.glsl:2") && text.contains("nothing"), "{text}");
}

#[test]
fn a_missing_include_names_the_include() {
    let text = message(&format!("{HEAD}#include \"lib/nowhere.glsl\"\nvoid main() {{}}\n"));
    assert!(text.contains("lib/nowhere.glsl") && text.contains("mine.comp:3"), "{text}");
}

#[test]
fn a_warning_is_an_error() {
    let source = "#version 460\n#extension GL_MAGPIE_unheard_of : enable\nvoid main() {}\n";
    let text = message(source);
    assert!(
        text.contains("WARNING") && text.contains("mine.comp:2") && text.contains("GL_MAGPIE_unheard_of"),
        "{text}"
    );
    let without = source.replace("#extension GL_MAGPIE_unheard_of : enable\n", "");
    assert!(compile("mine.comp", &without, Stage::Compute).is_ok());
}

#[test]
fn a_nul_byte_is_an_error() {
    let error = compile("mine.comp", "#version 460\nvoid main() {}\0", Stage::Compute).expect_err("NUL");
    assert!(matches!(error, CompileError::Source { .. }), "{error}");
}

/// Files that work on types of whoever includes them. They are compiled with each of these.
const TEMPLATES: [&str; 2] = ["lib/merging.glsl", "lib/reservoir_stream.glsl"];

#[test]
fn templates_are_used() {
    for template in TEMPLATES {
        let include = format!("#include \"{template}\"");
        assert!(INCLUDES.iter().any(|(_, source)| source.contains(&include)), "{template} is included nowhere");
    }
}

#[test]
fn includes_work_at_run_time() {
    for (name, _) in INCLUDES.iter().filter(|(name, _)| !TEMPLATES.contains(name)) {
        // A backend's file is compiled for that backend.
        let ways = match name.strip_prefix("lib/ray_") {
            Some("query.glsl") => vec![Rays::Query],
            Some("pipeline.glsl" | "payload.glsl") => vec![Rays::Pipeline],
            Some("driver.glsl") => vec![Rays::Query, Rays::Pipeline],
            Some("software.glsl") => vec![Rays::Software],
            _ => Rays::ALL.to_vec(),
        };
        for rays in ways {
            let source = format!("{HEAD}#include \"lib/ray.glsl\"\n#include \"{name}\"\nvoid main() {{}}\n");
            let words = compile_rays(name, &source, rays).unwrap_or_else(|e| panic!("{e}"));
            assert_eq!(words[0], 0x0723_0203, "{name}: SPIR-V's magic number");
        }
    }
}

#[test]
fn defines_reach_the_source() {
    struct Nothing;
    impl Includes for Nothing {
        fn find(&mut self, _: &str) -> Option<String> {
            None
        }
    }
    let source = "#version 460\n#ifndef WANTED\n#error not defined\n#endif\nvoid main() { float x = float(WANTED); }\n";
    assert!(compile_with("mine.comp", source, Stage::Compute, &[], &mut Nothing).is_err());
    assert!(compile_with("mine.comp", source, Stage::Compute, &[("WANTED", Some("3"))], &mut Nothing).is_ok());
}

#[test]
fn every_stage_is_known_by_its_extension() {
    assert!(!ALL.is_empty());
    for shader in ALL {
        if shader.name.ends_with(".ray") {
            assert!(Rays::ALL.iter().any(|r| r.stage() == shader.stage), "{}", shader.name);
        } else {
            assert_eq!(Stage::of_file(shader.name), Some(shader.stage), "{}", shader.name);
        }
    }
    assert_eq!(Stage::of_file("lib/brdf.glsl"), None);
}

#[test]
fn the_walk_counts_its_steps_where_it_is_asked_to() {
    struct Embedded;
    impl Includes for Embedded {
        fn find(&mut self, name: &str) -> Option<String> {
            INCLUDES.iter().find(|(n, _)| *n == name).map(|(_, text)| (*text).to_owned())
        }
    }
    let source = format!(
        "{HEAD}#include \"lib/ray.glsl\"
layout(push_constant, scalar) uniform Push {{ uvec2 scene; uint steps; }};
void main() {{
    Hit hit;
    trace_closest(SceneBuffer(scene), make_ray(vec3(0.0), 0.0, vec3(1.0), 1.0), hit);
    store_uint(steps, ivec2(RAY_INVOCATION.xy), uvec4(ray_steps, 0u, 0u));
}}
"
    );
    let with = [("RAYS_SOFTWARE", None), ("RAYS_STEPS", None)];
    assert!(compile_with("steps.ray", &source, Stage::Compute, &with, &mut Embedded).is_ok());
    // Without the define there is no counter, and so no cost.
    let error = compile_with("steps.ray", &source, Stage::Compute, &with[..1], &mut Embedded).expect_err("no counter");
    assert!(error.to_string().contains("ray_steps"), "{error}");
}
