//! Errors in scene and camera files; every message names the file and the element.
use super::EnvironmentError;
use std::path::PathBuf;

/// Why a scene or a camera could not be loaded or made.
#[derive(Debug, thiserror::Error)]
#[non_exhaustive]
pub enum SceneError {
    /// The file could not be opened or read.
    #[error("{}: cannot be read: {source}", path.display())]
    Read {
        /// Path of the file.
        path: PathBuf,
        /// Error of the operating system.
        source: std::io::Error,
    },
    /// The file is neither glTF 2.0 text nor a .glb container.
    #[error("{}: not a glTF 2.0 scene: {reason}", path.display())]
    NotGltf {
        /// Path of the file.
        path: PathBuf,
        /// What is wrong with it.
        reason: String,
    },
    /// The file is too short.
    #[error("{}: truncated: {what} needs {wanted} bytes, got {got}", path.display())]
    Truncated {
        /// Path of the file.
        path: PathBuf,
        /// The part that is truncated.
        what: &'static str,
        /// Its size in bytes, as declared.
        wanted: u64,
        /// Bytes that are left for it.
        got: u64,
    },
    /// The file is larger than the limit.
    #[error("{}: {got} bytes, the limit is {limit}", path.display())]
    TooLarge {
        /// Path of the file.
        path: PathBuf,
        /// Its size in bytes.
        got: u64,
        /// The limit in bytes.
        limit: u64,
    },
    /// The scene requires extensions that are not supported.
    #[error("{}: requires {names}, which Magpie does not support", path.display())]
    Extensions {
        /// Path of the file.
        path: PathBuf,
        /// Names of the extensions, separated by commas.
        names: String,
    },
    /// An element of the scene is invalid.
    #[error("{}: {element}: {fault}", path.display())]
    Element {
        /// Path of the file.
        path: PathBuf,
        /// The element, such as `mesh 3 primitive 1 POSITION`.
        element: String,
        /// What is wrong with it.
        fault: Fault,
    },
    /// The scene contains nothing that can be drawn.
    #[error("{}: the scene has no geometry", path.display())]
    NoGeometry {
        /// Path of the file.
        path: PathBuf,
    },
    /// An environment map is invalid.
    #[error("{}: {fault}", path.display())]
    Environment {
        /// Path of the file.
        path: PathBuf,
        /// What is wrong with it.
        fault: EnvironmentError,
    },
    /// A camera file is invalid.
    #[error("{}: {reason}", path.display())]
    CameraFile {
        /// Path of the file.
        path: PathBuf,
        /// What is wrong with it, with the key.
        reason: String,
    },
    /// The scene has no animation of that name or index.
    #[error("no animation {name:?}; {}", list(known))]
    Animation {
        /// The name or index that was asked for.
        name: String,
        /// Names of the animations of the scene, in order.
        known: Vec<String>,
    },
    /// These numbers do not make a camera.
    #[error("camera {name:?}: {reason}")]
    Camera {
        /// Name of the camera.
        name: String,
        /// What is wrong with the numbers.
        reason: String,
    },
}

fn list(names: &[String]) -> String {
    if names.is_empty() { "the scene has none".to_owned() } else { format!("the scene has {}", names.join(", ")) }
}

/// What is wrong with an element of a glTF scene.
#[derive(Debug, thiserror::Error)]
#[non_exhaustive]
pub enum Fault {
    /// A required part is missing.
    #[error("{0} is missing")]
    Missing(&'static str),
    /// A reference to an element that does not exist.
    #[error("refers to {what} {index} of {count}")]
    Reference {
        /// The kind of element that is referred to.
        what: &'static str,
        /// The index of the reference.
        index: usize,
        /// Number of such elements.
        count: usize,
    },
    /// An accessor extends beyond its buffer view.
    #[error("accessor {accessor} reads bytes {start}..{end} of a {length} byte buffer view")]
    AccessorRange {
        /// Index of the accessor.
        accessor: usize,
        /// Its first byte, relative to the view.
        start: u64,
        /// One past its last byte; `u64::MAX` on overflow.
        end: u64,
        /// Length of the view in bytes.
        length: u64,
    },
    /// A buffer view extends beyond its buffer.
    #[error("buffer view {view} covers bytes {start}..{end} of the {length} bytes of buffer {buffer}")]
    ViewRange {
        /// Index of the buffer view.
        view: usize,
        /// Its first byte.
        start: u64,
        /// One past its last byte; `u64::MAX` on overflow.
        end: u64,
        /// Index of the buffer.
        buffer: usize,
        /// Length of the buffer in bytes.
        length: u64,
    },
    /// The stride is smaller than an element, or too large.
    #[error("accessor {accessor} has elements of {size} bytes in a buffer view with a stride of {stride}")]
    Stride {
        /// Index of the accessor.
        accessor: usize,
        /// Size of an element in bytes.
        size: usize,
        /// Stride of the view in bytes.
        stride: usize,
    },
    /// An accessor has the wrong type.
    #[error("accessor {accessor} holds {got}, wanted {wanted}")]
    Type {
        /// Index of the accessor.
        accessor: usize,
        /// Its shape and component type.
        got: String,
        /// The types that are allowed.
        wanted: &'static str,
    },
    /// Two tables that must be equally long are not.
    #[error("accessor {accessor} has {got} elements, wanted {wanted}")]
    Count {
        /// Index of the accessor.
        accessor: usize,
        /// Its number of elements.
        got: u64,
        /// The number that is needed.
        wanted: u64,
    },
    /// A number is above a limit.
    #[error("{got} {what}, the limit is {limit}")]
    Limit {
        /// What exceeds the limit, such as `vertices`.
        what: &'static str,
        /// The number found.
        got: u64,
        /// The limit.
        limit: u64,
    },
    /// A vertex index is out of range.
    #[error("index {at} is {value}, there are {count} vertices")]
    IndexValue {
        /// Position in the index table.
        at: usize,
        /// The index.
        value: u32,
        /// Number of vertices.
        count: usize,
    },
    /// A number is NaN or infinite.
    #[error("element {at} is not finite")]
    NotFinite {
        /// Position of the element in its table.
        at: usize,
    },
    /// A node is its own ancestor.
    #[error("the node is its own ancestor")]
    Cycle,
    /// A node has two parents.
    #[error("child of both {first} and {second}")]
    TwoParents {
        /// Name of one parent.
        first: String,
        /// Name of the other parent.
        second: String,
    },
    /// Nodes are nested too deeply.
    #[error("nested more than {limit} levels deep")]
    Depth {
        /// The largest depth that is allowed.
        limit: usize,
    },
    /// A URI that is not allowed, such as one that leaves the scene's folder.
    #[error("URI {uri:?} is refused: {reason}")]
    Uri {
        /// The URI, possibly shortened.
        uri: String,
        /// The reason.
        reason: String,
    },
    /// A file that the scene refers to cannot be read.
    #[error("{uri:?} cannot be read: {reason}")]
    File {
        /// Its URI.
        uri: String,
        /// Error of the operating system.
        reason: String,
    },
    /// A buffer is shorter than declared.
    #[error("truncated: {wanted} bytes declared, got {got}")]
    Truncated {
        /// Declared size, bytes.
        wanted: u64,
        /// Actual size, bytes.
        got: u64,
    },
    /// An image cannot be decoded.
    #[error("image cannot be decoded: {0}")]
    Image(String),
    /// A value is out of range.
    #[error("{what} is {got}, wanted {wanted}")]
    Value {
        /// Name of the property.
        what: &'static str,
        /// The value found.
        got: String,
        /// The values that are allowed, in words.
        wanted: &'static str,
    },
}
