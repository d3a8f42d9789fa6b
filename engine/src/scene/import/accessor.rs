//! Accessors: typed views of the buffers, with every byte range checked.
use super::refer;
use crate::scene::error::Fault;
use gltf::json;
use json::accessor::{ComponentType, Type};
use json::validation::Checked;

/// The parsed JSON with the bytes of its buffers.
pub(super) struct Data<'a> {
    pub root: &'a json::Root,
    buffers: &'a [Vec<u8>],
    /// Whether KHR_mesh_quantization is in use.
    quantised: bool,
}

/// The component types that an attribute may have.
#[derive(Clone, Copy, Debug, PartialEq, Eq)]
pub(super) enum Allowed {
    /// `f32`; with KHR_mesh_quantization also 8 and 16 bit integers, normalised or not.
    Geometry,
    /// `f32` and normalised `u8` and `u16`; with KHR_mesh_quantization any 8 and 16 bit integers.
    TextureCoordinates,
    /// `f32` and normalised `u8` and `u16`.
    Colour,
    /// `f32` and normalised 8 and 16 bit integers.
    Unit,
    /// `f32`.
    Float,
}

impl Allowed {
    fn wanted(self) -> &'static str {
        match self {
            Self::Geometry => "f32, or 8 and 16 bit integers with KHR_mesh_quantization",
            Self::TextureCoordinates => {
                "f32, normalised u8 or u16, or 8 and 16 bit integers with KHR_mesh_quantization"
            }
            Self::Colour => "f32, normalised u8 or u16",
            Self::Unit => "f32, or normalised 8 and 16 bit integers",
            Self::Float => "f32",
        }
    }

    fn accepts(self, component: ComponentType, normalised: bool, quantised: bool) -> bool {
        use ComponentType::{F32, I8, I16, U8, U16, U32};
        match component {
            F32 => true,
            U32 => false,
            _ if self == Self::Float => false,
            _ if self == Self::Unit => normalised,
            U8 | U16 if normalised && self != Self::Geometry => true,
            I8 | U8 | I16 | U16 => quantised && self != Self::Colour,
        }
    }
}

/// A checked table of `count` elements, `stride` bytes apart.
struct Table<'a> {
    bytes: &'a [u8],
    stride: usize,
    count: usize,
}

impl Table<'_> {
    fn element(&self, i: usize) -> &[u8] {
        &self.bytes[i * self.stride..]
    }
}

impl<'a> Data<'a> {
    pub fn new(root: &'a json::Root, buffers: &'a [Vec<u8>]) -> Self {
        let uses = |names: &[String]| names.iter().any(|n| n == "KHR_mesh_quantization");
        Self { root, buffers, quantised: uses(&root.extensions_used) || uses(&root.extensions_required) }
    }

