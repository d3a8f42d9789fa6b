//! The Vulkan instance, and the messages of the validation layers.
use super::GpuError;
use ash::{ext, vk};
use raw_window_handle::RawDisplayHandle;
use std::ffi::{CStr, c_void};
use std::sync::Mutex;

const VALIDATION: &CStr = c"VK_LAYER_KHRONOS_validation";

/// Messages of the validation layers, in the order in which they came.
#[derive(Default)]
pub(super) struct Messages(Mutex<Vec<String>>);

impl Messages {
    pub(super) fn take(&self) -> Vec<String> {
        self.0.lock().map(|mut list| std::mem::take(&mut *list)).unwrap_or_default()
    }
}

/// A Vulkan instance. `messages` is boxed because the messenger holds its address.
pub(super) struct Instance {
    entry: ash::Entry,
    pub raw: ash::Instance,
    pub debug_utils: bool,
    messenger: Option<(ext::debug_utils::Instance, vk::DebugUtilsMessengerEXT)>,
    pub messages: Box<Messages>,
    /// Whether it is destroyed when this is dropped.
    is_own: bool,
}

impl Instance {
    /// Creates an instance. `validation` enables the Khronos layer and synchronization validation; the layer must be installed. With a `display`
    /// the instance can make surfaces for its windows.
    pub fn new(validation: bool, display: Option<RawDisplayHandle>) -> Result<Self, GpuError> {
        // SAFETY: the loader is the system's own library; it stays loaded as long as `entry` lives.
        let entry = unsafe { ash::Entry::load() }.map_err(|e| GpuError::NoLoader { reason: e.to_string() })?;
        let version = {
            // SAFETY: the entry was loaded above.
            let found = unsafe { entry.try_enumerate_instance_version() };
            found.map_err(GpuError::call("vkEnumerateInstanceVersion"))?.unwrap_or(vk::API_VERSION_1_0)
        };
        if version < vk::API_VERSION_1_3 {
            let (major, minor) = (vk::api_version_major(version), vk::api_version_minor(version));
            return Err(GpuError::NoLoader { reason: format!("it speaks Vulkan {major}.{minor}, 1.3 is needed") });
        }

        // Check layers and extensions.
        // SAFETY: plain enumeration calls on a loaded entry.
        let layers = unsafe { entry.enumerate_instance_layer_properties() }
            .map_err(GpuError::call("vkEnumerateInstanceLayerProperties"))?;
        let has_layer = layers.iter().any(|l| l.layer_name_as_c_str().is_ok_and(|n| n == VALIDATION));
        if validation && !has_layer {
            return Err(GpuError::MissingLayer { name: "VK_LAYER_KHRONOS_validation" });
        }
        // SAFETY: as above.
        let available = unsafe { entry.enumerate_instance_extension_properties(None) }
            .map_err(GpuError::call("vkEnumerateInstanceExtensionProperties"))?;
        let debug_utils =
            available.iter().any(|e| e.extension_name_as_c_str().is_ok_and(|n| n == ext::debug_utils::NAME));

        if validation && !debug_utils {
            let needed_for = "without it the validation layers' messages go unheard";
            return Err(GpuError::MissingExtension { name: "VK_EXT_debug_utils", needed_for });
        }

        let mut extensions = Vec::new();
        if debug_utils {
            extensions.push(ext::debug_utils::NAME.as_ptr());
        }
        if let Some(display) = display {
            let wanted = ash_window::enumerate_required_extensions(display)
                .map_err(|error| GpuError::NoDisplay { reason: format!("no surface for its windows ({error})") })?;
            for &name in wanted {
                // SAFETY: these are the names of extensions, which are static.
                let text = unsafe { CStr::from_ptr(name) };
                if !available.iter().any(|e| e.extension_name_as_c_str().is_ok_and(|n| n == text)) {
                    let reason = format!("no Vulkan driver here has the extension {}", text.to_string_lossy());
                    return Err(GpuError::NoDisplay { reason });
                }
                extensions.push(name);
            }
        }
        let mut enabled_layers = Vec::new();
        let checks = [vk::ValidationFeatureEnableEXT::SYNCHRONIZATION_VALIDATION];
        let mut features = vk::ValidationFeaturesEXT::default().enabled_validation_features(&checks);
        let application = vk::ApplicationInfo::default()
            .application_name(c"magpie")
            .engine_name(c"magpie")
            .api_version(vk::API_VERSION_1_3);
        let mut info = vk::InstanceCreateInfo::default().application_info(&application);
        if validation {
            enabled_layers.push(VALIDATION.as_ptr());
            extensions.push(ext::validation_features::NAME.as_ptr());
            info = info.push_next(&mut features);
        }
        let info = info.enabled_layer_names(&enabled_layers).enabled_extension_names(&extensions);
        // SAFETY: every pointer in `info` outlives the call.
        let raw = unsafe { entry.create_instance(&info, None) }.map_err(|result| match result {
            vk::Result::ERROR_INCOMPATIBLE_DRIVER => GpuError::NoDevice { refusals: Vec::new() }, // no driver at all
            other => GpuError::call("vkCreateInstance")(other),
        })?;

        // From here on it is destroyed if anything fails.
        let mut made = Self { entry, raw, debug_utils, messenger: None, messages: Box::default(), is_own: true };
        made.listen_if(validation)?;
        Ok(made)
    }

