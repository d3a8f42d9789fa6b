//! How a pass uses a resource, in terms that are independent of Vulkan: `gpu/access.rs` maps them to pipeline stages and access masks.

use std::fmt;

/// One way in which a pass uses a resource.
#[derive(Clone, Copy, Debug, PartialEq, Eq, Hash)]
#[repr(u8)]
pub enum Access {
    /// Colour attachment, cleared first.
    Color,
    /// Colour attachment whose contents are loaded.
    ColorLoad,
    /// Depth attachment, cleared first.
    Depth,
    /// Depth attachment whose contents are loaded.
    DepthLoad,
    /// Depth attachment that fragments are tested against and that is not written.
    DepthTest,
    /// Sampled, or fetched by texel, in a shader.
    Sample,
    /// Storage image, read.
    StorageRead,
    /// Storage image, written and not read; what is not written is kept.
    StorageWrite,
    /// Storage image, read and written.
    StorageReadWrite,
    /// Buffer read in a shader.
    BufferRead,
    /// Buffer written in a shader; earlier contents are discarded.
    BufferWrite,
    /// Buffer read and written in a shader.
    BufferReadWrite,
    /// Index buffer of a draw.
    Index,
    /// Arguments of an indirect draw, dispatch or trace.
    Indirect,
    /// Rays traced through an acceleration structure.
    Trace,
    /// Target of an acceleration structure build or compaction; earlier contents are discarded.
    Build,
    /// Acceleration structure refitted in place: the earlier build is read and overwritten.
    Refit,
    /// Input of a build: geometry buffers, the bottom levels of a top level, or the source of a compaction.
    BuildInput,
    /// Scratch buffer of a build.
    BuildScratch,
    /// Source of a copy.
    CopyRead,
    /// Target of a copy; what the copy leaves out is kept.
    CopyWrite,
    /// Read by the host after the frame. Valid only as the state in which an imported buffer enters or leaves the frame.
    HostRead,
}

impl Access {
    /// Every access, in discriminant order.
    pub const ALL: [Self; 22] = [
        Self::Color,
        Self::ColorLoad,
        Self::Depth,
        Self::DepthLoad,
        Self::DepthTest,
        Self::Sample,
        Self::StorageRead,
        Self::StorageWrite,
        Self::StorageReadWrite,
        Self::BufferRead,
        Self::BufferWrite,
        Self::BufferReadWrite,
        Self::Index,
        Self::Indirect,
        Self::Trace,
        Self::Build,
        Self::Refit,
        Self::BuildInput,
        Self::BuildScratch,
        Self::CopyRead,
        Self::CopyWrite,
        Self::HostRead,
    ];

    /// Whether earlier contents are read.
    pub fn reads(self) -> bool {
        !matches!(
            self,
            Self::Color
                | Self::Depth
                | Self::StorageWrite
                | Self::BufferWrite
                | Self::Build
                | Self::BuildScratch
                | Self::CopyWrite
        )
    }

    /// Whether contents are changed.
    pub fn writes(self) -> bool {
        match self {
            Self::Color
            | Self::ColorLoad
            | Self::Depth
            | Self::DepthLoad
            | Self::StorageWrite
            | Self::StorageReadWrite
            | Self::BufferWrite
            | Self::BufferReadWrite
            | Self::Build
            | Self::Refit
            | Self::BuildScratch
            | Self::CopyWrite => true,
            Self::DepthTest
            | Self::Sample
            | Self::StorageRead
            | Self::BufferRead
            | Self::Index
            | Self::Indirect
            | Self::Trace
            | Self::BuildInput
            | Self::CopyRead
            | Self::HostRead => false,
        }
    }

    /// Whether this access applies to images. Copies apply to images and buffers.
    pub fn is_image(self) -> bool {
        self.is_attachment()
            || self.is_copy()
            || matches!(self, Self::Sample | Self::StorageRead | Self::StorageWrite | Self::StorageReadWrite)
    }

    /// Whether this access applies to buffers.
    pub fn is_buffer(self) -> bool {
        self.is_copy()
            || matches!(
                self,
                Self::BufferRead
                    | Self::BufferWrite
                    | Self::BufferReadWrite
                    | Self::Index
                    | Self::Indirect
                    | Self::BuildInput
                    | Self::BuildScratch
                    | Self::HostRead
            )
    }

