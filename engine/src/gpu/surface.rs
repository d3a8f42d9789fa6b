//! The surface of a window, and the swapchain through which pictures reach it.
use super::device::lock;
use super::instance::Instance;
use super::{CommandEncoder, Gpu, GpuError, GpuOptions, Image, Submission, format};
use crate::graph::{Extent, Format, Queue};
use ash::{khr, vk};
use raw_window_handle::{HasDisplayHandle, HasWindowHandle, RawDisplayHandle, RawWindowHandle};
use std::any::Any;
use std::sync::Arc;

/// When a finished picture replaces the one that is shown.
#[derive(Clone, Copy, Debug, Default, PartialEq, Eq)]
pub enum PresentMode {
    /// At the next refresh of the display, in order: no tearing, and no more pictures than the display shows.
    #[default]
    Vsync,
    /// At the next refresh, only the newest: no tearing, and pictures may be made that are never shown.
    Newest,
    /// At once: the picture may tear.
    Immediate,
}

impl PresentMode {
    /// Every mode.
    pub const ALL: [Self; 3] = [Self::Vsync, Self::Newest, Self::Immediate];

    /// Name for people.
    #[must_use]
    pub fn name(self) -> &'static str {
        match self {
            Self::Vsync => "vsync",
            Self::Newest => "newest",
            Self::Immediate => "immediate",
        }
    }

    fn vulkan(self) -> vk::PresentModeKHR {
        match self {
            Self::Vsync => vk::PresentModeKHR::FIFO,
            Self::Newest => vk::PresentModeKHR::MAILBOX,
            Self::Immediate => vk::PresentModeKHR::IMMEDIATE,
        }
    }
}

/// What became of a picture.
#[derive(Clone, Copy, Debug, PartialEq, Eq)]
pub enum Presented {
    /// It was handed to the display.
    Shown,
    /// The window has no pixels, as one that is minimised.
    Hidden,
    /// The display had no image free in time. The picture was dropped.
    Late,
}

/// A window that pictures are shown in. It keeps the window alive.
pub struct Surface {
    // Dropped from top to bottom: the swapchain before the surface, the surface before the window and the device.
    swapchain: Option<Swapchain>,
    /// One per picture that may be on its way to the display.
    turns: Vec<Turn>,
    next: usize,
    window: WindowSurface,
    _handles: Arc<dyn Any + Send + Sync>,
    gpu: Gpu,
    mode: PresentMode,
    /// Bits of each colour, if the display offers that.
    bits: u32,
    offered: Vec<Offered>,
}

/// A format that the display offers.
#[derive(Clone, Copy)]
struct Offered {
    format: vk::Format,
    /// Bits of each colour.
    bits: u32,
    /// Whether pictures of any format and size can be scaled into it. Otherwise they are copied, and must have the same.
    scales: bool,
}

/// What one picture on its way to the display needs.
struct Turn {
    acquired: Semaphore,
    encoder: CommandEncoder,
    last: Option<Submission>,
}

/// The surface itself, which is made before a device is chosen.
pub(super) struct WindowSurface {
    calls: khr::surface::Instance,
    raw: vk::SurfaceKHR,
}

/// The handles of a window.
#[derive(Clone, Copy)]
pub(super) struct Handles {
    pub display: RawDisplayHandle,
    pub window: RawWindowHandle,
}

struct Swapchain {
    gpu: Gpu,
    calls: khr::swapchain::Device,
    raw: vk::SwapchainKHR,
    extent: Extent,
    mode: PresentMode,
    format: Offered,
    images: Vec<vk::Image>,
    /// Size of its images.
    pixels: Extent,
    /// One per image: signalled when it may be shown.
    ready: Vec<Semaphore>,
}

struct Semaphore {
    gpu: Gpu,
    raw: vk::Semaphore,
}

/// Time after which a picture is dropped if the display has no image free, nanoseconds.
const PATIENCE: u64 = 1_000_000_000;

