//! Every shared struct has the same offsets and size in Rust and in SPIR-V.
use magpie_shaders::{ALL, Stage, compile};
use rspirv::dr::{Module, Operand, load_words};
use rspirv::spirv::{Decoration, Op, StorageClass};
use std::collections::{BTreeMap, BTreeSet, HashMap};
use std::mem::size_of;
use std::path::Path;

/// A struct as rustc lays it out.
#[derive(Clone, Copy, Debug)]
struct Layout {
    /// Module of `magpie_shaders`.
    module: &'static str,
    name: &'static str,
    size: usize,
    fields: &'static [(&'static str, usize)],
}

/// Written by build.rs with `size_of!` and `offset_of!`, one entry per struct.
static LAYOUTS: &[Layout] = include!(concat!(env!("OUT_DIR"), "/layouts.rs"));

/// Modules of `src` that hold no shared structs.
const NOT_SHARED: [&str; 5] = ["lib", "compile", "sources", "twin", "types"];

/// Limit of push constants, bytes.
const PUSH_LIMIT: usize = 128;

/// Limit of a ray pass's push constants, bytes: the rest is the scene's address.
const RAY_PUSH_LIMIT: usize = 120;

/// A struct type with explicit layout, as SPIR-V decorates it.
#[derive(Clone, Debug, Default)]
struct Decorated {
    name: String,
    members: BTreeMap<u32, (String, u32)>,
    /// Stride of a runtime array of this struct, if the module has one.
    stride: Option<u32>,
}

fn word(operand: &Operand) -> u32 {
    match operand {
        Operand::IdRef(v) | Operand::LiteralBit32(v) => *v,
        other => panic!("not a word: {other:?}"),
    }
}

fn text(operand: &Operand) -> String {
    match operand {
        Operand::LiteralString(s) => s.clone(),
        other => panic!("not a text: {other:?}"),
    }
}

/// Struct types with member offsets, by id.
fn decorated(module: &Module) -> HashMap<u32, Decorated> {
    let mut found: HashMap<u32, Decorated> = HashMap::new();
    let mut strides = HashMap::new();
    for a in &module.annotations {
        match (a.class.opcode, &a.operands[..]) {
            (Op::MemberDecorate, [id, member, Operand::Decoration(Decoration::Offset), offset]) => {
                found.entry(word(id)).or_default().members.entry(word(member)).or_default().1 = word(offset);
            }
            (Op::Decorate, [id, Operand::Decoration(Decoration::ArrayStride), stride]) => {
                strides.insert(word(id), word(stride));
            }
            _ => {}
        }
    }
    for n in &module.debug_names {
        let Some(entry) = found.get_mut(&word(&n.operands[0])) else { continue };
        match n.class.opcode {
            Op::Name => entry.name = text(&n.operands[1]),
            Op::MemberName => {
                if let Some(member) = entry.members.get_mut(&word(&n.operands[1])) {
                    member.0 = text(&n.operands[2]);
                }
            }
            _ => {}
        }
    }
    for t in module.types_global_values.iter().filter(|t| t.class.opcode == Op::TypeRuntimeArray) {
        let id = t.result_id.expect("a type has an id");
        if let Some(entry) = found.get_mut(&word(&t.operands[0])) {
            entry.stride = strides.get(&id).copied();
        }
    }
    found
}

/// Describes the first difference between the two layouts.
fn compare(rust: &Layout, spirv: &Decorated) -> Result<(), String> {
    let name = format!("{}::{}", rust.module, rust.name);
    if rust.fields.len() != spirv.members.len() {
        return Err(format!("{name}: {} fields in Rust, {} in SPIR-V", rust.fields.len(), spirv.members.len()));
    }
    for ((field, offset), (other, other_offset)) in rust.fields.iter().zip(spirv.members.values()) {
        if field != other {
            return Err(format!("{name}: {field} in Rust, {other} in SPIR-V"));
        }
        if *offset != *other_offset as usize {
            return Err(format!("{name}.{field}: offset {offset} in Rust, {other_offset} in SPIR-V"));
        }
    }
    match spirv.stride {
        Some(stride) if stride as usize != rust.size => {
            Err(format!("{name}: size {} in Rust, {stride} in SPIR-V", rust.size))
        }
        _ => Ok(()),
    }
}

/// A shader that copies every struct of a module through its buffer references.
fn probe(module: &str) -> Vec<Decorated> {
    let mut source = format!(
        "#version 460\n#extension GL_GOOGLE_include_directive : require\n#include \"lib/bindless.glsl\"\n\
         #include \"shared/{module}.glsl\"\nlayout(local_size_x = 1) in;\n\
         layout(push_constant, scalar) uniform Push {{ uvec2 from; uvec2 to; }};\nvoid main() {{\n"
    );
    for layout in LAYOUTS.iter().filter(|l| l.module == module) {
        let name = layout.name;
        source += &format!("    {name}BufferWrite(to).at[1] = {name}Buffer(from).at[1];\n");
    }
    source += "}\n";
    let words = compile(&format!("probe of {module}"), &source, Stage::Compute).unwrap_or_else(|e| panic!("{e}"));
    let module = load_words(words).expect("SPIR-V");
    decorated(&module).into_values().collect()
}

fn modules() -> BTreeSet<&'static str> {
    LAYOUTS.iter().map(|l| l.module).collect()
}

#[test]
fn every_struct_agrees() {
    for module in modules() {
        let found = probe(module);
        for layout in LAYOUTS.iter().filter(|l| l.module == module) {
            // glslang may emit a separate type for each use of a struct.
            let mut sized = false;
            for spirv in found.iter().filter(|d| d.name == layout.name) {
                compare(layout, spirv).unwrap_or_else(|e| panic!("{e}"));
                sized |= spirv.stride.is_some();
            }
            assert!(sized, "{module}::{}: not in SPIR-V, or without a size", layout.name);
        }
    }
}