    /// Whether this access applies to acceleration structures: built, traced, or written as plain bytes where a shader builds them.
    pub fn is_accel(self) -> bool {
        matches!(
            self,
            Self::Trace
                | Self::Build
                | Self::Refit
                | Self::BuildInput
                | Self::BufferRead
                | Self::BufferWrite
                | Self::BufferReadWrite
                | Self::CopyWrite
        )
    }

    /// Whether it is part of a build by the driver.
    pub fn is_build(self) -> bool {
        matches!(self, Self::Build | Self::Refit | Self::BuildInput | Self::BuildScratch)
    }

    /// Whether it is a colour or depth attachment.
    pub fn is_attachment(self) -> bool {
        self.is_color() || self.is_depth()
    }

    /// Whether it is a colour attachment.
    pub fn is_color(self) -> bool {
        matches!(self, Self::Color | Self::ColorLoad)
    }

    /// Whether it is a depth attachment, written or only tested against.
    pub fn is_depth(self) -> bool {
        matches!(self, Self::Depth | Self::DepthLoad | Self::DepthTest)
    }

    /// Whether it is the source or target of a copy.
    pub fn is_copy(self) -> bool {
        matches!(self, Self::CopyRead | Self::CopyWrite)
    }

    /// Layout that an image has during this access; [`Layout::Undefined`] for accesses of buffers and acceleration structures.
    pub fn layout(self) -> Layout {
        match self {
            Self::Color | Self::ColorLoad => Layout::ColorAttachment,
            Self::Depth | Self::DepthLoad => Layout::DepthAttachment,
            Self::DepthTest | Self::Sample => Layout::ReadOnly,
            Self::StorageRead | Self::StorageWrite | Self::StorageReadWrite => Layout::General,
            Self::CopyRead => Layout::TransferSource,
            Self::CopyWrite => Layout::TransferTarget,
            Self::BufferRead
            | Self::BufferWrite
            | Self::BufferReadWrite
            | Self::Index
            | Self::Indirect
            | Self::Trace
            | Self::Build
            | Self::Refit
            | Self::BuildInput
            | Self::BuildScratch
            | Self::HostRead => Layout::Undefined,
        }
    }

    /// This access, paired with the domain that it has in a pass of domain `pass`. An access that implies a domain overrides `pass`, so
    /// that equal uses compare equal: attachments and index buffers are raster, copies and host reads are copy, builds are compute.
    pub fn at(self, pass: Domain) -> (Self, Domain) {
        let domain = match self {
            Self::Color | Self::ColorLoad | Self::Depth | Self::DepthLoad | Self::DepthTest | Self::Index => {
                Domain::Raster
            }
            Self::CopyRead | Self::CopyWrite | Self::HostRead => Domain::Copy,
            Self::Build | Self::Refit | Self::BuildInput | Self::BuildScratch => Domain::Compute,
            _ => pass,
        };
        (self, domain)
    }

    /// Name for dumps and messages, such as `colour`.
    pub fn name(self) -> &'static str {
        match self {
            Self::Color => "colour",
            Self::ColorLoad => "colour over",
            Self::Depth => "depth",
            Self::DepthLoad => "depth over",
            Self::DepthTest => "depth test",
            Self::Sample => "sample",
            Self::StorageRead => "storage read",
            Self::StorageWrite => "storage write",
            Self::StorageReadWrite => "storage read-write",
            Self::BufferRead => "buffer read",
            Self::BufferWrite => "buffer write",
            Self::BufferReadWrite => "buffer read-write",
            Self::Index => "index",
            Self::Indirect => "indirect",
            Self::Trace => "trace",
            Self::Build => "build",
            Self::Refit => "refit",
            Self::BuildInput => "build input",
            Self::BuildScratch => "build scratch",
            Self::CopyRead => "copy from",
            Self::CopyWrite => "copy to",
            Self::HostRead => "host read",
        }
    }
}

