//! The frame graph, on which all rendering is built.
//!
//! # The idea
//!
//! Every frame is declared anew, as a list of passes. Each pass says what it reads and writes, and gives a closure that records
//! its commands; outputs of one pass are ordinary Rust values that the next takes as inputs. The graph derives from the
//! declaration which passes to cull, the memory, and every barrier and layout transition. Passes never issue barriers themselves.
//!
//! | step | in | out | where |
//! |---|---|---|---|
//! | declare | closures | [`Declaration`], plain data, and mistakes found on the way | [`FrameGraph`], [`PassBuilder`] |
//! | plan | [`Declaration`] | [`Plan`]: order, dropped passes, lifetimes, batched barriers | [`plan`](fn@plan) |
//! | dump | both | text, JSON, DOT, HTML | [`dump`] |
//! | execute | both, and the closures | commands | `execute`, the only part that touches the device |
//!
//! # What the types ensure
//!
//! - A [`Handle`] names one version of a resource and can only be read. A [`WriteHandle`] is the one right to write the next
//!   version; writing consumes it.
//! - Declaring a use gives a token, and only a token yields a GPU id while recording.
//! - Closures that record are `Send + 'static`: they capture tokens and plain values, and may run on any thread.
//!
//! ```
//! use magpie::graph::plan::Packed;
//! use magpie::graph::{Extent, Format, FrameGraph, ImageDesc, Queue, Queues, Record, Switches, dump, plan};
//!
//! let mut g = FrameGraph::new(Extent::new(640, 360));
//! let noisy = g.pass("ao.trace", Queue::AsyncCompute, |p| {
//!     let (open, _target) = p.create("open", ImageDesc::half(Format::R8Unorm));
//!     (open.read(), move |_: &mut Record| { /* dispatch with `_target` */ })
//! });
//! let ao = g.pass("ao.blur", Queue::AsyncCompute, |p| {
//!     let _source = p.sample(noisy);
//!     let (smooth, _target) = p.create("smooth", p.desc(noisy));
//!     (smooth.read(), move |_: &mut Record| { /* dispatch with both tokens */ })
//! });
//! g.output(ao);
//!
//! let frame = g.finish().unwrap();
//! let plan = plan(&frame.declaration, &Switches::default(), Queues::default(), &mut Packed);
//! assert_eq!(plan.order, [0, 1]);
//! println!("{}", dump::text(&frame.declaration, &plan));
//! ```

mod access;
mod builder;
pub mod check;
mod contract;
mod declaration;
mod desc;
mod draw;
pub mod dump;
mod error;
pub mod execute;
mod handle;
mod history;
mod observe;
mod pass;
pub mod plan;
pub mod record;
mod switches;
mod token;

pub use access::{Access, Domain, Layout, Queue, Uses};
pub use builder::PassBuilder;
pub use contract::{Contract, Idle};
pub use declaration::{
    Clear, Declaration, HistoryDecl, ImageState, ImportKey, Name, NamedOutput, Origin, OutputDecl, PassDecl,
    ResourceDecl, Shape, Span, Use, Writers,
};
pub use desc::{BufferDesc, Content, Extent, Format, ImageDesc, Part, Size};
pub use draw::{Draw, DrawClass, DrawLists};
pub use error::{GraphError, GraphErrors};
pub use handle::{Accel, Blas, Buffer, BuildInput, Copyable, Handle, Image, Kind, Tlas, WriteHandle};
pub use history::{BufferHistory, History, HistoryScope, KeptBuffer, KeptLayers};
pub use pass::{Frame, FrameGraph, Observer, Produced, RecordFn, SlotObserver};
pub use plan::{Plan, plan};
pub use record::{IndirectDraws, MOST_COUNTS, MipCopy, Record, Token};
pub use switches::{Queues, Switches};
pub use token::{
    BufferToken, BuildInputToken, BuildToken, ColorToken, CopySource, CopyTarget, DepthToken, IndexToken,
    IndirectToken, SampleToken, ScratchToken, StorageToken, TraceToken,
};
