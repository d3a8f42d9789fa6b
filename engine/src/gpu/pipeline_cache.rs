//! The driver's pipeline cache on disk: one file per device and driver, under the user's cache folder.
use super::GpuError;
use ash::vk;
use std::path::{Path, PathBuf};
use std::sync::atomic::{AtomicU32, Ordering};
use std::{env, fs};

/// Creates the cache, with the data of an earlier run if it is from the same device and driver.
pub(super) fn open(
    device: &ash::Device,
    properties: &vk::PhysicalDeviceProperties,
) -> Result<(vk::PipelineCache, Option<PathBuf>), GpuError> {
    let file = folder().map(|folder| folder.join(file_name(properties)));
    let stored = file.as_deref().and_then(|f| fs::read(f).ok()).filter(|data| belongs(data, properties));
    let data = stored.unwrap_or_default();
    let info = vk::PipelineCacheCreateInfo::default().initial_data(&data);
    // SAFETY: the header was compared with this device; the driver checks the rest.
    let cache =
        unsafe { device.create_pipeline_cache(&info, None) }.map_err(GpuError::call("vkCreatePipelineCache"))?;
    Ok((cache, file))
}

/// Writes the cache to a temporary file and renames it, so that nobody reads half a file. Failure is logged, not an error.
pub(super) fn save(device: &ash::Device, cache: vk::PipelineCache, file: &Path) {
    // SAFETY: the cache is alive.
    let Ok(data) = (unsafe { device.get_pipeline_cache_data(cache) }) else { return };
    let written = (|| {
        fs::create_dir_all(file.parent().unwrap_or(Path::new(".")))?;
        // Unique per save, since two devices of one process may close at the same time.
        static SAVES: AtomicU32 = AtomicU32::new(0);
        let save = SAVES.fetch_add(1, Ordering::Relaxed);
        let temporary = file.with_extension(format!("{}-{save}.tmp", std::process::id()));
        let moved = fs::write(&temporary, data).and_then(|()| fs::rename(&temporary, file));
        if moved.is_err() {
            let _ = fs::remove_file(&temporary); // it may not exist
        }
        moved
    })();
    if let Err(e) = written {
        log::info!("the pipeline cache {} was not kept: {e}", file.display());
    }
}

/// `$MAGPIE_CACHE`, or else `magpie` in the user's cache folder.
fn folder() -> Option<PathBuf> {
    let from = |name: &str| env::var_os(name).filter(|v| !v.is_empty()).map(PathBuf::from);
    from("MAGPIE_CACHE")
        .or_else(|| from("XDG_CACHE_HOME").map(|p| p.join("magpie")))
        .or_else(|| from("LOCALAPPDATA").map(|p| p.join("magpie")))
        .or_else(|| from("HOME").map(|p| p.join(".cache/magpie")))
}

fn file_name(properties: &vk::PhysicalDeviceProperties) -> String {
    let uuid: String = properties.pipeline_cache_uuid.iter().map(|b| format!("{b:02x}")).collect();
    format!("pipelines-{:04x}-{:04x}-{uuid}.bin", properties.vendor_id, properties.device_id)
}

/// Whether the header (`VkPipelineCacheHeaderVersionOne`) names this device.
fn belongs(data: &[u8], properties: &vk::PhysicalDeviceProperties) -> bool {
    let word = |at: usize| data.get(at..at + 4).and_then(|b| b.try_into().ok()).map(u32::from_le_bytes);
    word(0).is_some_and(|length| length as usize >= 32)
        && word(4) == Some(vk::PipelineCacheHeaderVersion::ONE.as_raw() as u32)
        && word(8) == Some(properties.vendor_id)
        && word(12) == Some(properties.device_id)
        && data.get(16..32) == Some(&properties.pipeline_cache_uuid[..])
}

#[cfg(test)]
mod tests {
    use super::*;

    fn header(properties: &vk::PhysicalDeviceProperties) -> Vec<u8> {
        let mut data = Vec::new();
        for word in [32, 1, properties.vendor_id, properties.device_id] {
            data.extend_from_slice(&word.to_le_bytes());
        }
        data.extend_from_slice(&properties.pipeline_cache_uuid);
        data
    }

    #[test]
    fn only_a_cache_of_the_same_driver_is_taken() {
        let properties = vk::PhysicalDeviceProperties {
            vendor_id: 7,
            device_id: 9,
            pipeline_cache_uuid: [3; 16],
            ..Default::default()
        };
        let good = header(&properties);
        assert!(belongs(&good, &properties));
        for at in [0, 4, 8, 12, 20] {
            let mut bad = good.clone();
            bad[at] ^= 0x3f;
            assert!(!belongs(&bad, &properties), "byte {at} changed");
        }
        assert!(!belongs(&good[..31], &properties));
        assert!(!belongs(&[], &properties));
    }
}
