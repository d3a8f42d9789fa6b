//! The meaning of each access, implemented independently of the planner.

use magpie::graph::{Access, Domain, Layout, Origin, Queue, ResourceDecl, Uses};

/// A set of pairs of access and domain, one bit each.
pub type Set = u128;

/// Every pair.
pub const ALL: Set = Set::MAX;

/// The bit of an access in a pass of a domain. Some accesses use the same stages in every domain.
pub fn pair(access: Access, pass: Domain) -> Set {
    use Access::*;
    let domain = match access {
        Color | ColorLoad | Depth | DepthLoad | DepthTest | Index => Domain::Raster,
        CopyRead | CopyWrite | HostRead => Domain::Copy,
        Build | Refit | BuildInput | BuildScratch => Domain::Compute,
        Sample | StorageRead | StorageWrite | StorageReadWrite | BufferRead | BufferWrite | BufferReadWrite
        | Indirect | Trace => pass,
    };
    1 << (access as u32 * 3 + domain as u32)
}

/// Whether an access writes.
pub fn changes(access: Access) -> bool {
    use Access::*;
    [
        Color,
        ColorLoad,
        Depth,
        DepthLoad,
        StorageWrite,
        StorageReadWrite,
        BufferWrite,
        BufferReadWrite,
        Build,
        Refit,
        BuildScratch,
        CopyWrite,
    ]
    .contains(&access)
}

/// Colour or depth attachment that is written.
pub fn is_attachment(access: Access) -> bool {
    [Access::Color, Access::ColorLoad, Access::Depth, Access::DepthLoad].contains(&access)
}

/// The layout that an image must have for an access.
pub fn layout(access: Access) -> Layout {
    use Access::*;
    match access {
        Color | ColorLoad => Layout::ColorAttachment,
        Depth | DepthLoad => Layout::DepthAttachment,
        Sample | DepthTest => Layout::ReadOnly,
        StorageRead | StorageWrite | StorageReadWrite => Layout::General,
        CopyRead => Layout::TransferSource,
        CopyWrite => Layout::TransferTarget,
        other => panic!("images are not used as {other:?}"),
    }
}

/// One scope of a barrier.
#[derive(Clone, Copy)]
pub struct Scope {
    pub pairs: Set,
    pub any: bool,
    pub waited: bool,
}

impl Scope {
    pub fn of(uses: Uses) -> Self {
        let pairs = uses.iter().fold(0, |set, (access, domain)| set | pair(access, domain));
        Self { pairs, any: uses.is_any(), waited: uses.has_other_queues() }
    }
}

/// The pairs whose stages a queue supports.
pub fn stages_of(queue: Queue) -> Set {
    let copies = pair(Access::CopyRead, Domain::Copy) | pair(Access::CopyWrite, Domain::Copy);
    use Access::{Color, ColorLoad, Depth, DepthLoad, DepthTest, Index};
    let attachments = [Color, ColorLoad, Depth, DepthLoad, DepthTest, Index];
    let drawing = Access::ALL.iter().fold(0, |set, &a| set | pair(a, Domain::Raster));
    let in_any_pass = Access::ALL.iter().filter(|&&a| pair(a, Domain::Raster) == pair(a, Domain::Compute));
    let elsewhere = in_any_pass.filter(|a| !attachments.contains(a)).fold(0, |set, &a| set | pair(a, Domain::Raster));
    match queue {
        Queue::Graphics => ALL,
        Queue::AsyncCompute => ALL & !drawing | elsewhere,
        Queue::Transfer => copies,
    }
}

/// Whether a resource was imported without contents.
pub fn comes_empty(decl: &ResourceDecl) -> bool {
    match decl.origin {
        Origin::Transient => false,
        Origin::Imported { last, .. } => last.iter().next().is_none(),
    }
}
