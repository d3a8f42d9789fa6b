//! The bindless descriptor set: sampled images, storage images and samplers, addressed by index.
use super::GpuError;
use super::device::lock;
use super::pass_set::SpareSets;
use crate::scene::{Sampler, Wrap};
use ash::vk;
use bytemuck::Pod;
use magpie_shaders::SamplerId;
use std::collections::{BTreeSet, HashMap};
use std::sync::Mutex;

/// Descriptors in the set: enough for large scenes, below every desktop driver's limit, and small enough for one set per pass
/// when the validation layers are on.
pub(super) const SAMPLED: u32 = 8_192;
const STORAGE: u32 = 1_024;
const SAMPLERS: u32 = 128;

const KINDS: [(vk::DescriptorType, u32); 3] = [
    (vk::DescriptorType::SAMPLER, SAMPLERS),
    (vk::DescriptorType::STORAGE_IMAGE, STORAGE),
    (vk::DescriptorType::SAMPLED_IMAGE, SAMPLED),
];

/// Bindings of `shaders/lib/bindless.glsl`. Only the last of a set may differ in length from set to set.
pub(super) const SAMPLER_BINDING: u32 = 0;
pub(super) const STORAGE_BINDING: u32 = 1;
pub(super) const SAMPLED_BINDING: u32 = 2;

pub(super) struct Bindless {
    pub layout: vk::DescriptorSetLayout,
    pub set: vk::DescriptorSet,
    pool: vk::DescriptorPool,
    sampled: Mutex<Slots>,
    storage: Mutex<Slots>,
    /// Indices of sampled images that no pass writes, which are the textures.
    pub textures: Mutex<BTreeSet<u32>>,
    /// Sets of passes that no frame uses at present; none without the validation layers.
    pub spare: Mutex<SpareSets>,
    pub samplers: Mutex<HashMap<Sampler, (u32, vk::Sampler)>>,
    anisotropy: f32,
}

/// Makes an index for shaders from a number, which happens nowhere else. `T` is one of the three index types.
pub(super) fn place<T: Pod>(index: u32) -> T {
    bytemuck::cast(index)
}

/// Allocator of indices: those that were freed first, then those never used.
struct Slots {
    free: Vec<u32>,
    next: u32,
    limit: u32,
    what: &'static str,
}

impl Slots {
    fn take(&mut self) -> Result<u32, GpuError> {
        if let Some(index) = self.free.pop() {
            return Ok(index);
        }
        if self.next == self.limit {
            let (wanted, limit) = (u64::from(self.next) + 1, u64::from(self.limit));
            return Err(GpuError::Limit { what: format!("{} in the bindless set", self.what), wanted, limit });
        }
        self.next += 1;
        Ok(self.next - 1)
    }
}

impl Bindless {
    pub fn new(device: &ash::Device, anisotropy: f32) -> Result<Self, GpuError> {
        let bindings: Vec<_> = KINDS
            .iter()
            .zip(0..)
            .map(|((kind, count), binding)| {
                vk::DescriptorSetLayoutBinding::default()
                    .binding(binding)
                    .descriptor_type(*kind)
                    .descriptor_count(*count)
                    .stage_flags(vk::ShaderStageFlags::ALL)
            })
            .collect();
        let mut flags = [vk::DescriptorBindingFlags::PARTIALLY_BOUND
            | vk::DescriptorBindingFlags::UPDATE_AFTER_BIND
            | vk::DescriptorBindingFlags::UPDATE_UNUSED_WHILE_PENDING; 3];
        flags[SAMPLED_BINDING as usize] |= vk::DescriptorBindingFlags::VARIABLE_DESCRIPTOR_COUNT;
        let mut flags = vk::DescriptorSetLayoutBindingFlagsCreateInfo::default().binding_flags(&flags);
        let info = vk::DescriptorSetLayoutCreateInfo::default()
            .bindings(&bindings)
            .flags(vk::DescriptorSetLayoutCreateFlags::UPDATE_AFTER_BIND_POOL)
            .push_next(&mut flags);
        // SAFETY: all pointers outlive the call.
        let layout = unsafe { device.create_descriptor_set_layout(&info, None) }
            .map_err(GpuError::call("vkCreateDescriptorSetLayout"))?;
        let (pool, set) = allocate(device, layout, SAMPLED)?;
        let slots = |limit, what| Mutex::new(Slots { free: Vec::new(), next: 0, limit, what });
        Ok(Self {
            layout,
            set,
            pool,
            sampled: slots(SAMPLED, "sampled images"),
            storage: slots(STORAGE, "storage images"),
            textures: Mutex::default(),
            spare: Mutex::default(),
            samplers: Mutex::default(),
            anisotropy,
        })
    }

