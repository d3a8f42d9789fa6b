//! Reflection of SPIR-V: workgroup size, and size and members of the push constants (SPIR-V 1.6).
use std::collections::HashMap;

// Opcodes, decorations and storage classes, by their numbers in the specification.
const MEMBER_NAME: u32 = 6;
const EXECUTION_MODE: u32 = 16;
const TYPE_INT: u32 = 21;
const TYPE_FLOAT: u32 = 22;
const TYPE_VECTOR: u32 = 23;
const TYPE_MATRIX: u32 = 24;
const TYPE_ARRAY: u32 = 28;
const TYPE_STRUCT: u32 = 30;
const TYPE_POINTER: u32 = 32;
const CONSTANT: u32 = 43;
const VARIABLE: u32 = 59;
const DECORATE: u32 = 71;
const MEMBER_DECORATE: u32 = 72;
const LOCAL_SIZE: u32 = 17;
const ROW_MAJOR: u32 = 4;
const ARRAY_STRIDE: u32 = 6;
const MATRIX_STRIDE: u32 = 7;
const OFFSET: u32 = 35;
const PUSH_CONSTANT: u32 = 9;
/// Limit on the nesting of types, in case invalid SPIR-V has cycles.
const MAX_DEPTH: u32 = 64;

/// The instructions of a module, as opcode and operands. Stops at the end or at the first invalid one.
fn instructions(words: &[u32]) -> impl Iterator<Item = (u32, &[u32])> {
    let mut rest = words.get(5..).unwrap_or_default();
    std::iter::from_fn(move || {
        let first = *rest.first()?;
        let (opcode, length) = (first & 0xffff, (first >> 16) as usize);
        let operands = rest.get(1..length)?;
        rest = &rest[length..];
        Some((opcode, operands))
    })
}

/// The workgroup size that a compute shader declares: `OpExecutionMode … LocalSize x y z`.
pub(super) fn local_size(words: &[u32]) -> Option<[u32; 3]> {
    instructions(words).find_map(|(opcode, operands)| match (opcode, operands) {
        (EXECUTION_MODE, [_, LOCAL_SIZE, x, y, z, ..]) => Some([*x, *y, *z]),
        _ => None,
    })
}

/// Size of a shader's push constants in bytes: from byte 0 to the end of the last member, rounded up to the size of the widest
/// scalar, as in a `#[repr(C)]` struct. `None` if the shader has none, or if their size is not declared.
pub(super) fn push_bytes(words: &[u32]) -> Option<u32> {
    let (types, block) = types(words);
    let Size { bytes, widest } = types.size(block?, MAX_DEPTH)?;
    bytes.checked_next_multiple_of(widest.max(1))
}

/// Members of a shader's push constants and of the structs among them: the words of their names, their offsets, and their sizes in bytes.
pub(super) fn push_members(words: &[u32]) -> Vec<(&[u32], u32, Option<u32>)> {
    let (types, block) = types(words);
    let mut members = Vec::new();
    block.into_iter().for_each(|block| types.list(block, 0, MAX_DEPTH, &mut members));
    members
}

/// The types of a module, and the one of its push constants.
fn types(words: &[u32]) -> (Types<'_>, Option<u32>) {
    let mut types = Types::default();
    let mut block = None;
    for (opcode, operands) in instructions(words) {
        match (opcode, operands) {
            (TYPE_INT | TYPE_FLOAT, [id, width, ..]) => drop(types.kinds.insert(*id, Kind::Number(width / 8))),
            (TYPE_VECTOR, [id, of, count]) => drop(types.kinds.insert(*id, Kind::Vector(*of, *count))),
            (TYPE_MATRIX, [id, column, count]) => drop(types.kinds.insert(*id, Kind::Matrix(*column, *count))),
            (TYPE_ARRAY, [id, of, length]) => drop(types.kinds.insert(*id, Kind::Array(*of, *length))),
            (TYPE_STRUCT, [id, members @ ..]) => drop(types.kinds.insert(*id, Kind::Struct(members))),
            (TYPE_POINTER, [id, PUSH_CONSTANT, to]) => drop(types.kinds.insert(*id, Kind::Block(*to))),
            // Pointers to other storage classes are buffer references, which are two words in Rust.
            (TYPE_POINTER, [id, ..]) => drop(types.kinds.insert(*id, Kind::Address)),
            (CONSTANT, [_, id, value]) => drop(types.constants.insert(*id, *value)),
            (DECORATE, [id, ARRAY_STRIDE, stride]) => drop(types.strides.insert(*id, *stride)),
            (MEMBER_DECORATE, [id, member, ROW_MAJOR]) => drop(types.members.insert((*id, *member, ROW_MAJOR), 1)),
            (MEMBER_DECORATE, [id, member, kind @ (OFFSET | MATRIX_STRIDE), value]) => {
                types.members.insert((*id, *member, *kind), *value);
            }
            (MEMBER_NAME, [id, member, name @ ..]) => drop(types.names.insert((*id, *member), name)),
            (VARIABLE, [pointer, _, PUSH_CONSTANT, ..]) => block = Some(*pointer),
            _ => {}
        }
    }
    let block = block.and_then(|pointer| match types.kinds.get(&pointer) {
        Some(Kind::Block(block)) => Some(*block),
        _ => None,
    });
    (types, block)
}

