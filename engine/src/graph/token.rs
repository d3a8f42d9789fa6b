//! Proofs of declared use. Only a token yields a GPU id while recording, so what was not declared cannot be used.

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
    /// An image, or a part of one, that this pass samples.
    SampleToken {
        /// How much of the image, counts resolved.
        part: Part
    }
    /// A storage image, or a part of one, that this pass reads or writes, as it declared.
    StorageToken {
        /// How much of the image, counts resolved.
        part: Part
    }
    /// A colour attachment of this pass.
    ColorToken
    /// The depth attachment of this pass.
    DepthToken
    /// A buffer that this pass reads or writes in a shader, as it declared.
    BufferToken
    /// Indices of this pass's draws.
    IndexToken
    /// Arguments of this pass's indirect draws or dispatches.
    IndirectToken
    /// An acceleration structure that this pass traces.
    TraceToken
    /// An acceleration structure that this pass builds or refits.
    BuildToken
    /// What a build of this pass is made from.
    BuildInputToken
    /// Working memory of a build of this pass.
    ScratchToken
    /// An image or buffer that this pass copies from.
    CopySource
    /// An image or buffer that this pass copies to.
    CopyTarget
}