impl WindowSurface {
    pub fn new(instance: &Instance, handles: Handles) -> Result<Self, GpuError> {
        let calls = khr::surface::Instance::new(instance.entry(), &instance.raw);
        // SAFETY: the caller keeps the window alive; the extensions for its display were enabled with the instance.
        let raw = unsafe {
            ash_window::create_surface(instance.entry(), &instance.raw, handles.display, handles.window, None)
        };
        Ok(Self { calls, raw: raw.map_err(GpuError::call("vkCreateSurface"))? })
    }

    /// Whether a queue family of a device can show pictures on it.
    pub fn is_supported(&self, device: vk::PhysicalDevice, family: u32) -> bool {
        // SAFETY: device and surface are of the same instance, and the family exists.
        unsafe { self.calls.get_physical_device_surface_support(device, family, self.raw) }.unwrap_or(false)
    }

    /// The formats that pictures can be copied to, those of 8 bits first.
    fn formats(&self, gpu: &Gpu) -> Result<Vec<Offered>, GpuError> {
        // SAFETY: device and surface are of the same instance.
        let offered = unsafe { self.calls.get_physical_device_surface_formats(gpu.physical(), self.raw) }
            .map_err(surface_error("vkGetPhysicalDeviceSurfaceFormatsKHR"))?;
        let is_offered = |format: vk::Format| {
            // Pictures hold display values, which must not go through the sRGB curve again.
            let is_it =
                |f: &vk::SurfaceFormatKHR| f.format == format && f.color_space == vk::ColorSpaceKHR::SRGB_NONLINEAR;
            offered.iter().any(is_it)
        };
        let known = [
            (vk::Format::B8G8R8A8_UNORM, 8),
            (vk::Format::R8G8B8A8_UNORM, 8),
            (vk::Format::A2B10G10R10_UNORM_PACK32, 10),
            (vk::Format::A2R10G10B10_UNORM_PACK32, 10),
        ];
        let of = |(format, bits)| {
            let scales = gpu.format_features(format).contains(vk::FormatFeatureFlags::BLIT_DST);
            Offered { format, bits, scales }
        };
        let suits = |offered: &Offered| {
            is_offered(offered.format) && (offered.scales || offered.format == format::vulkan(Format::A2Rgb10Unorm))
        };
        Ok(known.into_iter().map(of).filter(suits).collect())
    }
}

impl Drop for WindowSurface {
    fn drop(&mut self) {
        // SAFETY: the swapchain is dropped before, and the instance after.
        unsafe { self.calls.destroy_surface(self.raw, None) };
    }
}

impl Semaphore {
    fn new(gpu: &Gpu) -> Result<Self, GpuError> {
        // SAFETY: the device is alive.
        let raw = unsafe { gpu.raw().create_semaphore(&vk::SemaphoreCreateInfo::default(), None) };
        Ok(Self { gpu: gpu.clone(), raw: raw.map_err(GpuError::call("vkCreateSemaphore"))? })
    }

    fn at(&self, stages: vk::PipelineStageFlags2) -> vk::SemaphoreSubmitInfo<'static> {
        vk::SemaphoreSubmitInfo::default().semaphore(self.raw).stage_mask(stages)
    }
}

impl Drop for Semaphore {
    fn drop(&mut self) {
        // SAFETY: whoever drops it has waited for the queue.
        unsafe { self.gpu.raw().destroy_semaphore(self.raw, None) };
    }
}

impl Gpu {
    /// Opens a device that can show pictures in a window, and the window's surface. Without a device of choice it is the best accepted one that
    /// can.
    ///
    /// # Errors
    /// As [`Gpu::new`]; devices that cannot show pictures in the window are refused.
    pub fn with_surface<W>(options: &GpuOptions, window: Arc<W>) -> Result<(Self, Surface), GpuError>
    where
        W: HasDisplayHandle + HasWindowHandle + Send + Sync + 'static,
    {
        let missing = |error: raw_window_handle::HandleError| GpuError::NoDisplay { reason: error.to_string() };
        let handles = Handles {
            display: window.display_handle().map_err(missing)?.as_raw(),
            window: window.window_handle().map_err(missing)?.as_raw(),
        };
        let (gpu, surface) = Self::open(options, Some(handles))?;
        let none = || GpuError::NoDisplay { reason: "the window has no surface".to_owned() };
        let surface = surface.ok_or_else(none)?;
        let surface = Surface {
            swapchain: None,
            turns: Vec::new(),
            next: 0,
            offered: surface.formats(&gpu)?,
            window: surface,
            _handles: window,
            gpu: gpu.clone(),
            mode: PresentMode::default(),
            bits: 8,
        };
        Ok((gpu, surface))
    }
}