impl fmt::Display for Access {
    fn fmt(&self, f: &mut fmt::Formatter<'_>) -> fmt::Result {
        f.write_str(self.name())
    }
}

/// Kind of work that a pass does; together with an [`Access`] it determines the pipeline stages.
#[derive(Clone, Copy, Debug, PartialEq, Eq, Hash)]
#[repr(u8)]
pub enum Domain {
    /// The pass draws: it has colour or depth attachments, or an index buffer.
    Raster,
    /// Dispatches, ray traces and builds of acceleration structures.
    Compute,
    /// Copies only.
    Copy,
}

impl Domain {
    /// Every domain, in discriminant order.
    pub const ALL: [Self; 3] = [Self::Raster, Self::Compute, Self::Copy];

    /// Name for dumps.
    pub fn name(self) -> &'static str {
        match self {
            Self::Raster => "raster",
            Self::Compute => "compute",
            Self::Copy => "copy",
        }
    }
}

/// The queue that a pass requests. The plan grants it if the device has such a queue and the pass can run on it; otherwise the
/// pass runs on the graphics queue.
#[derive(Clone, Copy, Debug, PartialEq, Eq, PartialOrd, Ord, Hash)]
#[repr(u8)]
pub enum Queue {
    /// Draws, dispatches, traces and copies. Every device has this queue.
    Graphics,
    /// Compute that may overlap the graphics queue.
    AsyncCompute,
    /// Copies that may overlap the other queues.
    Transfer,
}

impl Queue {
    /// Every queue, in discriminant order.
    pub const ALL: [Self; 3] = [Self::Graphics, Self::AsyncCompute, Self::Transfer];

    /// Index in [`Queue::ALL`].
    pub fn index(self) -> usize {
        self as usize
    }

    /// Name for dumps, such as `async compute`.
    pub fn name(self) -> &'static str {
        match self {
            Self::Graphics => "graphics",
            Self::AsyncCompute => "async compute",
            Self::Transfer => "transfer",
        }
    }
}

/// Layout of an image. Buffers and acceleration structures are always [`Layout::Undefined`].
#[derive(Clone, Copy, Debug, PartialEq, Eq, Hash)]
pub enum Layout {
    /// Contents are undefined, or the resource is not an image.
    Undefined,
    /// Storage image.
    General,
    /// Colour attachment.
    ColorAttachment,
    /// Depth attachment that is written.
    DepthAttachment,
    /// Sampled, or a depth attachment that is only tested against. A depth image may be both at once.
    ReadOnly,
    /// Source of a copy.
    TransferSource,
    /// Target of a copy.
    TransferTarget,
}

impl Layout {
    /// Name for dumps.
    pub fn name(self) -> &'static str {
        match self {
            Self::Undefined => "undefined",
            Self::General => "general",
            Self::ColorAttachment => "colour attachment",
            Self::DepthAttachment => "depth attachment",
            Self::ReadOnly => "read only",
            Self::TransferSource => "transfer source",
            Self::TransferTarget => "transfer target",
        }
    }
}

/// A set of pairs of [`Access`] and [`Domain`], or every possible use ([`Uses::ANY`]).
#[derive(Clone, Copy, Debug, Default, PartialEq, Eq, Hash)]
pub struct Uses(u128);

const ANY_BIT: u128 = 1 << 127;
const OTHER_QUEUES_BIT: u128 = 1 << 126;
const _: () =
    assert!(Access::ALL.len() * Domain::ALL.len() < 126, "one bit per pair, and two for ANY and OTHER_QUEUES");

impl Uses {
    /// The empty set.
    pub const EMPTY: Self = Self(0);

    /// Every use by the device before this point, in this frame and in earlier ones.
    pub const ANY: Self = Self(ANY_BIT);

    /// Every use on other queues that the batch waited for. The semaphore wait has already made their results visible.
    pub const OTHER_QUEUES: Self = Self(OTHER_QUEUES_BIT);

    /// The set that holds one use.
    pub fn of((access, domain): (Access, Domain)) -> Self {
        Self(1 << (access as u32 * Domain::ALL.len() as u32 + domain as u32))
    }

    /// Adds one use.
    pub fn insert(&mut self, at: (Access, Domain)) {
        self.0 |= Self::of(at).0;
    }