    /// Adds a sampled image and returns its index. `layout` is the one in which images of its format are read; `texture` means that no
    /// pass writes it.
    pub fn add_sampled(
        &self,
        device: &ash::Device,
        view: vk::ImageView,
        layout: vk::ImageLayout,
        texture: bool,
    ) -> Result<u32, GpuError> {
        let index = lock(&self.sampled).take()?;
        if texture {
            lock(&self.textures).insert(index);
        }
        self.write_image(device, SAMPLED_BINDING, index, view, layout);
        Ok(index)
    }

    pub fn add_storage(&self, device: &ash::Device, view: vk::ImageView) -> Result<u32, GpuError> {
        let index = lock(&self.storage).take()?;
        self.write_image(device, STORAGE_BINDING, index, view, vk::ImageLayout::GENERAL);
        Ok(index)
    }

    fn write_image(
        &self,
        device: &ash::Device,
        binding: u32,
        index: u32,
        view: vk::ImageView,
        layout: vk::ImageLayout,
    ) {
        let info = [vk::DescriptorImageInfo { image_view: view, image_layout: layout, ..Default::default() }];
        let (kind, _) = KINDS[binding as usize];
        let write = vk::WriteDescriptorSet::default()
            .dst_set(self.set)
            .dst_binding(binding)
            .dst_array_element(index)
            .descriptor_type(kind)
            .image_info(&info);
        // SAFETY: the element is free, so no pending work reads it; the bindings may be updated after being bound.
        unsafe { device.update_descriptor_sets(&[write], &[]) };
    }

    pub fn release(&self, device: &ash::Device, sampled: &[u32], storage: &[u32]) {
        let mut textures = lock(&self.textures);
        let before = textures.len();
        textures.retain(|index| !sampled.contains(index));
        if textures.len() < before {
            lock(&self.spare).forget(device);
        }
        drop(textures);
        lock(&self.sampled).free.extend(sampled);
        lock(&self.storage).free.extend(storage);
    }

    /// Every index of a sampled image in use is less than this.
    pub fn sampled_end(&self) -> u32 {
        lock(&self.sampled).next
    }

    /// Number of sampled and storage images in the set, without the two placeholders at index 0.
    pub fn in_use(&self) -> u32 {
        let taken = |slots: &Slots| (slots.next - slots.free.len() as u32).saturating_sub(1);
        taken(&lock(&self.sampled)) + taken(&lock(&self.storage))
    }