impl Surface {
    /// The modes that the display offers. The first is always [`PresentMode::Vsync`].
    ///
    /// # Errors
    /// A failed Vulkan call.
    pub fn modes(&self) -> Result<Vec<PresentMode>, GpuError> {
        let WindowSurface { calls, raw } = &self.window;
        // SAFETY: device and surface are of the same instance.
        let offered = unsafe { calls.get_physical_device_surface_present_modes(self.gpu.physical(), *raw) }
            .map_err(surface_error("vkGetPhysicalDeviceSurfacePresentModesKHR"))?;
        let is_offered = |mode: &PresentMode| *mode == PresentMode::Vsync || offered.contains(&mode.vulkan());
        Ok(PresentMode::ALL.into_iter().filter(is_offered).collect())
    }

    /// The mode that was set.
    #[must_use]
    pub fn mode(&self) -> PresentMode {
        self.mode
    }

    /// Sets the mode from the next picture on. One that the display does not offer becomes [`PresentMode::Vsync`].
    pub fn set_mode(&mut self, mode: PresentMode) {
        self.mode = mode;
    }

    /// Sets how many bits each colour has from the next picture on: 8, or 10 for display values that have more. Where the display does not offer
    /// that, it gets what it offers. Returns the format in which pictures can then be shown, in the size of the window.
    pub fn set_bits(&mut self, bits: u32) -> Format {
        self.bits = bits;
        match self.offer(bits) {
            Some(Offered { bits: 10, .. }) if self.gpu.blends(Format::A2Rgb10Unorm) => Format::A2Rgb10Unorm,
            _ => Format::Rgba8Unorm,
        }
    }

    /// The format that is taken where so many bits are wanted.
    fn offer(&self, bits: u32) -> Option<Offered> {
        self.offered.iter().find(|offered| offered.bits == bits).or(self.offered.first()).copied()
    }

    /// Shows an image in the window, scaled to it. The image holds display values, and a frame has left it to be copied from
    /// ([`Access::CopyRead`](crate::graph::Access::CopyRead)). The device does it after all work submitted so far.
    ///
    /// `size` is the window's size in pixels.
    ///
    /// # Errors
    /// [`GpuError::NoDisplay`] if the surface was lost, [`GpuError::DeviceLost`], and other failed Vulkan calls.
    pub fn present(&mut self, image: &Image, size: Extent) -> Result<Presented, GpuError> {
        if size.width == 0 || size.height == 0 {
            return Ok(Presented::Hidden);
        }
        // The window may change its size at any moment, so the swapchain may be outdated as soon as it was made.
        for _ in 0..3 {
            let format = self.offer(self.bits).map(|offered| offered.format);
            let fits = |s: &Swapchain| (s.extent, s.mode, Some(s.format.format)) == (size, self.mode, format);
            if !self.swapchain.as_ref().is_some_and(fits) && !self.renew(size)? {
                return Ok(Presented::Hidden);
            }
            match self.try_present(image)? {
                Some(presented) => return Ok(presented),
                None => self.retire()?,
            }
        }
        Ok(Presented::Late)
    }

    /// Waits until the display is done with all pictures, and frees the swapchain.
    fn retire(&mut self) -> Result<(), GpuError> {
        self.gpu.wait_for_presentation()?;
        self.swapchain = None;
        Ok(())
    }

