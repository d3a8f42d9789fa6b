//! Generates the GLSL equivalent of a Rust module of shared structs. Only the build script uses it.
use std::fmt::Write;
use syn::{Expr, Fields, Item, Lit, Type};

/// The GLSL text for the constants and `#[repr(C)]` structs of one Rust source text.
///
/// Types: `f32 u32 i32`, `[f32; 2..4]` (vec), `[u32; 2..4]` (uvec), `[[f32; 4]; 4]` (mat4, column-major),
/// other arrays, `Address` (uvec2), `SampledImage`, `StorageImage`, `SamplerId` (uint), and structs by name.
/// Each struct `X` also gets buffer references `XBuffer` (read only) and `XBufferWrite`, both with a runtime array `at`.
pub fn glsl(module: &str, source: &str) -> Result<String, String> {
    let file = syn::parse_file(source).map_err(|e| format!("{module}.rs: {e}"))?;
    let guard = format!("SHARED_{}_GLSL", module.to_uppercase());
    let mut out = format!("#ifndef {guard}\n#define {guard}\n");
    let mut structs = Vec::new();
    for item in &file.items {
        match item {
            Item::Const(c) => constant(c, &mut out).map_err(|e| format!("{module}.rs: {e}"))?,
            Item::Struct(s) => structs.push(s),
            Item::Use(u) => include(u, &mut out),
            _ => {}
        }
    }
    for item in by_use(structs) {
        structure(item, &mut out).map_err(|e| format!("{module}.rs: {e}"))?;
    }
    out.push_str("#endif\n");
    Ok(out)
}

/// Rust code for one `Layout` (see `tests/layout.rs`) per struct of a module, with the offsets that rustc gives its fields.
pub fn layouts(module: &str, source: &str) -> Result<String, String> {
    let file = syn::parse_file(source).map_err(|e| format!("{module}.rs: {e}"))?;
    let mut out = String::new();
    for item in &file.items {
        let Item::Struct(item) = item else { continue };
        let path = format!("magpie_shaders::{module}::{}", item.ident);
        let _ = write!(
            out,
            "Layout {{ module: {module:?}, name: \"{}\", size: size_of::<{path}>(), fields: &[",
            item.ident
        );
        for ident in item.fields.iter().filter_map(|f| f.ident.as_ref()) {
            let _ = write!(out, "(\"{ident}\", std::mem::offset_of!({path}, {ident})), ");
        }
        out.push_str("] },\n");
    }
    Ok(out)
}

/// GLSL needs a struct before its first use: used structs first, else in the order of the file.
fn by_use(mut rest: Vec<&syn::ItemStruct>) -> Vec<&syn::ItemStruct> {
    let mut sorted = Vec::new();
    while !rest.is_empty() {
        // Structs cannot contain each other in a cycle, so there is always a first.
        let next = rest.iter().position(|s| !s.fields.iter().any(|f| rest.iter().any(|r| mentions(&f.ty, r))));
        sorted.push(rest.remove(next.unwrap_or(0)));
    }
    sorted
}

/// Whether a field of this type contains that struct.
fn mentions(ty: &Type, item: &syn::ItemStruct) -> bool {
    match ty {
        Type::Path(p) => p.path.segments.last().is_some_and(|s| s.ident == item.ident),
        Type::Array(a) => mentions(&a.elem, item),
        _ => false,
    }
}

/// `use super::scene::Light;` becomes an include of that module's GLSL.
fn include(item: &syn::ItemUse, out: &mut String) {
    if let syn::UseTree::Path(path) = &item.tree
        && path.ident == "super"
        && let syn::UseTree::Path(module) = &*path.tree
        && module.ident != "types"
    {
        let _ = writeln!(out, "#include \"shared/{}.glsl\"", module.ident);
    }
}