    /// Removes one use.
    pub fn remove(&mut self, at: (Access, Domain)) {
        self.0 &= !Self::of(at).0;
    }

    /// Whether the set holds this use explicitly. [`Uses::ANY`] holds none.
    pub fn contains(self, at: (Access, Domain)) -> bool {
        self.0 & Self::of(at).0 != 0
    }

    /// The union of both sets.
    pub fn union(self, other: Self) -> Self {
        Self(self.0 | other.0)
    }

    /// Whether every use of `other` is in the set. Only meaningful where neither contains [`Uses::ANY`].
    pub fn includes(self, other: Self) -> bool {
        other.0 & !self.0 == 0
    }

    /// Whether the set is empty.
    pub fn is_empty(self) -> bool {
        self.0 == 0
    }

    /// Whether it contains [`Uses::ANY`].
    pub fn is_any(self) -> bool {
        self.0 & ANY_BIT != 0
    }

    /// Whether it contains [`Uses::OTHER_QUEUES`].
    pub fn has_other_queues(self) -> bool {
        self.0 & OTHER_QUEUES_BIT != 0
    }

    /// The explicit uses, ordered by access and then by domain.
    pub fn iter(self) -> impl Iterator<Item = (Access, Domain)> {
        let mut left = self.0 & !(ANY_BIT | OTHER_QUEUES_BIT);
        std::iter::from_fn(move || {
            let bit = (left != 0).then(|| left.trailing_zeros() as usize)?;
            left &= left - 1;
            Some((Access::ALL[bit / Domain::ALL.len()], Domain::ALL[bit % Domain::ALL.len()]))
        })
    }
}

impl FromIterator<(Access, Domain)> for Uses {
    fn from_iter<I: IntoIterator<Item = (Access, Domain)>>(uses: I) -> Self {
        let mut set = Self::EMPTY;
        uses.into_iter().for_each(|at| set.insert(at));
        set
    }
}

impl fmt::Display for Uses {
    fn fmt(&self, f: &mut fmt::Formatter<'_>) -> fmt::Result {
        if self.is_any() {
            return f.write_str("anything");
        }
        if self.is_empty() {
            return f.write_str("nothing");
        }
        let waited = self.has_other_queues().then(|| "other queues".to_owned());
        let named = self.iter().map(|(access, domain)| format!("{access} ({})", domain.name()));
        for (i, one) in waited.into_iter().chain(named).enumerate() {
            write!(f, "{}{one}", if i > 0 { ", " } else { "" })?;
        }
        Ok(())
    }
}

#[cfg(test)]
mod tests {
    use super::*;

    #[test]
    fn every_pair_has_a_bit_of_its_own() {
        let all: Vec<_> = Access::ALL.into_iter().flat_map(|a| Domain::ALL.map(|d| (a, d))).collect();
        let set: Uses = all.iter().copied().collect();
        assert_eq!(set.iter().collect::<Vec<_>>(), all);
        assert!(!set.is_any());
        for &at in &all {
            let mut rest = set;
            rest.remove(at);
            assert!(!rest.contains(at));
            assert_eq!(rest.iter().count(), all.len() - 1);
        }
    }

    #[test]
    fn numbers_match_the_table() {
        for (i, access) in Access::ALL.into_iter().enumerate() {
            assert_eq!(access as usize, i);
        }
    }

    #[test]
    fn every_access_reads_or_writes_and_suits_some_kind() {
        for access in Access::ALL {
            assert!(access.reads() || access.writes(), "{access}");
            assert!(access.is_image() || access.is_buffer() || access.is_accel(), "{access}");
            assert_eq!(access.layout() != Layout::Undefined, access.is_image(), "{access}");
        }
    }

    #[test]
    fn sets_read_as_words() {
        let set: Uses = [(Access::Sample, Domain::Compute), (Access::Color, Domain::Raster)].into_iter().collect();
        assert_eq!(set.to_string(), "colour (raster), sample (compute)");
        assert_eq!(Uses::ANY.to_string(), "anything");
        assert_eq!(Uses::EMPTY.to_string(), "nothing");
    }
}
