//! The one descriptor set: sampled images, storage images and samplers, addressed by index.
use super::device::lock;
use super::GpuError;
use crate::scene::{Sampler, Wrap};
use ash::vk;
use magpie_shaders::SamplerId;
use std::collections::HashMap;
use std::sync::Mutex;

/// Places in the set. 32k sampled images cover big scenes and stay below every desktop driver's limit.
const SAMPLED: u32 = 32_768;
const STORAGE: u32 = 4_096;
const SAMPLERS: u32 = 128;

pub(super) struct Bindless {
    pub layout: vk::DescriptorSetLayout,
    pub set: vk::DescriptorSet,
    pool: vk::DescriptorPool,
    sampled: Mutex<Slots>,
    storage: Mutex<Slots>,
    samplers: Mutex<HashMap<Sampler, (u32, vk::Sampler)>>,
    anisotropy: f32,
}

/// Indices that are free again, then those never used.
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
        let kinds = [
            (vk::DescriptorType::SAMPLED_IMAGE, SAMPLED),
            (vk::DescriptorType::STORAGE_IMAGE, STORAGE),
            (vk::DescriptorType::SAMPLER, SAMPLERS),
        ];
        let bindings: Vec<_> = kinds
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
        let flags = [vk::DescriptorBindingFlags::PARTIALLY_BOUND
            | vk::DescriptorBindingFlags::UPDATE_AFTER_BIND
            | vk::DescriptorBindingFlags::UPDATE_UNUSED_WHILE_PENDING; 3];
        let mut flags = vk::DescriptorSetLayoutBindingFlagsCreateInfo::default().binding_flags(&flags);
        let info = vk::DescriptorSetLayoutCreateInfo::default()
            .bindings(&bindings)
            .flags(vk::DescriptorSetLayoutCreateFlags::UPDATE_AFTER_BIND_POOL)
            .push_next(&mut flags);
        // SAFETY: all pointers outlive the call.
        let layout = unsafe { device.create_descriptor_set_layout(&info, None) }
            .map_err(GpuError::call("vkCreateDescriptorSetLayout"))?;
        let sizes = kinds.map(|(ty, descriptor_count)| vk::DescriptorPoolSize { ty, descriptor_count });
        let info = vk::DescriptorPoolCreateInfo::default()
            .max_sets(1)
            .pool_sizes(&sizes)
            .flags(vk::DescriptorPoolCreateFlags::UPDATE_AFTER_BIND);
        // SAFETY: as above.
        let pool = unsafe { device.create_descriptor_pool(&info, None) }
            .map_err(GpuError::call("vkCreateDescriptorPool"))?;
        let layouts = [layout];
        let info = vk::DescriptorSetAllocateInfo::default().descriptor_pool(pool).set_layouts(&layouts);
        // SAFETY: the pool was made for one such set.
        let sets = unsafe { device.allocate_descriptor_sets(&info) }
            .map_err(GpuError::call("vkAllocateDescriptorSets"))?;
        let slots = |limit, what| Mutex::new(Slots { free: Vec::new(), next: 0, limit, what });
        Ok(Self {
            layout,
            set: sets[0],
            pool,
            sampled: slots(SAMPLED, "sampled images"),
            storage: slots(STORAGE, "storage images"),
            samplers: Mutex::default(),
            anisotropy,
        })
    }

    pub fn add_sampled(&self, device: &ash::Device, view: vk::ImageView) -> Result<u32, GpuError> {
        let index = lock(&self.sampled).take()?;
        self.write_image(device, 0, index, view, vk::ImageLayout::SHADER_READ_ONLY_OPTIMAL);
        Ok(index)
    }

    pub fn add_storage(&self, device: &ash::Device, view: vk::ImageView) -> Result<u32, GpuError> {
        let index = lock(&self.storage).take()?;
        self.write_image(device, 1, index, view, vk::ImageLayout::GENERAL);
        Ok(index)
    }

    fn write_image(&self, device: &ash::Device, binding: u32, index: u32, view: vk::ImageView, layout: vk::ImageLayout) {
        let info = [vk::DescriptorImageInfo { image_view: view, image_layout: layout, ..Default::default() }];
        let kind = if binding == 0 { vk::DescriptorType::SAMPLED_IMAGE } else { vk::DescriptorType::STORAGE_IMAGE };
        let write = vk::WriteDescriptorSet::default()
            .dst_set(self.set)
            .dst_binding(binding)
            .dst_array_element(index)
            .descriptor_type(kind)
            .image_info(&info);
        // SAFETY: the element is free, so no pending work reads it; the bindings may be updated after being bound.
        unsafe { device.update_descriptor_sets(&[write], &[]) };
    }

    pub fn release(&self, sampled: Option<u32>, storage: Option<u32>) {
        lock(&self.sampled).free.extend(sampled);
        lock(&self.storage).free.extend(storage);
    }

    /// The sampler with these properties, made when first asked for.
    pub fn sampler(&self, device: &ash::Device, wanted: Sampler) -> Result<SamplerId, GpuError> {
        let mut known = lock(&self.samplers);
        if let Some((index, _)) = known.get(&wanted) {
            return Ok(SamplerId(*index));
        }
        let index = known.len() as u32;
        if index == SAMPLERS {
            return Err(GpuError::Limit { what: "samplers".to_owned(), wanted: u64::from(index) + 1, limit: u64::from(SAMPLERS) });
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
            .mipmap_mode(if wanted.linear_mips { vk::SamplerMipmapMode::LINEAR } else { vk::SamplerMipmapMode::NEAREST })
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
            .dst_binding(2)
            .dst_array_element(index)
            .descriptor_type(vk::DescriptorType::SAMPLER)
            .image_info(&image_info);
        // SAFETY: the element was never used before.
        unsafe { device.update_descriptor_sets(&[write], &[]) };
        known.insert(wanted, (index, sampler));
        Ok(SamplerId(index))
    }

    /// # Safety
    /// The device is idle and the set is never used again.
    pub unsafe fn destroy(&self, device: &ash::Device) {
        // SAFETY: by this function's contract.
        unsafe {
            for (_, sampler) in lock(&self.samplers).values() {
                device.destroy_sampler(*sampler, None);
            }
            device.destroy_descriptor_pool(self.pool, None);
            device.destroy_descriptor_set_layout(self.layout, None);
        }
    }
}

impl super::Gpu {
    /// The bindless index of a sampler, made when first asked for.
    ///
    /// # Errors
    /// [`GpuError::Limit`] after 128 different samplers.
    pub fn sampler(&self, wanted: Sampler) -> Result<SamplerId, GpuError> {
        self.0.bindless.sampler(self.raw(), wanted)
    }
}
