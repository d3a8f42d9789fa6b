//! The operating system, and what to install on it.

use std::fs;

/// Operating systems that differ in how a Vulkan driver is installed.
#[derive(Clone, Debug, PartialEq, Eq)]
pub enum System {
    /// Debian, Ubuntu and derivatives.
    Apt {
        /// Codename of the release that packages come from, such as `bookworm`; some releases have none.
        codename: Option<String>,
    },
    /// Fedora, RHEL and relatives.
    Fedora,
    /// Arch and relatives.
    Arch,
    /// openSUSE and SLES.
    Suse,
    /// Alpine.
    Alpine,
    /// macOS.
    Mac,
    /// Windows.
    Windows,
    /// Any other system, by name.
    Other(String),
}

impl System {
    /// The system that this program runs on.
    pub fn here() -> System {
        match std::env::consts::OS {
            "linux" => {
                let text =
                    ["/etc/os-release", "/usr/lib/os-release"].iter().find_map(|path| fs::read_to_string(path).ok());
                System::from_os_release(&text.unwrap_or_default())
            }
            "macos" => System::Mac,
            "windows" => System::Windows,
            other => System::Other(other.to_owned()),
        }
    }

    /// Parses an os-release file (os-release(5): shell assignments, one per line).
    pub fn from_os_release(text: &str) -> System {
        let value = |name: &str| {
            let line = text.lines().find_map(|line| line.trim().strip_prefix(name)?.strip_prefix('='))?;
            let value = line.trim().trim_matches(|c| c == '"' || c == '\'');
            (!value.is_empty()).then(|| value.to_owned())
        };
        let id = value("ID").unwrap_or_else(|| "linux".to_owned());
        let relatives = value("ID_LIKE").unwrap_or_default();
        for name in std::iter::once(id.as_str()).chain(relatives.split_whitespace()) {
            match name {
                "debian" | "ubuntu" => {
                    // A derivative has its own codename, and also names that of the packages it uses.
                    let names = ["DEBIAN_CODENAME", "UBUNTU_CODENAME", "VERSION_CODENAME"];
                    return System::Apt { codename: names.iter().find_map(|name| value(name)) };
                }
                "fedora" | "rhel" | "centos" => return System::Fedora,
                "arch" => return System::Arch,
                "suse" | "opensuse" | "opensuse-tumbleweed" | "opensuse-leap" | "sles" => return System::Suse,
                "alpine" => return System::Alpine,
                _ => {}
            }
        }
        System::Other(id)
    }

    /// Lines of advice on installing a Vulkan driver, for systems that are not set up automatically.
    pub fn device_advice(&self) -> Vec<String> {
        let lines: &[&str] = match self {
            System::Apt { .. } => &["sudo apt-get install libvulkan1 mesa-vulkan-drivers vulkan-validationlayers"],
            System::Fedora => &["sudo dnf install vulkan-loader mesa-vulkan-drivers vulkan-validation-layers"],
            System::Arch => &[
                "sudo pacman -S --needed vulkan-icd-loader vulkan-swrast vulkan-validation-layers",
                "with a graphics card also its driver: vulkan-radeon, vulkan-intel or nvidia-utils",
            ],
            System::Suse => &["sudo zypper install libvulkan1 libvulkan_lvp vulkan-validationlayers"],
            System::Alpine => &["sudo apk add vulkan-loader mesa-vulkan-swrast vulkan-validation-layers"],
            System::Mac => &[
                "the Vulkan SDK for macOS from LunarG (loader, MoltenVK, validation layers), or with Homebrew:",
                "brew install vulkan-loader molten-vk vulkan-validationlayers",
            ],
            System::Windows => &[
                "the newest driver of the graphics card from its maker: it brings the Vulkan loader",
                "for the tests also the Vulkan SDK for Windows from LunarG: it brings the validation layers",
                "without a graphics card: Mesa for Windows with its software driver lavapipe",
            ],
            System::Other(_) => &[
                "the Vulkan loader (libvulkan.so.1)",
                "a Vulkan 1.3 driver: that of the graphics card, or Mesa's software driver lavapipe, 24.1 or newer",
                "for the tests also the Khronos validation layers",
            ],
        };
        lines.iter().map(|&line| line.to_owned()).collect()
    }

    /// Advice on installing a C++ compiler.
    pub fn compiler_advice(&self) -> &'static str {
        match self {
            System::Apt { .. } => "sudo apt-get install g++",
            System::Fedora => "sudo dnf install gcc-c++",
            System::Arch => "sudo pacman -S --needed gcc",
            System::Suse => "sudo zypper install gcc-c++",
            System::Alpine => "sudo apk add g++",
            System::Mac => "xcode-select --install",
            System::Windows => "Visual Studio Build Tools with \"Desktop development with C++\"",
            System::Other(_) => "g++ or clang++",
        }
    }
}

#[cfg(test)]
mod tests {
    use super::*;

    fn apt(codename: &str) -> System {
        System::Apt { codename: Some(codename.to_owned()) }
    }

    #[test]
    fn systems_are_known_by_their_release_file() {
        let cases = [
            ("ID=debian\nVERSION_CODENAME=bookworm\n", apt("bookworm")),
            (
                "NAME=\"Ubuntu\"\nID=ubuntu\nID_LIKE=debian\nVERSION_CODENAME=noble\nUBUNTU_CODENAME=noble\n",
                apt("noble"),
            ),
            ("ID=linuxmint\nID_LIKE=\"ubuntu debian\"\nVERSION_CODENAME=wilma\nUBUNTU_CODENAME=noble\n", apt("noble")),
            ("ID=linuxmint\nID_LIKE=debian\nVERSION_CODENAME=faye\nDEBIAN_CODENAME=bookworm\n", apt("bookworm")),
            ("ID='debian'\nPRETTY_NAME='Debian sid'\n", System::Apt { codename: None }),
            ("ID=fedora\nVERSION_ID=42\n", System::Fedora),
            ("ID=\"rocky\"\nID_LIKE=\"rhel centos fedora\"\n", System::Fedora),
            ("ID=manjaro\nID_LIKE=arch\n", System::Arch),
            ("ID=\"opensuse-tumbleweed\"\nID_LIKE=\"opensuse suse\"\n", System::Suse),
            ("ID=alpine\n", System::Alpine),
            ("ID=nixos\n", System::Other("nixos".to_owned())),
            ("", System::Other("linux".to_owned())),
        ];
        for (text, system) in cases {
            assert_eq!(System::from_os_release(text), system, "{text}");
        }
    }

    #[test]
    fn every_system_is_told_of_a_driver_and_a_compiler() {
        use System::*;
        for system in [apt("x"), Fedora, Arch, Suse, Alpine, Mac, Windows, Other("plan9".to_owned())] {
            let advice = system.device_advice().join(" ").to_lowercase();
            assert!(advice.contains("vulkan") && advice.contains("validation"), "{system:?}: {advice}");
            assert!(!system.compiler_advice().is_empty());
        }
    }
}
