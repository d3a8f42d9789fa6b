//! Tokens, which prove that a pass declared a use. Only a token yields an id while recording, so undeclared resources cannot be used.

use super::desc::Part;

macro_rules! tokens {
    ($($(#[$doc:meta])* $name:ident $({ $(#[$more:meta])* $field:ident: $kind:ty })?)*) => {
        $(
            $(#[$doc])*
            #[derive(Clone, Copy, Debug, PartialEq, Eq)]
            pub struct $name {
                /// Index into the declaration's resources.
                pub(crate) resource: u32,
                /// Index of the pass that declared the use: the only one that may record with it.
                pub(crate) pass: u32,
                $($(#[$more])* pub(crate) $field: $kind,)?
            }
        )*
    };
}

tokens! {
    /// A sampled image of this pass, or a part of one.
    SampleToken {
        /// The part, counts resolved.
        part: Part
    }
    /// A storage image of this pass, or a part of one, read or written as declared.
    StorageToken {
        /// The part, counts resolved.
        part: Part
    }
    /// A colour attachment of this pass.
    ColorToken
    /// The depth attachment of this pass, written or only tested against.
    DepthToken
    /// A buffer that this pass reads or writes in a shader, as declared.
    BufferToken
    /// The index buffer of this pass's draws.
    IndexToken
    /// Arguments of this pass's indirect draws, dispatches or traces.
    IndirectToken
    /// An acceleration structure that this pass traces.
    TraceToken
    /// An acceleration structure that this pass builds or refits.
    BuildToken
    /// An input of a build in this pass.
    BuildInputToken
    /// Scratch memory of a build in this pass.
    ScratchToken
    /// An image or buffer that this pass copies from.
    CopySource
    /// An image or buffer that this pass copies to.
    CopyTarget
}
