//! How a pass touches a resource, in words that know nothing of Vulkan: `gpu/` maps them to stages and access masks.

use std::fmt;

/// What a pass does with one resource.
#[derive(Clone, Copy, Debug, PartialEq, Eq, Hash)]
#[repr(u8)]
pub enum Access {
    /// Colour attachment, cleared first.
    Color,
    /// Colour attachment over what is there.
    ColorLoad,
    /// Depth attachment, cleared first.
    Depth,
    /// Depth attachment over what is there.
    DepthLoad,
    /// Texture reads in a shader.
    Sample,
    /// Storage image, read.
    StorageRead,
    /// Storage image, written, nothing kept of what was there.
    StorageWrite,
    /// Storage image, read and written.
    StorageReadWrite,
    /// Buffer read in a shader.
    BufferRead,
    /// Buffer written in a shader, nothing kept of what was there.
    BufferWrite,
    /// Buffer read and written in a shader.
    BufferReadWrite,
    /// Indices of a draw.
    Index,
    /// Arguments of an indirect draw or dispatch.
    Indirect,
    /// Rays traced through an acceleration structure.
    Trace,
    /// Acceleration structure built, or compacted into, nothing kept of what was there.
    Build,
    /// Acceleration structure refitted: the build before is read and written over.
    Refit,
    /// Read by a build: geometry in buffers, bottom levels under a top level, the source of a compaction.
    BuildInput,
    /// Working memory of a build.
    BuildScratch,
    /// Source of a copy.
    CopyRead,
    /// Target of a copy; what the copy leaves out is kept.
    CopyWrite,
    /// Read by the host after the frame; only as the state that an imported buffer is left in.
    HostRead,
}