    /// The instance of an application, which is not destroyed here.
    pub fn adopt(
        entry: &ash::Entry,
        raw: &ash::Instance,
        debug_utils: bool,
        validation: bool,
    ) -> Result<Self, GpuError> {
        let (entry, raw) = (entry.clone(), raw.clone());
        let mut made = Self { entry, raw, debug_utils, messenger: None, messages: Box::default(), is_own: false };
        made.listen_if(validation)?;
        Ok(made)
    }

    fn listen_if(&mut self, validation: bool) -> Result<(), GpuError> {
        self.messenger = validation.then(|| listen(&self.entry, &self.raw, &self.messages)).transpose()?;
        Ok(())
    }

    /// The functions of the loader.
    pub fn entry(&self) -> &ash::Entry {
        &self.entry
    }
}

impl Drop for Instance {
    fn drop(&mut self) {
        // SAFETY: the device that was made from this instance is gone: `Gpu` drops it first.
        unsafe {
            if let Some((api, messenger)) = &self.messenger {
                api.destroy_debug_utils_messenger(*messenger, None);
            }
            if self.is_own {
                self.raw.destroy_instance(None);
            }
        }
    }
}

fn listen(
    entry: &ash::Entry,
    raw: &ash::Instance,
    messages: &Messages,
) -> Result<(ext::debug_utils::Instance, vk::DebugUtilsMessengerEXT), GpuError> {
    let api = ext::debug_utils::Instance::new(entry, raw);
    let info = vk::DebugUtilsMessengerCreateInfoEXT::default()
        .message_severity(vk::DebugUtilsMessageSeverityFlagsEXT::ERROR | vk::DebugUtilsMessageSeverityFlagsEXT::WARNING)
        .message_type(vk::DebugUtilsMessageTypeFlagsEXT::VALIDATION)
        .pfn_user_callback(Some(on_message))
        .user_data(std::ptr::from_ref(messages).cast_mut().cast());
    // SAFETY: `messages` is boxed by the caller and outlives the messenger, which `Instance::drop` destroys first.
    let messenger = unsafe { api.create_debug_utils_messenger(&info, None) }
        .map_err(GpuError::call("vkCreateDebugUtilsMessengerEXT"))?;
    Ok((api, messenger))
}

unsafe extern "system" fn on_message(
    _: vk::DebugUtilsMessageSeverityFlagsEXT,
    _: vk::DebugUtilsMessageTypeFlagsEXT,
    data: *const vk::DebugUtilsMessengerCallbackDataEXT<'_>,
    user: *mut c_void,
) -> vk::Bool32 {
    // SAFETY: the layer hands valid callback data; `user` is the `Messages` given to `listen`.
    let (text, messages) = unsafe {
        let message = (*data).p_message;
        let text =
            if message.is_null() { String::new() } else { CStr::from_ptr(message).to_string_lossy().into_owned() };
        (text, &*user.cast::<Messages>())
    };
    log::error!("validation: {text}");
    if let Ok(mut list) = messages.0.lock() {
        list.push(text);
    }
    vk::FALSE
}
