//! Writes the GLSL twin of a Rust module of shared structs. Only the build script uses it.
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
    for item in &file.items {
        let result = match item {
            Item::Const(c) => constant(c, &mut out),
            Item::Struct(s) => structure(s, &mut out),
            Item::Use(u) => {
                include(u, &mut out);
                Ok(())
            }
            _ => Ok(()),
        };
        result.map_err(|e| format!("{module}.rs: {e}"))?;
    }
    out.push_str("#endif\n");
    Ok(out)
}

/// `use super::scene::Light;` includes the twin of that module.
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
    let Fields::Named(fields) = &item.fields else { return Ok(()) };
    let name = &item.ident;
    let _ = writeln!(out, "struct {name} {{");
    for field in &fields.named {
        let ident = field.ident.as_ref().map(ToString::to_string).unwrap_or_default();
        let (base, suffix) = glsl_type(&field.ty).map_err(|e| format!("{name}.{ident}: {e}"))?;
        let _ = writeln!(out, "    {base} {ident}{suffix};");
    }
    out.push_str("};\n");
    for (suffix, access) in [("Buffer", "readonly"), ("BufferWrite", "")] {
        let _ = writeln!(
            out,
            "layout(buffer_reference, scalar, buffer_reference_align = 4) {access} buffer {name}{suffix} {{ {name} at[]; }};"
        );
    }
    Ok(())
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