fn constant(item: &syn::ItemConst, out: &mut String) -> Result<(), String> {
    let name = &item.ident;
    let (kind, suffix) = match &*item.ty {
        Type::Path(p) if p.path.is_ident("u32") => ("uint", "u"),
        Type::Path(p) if p.path.is_ident("f32") => ("float", ""),
        _ => return Err(format!("constant {name}: only u32 and f32 have a GLSL twin")),
    };
    let Expr::Lit(value) = &*item.expr else {
        return Err(format!("constant {name}: its value must be a literal"));
    };
    let text = match &value.lit {
        Lit::Int(i) => i.base10_digits().to_owned(),
        Lit::Float(f) => f.base10_digits().to_owned(),
        _ => return Err(format!("constant {name}: its value must be a number")),
    };
    let _ = writeln!(out, "const {kind} {name} = {text}{suffix};");
    Ok(())
}

fn structure(item: &syn::ItemStruct, out: &mut String) -> Result<(), String> {
    let name = &item.ident;
    let Fields::Named(fields) = &item.fields else {
        return Err(format!("{name}: only structs with named fields have a GLSL twin"));
    };
    let _ = writeln!(out, "struct {name} {{");
    for field in &fields.named {
        let ident = field.ident.as_ref().map(ToString::to_string).unwrap_or_default();
        let (base, suffix) = glsl_type(&field.ty).map_err(|e| format!("{name}.{ident}: {e}"))?;
        let _ = writeln!(out, "    {base} {ident}{suffix};");
    }
    out.push_str("};\n");
    let alignment = alignment(item).map_err(|e| format!("{name}: {e}"))?;
    for (suffix, access) in [("Buffer", "readonly"), ("BufferWrite", "")] {
        let _ = writeln!(
            out,
            "layout(buffer_reference, scalar, buffer_reference_align = {alignment}) {access} buffer {name}{suffix} {{ {name} at[]; }};"
        );
    }
    Ok(())
}

/// That of `repr(align)`, with which compilers load several words at once; else that of a word.
fn alignment(item: &syn::ItemStruct) -> Result<u32, String> {
    let mut alignment = 4;
    for attribute in item.attrs.iter().filter(|attribute| attribute.path().is_ident("repr")) {
        let read = attribute.parse_nested_meta(|meta| {
            if meta.path.is_ident("align") {
                let number;
                syn::parenthesized!(number in meta.input);
                alignment = number.parse::<syn::LitInt>()?.base10_parse()?;
            }
            Ok(())
        });
        read.map_err(|e| format!("{e}"))?;
    }
    Ok(alignment)
}

fn glsl_type(ty: &Type) -> Result<(String, String), String> {
    match ty {
        Type::Path(p) => {
            let ident = p.path.segments.last().map(|s| s.ident.to_string()).unwrap_or_default();
            let name = match ident.as_str() {
                "f32" => "float",
                "u32" | "SampledImage" | "StorageImage" | "SamplerId" => "uint",
                "i32" => "int",
                "Address" => "uvec2",
                "u64" | "f64" | "u8" | "u16" | "i64" | "bool" | "usize" => {
                    return Err(format!("{ident} has no GLSL twin of the same alignment"));
                }
                other => other,
            };
            Ok((name.to_owned(), String::new()))
        }
        Type::Array(a) => {
            let Expr::Lit(syn::ExprLit { lit: Lit::Int(n), .. }) = &a.len else {
                return Err("an array length must be a literal".to_owned());
            };
            let n: usize = n.base10_parse().map_err(|e| format!("{e}"))?;
            let (base, inner) = glsl_type(&a.elem)?;
            Ok(match (base.as_str(), inner.as_str(), n) {
                ("float", "", 2..=4) => (format!("vec{n}"), String::new()),
                ("uint", "", 2..=4) => (format!("uvec{n}"), String::new()),
                ("vec4", "", 4) => ("mat4".to_owned(), String::new()),
                _ => (base, format!("[{n}]{inner}")),
            })
        }
        _ => Err("this type has no GLSL twin".to_owned()),
    }
}