    /// Makes a swapchain of this size. Returns whether the window has any pixels.
    fn renew(&mut self, size: Extent) -> Result<bool, GpuError> {
        self.gpu.wait_for_presentation()?;
        let old = self.swapchain.take();
        let none = || GpuError::NoDisplay { reason: "it has no format of 8 or 10 bits that copies reach".to_owned() };
        let format = self.offer(self.bits).ok_or_else(none)?;
        let modes = self.modes()?;
        self.mode = if modes.contains(&self.mode) { self.mode } else { PresentMode::Vsync };
        self.swapchain = Swapchain::new(&self.gpu, &self.window, size, (self.mode, format), old.as_ref())?;
        let Some(swapchain) = &self.swapchain else { return Ok(false) };
        while self.turns.len() < swapchain.images.len() {
            let acquired = Semaphore::new(&self.gpu)?;
            self.turns.push(Turn { acquired, encoder: CommandEncoder::new(&self.gpu, Queue::Graphics)?, last: None });
        }
        Ok(true)
    }

    /// `None` if the swapchain is outdated.
    fn try_present(&mut self, image: &Image) -> Result<Option<Presented>, GpuError> {
        let Some(swapchain) = &self.swapchain else { return Ok(None) };
        let at = self.next % self.turns.len();
        let turn = &mut self.turns[at];
        if let Some(last) = turn.last.take() {
            self.gpu.wait(last)?;
        }
        // SAFETY: the submission that waited for this semaphore last is done.
        let acquired = unsafe {
            swapchain.calls.acquire_next_image(swapchain.raw, PATIENCE, turn.acquired.raw, vk::Fence::null())
        };
        let (index, outdated) = match acquired {
            Ok((index, suboptimal)) => (index, suboptimal),
            Err(vk::Result::ERROR_OUT_OF_DATE_KHR) => return Ok(None),
            Err(vk::Result::TIMEOUT | vk::Result::NOT_READY) => return Ok(Some(Presented::Late)),
            Err(error) => return Err(surface_error("vkAcquireNextImageKHR")(error)),
        };
        self.next += 1;
        if !swapchain.format.scales && image.format() != Format::A2Rgb10Unorm {
            let reason = "its format of 10 bits takes only pictures of that format".to_owned();
            return Err(GpuError::NoDisplay { reason });
        }
        turn.encoder.begin()?;
        swapchain.copy(&turn.encoder, image, index);
        turn.encoder.finish()?;
        let ready = &swapchain.ready[index as usize];
        let wait = turn.acquired.at(COPIES);
        let signal = ready.at(vk::PipelineStageFlags2::ALL_COMMANDS);
        turn.last = Some(self.gpu.submit_for_display(&turn.encoder, wait, signal)?);
        let shown = swapchain.show(index)?;
        // A swapchain that only fits less well is replaced before the next picture.
        if outdated || !shown {
            self.retire()?;
        }
        Ok(Some(Presented::Shown))
    }
}

impl Drop for Surface {
    fn drop(&mut self) {
        // The display may still wait for the semaphores. A lost device waits for nothing.
        let _ = self.gpu.wait_for_presentation();
    }
}