/// A type; numbers are ids of other types.
enum Kind<'w> {
    /// A scalar, with its size in bytes.
    Number(u32),
    Address,
    Vector(u32, u32),
    Matrix(u32, u32),
    Array(u32, u32),
    Struct(&'w [u32]),
    /// A pointer to the push constants.
    Block(u32),
}

#[derive(Default)]
struct Types<'w> {
    kinds: HashMap<u32, Kind<'w>>,
    constants: HashMap<u32, u32>,
    strides: HashMap<u32, u32>,
    /// Decorations of struct members, by (struct, member, decoration): offset, matrix stride, row-major.
    members: HashMap<(u32, u32, u32), u32>,
    /// Names of struct members, by struct and member.
    names: HashMap<(u32, u32), &'w [u32]>,
}

/// Size of a type in bytes, and of the widest scalar in it.
#[derive(Clone, Copy)]
struct Size {
    bytes: u32,
    widest: u32,
}

impl<'w> Types<'w> {
    /// Adds the members of a struct, and of arrays of it, from an offset on.
    fn list(&self, id: u32, from: u32, deepest: u32, members: &mut Vec<(&'w [u32], u32, Option<u32>)>) {
        let Some(deeper) = deepest.checked_sub(1) else { return };
        match self.kinds.get(&id) {
            Some(Kind::Struct(of)) => {
                for (member, of) in (0..).zip(of.iter()) {
                    let offset = from + self.members.get(&(id, member, OFFSET)).copied().unwrap_or_default();
                    let name = self.names.get(&(id, member)).copied().unwrap_or_default();
                    members.push((name, offset, self.member(id, member, *of, deeper).map(|size| size.bytes)));
                    self.list(*of, offset, deeper, members);
                }
            }
            Some(Kind::Array(of, _)) => self.list(*of, from, deeper, members),
            _ => {}
        }
    }

    fn size(&self, id: u32, deepest: u32) -> Option<Size> {
        let deeper = deepest.checked_sub(1)?;
        match self.kinds.get(&id)? {
            Kind::Number(bytes) => Some(Size { bytes: *bytes, widest: *bytes }),
            Kind::Address => Some(Size { bytes: 8, widest: 4 }),
            Kind::Vector(of, count) | Kind::Matrix(of, count) => {
                let one = self.size(*of, deeper)?;
                Some(Size { bytes: one.bytes.checked_mul(*count)?, widest: one.widest })
            }
            Kind::Array(of, length) => {
                let one = self.size(*of, deeper)?;
                let stride = self.strides.get(&id)?;
                Some(Size { bytes: self.constants.get(length)?.checked_mul(*stride)?, widest: one.widest })
            }
            Kind::Struct(members) => {
                let mut all = Size { bytes: 0, widest: 1 };
                for (member, of) in (0..).zip(members.iter()) {
                    let offset = self.members.get(&(id, member, OFFSET))?;
                    let own = self.member(id, member, *of, deeper)?;
                    all.bytes = all.bytes.max(offset.checked_add(own.bytes)?);
                    all.widest = all.widest.max(own.widest);
                }
                Some(all)
            }
            Kind::Block(_) => None,
        }
    }

    /// Size of a struct member, whose decorations give the matrix stride.
    fn member(&self, id: u32, member: u32, of: u32, deeper: u32) -> Option<Size> {
        let plain = self.size(of, deeper)?;
        let (Some(stride), Some(Kind::Matrix(column, columns))) =
            (self.members.get(&(id, member, MATRIX_STRIDE)), self.kinds.get(&of))
        else {
            return Some(plain);
        };
        let Some(Kind::Vector(_, rows)) = self.kinds.get(column) else { return None };
        let by_rows = self.members.contains_key(&(id, member, ROW_MAJOR));
        let bytes = stride.checked_mul(if by_rows { *rows } else { *columns })?;
        Some(Size { bytes, widest: plain.widest })
    }
}

#[cfg(test)]
mod tests {
    use super::*;
    use magpie_shaders::{Stage, compile};