    /// The bytes of a buffer view.
    pub fn view(&self, index: usize) -> Result<&'a [u8], Fault> {
        let view = refer(&self.root.buffer_views, index, "buffer view")?;
        let buffer = view.buffer.value();
        let bytes = refer(self.buffers, buffer, "buffer")?;
        let start = view.byte_offset.map_or(0, |o| o.0);
        let end = start.checked_add(view.byte_length.0);
        end.and_then(|end| bytes.get(usize::try_from(start).ok()?..usize::try_from(end).ok()?)).ok_or(
            Fault::ViewRange { view: index, start, end: end.unwrap_or(u64::MAX), buffer, length: bytes.len() as u64 },
        )
    }

    /// Number of elements that an accessor declares.
    pub fn count(&self, index: usize) -> Result<u64, Fault> {
        Ok(refer(&self.root.accessors, index, "accessor")?.count.0)
    }

    fn table(
        &self,
        accessor: usize,
        view: usize,
        offset: u64,
        count: u64,
        size: usize,
        strided: bool,
    ) -> Result<Table<'a>, Fault> {
        let bytes = self.view(view)?;
        let stride = self.root.buffer_views[view].byte_stride.filter(|_| strided).map_or(size, |s| s.0);
        if stride < size || stride > 252.max(size) {
            return Err(Fault::Stride { accessor, size, stride });
        }
        // The last element needs only its own size, not the whole stride.
        let length = match count {
            0 => Some(0),
            n => (n - 1).checked_mul(stride as u64).and_then(|l| l.checked_add(size as u64)),
        };
        let end = length.and_then(|l| l.checked_add(offset));
        end.and_then(|end| bytes.get(usize::try_from(offset).ok()?..usize::try_from(end).ok()?))
            .map(|bytes| Table { bytes, stride, count: count as usize })
            .ok_or(Fault::AccessorRange {
                accessor,
                start: offset,
                end: end.unwrap_or(u64::MAX),
                length: bytes.len() as u64,
            })
    }

    /// The component type of an accessor, after checking its shape.
    fn component(&self, index: usize, shape: Type, wanted: &'static str) -> Result<ComponentType, Fault> {
        let accessor = refer(&self.root.accessors, index, "accessor")?;
        match (accessor.component_type, accessor.type_) {
            (Checked::Valid(c), Checked::Valid(t)) if t == shape => Ok(c.0),
            (c, t) => {
                let component = if let Checked::Valid(c) = c { format!("{:?}", c.0) } else { "unknown".to_owned() };
                let shape = if let Checked::Valid(t) = t { format!("{t:?}") } else { "unknown".to_owned() };
                Err(Fault::Type { accessor: index, got: format!("{shape} of {component}"), wanted })
            }
        }
    }

    /// Whether an accessor holds four-component vectors.
    pub fn is_vec4(&self, index: usize) -> bool {
        self.root.accessors.get(index).is_some_and(|a| a.type_ == Checked::Valid(Type::Vec4))
    }

    /// Vectors of `N` components as floats, all finite.
    pub fn vectors<const N: usize>(&self, index: usize, allowed: Allowed) -> Result<Vec<[f32; N]>, Fault> {
        let (shape, wanted) = match N {
            1 => (Type::Scalar, "SCALAR"),
            2 => (Type::Vec2, "VEC2"),
            3 => (Type::Vec3, "VEC3"),
            16 => (Type::Mat4, "MAT4"),
            _ => (Type::Vec4, "VEC4"),
        };
        let component = self.component(index, shape, wanted)?;
        let accessor = &self.root.accessors[index];
        if !allowed.accepts(component, accessor.normalized, self.quantised) {
            let normalised = if accessor.normalized { "normalised " } else { "" };
            return Err(Fault::Type {
                accessor: index,
                got: format!("{normalised}{component:?}"),
                wanted: allowed.wanted(),
            });
        }
        let read = |bytes: &[u8]| -> [f32; N] {
            let size = component.size();
            std::array::from_fn(|c| number(&bytes[c * size..], component, accessor.normalized))
        };
        let size = component.size() * N;
        let mut all = match accessor.buffer_view {
            Some(view) => {
                let offset = accessor.byte_offset.map_or(0, |o| o.0);
                let table = self.table(index, view.value(), offset, accessor.count.0, size, true)?;
                (0..table.count).map(|i| read(table.element(i))).collect()
            }
            None => vec![[0.0; N]; accessor.count.0 as usize],
        };
        self.sparse(index, size, |at, bytes| all[at] = read(bytes))?;
        match all.iter().position(|v| v.iter().any(|x| !x.is_finite())) {
            Some(at) => Err(Fault::NotFinite { at }),
            None => Ok(all),
        }
    }

    /// Unsigned integers of a scalar accessor.
    pub fn indices(&self, index: usize) -> Result<Vec<u32>, Fault> {
        let component = self.component(index, Type::Scalar, "SCALAR of u8, u16 or u32")?;
        if matches!(component, ComponentType::I8 | ComponentType::I16 | ComponentType::F32) {
            let got = format!("Scalar of {component:?}");
            return Err(Fault::Type { accessor: index, got, wanted: "SCALAR of u8, u16 or u32" });
        }
        Ok(self.integers::<1>(index, component)?.into_flattened())
    }

    /// Four joint indices for each vertex.
    pub fn joints(&self, index: usize) -> Result<Vec<[u32; 4]>, Fault> {
        const WANTED: &str = "VEC4 of u8 or u16, not normalised";
        let component = self.component(index, Type::Vec4, WANTED)?;
        let normalised = self.root.accessors[index].normalized;
        if normalised || !matches!(component, ComponentType::U8 | ComponentType::U16) {
            let got = format!("Vec4 of {}{component:?}", if normalised { "normalised " } else { "" });
            return Err(Fault::Type { accessor: index, got, wanted: WANTED });
        }
        self.integers(index, component)
    }

    /// Unsigned integers of an accessor whose shape has been checked.
    fn integers<const N: usize>(&self, index: usize, component: ComponentType) -> Result<Vec<[u32; N]>, Fault> {
        let accessor = &self.root.accessors[index];
        let read =
            |bytes: &[u8]| -> [u32; N] { std::array::from_fn(|c| integer(&bytes[c * component.size()..], component)) };
        let size = component.size() * N;
        let mut all = match accessor.buffer_view {
            Some(view) => {
                let offset = accessor.byte_offset.map_or(0, |o| o.0);
                let table = self.table(index, view.value(), offset, accessor.count.0, size, true)?;
                (0..table.count).map(|i| read(table.element(i))).collect()
            }
            None => vec![[0; N]; accessor.count.0 as usize],
        };
        self.sparse(index, size, |at, bytes| all[at] = read(bytes))?;
        Ok(all)
    }

    /// Calls `set` for each element that a sparse accessor replaces. Its index is below the accessor's count.
    fn sparse(&self, index: usize, size: usize, mut set: impl FnMut(usize, &[u8])) -> Result<(), Fault> {
        let accessor = &self.root.accessors[index];
        let Some(sparse) = &accessor.sparse else { return Ok(()) };
        let (count, most) = (sparse.count.0, accessor.count.0);
        if count > most {
            return Err(Fault::Limit { what: "sparse elements", got: count, limit: most });
        }
        let Checked::Valid(kind) = sparse.indices.component_type else {
            return Err(Fault::Type {
                accessor: index,
                got: "unknown".to_owned(),
                wanted: "sparse indices u8, u16 or u32",
            });
        };
        let (places, kind) = (&sparse.indices, kind.0);
        let places = self.table(index, places.buffer_view.value(), places.byte_offset.0, count, kind.size(), false)?;
        let values = &sparse.values;
        let values = self.table(index, values.buffer_view.value(), values.byte_offset.0, count, size, false)?;
        for i in 0..places.count {
            let at = integer(places.element(i), kind);
            if at as u64 >= most {
                return Err(Fault::IndexValue { at: i, value: at, count: most as usize });
            }
            set(at as usize, values.element(i));
        }
        Ok(())
    }
}

fn head<const N: usize>(bytes: &[u8]) -> [u8; N] {
    std::array::from_fn(|i| bytes[i])
}

/// A component as a float; normalised integers are converted as in glTF 2.0, section 3.6.2.2.
fn number(bytes: &[u8], component: ComponentType, normalised: bool) -> f32 {
    let (value, greatest) = match component {
        ComponentType::I8 => (bytes[0] as i8 as f32, 127.0),
        ComponentType::U8 => (bytes[0] as f32, 255.0),
        ComponentType::I16 => (i16::from_le_bytes(head(bytes)) as f32, 32767.0),
        ComponentType::U16 => (u16::from_le_bytes(head(bytes)) as f32, 65535.0),
        ComponentType::U32 => (u32::from_le_bytes(head(bytes)) as f32, 1.0),
        ComponentType::F32 => return f32::from_le_bytes(head(bytes)),
    };
    if normalised { (value / greatest).max(-1.0) } else { value }
}

/// A component as an unsigned integer; it must have such a type.
fn integer(bytes: &[u8], component: ComponentType) -> u32 {
    match component.size() {
        1 => bytes[0] as u32,
        2 => u16::from_le_bytes(head(bytes)) as u32,
        _ => u32::from_le_bytes(head(bytes)),
    }
}