impl Swapchain {
    /// `None` if the window has no pixels.
    fn new(
        gpu: &Gpu,
        window: &WindowSurface,
        size: Extent,
        (mode, format): (PresentMode, Offered),
        old: Option<&Self>,
    ) -> Result<Option<Self>, GpuError> {
        let WindowSurface { calls: of_surface, raw: surface } = window;
        let physical = gpu.physical();
        // SAFETY: device and surface are of the same instance.
        let capabilities = unsafe { of_surface.get_physical_device_surface_capabilities(physical, *surface) }
            .map_err(surface_error("vkGetPhysicalDeviceSurfaceCapabilitiesKHR"))?;
        // Where the window's size follows from the swapchain's, as under Wayland, it is not given.
        let given = capabilities.current_extent;
        let (least, most) = (capabilities.min_image_extent, capabilities.max_image_extent);
        let extent = if given.width == u32::MAX {
            vk::Extent2D {
                width: size.width.clamp(least.width, most.width.max(least.width)),
                height: size.height.clamp(least.height, most.height.max(least.height)),
            }
        } else {
            given
        };
        if extent.width == 0 || extent.height == 0 {
            return Ok(None);
        }
        let most_images = if capabilities.max_image_count == 0 { u32::MAX } else { capabilities.max_image_count };
        let opaque = vk::CompositeAlphaFlagsKHR::OPAQUE;
        let alpha = if capabilities.supported_composite_alpha.contains(opaque) {
            opaque
        } else {
            vk::CompositeAlphaFlagsKHR::INHERIT
        };
        let info = vk::SwapchainCreateInfoKHR::default()
            .surface(*surface)
            .min_image_count((capabilities.min_image_count + 1).min(most_images))
            .image_format(format.format)
            .image_color_space(vk::ColorSpaceKHR::SRGB_NONLINEAR)
            .image_extent(extent)
            .image_array_layers(1)
            .image_usage(vk::ImageUsageFlags::TRANSFER_DST)
            .image_sharing_mode(vk::SharingMode::EXCLUSIVE)
            .pre_transform(capabilities.current_transform)
            .composite_alpha(alpha)
            .present_mode(mode.vulkan())
            .clipped(true)
            .old_swapchain(old.map_or(vk::SwapchainKHR::null(), |old| old.raw));
        let calls = gpu.swapchain_calls();
        // SAFETY: `info` is within the capabilities of the surface.
        let raw = unsafe { calls.create_swapchain(&info, None) }.map_err(surface_error("vkCreateSwapchainKHR"))?;
        let mut made = Self {
            gpu: gpu.clone(),
            calls,
            raw,
            // The size that was asked for, so that it is not made anew where the window has another.
            extent: size,
            format,
            pixels: Extent::new(extent.width, extent.height),
            mode,
            images: Vec::new(),
            ready: Vec::new(),
        };
        // SAFETY: the swapchain was just made.
        made.images =
            unsafe { made.calls.get_swapchain_images(raw) }.map_err(surface_error("vkGetSwapchainImagesKHR"))?;
        made.ready = made.images.iter().map(|_| Semaphore::new(gpu)).collect::<Result<_, _>>()?;
        Ok(Some(made))
    }