    /// The sampler with these properties; created on first use.
    pub fn sampler(&self, device: &ash::Device, wanted: Sampler) -> Result<SamplerId, GpuError> {
        let mut known = lock(&self.samplers);
        if let Some((index, _)) = known.get(&wanted) {
            return Ok(place(*index));
        }
        let index = known.len() as u32;
        if index == SAMPLERS {
            return Err(GpuError::Limit {
                what: "samplers".to_owned(),
                wanted: u64::from(index) + 1,
                limit: u64::from(SAMPLERS),
            });
        }
        let filter = |linear| if linear { vk::Filter::LINEAR } else { vk::Filter::NEAREST };
        let wrap = |w| match w {
            Wrap::Repeat => vk::SamplerAddressMode::REPEAT,
            Wrap::Mirror => vk::SamplerAddressMode::MIRRORED_REPEAT,
            Wrap::Clamp => vk::SamplerAddressMode::CLAMP_TO_EDGE,
        };
        let smooth = wanted.linear_magnify && wanted.linear_minify && wanted.mips;
        let info = vk::SamplerCreateInfo::default()
            .mag_filter(filter(wanted.linear_magnify))
            .min_filter(filter(wanted.linear_minify))
            .mipmap_mode(if wanted.linear_mips {
                vk::SamplerMipmapMode::LINEAR
            } else {
                vk::SamplerMipmapMode::NEAREST
            })
            .address_mode_u(wrap(wanted.wrap[0]))
            .address_mode_v(wrap(wanted.wrap[1]))
            .max_lod(if wanted.mips { vk::LOD_CLAMP_NONE } else { 0.0 })
            .anisotropy_enable(smooth && self.anisotropy > 1.0)
            .max_anisotropy(self.anisotropy.clamp(1.0, 8.0));
        // SAFETY: `info` is complete; anisotropy is on only where the device has it.
        let sampler = unsafe { device.create_sampler(&info, None) }.map_err(GpuError::call("vkCreateSampler"))?;
        let image_info = [vk::DescriptorImageInfo { sampler, ..Default::default() }];
        let write = vk::WriteDescriptorSet::default()
            .dst_set(self.set)
            .dst_binding(SAMPLER_BINDING)
            .dst_array_element(index)
            .descriptor_type(vk::DescriptorType::SAMPLER)
            .image_info(&image_info);
        // SAFETY: the element was never used before.
        unsafe { device.update_descriptor_sets(&[write], &[]) };
        known.insert(wanted, (index, sampler));
        Ok(place(index))
    }

    /// # Safety
    /// The device is idle and the set is never used again.
    pub unsafe fn destroy(&self, device: &ash::Device) {
        // SAFETY: by this function's contract.
        unsafe {
            for (_, sampler) in lock(&self.samplers).values() {
                device.destroy_sampler(*sampler, None);
            }
            lock(&self.spare).forget(device);
            device.destroy_descriptor_pool(self.pool, None);
            device.destroy_descriptor_set_layout(self.layout, None);
        }
    }
}

/// A descriptor set of this layout with so many sampled images, from a pool of its own.
pub(super) fn allocate(
    device: &ash::Device,
    layout: vk::DescriptorSetLayout,
    sampled: u32,
) -> Result<(vk::DescriptorPool, vk::DescriptorSet), GpuError> {
    let mut sizes = KINDS.map(|(ty, descriptor_count)| vk::DescriptorPoolSize { ty, descriptor_count });
    sizes[SAMPLED_BINDING as usize].descriptor_count = sampled;
    let info = vk::DescriptorPoolCreateInfo::default()
        .max_sets(1)
        .pool_sizes(&sizes)
        .flags(vk::DescriptorPoolCreateFlags::UPDATE_AFTER_BIND);
    // SAFETY: all pointers outlive the call.
    let pool =
        unsafe { device.create_descriptor_pool(&info, None) }.map_err(GpuError::call("vkCreateDescriptorPool"))?;
    let (layouts, lengths) = ([layout], [sampled]);
    let mut lengths = vk::DescriptorSetVariableDescriptorCountAllocateInfo::default().descriptor_counts(&lengths);
    let info =
        vk::DescriptorSetAllocateInfo::default().descriptor_pool(pool).set_layouts(&layouts).push_next(&mut lengths);
    // SAFETY: the pool was made for one such set.
    let sets = unsafe { device.allocate_descriptor_sets(&info) };
    match sets {
        Ok(sets) => Ok((pool, sets[0])),
        Err(e) => {
            // SAFETY: nothing was allocated from it.
            unsafe { device.destroy_descriptor_pool(pool, None) };
            Err(GpuError::call("vkAllocateDescriptorSets")(e))
        }
    }
}

impl super::Gpu {
    /// The bindless index of a sampler; created on first use.
    ///
    /// # Errors
    /// [`GpuError::Limit`] if there are 128 different samplers already.
    pub fn sampler(&self, wanted: Sampler) -> Result<SamplerId, GpuError> {
        self.0.bindless.sampler(self.raw(), wanted)
    }
}