#[test]
fn a_wrong_layout_is_found() {
    let found = probe("scene");
    let right = *LAYOUTS.iter().find(|l| l.module == "scene" && l.name == "Light").expect("Light");
    let spirv = found.iter().find(|d| d.name == "Light" && d.stride.is_some()).expect("Light in SPIR-V");
    assert_eq!(compare(&right, spirv), Ok(()));

    let mut fields = right.fields.to_vec();
    fields[2].1 += 4;
    let moved = Layout { fields: fields.leak(), ..right };
    assert_eq!(compare(&moved, spirv), Err("scene::Light.direction: offset 20 in Rust, 16 in SPIR-V".to_owned()),);

    let mut fields = right.fields.to_vec();
    fields.swap(1, 2);
    let swapped = Layout { fields: fields.leak(), ..right };
    assert!(compare(&swapped, spirv).is_err_and(|e| e.contains("direction in Rust, position in SPIR-V")));

    let short = Layout { fields: &right.fields[1..], ..right };
    assert!(compare(&short, spirv).is_err_and(|e| e.contains("fields in Rust")));

    let padded = Layout { size: right.size + 4, ..right };
    assert!(compare(&padded, spirv).is_err_and(|e| e.contains("size")));
}

#[test]
fn no_struct_is_forgotten() {
    let folder = Path::new(env!("CARGO_MANIFEST_DIR")).join("src");
    let mut in_sources = BTreeSet::new();
    for entry in std::fs::read_dir(folder).expect("src") {
        let path = entry.expect("entry").path();
        let module = path.file_stem().expect("stem").to_string_lossy().into_owned();
        if NOT_SHARED.contains(&module.as_str()) {
            continue;
        }
        let file = syn::parse_file(&std::fs::read_to_string(&path).expect("text")).expect("Rust");
        for item in file.items {
            let syn::Item::Struct(item) = item else { continue };
            let name = format!("{module}::{}", item.ident);
            type Paths = syn::punctuated::Punctuated<syn::Meta, syn::Token![,]>;
            let repr_c = item.attrs.iter().filter(|a| a.path().is_ident("repr")).any(|a| {
                a.parse_args_with(Paths::parse_terminated)
                    .is_ok_and(|words| words.iter().any(|word| word.path().is_ident("C")))
            });
            assert!(repr_c, "{name} is shared with GLSL but not #[repr(C)]");
            in_sources.insert(name);
        }
    }
    let compared: BTreeSet<_> = LAYOUTS.iter().map(|l| format!("{}::{}", l.module, l.name)).collect();
    assert!(!compared.is_empty());
    assert_eq!(in_sources, compared);
}

/// The structs as the shipped shaders use them, and the sizes of their push constants.
#[test]
fn shipped_shaders_agree() {
    for shader in ALL {
        let words: Vec<u32> =
            shader.spirv.chunks_exact(4).map(|b| u32::from_le_bytes([b[0], b[1], b[2], b[3]])).collect();
        let module = load_words(words).unwrap_or_else(|e| panic!("{}: {e}", shader.name));
        let found = decorated(&module);
        let effect = shader.name.split('/').next().expect("folder");
        let own = |name: &str| {
            let mut of_name = LAYOUTS.iter().filter(|l| l.name == name);
            let first = of_name.clone().next();
            of_name.find(|l| l.module == effect).or(first)
        };
        let mut compared = 0;
        for spirv in found.values() {
            if let Some(layout) = own(&spirv.name) {
                compare(layout, spirv).unwrap_or_else(|e| panic!("{}: {e}", shader.name));
                compared += 1;
            }
        }
        if matches!(shader.stage, Stage::ClosestHit | Stage::Miss) {
            assert!(pushed(&module, &found).is_empty(), "{}: the payload is all that it needs", shader.name);
            continue;
        }
        assert!(compared > 0, "{}: no shared struct", shader.name);
        assert_eq!(pushed(&module, &found), vec!["Push".to_owned()], "{}: push constant blocks", shader.name);
        let params = found.values().find(|d| d.name == "Push").expect("Push");
        // The last eight bytes are for the shaders of hit groups, which do not know the pass.
        let hit = matches!(shader.stage, Stage::AnyHit | Stage::Intersection);
        let wanted = if hit { ("scene_address", RAY_PUSH_LIMIT as u32) } else { ("params", 0) };
        let members: Vec<_> = params.members.values().map(|(n, o)| (n.as_str(), *o)).collect();
        assert_eq!(members, [wanted], "{}", shader.name);
        if hit {
            continue;
        }
        let limit = if shader.name.ends_with(".ray") { RAY_PUSH_LIMIT } else { PUSH_LIMIT };
        let pushes =
            found.values().filter(|d| d.name.ends_with("Params")).filter_map(|d| own(&d.name)).map(|l| l.size).max();
        assert!(pushes.is_some_and(|size| size <= limit), "{}: pushes {pushes:?} bytes", shader.name);
    }
}

/// Names of the blocks behind the push-constant variables.
fn pushed(module: &Module, found: &HashMap<u32, Decorated>) -> Vec<String> {
    let pointee = |id: u32| {
        let pointer = module.types_global_values.iter().find(|t| t.result_id == Some(id)).expect("type");
        word(&pointer.operands[1])
    };
    module
        .types_global_values
        .iter()
        .filter(|t| {
            t.class.opcode == Op::Variable && t.operands[0] == Operand::StorageClass(StorageClass::PushConstant)
        })
        .map(|t| found[&pointee(t.result_type.expect("a variable has a type"))].name.clone())
        .collect()
}
