//! Proofs of declared use. Only a token yields a GPU id while recording, so what was not declared cannot be used.

macro_rules! tokens {
    ($($(#[$doc:meta])* $name:ident)*) => {
        $(
            $(#[$doc])*
            #[derive(Clone, Copy, Debug, PartialEq, Eq)]
            pub struct $name {
                /// Index into the declaration's resources.
                pub(crate) resource: u32,
                /// Index of the pass that declared the use: the only one that may record with it.
                pub(crate) pass: u32,
            }
        )*
    };
}

tokens! {
    /// A colour attachment of this pass.
    ColorToken
    /// The depth attachment of this pass.
    DepthToken
    /// An image that this pass samples.
    SampleToken
    /// A storage image that this pass reads or writes, as it declared.
    StorageToken
    /// A buffer that this pass reads or writes in a shader, as it declared.
    BufferToken
    /// Indices of this pass's draws.
    IndexToken
    /// Arguments of this pass's indirect draws or dispatches.
    IndirectToken
    /// An acceleration structure that this pass traces.
    TraceToken
    /// An image or buffer that this pass copies from.
    CopySource
    /// An image or buffer that this pass copies to.
    CopyTarget
}
