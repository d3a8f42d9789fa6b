//! Descriptor sets of single passes, for validation.
use super::bindless::{SAMPLED, SAMPLED_BINDING, SAMPLER_BINDING, STORAGE_BINDING, allocate};
use super::device::lock;
use super::{Gpu, GpuError};
use ash::vk;
use magpie_shaders::{SampledImage, StorageImage};
use std::collections::VecDeque;

/// The part of the bindless set that one pass uses: its images, and all textures and samplers.
///
/// Synchronization validation cannot know which elements of an array a shader reads, and assumes all of them. With a set per
/// pass, it assumes what the pass declared. Only used with the validation layers on.
pub(crate) struct PassSet {
    gpu: Gpu,
    /// Taken on drop.
    own: Option<OwnSet>,
}

/// A descriptor set with its pool.
struct OwnSet {
    pool: vk::DescriptorPool,
    set: vk::DescriptorSet,
    images: PassImages,
    /// Number of sampled images that it has room for.
    length: u32,
    /// [`SpareSets::generation`] when it was made.
    generation: u64,
}

/// Indices of the images that a pass declared.
#[derive(PartialEq, Eq)]
struct PassImages {
    sampled: Vec<u32>,
    stored: Vec<u32>,
}

/// Sets of passes that no frame uses at present. Making one costs a millisecond or two, since drivers clear all of its thousands of
/// elements; so a pass takes a set that had the same elements in a frame before.
#[derive(Default)]
pub(super) struct SpareSets {
    /// The set used last is at the back.
    free: VecDeque<OwnSet>,
    /// Counts removals of textures: sets from before still have them.
    generation: u64,
}

impl SpareSets {
    /// Sets that are kept.
    const MOST: usize = 192;

    fn take(&mut self, images: &PassImages, length: u32) -> Option<OwnSet> {
        let found = self.free.iter().rposition(|own| own.length == length && own.images == *images)?;
        self.free.remove(found)
    }

    fn put(&mut self, device: &ash::Device, own: OwnSet) {
        if own.generation != self.generation {
            own.destroy(device);
            return;
        }
        self.free.push_back(own);
        if self.free.len() > Self::MOST
            && let Some(oldest) = self.free.pop_front()
        {
            oldest.destroy(device);
        }
    }

    /// Destroys all, because a texture is gone that they still have.
    pub fn forget(&mut self, device: &ash::Device) {
        self.generation += 1;
        self.free.drain(..).for_each(|own| own.destroy(device));
    }
}

impl OwnSet {
    fn destroy(self, device: &ash::Device) {
        // SAFETY: no frame uses the set: it is spare, or its frame is done.
        unsafe { device.destroy_descriptor_pool(self.pool, None) };
    }
}

impl PassSet {
    pub fn new(gpu: &Gpu, sampled: &[SampledImage], stored: &[StorageImage]) -> Result<Self, GpuError> {
        let (device, bindless) = (gpu.raw(), &gpu.0.bindless);
        let images = PassImages {
            sampled: sampled.iter().map(|i| i.index()).collect(),
            stored: stored.iter().map(|i| i.index()).collect(),
        };
        // Held to the end, so that no texture goes meanwhile.
        let textures = lock(&bindless.textures);
        // The validation layers go through all elements at every dispatch, so there are few more than needed.
        let length = bindless.sampled_end().next_multiple_of(64).min(SAMPLED);
        let (spare, generation) = {
            let mut sets = lock(&bindless.spare);
            (sets.take(&images, length), sets.generation)
        };
        let own = match spare {
            Some(own) => own,
            None => {
                let (pool, set) = allocate(device, bindless.layout, length)?;
                OwnSet { pool, set, images, length, generation }
            }
        };
        let copy = |binding, element| {
            vk::CopyDescriptorSet::default()
                .src_set(bindless.set)
                .src_binding(binding)
                .src_array_element(element)
                .dst_set(own.set)
                .dst_binding(binding)
                .dst_array_element(element)
                .descriptor_count(1)
        };
        // A spare set's indices may mean other images by now, so all are written again.
        let mut copies: Vec<_> = textures.iter().map(|i| copy(SAMPLED_BINDING, *i)).collect();
        copies.extend(lock(&bindless.samplers).values().map(|(i, _)| copy(SAMPLER_BINDING, *i)));
        copies.extend(own.images.sampled.iter().map(|i| copy(SAMPLED_BINDING, *i)));
        copies.extend(own.images.stored.iter().map(|i| copy(STORAGE_BINDING, *i)));
        // SAFETY: every element was written when its image or sampler was made; no frame uses the set.
        unsafe { device.update_descriptor_sets(&[], &copies) };
        Ok(Self { gpu: gpu.clone(), own: Some(own) })
    }

    /// The set; null only while it is dropped.
    pub(super) fn raw(&self) -> vk::DescriptorSet {
        self.own.as_ref().map_or(vk::DescriptorSet::null(), |own| own.set)
    }
}

impl Drop for PassSet {
    /// Its owner waits for the device before it drops a frame.
    fn drop(&mut self) {
        if let Some(own) = self.own.take() {
            lock(&self.gpu.0.bindless.spare).put(self.gpu.raw(), own);
        }
    }
}

#[cfg(test)]
mod tests {
    use super::*;

    fn images(sampled: &[u32], stored: &[u32]) -> PassImages {
        PassImages { sampled: sampled.to_vec(), stored: stored.to_vec() }
    }

    fn spare(sampled: &[u32], stored: &[u32], length: u32) -> OwnSet {
        let (pool, set) = (vk::DescriptorPool::null(), vk::DescriptorSet::null());
        OwnSet { pool, set, images: images(sampled, stored), length, generation: 0 }
    }

    /// A set with more elements than a pass declared would hide that the pass uses them.
    #[test]
    fn a_pass_takes_a_set_with_exactly_its_images() {
        let mut sets = SpareSets::default();
        sets.free.extend([spare(&[3, 4], &[1], 64), spare(&[3], &[1], 64), spare(&[3], &[1], 128)]);
        for other in [images(&[], &[]), images(&[3], &[]), images(&[4], &[1]), images(&[3, 4, 5], &[1])] {
            assert!(sets.take(&other, 64).is_none());
        }
        let taken = sets.take(&images(&[3], &[1]), 64).expect("a spare set");
        assert!(taken.images == images(&[3], &[1]) && taken.length == 64);
        assert!(sets.take(&images(&[3], &[1]), 64).is_none(), "it is taken");
        assert_eq!(sets.free.len(), 2);
    }
}