    fn of_block(layout: &str, members: &str, used: &str) -> Option<u32> {
        let text = format!(
            "#version 460\n#extension GL_GOOGLE_include_directive : require\n#include \"lib/bindless.glsl\"\n\
             layout(local_size_x = 4, local_size_y = 2) in;\nstruct Two {{ uint a; vec2 b; }};\n\
             layout(push_constant, {layout}) uniform Push {{ {members} }};\n\
             void main() {{ {used} }}\n"
        );
        let words = compile("test.comp", &text, Stage::Compute).expect("it compiles");
        assert_eq!(local_size(&words), Some([4, 2, 1]));
        push_bytes(&words)
    }

    #[test]
    fn blocks_are_as_large_as_their_last_member_ends() {
        let store = |value: &str| format!("store(image, ivec2(0), vec4({value}));");
        for (layout, members, used, bytes) in [
            ("scalar", "uint image; uint other; uvec2 size; float last;", "last", 20),
            ("scalar", "vec3 a; uint image;", "a.x", 16),
            ("scalar", "uint image; vec3 a;", "a.x", 16),
            ("std430", "uint image; vec3 a;", "a.x", 28),
            ("scalar", "uint image; float a[5];", "a[1]", 24),
            ("std430", "uint image; vec3 a[2];", "a[1].x", 48),
            ("scalar", "uint image; mat4 a;", "a[1].x", 68),
            ("scalar", "uint image; mat2x3 a;", "a[1].x", 28),
            ("scalar, row_major", "uint image; mat2x3 a;", "a[1].x", 28),
            ("scalar", "uint image; Two a[3];", "a[1].b.x", 40),
            ("scalar", "uint image; uvec2 address; WordBuffer words;", "float(words.at[0])", 24),
            ("scalar", "WordBuffer words; uint image;", "float(words.at[0])", 12),
            ("scalar", "layout(offset = 16) uint image; uvec2 last;", "float(last.x)", 28),
        ] {
            assert_eq!(of_block(layout, members, &store(used)), Some(bytes), "{layout}: {members}");
        }
    }

    #[test]
    fn members_tell_blocks_apart_that_are_as_large() {
        let words = |members: &str| {
            let text = format!(
                "#version 460\n#extension GL_GOOGLE_include_directive : require\n#include \"lib/bindless.glsl\"\n\
                 layout(local_size_x = 1) in;\nstruct Two {{ uint a; vec2 b; }};\n\
                 layout(push_constant, scalar) uniform Push {{ {members} }};\n\
                 void main() {{ store(image, ivec2(0), vec4(1)); }}\n"
            );
            compile("test.comp", &text, Stage::Compute).expect("it compiles")
        };
        let all = ["uint image; float x; float y;", "uint image; float y; float x;", "uint image; vec2 x;"];
        let all = all.map(words);
        for (at, one) in all.iter().enumerate() {
            for (other_at, other) in all.iter().enumerate() {
                assert_eq!(push_members(one) == push_members(other), at == other_at, "{at} and {other_at}");
                assert_eq!(push_bytes(one), push_bytes(other));
            }
        }
        assert_eq!(push_members(&words("uint image; Two a[3];")).len(), 4);
        assert_ne!(push_members(&words("uint image; Two a[3];")), push_members(&words("uint image; Two b[3];")));
    }

    #[test]
    fn words_that_are_no_shader_have_no_block() {
        assert_eq!(of_block("scalar", "uint image;", ""), Some(4), "what is not used is there nevertheless");
        for words in [&[][..], &[0x0723_0203, 0, 0, 0, 0], &[0, 0, 0, 0, 0, 0], &[0, 0, 0, 0, 0, 0xffff_003b, 1]] {
            assert_eq!((push_bytes(words), local_size(words)), (None, None), "{words:?}");
        }
    }
}
