//! What can be wrong with a scene or camera file: every message names the file and the element.
use super::EnvironmentError;
use std::path::PathBuf;

/// Why a scene or a camera could not be had.
#[derive(Debug, thiserror::Error)]
#[non_exhaustive]
pub enum SceneError {
    /// The file could not be opened or read.
    #[error("{}: cannot be read: {source}", path.display())]
    Read {
        /// The file.
        path: PathBuf,
        /// The system's reason.
        source: std::io::Error,
    },
    /// The file is no glTF 2.0 text or container.
    #[error("{}: not a glTF 2.0 scene: {reason}", path.display())]
    NotGltf {
        /// The file.
        path: PathBuf,
        /// What is wrong with it.
        reason: String,
    },
    /// The file ends too early.
    #[error("{}: truncated: {what} needs {wanted} bytes, got {got}", path.display())]
    Truncated {
        /// The file.
        path: PathBuf,
        /// The part that is cut.
        what: &'static str,
        /// Bytes that it should have.
        wanted: u64,
        /// Bytes that are there.
        got: u64,
    },
    /// The file is larger than Magpie reads.
    #[error("{}: {got} bytes, the limit is {limit}", path.display())]
    TooLarge {
        /// The file.
        path: PathBuf,
        /// Its size in bytes.
        got: u64,
        /// The largest size that is read.
        limit: u64,
    },
    /// The scene requires extensions that Magpie does not have.
    #[error("{}: requires {names}, which Magpie does not support", path.display())]
    Extensions {
        /// The file.
        path: PathBuf,
        /// The extensions, separated by commas.
        names: String,
    },
    /// One element of the scene is faulty.
    #[error("{}: {element}: {fault}", path.display())]
    Element {
        /// The file.
        path: PathBuf,
        /// The element, such as `mesh 3 primitive 1 POSITION`.
        element: String,
        /// What is wrong with it.
        fault: Fault,
    },
    /// Nothing in the scene can be drawn.
    #[error("{}: the scene has no geometry", path.display())]
    NoGeometry {
        /// The file.
        path: PathBuf,
    },
    /// An environment map is faulty.
    #[error("{}: {fault}", path.display())]
    Environment {
        /// The file.
        path: PathBuf,
        /// What is wrong with it.
        fault: EnvironmentError,
    },
    /// A camera file is faulty.
    #[error("{}: {reason}", path.display())]
    CameraFile {
        /// The file.
        path: PathBuf,
        /// The key and what is wrong with it.
        reason: String,
    },
    /// The scene has no such animation.
    #[error("no animation {name:?}; {}", list(known))]
    Animation {
        /// The name or index that was asked for.
        name: String,
        /// The names that there are, in order.
        known: Vec<String>,
    },
    /// A camera cannot be made from these numbers.
    #[error("camera {name:?}: {reason}")]
    Camera {
        /// The camera.
        name: String,
        /// What is wrong with it.
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
    /// A part that glTF demands is absent.
    #[error("{0} is missing")]
    Missing(&'static str),
    /// A reference leads nowhere.
    #[error("refers to {what} {index} of {count}")]
    Reference {
        /// The kind of element that is referred to.
        what: &'static str,
        /// The index found.
        index: usize,
        /// How many there are.
        count: usize,
    },
    /// An accessor leaves its buffer view.
    #[error("accessor {accessor} reads bytes {start}..{end} of a {length} byte buffer view")]
    AccessorRange {
        /// The accessor.
        accessor: usize,
        /// First byte, relative to the view.
        start: u64,
        /// One past the last byte; the largest number where it overflows.
        end: u64,
        /// Length of the view in bytes.
        length: u64,
    },
    /// A buffer view leaves its buffer.
    #[error("buffer view {view} covers bytes {start}..{end} of the {length} bytes of buffer {buffer}")]
    ViewRange {
        /// The buffer view.
        view: usize,
        /// First byte.
        start: u64,
        /// One past the last byte; the largest number where it overflows.
        end: u64,
        /// The buffer.
        buffer: usize,
        /// Length of the buffer in bytes.
        length: u64,
    },
    /// Elements overlap or lie too far apart.
    #[error("accessor {accessor} has elements of {size} bytes in a buffer view with a stride of {stride}")]
    Stride {
        /// The accessor.
        accessor: usize,
        /// Size of an element in bytes.
        size: usize,
        /// Stride of the view in bytes.
        stride: usize,
    },
    /// An accessor holds the wrong kind of numbers.
    #[error("accessor {accessor} holds {got}, wanted {wanted}")]
    Type {
        /// The accessor.
        accessor: usize,
        /// Shape and component type found.
        got: String,
        /// What the attribute allows.
        wanted: &'static str,
    },
    /// Two tables that belong together differ in length.
    #[error("accessor {accessor} has {got} elements, wanted {wanted}")]
    Count {
        /// The accessor.
        accessor: usize,
        /// Elements found.
        got: u64,
        /// Elements wanted.
        wanted: u64,
    },
    /// More than Magpie takes.
    #[error("{got} {what}, the limit is {limit}")]
    Limit {
        /// What is counted.
        what: &'static str,
        /// The number found.
        got: u64,
        /// The largest number that is taken.
        limit: u64,
    },
    /// An index points past the vertices.
    #[error("index {at} is {value}, there are {count} vertices")]
    IndexValue {
        /// Place in the index table.
        at: usize,
        /// The index found.
        value: u32,
        /// How many vertices there are.
        count: usize,
    },
    /// A NaN or an infinity.
    #[error("element {at} is not finite")]
    NotFinite {
        /// Place in the table.
        at: usize,
    },
    /// A node is its own ancestor.
    #[error("the node is its own ancestor")]
    Cycle,
    /// A node is reached twice.
    #[error("child of both {first} and {second}")]
    TwoParents {
        /// One parent.
        first: String,
        /// Another parent.
        second: String,
    },
    /// Nodes are nested too deeply.
    #[error("nested more than {limit} levels deep")]
    Depth {
        /// The deepest level that is taken.
        limit: usize,
    },
    /// A URI that is refused.
    #[error("URI {uri:?} is refused: {reason}")]
    Uri {
        /// The URI, shortened.
        uri: String,
        /// Why.
        reason: String,
    },
    /// A file of the scene cannot be read.
    #[error("{uri:?} cannot be read: {reason}")]
    File {
        /// The URI.
        uri: String,
        /// The system's reason.
        reason: String,
    },
    /// A buffer is shorter than it says.
    #[error("truncated: {wanted} bytes declared, got {got}")]
    Truncated {
        /// Bytes declared.
        wanted: u64,
        /// Bytes that are there.
        got: u64,
    },
    /// An image cannot be decoded.
    #[error("image cannot be decoded: {0}")]
    Image(String),
    /// A value outside its range.
    #[error("{what} is {got}, wanted {wanted}")]
    Value {
        /// The property.
        what: &'static str,
        /// The value found.
        got: String,
        /// What is allowed.
        wanted: &'static str,
    },
}