impl Access {
    /// Every access, in the order of their numbers.
    pub const ALL: [Self; 21] = [
        Self::Color,
        Self::ColorLoad,
        Self::Depth,
        Self::DepthLoad,
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
            Self::Sample
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

    /// Whether images can be used so. Copies suit images and buffers.
    pub fn is_image(self) -> bool {
        self.is_attachment()
            || self.is_copy()
            || matches!(self, Self::Sample | Self::StorageRead | Self::StorageWrite | Self::StorageReadWrite)
    }

    /// Whether buffers can be used so.
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

    /// Whether acceleration structures can be used so: built, traced, or written as plain bytes where a shader builds them.
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

    /// Part of a build of the driver's acceleration structures.
    pub fn is_build(self) -> bool {
        matches!(self, Self::Build | Self::Refit | Self::BuildInput | Self::BuildScratch)
    }

    /// Colour or depth attachment.
    pub fn is_attachment(self) -> bool {
        self.is_color() || self.is_depth()
    }

    /// Colour attachment.
    pub fn is_color(self) -> bool {
        matches!(self, Self::Color | Self::ColorLoad)
    }

    /// Depth attachment.
    pub fn is_depth(self) -> bool {
        matches!(self, Self::Depth | Self::DepthLoad)
    }

    /// Source or target of a copy.
    pub fn is_copy(self) -> bool {
        matches!(self, Self::CopyRead | Self::CopyWrite)
    }

    /// Layout that an image has during this access; [`Layout::Undefined`] for accesses of buffers and acceleration structures.
    pub fn layout(self) -> Layout {
        match self {
            Self::Color | Self::ColorLoad => Layout::ColorAttachment,
            Self::Depth | Self::DepthLoad => Layout::DepthAttachment,
            Self::Sample => Layout::ShaderRead,
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

    /// This access in a pass of a domain. Where the access alone fixes the domain, that one is given, so that equal uses are
    /// equal values: attachments and indices are raster, copies and the host are copy, builds are compute.
    pub fn at(self, pass: Domain) -> (Self, Domain) {
        let domain = match self {
            Self::Color | Self::ColorLoad | Self::Depth | Self::DepthLoad | Self::Index => Domain::Raster,
            Self::CopyRead | Self::CopyWrite | Self::HostRead => Domain::Copy,
            Self::Build | Self::Refit | Self::BuildInput | Self::BuildScratch => Domain::Compute,
            _ => pass,
        };
        (self, domain)
    }

    /// In words, for dumps and messages.
    pub fn name(self) -> &'static str {
        match self {
            Self::Color => "colour",
            Self::ColorLoad => "colour over",
            Self::Depth => "depth",
            Self::DepthLoad => "depth over",
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

/// Which part of the device a pass runs on; with an [`Access`] it fixes the pipeline stages.
#[derive(Clone, Copy, Debug, PartialEq, Eq, Hash)]
#[repr(u8)]
pub enum Domain {
    /// It has colour or depth attachments.
    Raster,
    /// Dispatches and rays.
    Compute,
    /// Copies only.
    Copy,
}

impl Domain {
    /// Every domain, in the order of their numbers.
    pub const ALL: [Self; 3] = [Self::Raster, Self::Compute, Self::Copy];

    /// In words, for dumps.
    pub fn name(self) -> &'static str {
        match self {
            Self::Raster => "raster",
            Self::Compute => "compute",
            Self::Copy => "copy",
        }
    }
}

/// The queue a pass would like. It is a wish: the plan grants it where the device has such a queue and the pass can run there.
#[derive(Clone, Copy, Debug, PartialEq, Eq, PartialOrd, Ord, Hash)]
#[repr(u8)]
pub enum Queue {
    /// The queue that can do everything.
    Graphics,
    /// Compute beside graphics, where the device has such a queue.
    AsyncCompute,
    /// Copies beside both, where the device has such a queue.
    Transfer,
}

impl Queue {
    /// Every queue, in the order of their numbers.
    pub const ALL: [Self; 3] = [Self::Graphics, Self::AsyncCompute, Self::Transfer];

    /// Its place in [`Queue::ALL`].
    pub fn index(self) -> usize {
        self as usize
    }

    /// In words, for dumps.
    pub fn name(self) -> &'static str {
        match self {
            Self::Graphics => "graphics",
            Self::AsyncCompute => "async compute",
            Self::Transfer => "transfer",
        }
    }
}

/// How an image lies in memory; buffers and acceleration structures are always [`Layout::Undefined`].
#[derive(Clone, Copy, Debug, PartialEq, Eq, Hash)]
pub enum Layout {
    /// Contents are lost, or it is no image.
    Undefined,
    /// Storage image.
    General,
    /// Colour attachment.
    ColorAttachment,
    /// Depth attachment.
    DepthAttachment,
    /// Sampled.
    ShaderRead,
    /// Source of a copy.
    TransferSource,
    /// Target of a copy.
    TransferTarget,
}

impl Layout {
    /// In words, for dumps.
    pub fn name(self) -> &'static str {
        match self {
            Self::Undefined => "undefined",
            Self::General => "general",
            Self::ColorAttachment => "colour attachment",
            Self::DepthAttachment => "depth attachment",
            Self::ShaderRead => "shader read",
            Self::TransferSource => "transfer source",
            Self::TransferTarget => "transfer target",
        }
    }
}

/// A set of pairs of [`Access`] and [`Domain`], or everything whatsoever ([`Uses::ANY`]).
#[derive(Clone, Copy, Debug, Default, PartialEq, Eq, Hash)]
pub struct Uses(u128);

const ANY_BIT: u128 = 1 << 127;
const WAITED_BIT: u128 = 1 << 126;
const _: () = assert!(Access::ALL.len() * Domain::ALL.len() < 126, "one bit per pair, and two for ANY and WAITED");

impl Uses {
    /// Nothing.
    pub const EMPTY: Self = Self(0);

    /// All that the device did before, in this frame and in those before it.
    pub const ANY: Self = Self(ANY_BIT);

    /// All that the batch waited for on other queues, whose results the wait has shown to everything already.
    pub const WAITED: Self = Self(WAITED_BIT);

    /// The set of one use.
    pub fn of((access, domain): (Access, Domain)) -> Self {
        Self(1 << (access as u32 * Domain::ALL.len() as u32 + domain as u32))
    }

    /// Adds one use.
    pub fn insert(&mut self, at: (Access, Domain)) {
        self.0 |= Self::of(at).0;
    }

    /// Takes one use out.
    pub fn remove(&mut self, at: (Access, Domain)) {
        self.0 &= !Self::of(at).0;
    }

    /// Whether the set names this use. [`Uses::ANY`] names none.
    pub fn contains(self, at: (Access, Domain)) -> bool {
        self.0 & Self::of(at).0 != 0
    }

    /// Both together.
    pub fn union(self, other: Self) -> Self {
        Self(self.0 | other.0)
    }

    /// Whether every use of `other` is in it, where neither is [`Uses::ANY`].
    pub fn includes(self, other: Self) -> bool {
        other.0 & !self.0 == 0
    }

    /// No use at all.
    pub fn is_empty(self) -> bool {
        self.0 == 0
    }

    /// Whether it stands for everything whatsoever.
    pub fn is_any(self) -> bool {
        self.0 & ANY_BIT != 0
    }

    /// Whether it includes what the batch waited for.
    pub fn is_waited(self) -> bool {
        self.0 & WAITED_BIT != 0
    }

    /// The named uses, by access and then domain.
    pub fn iter(self) -> impl Iterator<Item = (Access, Domain)> {
        let mut left = self.0 & !(ANY_BIT | WAITED_BIT);
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
        let waited = self.is_waited().then(|| "other queues".to_owned());
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
