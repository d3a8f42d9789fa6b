//! The G-buffer: the surface that the camera sees first in each pixel. To add a channel, add an entry to the table below, a field of the same
//! name to the shaders' [`GBufferImages`], and code that writes it.
use crate::outputs::{COAT, COLOUR, DEPTH, DIRECTION, Gives, IDS, MATERIAL, NORMAL, RADIANCE};
use magpie::graph::{Format, Handle, Image, PassBuilder, Record, SampleToken};
use magpie_shaders::SampledImage;
use magpie_shaders::gbuffer::GBufferImages;

/// A field of [`GBuffer`]: an image, or an image that may be absent.
trait Channelled: Copy {
    fn image(self) -> Option<Handle<Image>>;
}

impl Channelled for Handle<Image> {
    fn image(self) -> Option<Handle<Image>> {
        Some(self)
    }
}

impl Channelled for Option<Handle<Image>> {
    fn image(self) -> Option<Handle<Image>> {
        self
    }
}

macro_rules! channels {
    ($($(#[$about:meta])* $field:ident / $Channel:ident: $Image:ty, $formats:expr;)*) => {
        /// Images of the surface that the camera sees first in each pixel.
        #[derive(Clone, Copy, Debug)]
        pub struct GBuffer {
            $($(#[$about])* pub $field: $Image,)*
        }

        /// A channel of the G-buffer.
        #[derive(Clone, Copy, Debug, PartialEq, Eq)]
        pub enum Channel {
            $($(#[$about])* $Channel,)*
        }

        /// The channels of the G-buffer that a pass reads.
        #[derive(Clone, Copy, Debug)]
        pub struct GBufferToken {
            $($field: Option<SampleToken>,)*
        }

        impl GBuffer {
            /// Declares that a pass reads these channels.
            pub fn read(self, p: &mut PassBuilder<'_>, channels: &[Channel]) -> GBufferToken {
                let mut sample = |channel, image: Option<Handle<Image>>| {
                    image.filter(|_| channels.contains(&channel)).map(|image| p.sample(image))
                };
                GBufferToken { $($field: sample(Channel::$Channel, self.$field.image()),)* }
            }
        }

        impl GBufferToken {
            /// Indices of the images for the shader. Channels that the pass did not declare read as black.
            pub fn images(self, c: &Record<'_>) -> GBufferImages {
                let index = |token: Option<SampleToken>| token.map_or(SampledImage::default(), |token| c.id(token));
                GBufferImages { $($field: index(self.$field),)* }
            }
        }

        impl Gives for GBuffer {
            const SHOWN: bool = false;

            fn images(&self) -> Vec<(&'static str, Handle<Image>, &'static [Format])> {
                let named = |name, image: Option<Handle<Image>>, formats| Some((name, image?, formats));
                [$(named(stringify!($field), self.$field.image(), $formats),)*].into_iter().flatten().collect()
            }
        }
    };
}

channels! {
    /// Reversed depth: 1 at the near plane, 0 where nothing was drawn. D32F.
    depth / Depth: Handle<Image>, DEPTH;
    /// Linear base colour; occlusion map in alpha, 1 is open. 0 in all channels on the background. RGBA8 sRGB, RGBA8 unorm, RGBA16F or RGBA32F.
    base_colour / BaseColour: Handle<Image>, COLOUR;
    /// Shading normal in world space, octahedral, facing the viewer. RG16 snorm, RG16F or RG32F.
    normal / Normal: Handle<Image>, NORMAL;
    /// Geometric normal, in the same encoding and formats.
    geometric_normal / GeometricNormal: Handle<Image>, NORMAL;
    /// Metalness in red and perceptual roughness in green, 0 to 1: RG8 unorm, RG16F or RG32F. If materials of the scene set the specular
    /// reflectance of their dielectric part, it is in blue and alpha, encoded as in `lib/gbuffer_specular.glsl`: RGBA16 snorm or RGBA32F. Images
    /// of two channels stand for an index of refraction of 1.5.
    material / Material: Handle<Image>, MATERIAL;
    /// Clear coat: strength in red and perceptual roughness in green, 0 to 1; `None` if no material has one. RG8 unorm, RG16F or RG32F.
    coat / Coat: Option<Handle<Image>>, COAT;
    /// Emitted radiance; `None` if no material emits. RGBA16F or RGBA32F.
    emission / Emission: Option<Handle<Image>>, RADIANCE;
    /// Motion vectors: uv in this frame minus uv in the previous one, without jitter. RG16F or RG32F.
    motion / Motion: Handle<Image>, DIRECTION;
    /// Index of the instance + 1 in red, index of the triangle or sphere in green; 0 in red is background. RG32 uint.
    ids / Ids: Handle<Image>, IDS;
}

/// Channels for position and both normals.
pub const GEOMETRY: &[Channel] = &[Channel::Depth, Channel::Normal, Channel::GeometricNormal];
/// Channels from which origins of rays are computed: depth, both normals and ids.
pub const RAY_START: &[Channel] = &[Channel::Depth, Channel::Normal, Channel::GeometricNormal, Channel::Ids];