    /// Records the copy of an image to one of the swapchain, scaled, between what was submitted before and what comes after.
    fn copy(&self, encoder: &CommandEncoder, image: &Image, index: u32) {
        let (device, target) = (self.gpu.raw(), self.images[index as usize]);
        let range = vk::ImageSubresourceRange {
            aspect_mask: vk::ImageAspectFlags::COLOR,
            level_count: 1,
            layer_count: 1,
            ..Default::default()
        };
        let of_target = vk::ImageMemoryBarrier2::default()
            .src_queue_family_index(vk::QUEUE_FAMILY_IGNORED)
            .dst_queue_family_index(vk::QUEUE_FAMILY_IGNORED)
            .image(target)
            .subresource_range(range);
        let (copies, everything) = (COPIES, vk::PipelineStageFlags2::ALL_COMMANDS);
        // The semaphore of the display is waited for by copies, so that this must be too.
        let before = [of_target
            .src_stage_mask(copies)
            .dst_stage_mask(copies)
            .dst_access_mask(vk::AccessFlags2::TRANSFER_WRITE)
            .old_layout(vk::ImageLayout::UNDEFINED)
            .new_layout(vk::ImageLayout::TRANSFER_DST_OPTIMAL)];
        let drawn = [vk::MemoryBarrier2::default()
            .src_stage_mask(everything)
            .src_access_mask(vk::AccessFlags2::MEMORY_WRITE)
            .dst_stage_mask(copies)
            .dst_access_mask(vk::AccessFlags2::TRANSFER_READ)];
        let after = [of_target
            .src_stage_mask(copies)
            .src_access_mask(vk::AccessFlags2::TRANSFER_WRITE)
            .dst_stage_mask(everything)
            .old_layout(vk::ImageLayout::TRANSFER_DST_OPTIMAL)
            .new_layout(vk::ImageLayout::PRESENT_SRC_KHR)];
        // The next frame draws into the same image.
        let read = [vk::MemoryBarrier2::default().src_stage_mask(copies).dst_stage_mask(everything)];
        let layer = vk::ImageSubresourceLayers {
            aspect_mask: vk::ImageAspectFlags::COLOR,
            layer_count: 1,
            ..Default::default()
        };
        let corner = |e: Extent| vk::Offset3D { x: e.width as i32, y: e.height as i32, z: 1 };
        let region = vk::ImageBlit2::default()
            .src_subresource(layer)
            .src_offsets([vk::Offset3D::default(), corner(image.extent())])
            .dst_subresource(layer)
            .dst_offsets([vk::Offset3D::default(), corner(self.pixels)]);
        let regions = [region];
        let blit = vk::BlitImageInfo2::default()
            .src_image(image.raw)
            .src_image_layout(vk::ImageLayout::TRANSFER_SRC_OPTIMAL)
            .dst_image(target)
            .dst_image_layout(vk::ImageLayout::TRANSFER_DST_OPTIMAL)
            .regions(&regions)
            .filter(if image.extent() == self.pixels { vk::Filter::NEAREST } else { vk::Filter::LINEAR });
        let whole = [vk::ImageCopy2::default().src_subresource(layer).dst_subresource(layer).extent(vk::Extent3D {
            width: self.pixels.width.min(image.extent().width),
            height: self.pixels.height.min(image.extent().height),
            depth: 1,
        })];
        let copy = vk::CopyImageInfo2::default()
            .src_image(image.raw)
            .src_image_layout(vk::ImageLayout::TRANSFER_SRC_OPTIMAL)
            .dst_image(target)
            .dst_image_layout(vk::ImageLayout::TRANSFER_DST_OPTIMAL)
            .regions(&whole);
        let (before, after) = (
            vk::DependencyInfo::default().memory_barriers(&drawn).image_memory_barriers(&before),
            vk::DependencyInfo::default().memory_barriers(&read).image_memory_barriers(&after),
        );
        encoder.depend(&before);
        // SAFETY: the command buffer is recording; both images are alive, in these layouts, and have these sizes.
        unsafe {
            if self.format.scales {
                device.cmd_blit_image2(encoder.raw(), &blit);
            } else {
                device.cmd_copy_image2(encoder.raw(), &copy);
            }
        }
        encoder.depend(&after);
    }

    /// Hands an image to the display. Returns whether the swapchain still fits the window.
    fn show(&self, index: u32) -> Result<bool, GpuError> {
        let (ready, chains, indices) = ([self.ready[index as usize].raw], [self.raw], [index]);
        let info = vk::PresentInfoKHR::default().wait_semaphores(&ready).swapchains(&chains).image_indices(&indices);
        let queue = lock(self.gpu.graphics_queue());
        // SAFETY: the queue is locked; the image was acquired, and its commands signal the semaphore.
        match unsafe { self.calls.queue_present(*queue, &info) } {
            Ok(suboptimal) => Ok(!suboptimal),
            Err(vk::Result::ERROR_OUT_OF_DATE_KHR) => Ok(false),
            Err(error) => Err(surface_error("vkQueuePresentKHR")(error)),
        }
    }
}

impl Drop for Swapchain {
    fn drop(&mut self) {
        // SAFETY: whoever drops it has waited for the queue.
        unsafe { self.calls.destroy_swapchain(self.raw, None) };
    }
}

/// The stages that bring a picture to the display.
const COPIES: vk::PipelineStageFlags2 =
    vk::PipelineStageFlags2::from_raw(vk::PipelineStageFlags2::BLIT.as_raw() | vk::PipelineStageFlags2::COPY.as_raw());

fn surface_error(call: &'static str) -> impl Fn(vk::Result) -> GpuError {
    move |result| match result {
        vk::Result::ERROR_SURFACE_LOST_KHR => GpuError::NoDisplay { reason: format!("{call}: the surface was lost") },
        other => GpuError::call(call)(other),
    }
}
