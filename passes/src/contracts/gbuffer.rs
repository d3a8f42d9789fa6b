//! The G-buffer: what the camera sees first. A channel is one entry of the table below, one field of the shaders'
//! [`GBufferImages`], and whatever writes it.
use crate::outputs::{COLOUR, DEPTH, DIRECTION, Gives, IDS, MATERIAL, NORMAL, RADIANCE};
use magpie::graph::{Format, Handle, Image, PassBuilder, Record, SampleToken};
use magpie_shaders::SampledImage;
use magpie_shaders::gbuffer::GBufferImages;

/// The image of a channel, or none.
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
        /// What the camera sees first, one value per pixel.
        #[derive(Clone, Copy, Debug)]
        pub struct GBuffer {
            $($(#[$about])* pub $field: $Image,)*
        }

        /// A channel of the G-buffer.
        #[derive(Clone, Copy, Debug, PartialEq, Eq)]
        pub enum Channel {
            $($(#[$about])* $Channel,)*
        }

        /// Channels of the G-buffer that a pass reads.
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
            /// Indices of the images for the shader; others than those that were declared read as black.
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
    /// Linear base colour; occlusion in alpha. RGBA8 with or without the sRGB curve, RGBA16F or RGBA32F.
    base_colour / BaseColour: Handle<Image>, COLOUR;
    /// Shading normal, octahedral, facing the viewer. RG16 signed normalised, RG16F or RG32F.
    normal / Normal: Handle<Image>, NORMAL;
    /// Geometric normal, in the same way.
    geometric_normal / GeometricNormal: Handle<Image>, NORMAL;
    /// Metalness in red, perceptual roughness in green; where materials of the scene have a specular reflectance of their own, that in blue
    /// and alpha (`lib/gbuffer_specular.glsl`). An image without the two means an index of refraction of 1.5. RG8, RG16F or RG32F; RGBA16
    /// signed normalised or RGBA32F.
    material / Material: Handle<Image>, MATERIAL;
    /// Emitted radiance; `None` if no material emits. RGBA16F or RGBA32F.
    emission / Emission: Option<Handle<Image>>, RADIANCE;
    /// Motion vectors: texture coordinates now minus one frame ago. RG16F or RG32F.
    motion / Motion: Handle<Image>, DIRECTION;
    /// Instance + 1 in red, triangle in green. RG32 unsigned.
    ids / Ids: Handle<Image>, IDS;
}

/// Position and both normals.
pub const GEOMETRY: &[Channel] = &[Channel::Depth, Channel::Normal, Channel::GeometricNormal];
/// Position, both normals and the triangle: where rays start.
pub const RAY_START: &[Channel] = &[Channel::Depth, Channel::Normal, Channel::GeometricNormal, Channel::Ids];
