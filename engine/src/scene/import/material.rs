//! Reads materials and samplers, and collects the images that they need, with their colour spaces.
use super::layers::Layers;
use super::{Import, Of, label, refer};
use crate::scene::error::Fault;
use crate::scene::{AlphaMode, ColourSpace, Material, Sampler, TextureUse, Wrap};
use glam::{Vec3, Vec4};
use gltf::json;
use json::extensions::texture::TextureTransform;
use json::material::AlphaMode as JsonAlpha;
use json::texture::{MagFilter, MinFilter, WrappingMode};
use json::validation::Checked;
use std::collections::HashMap;

/// An image in a colour space, which becomes one texture.
pub(super) struct Request {
    pub image: usize,
    pub colour_space: ColourSpace,
}

/// All materials of the file. `requests[i]` becomes texture `i`.
#[derive(Default)]
pub(super) struct Materials {
    pub materials: Vec<Material>,
    pub samplers: Vec<Sampler>,
    pub requests: Vec<Request>,
}

/// Identifies the bytes of an image, so that images with the same bytes become one texture.
#[derive(PartialEq, Eq, Hash)]
enum Source<'a> {
    Uri(&'a str),
    View(usize),
    None(usize),
}

struct Reader<'a> {
    root: &'a json::Root,
    out: Materials,
    textures: HashMap<(Source<'a>, ColourSpace), u32>,
    samplers: HashMap<Sampler, u32>,
    notices: &'a mut Vec<String>,
}

/// A reference to a texture, from any of the three structs that glTF has for it.
pub(super) struct Slot<'a> {
    element: &'static str,
    texture: usize,
    uv_set: u32,
    transform: Option<&'a TextureTransform>,
    colour_space: ColourSpace,
}

impl<'a> Slot<'a> {
    /// A reference through the plain struct.
    pub fn of(element: &'static str, info: Option<&'a json::texture::Info>, colour_space: ColourSpace) -> Option<Self> {
        info.map(|info| Self {
            element,
            texture: info.index.value(),
            uv_set: info.tex_coord,
            transform: info.extensions.as_ref().and_then(|e| e.texture_transform.as_ref()),
            colour_space,
        })
    }
}

pub(super) fn read(root: &json::Root, notices: &mut Vec<String>) -> Import<Materials> {
    let mut reader =
        Reader { root, out: Materials::default(), textures: HashMap::new(), samplers: HashMap::new(), notices };
    let (mut blended, mut transmitting) = (Vec::new(), Vec::new());
    for (i, material) in root.materials.iter().enumerate() {
        let read = reader.material(i, material)?;
        if read.alpha == AlphaMode::Blend {
            blended.push(read.name.clone());
        }
        if read.transmission > 0.0 {
            transmitting.push(read.name.clone());
        }
        reader.out.materials.push(read);
    }
    let out = reader.out;
    for (names, notice) in [
        (
            blended,
            "blended materials are drawn alpha-tested at 0.5 until there is a transparency stage (the reference blends)",
        ),
        (
            transmitting,
            "materials with transmission are drawn opaque until there is a transparency stage (not by the reference)",
        ),
    ] {
        if !names.is_empty() {
            notices.push(format!("{notice}: {}", names.join(", ")));
        }
    }
    Ok(out)
}

/// A factor, clamped to 0 to 1 with a notice.
pub(super) fn unit(value: f32, what: &'static str, name: &str, notices: &mut Vec<String>) -> Result<f32, Fault> {
    let value = finite(value, what)?;
    if !(0.0..=1.0).contains(&value) {
        notices.push(format!("material {name}: {what} {value} lies outside 0 to 1: moved in"));
    }
    Ok(value.clamp(0.0, 1.0))
}

pub(super) fn finite(value: f32, what: &'static str) -> Result<f32, Fault> {
    if value.is_finite() {
        Ok(value)
    } else {
        Err(Fault::Value { what, got: value.to_string(), wanted: "a finite number" })
    }
}

impl<'a> Reader<'a> {
    fn material(&mut self, index: usize, from: &'a json::Material) -> Import<Material> {
        let element = || format!("material {index}");
        let name = label(from.name.as_deref(), element);
        let pbr = &from.pbr_metallic_roughness;
        let extensions = from.extensions.as_ref();

        let mut base_colour = pbr.base_color_factor.0;
        for c in &mut base_colour {
            *c = unit(*c, "baseColorFactor", &name, self.notices).of(element)?;
        }
        let metalness = unit(pbr.metallic_factor.0, "metallicFactor", &name, self.notices).of(element)?;
        let roughness = unit(pbr.roughness_factor.0, "roughnessFactor", &name, self.notices).of(element)?;
        let strength = extensions.and_then(|e| e.emissive_strength.as_ref()).map_or(1.0, |s| s.emissive_strength.0);
        let emission = Vec3::from(from.emissive_factor.0) * strength;
        if !(emission.is_finite() && emission.min_element() >= 0.0) {
            let (what, wanted) = ("emission", "finite numbers of at least 0");
            return Err(Fault::Value { what, got: emission.to_string(), wanted }).of(element);
        }
        let alpha = match from.alpha_mode {
            Checked::Valid(JsonAlpha::Opaque) => AlphaMode::Opaque,
            Checked::Valid(JsonAlpha::Mask) => {
                let cutoff = from.alpha_cutoff.map_or(0.5, |c| c.0);
                AlphaMode::Mask(finite(cutoff, "alphaCutoff").of(element)?)
            }
            Checked::Valid(JsonAlpha::Blend) => AlphaMode::Blend,
            Checked::Invalid => {
                let (got, wanted) = ("unknown".to_owned(), "OPAQUE, MASK or BLEND");
                return Err(Fault::Value { what: "alphaMode", got, wanted }).of(element);
            }
        };

        // The `gltf` crate has no typed KHR_texture_transform for these two.
        let normal_transform = from
            .normal_texture
            .as_ref()
            .and_then(|t| transform(t.extensions.as_ref().map(|e| &e.others)))
            .transpose()
            .of(|| format!("material {index} normalTexture"))?;
        let occlusion_transform = from
            .occlusion_texture
            .as_ref()
            .and_then(|t| transform(t.extensions.as_ref().map(|e| &e.others)))
            .transpose()
            .of(|| format!("material {index} occlusionTexture"))?;
        let normal = from.normal_texture.as_ref().map(|t| Slot {
            element: "normalTexture",
            texture: t.index.value(),
            uv_set: t.tex_coord,
            transform: normal_transform.as_ref(),
            colour_space: ColourSpace::Linear,
        });
        let occlusion = from.occlusion_texture.as_ref().map(|t| Slot {
            element: "occlusionTexture",
            texture: t.index.value(),
            uv_set: t.tex_coord,
            transform: occlusion_transform.as_ref(),
            colour_space: ColourSpace::Linear,
        });
        let base = Slot::of("baseColorTexture", pbr.base_color_texture.as_ref(), ColourSpace::Srgb);
        let rough = Slot::of("metallicRoughnessTexture", pbr.metallic_roughness_texture.as_ref(), ColourSpace::Linear);
        let emissive = Slot::of("emissiveTexture", from.emissive_texture.as_ref(), ColourSpace::Srgb);
        let layers = Layers::read(extensions, &name, self.notices).of(element)?;
        let occlusion_strength = from.occlusion_texture.as_ref().map_or(1.0, |t| t.strength.0);
        let normal_scale = from.normal_texture.as_ref().map_or(1.0, |t| t.scale);
        Ok(Material {
            base_colour: Vec4::from(base_colour),
            metalness,
            roughness,
            emission,
            normal_scale: finite(normal_scale, "normalTexture scale").of(element)?,
            occlusion_strength: unit(occlusion_strength, "occlusionTexture strength", &name, self.notices)
                .of(element)?,
            alpha,
            double_sided: from.double_sided,
            unlit: extensions.is_some_and(|e| e.unlit.is_some()),
            base_colour_texture: self.slot(index, base)?,
            metallic_roughness_texture: self.slot(index, rough)?,
            normal_texture: self.slot(index, normal)?,
            occlusion_texture: self.slot(index, occlusion)?,
            emission_texture: self.slot(index, emissive)?,
            shows_light: false,
            transmission: layers.transmission,
            ior: layers.ior,
            specular: layers.specular,
            specular_colour: layers.specular_colour,
            thickness: layers.thickness,
            attenuation_colour: layers.attenuation_colour,
            attenuation_distance: layers.attenuation_distance,
            clearcoat: layers.clearcoat.factor,
            clearcoat_roughness: layers.clearcoat.roughness,
            specular_texture: self.slot(index, layers.specular_slot())?,
            specular_colour_texture: self.slot(index, layers.specular_colour_slot())?,
            transmission_texture: self.slot(index, layers.transmission_slot())?,
            clearcoat_texture: self.slot(index, layers.clearcoat.slot())?,
            clearcoat_roughness_texture: self.slot(index, layers.clearcoat.roughness_slot())?,
            name,
        })
    }

    fn slot(&mut self, material: usize, slot: Option<Slot<'_>>) -> Import<Option<TextureUse>> {
        let Some(slot) = slot else { return Ok(None) };
        let element = || format!("material {material} {}", slot.element);
        let root = self.root;
        let texture = refer(&root.textures, slot.texture, "texture").of(element)?;
        // The parser uses this index for a texture whose source is in an extension.
        if texture.source.value() == u32::MAX as usize {
            self.notices.push(format!("texture {} has no PNG or JPEG image: ignored", slot.texture));
            return Ok(None);
        }
        let image = texture.source.value();
        let of_texture = || format!("texture {}", slot.texture);
        let from = refer(&root.images, image, "image").of(of_texture)?;
        let source = match (&from.uri, from.buffer_view) {
            (Some(uri), _) => Source::Uri(uri),
            (None, Some(view)) => Source::View(view.value()),
            (None, None) => Source::None(image),
        };
        let requests = &mut self.out.requests;
        let texture_index = *self.textures.entry((source, slot.colour_space)).or_insert_with(|| {
            requests.push(Request { image, colour_space: slot.colour_space });
            requests.len() as u32 - 1
        });

        let sampler = match texture.sampler {
            Some(s) => {
                let s = s.value();
                sampler(refer(&root.samplers, s, "sampler").of(of_texture)?).of(|| format!("sampler {s}"))?
            }
            None => Sampler::default(),
        };
        let samplers = &mut self.out.samplers;
        let sampler_index = *self.samplers.entry(sampler).or_insert_with(|| {
            samplers.push(sampler);
            samplers.len() as u32 - 1
        });

        let mut uv_set = slot.transform.and_then(|t| t.tex_coord).unwrap_or(slot.uv_set);
        if uv_set > 1 {
            self.notices.push(format!("{}: TEXCOORD_{uv_set} is not supported: TEXCOORD_0 is used", element()));
            uv_set = 0;
        }
        let rows = slot.transform.map_or([Vec3::X, Vec3::Y], rows);
        if !rows.iter().all(|r| r.is_finite()) {
            let (what, wanted) = ("KHR_texture_transform", "finite numbers");
            return Err(Fault::Value { what, got: format!("{rows:?}"), wanted }).of(element);
        }
        Ok(Some(TextureUse { texture: texture_index, sampler: sampler_index, uv_set, rows }))
    }
}

/// Reads KHR_texture_transform of a struct whose extensions are not typed.
fn transform(others: Option<&serde_json::Map<String, json::Value>>) -> Option<Result<TextureTransform, Fault>> {
    let value = others?.get("KHR_texture_transform")?;
    Some(json::deserialize::from_value(value.clone()).map_err(|e| Fault::Value {
        what: "KHR_texture_transform",
        got: e.to_string(),
        wanted: "offset, rotation, scale and texCoord",
    }))
}

/// Offset * rotation * scale. The rotation is counter-clockwise in the image, where v points down.
fn rows(t: &TextureTransform) -> [Vec3; 2] {
    let ([ox, oy], [sx, sy], (s, c)) = (t.offset.0, t.scale.0, t.rotation.0.sin_cos());
    [Vec3::new(c * sx, s * sy, ox), Vec3::new(-s * sx, c * sy, oy)]
}

fn sampler(from: &json::texture::Sampler) -> Result<Sampler, Fault> {
    let unknown = |what| Fault::Value { what, got: "unknown".to_owned(), wanted: "one of glTF's constants" };
    let wrap = |mode: Checked<WrappingMode>, what| match mode {
        Checked::Valid(WrappingMode::Repeat) => Ok(Wrap::Repeat),
        Checked::Valid(WrappingMode::MirroredRepeat) => Ok(Wrap::Mirror),
        Checked::Valid(WrappingMode::ClampToEdge) => Ok(Wrap::Clamp),
        Checked::Invalid => Err(unknown(what)),
    };
    let linear_magnify = match from.mag_filter {
        None | Some(Checked::Valid(MagFilter::Linear)) => true,
        Some(Checked::Valid(MagFilter::Nearest)) => false,
        Some(Checked::Invalid) => return Err(unknown("magFilter")),
    };
    let (linear_minify, linear_mips, mips) = match from.min_filter {
        None | Some(Checked::Valid(MinFilter::LinearMipmapLinear)) => (true, true, true),
        Some(Checked::Valid(MinFilter::LinearMipmapNearest)) => (true, false, true),
        Some(Checked::Valid(MinFilter::NearestMipmapLinear)) => (false, true, true),
        Some(Checked::Valid(MinFilter::NearestMipmapNearest)) => (false, false, true),
        Some(Checked::Valid(MinFilter::Linear)) => (true, false, false),
        Some(Checked::Valid(MinFilter::Nearest)) => (false, false, false),
        Some(Checked::Invalid) => return Err(unknown("minFilter")),
    };
    let wrap = [wrap(from.wrap_s, "wrapS")?, wrap(from.wrap_t, "wrapT")?];
    Ok(Sampler { wrap, linear_magnify, linear_minify, linear_mips, mips })
}

#[cfg(test)]
mod tests {
    use super::*;
    use json::extensions::texture::{TextureTransformOffset, TextureTransformRotation, TextureTransformScale};

    #[test]
    fn texture_transforms_scale_turn_and_move() {
        let t = TextureTransform {
            offset: TextureTransformOffset([0.1, 0.2]),
            rotation: TextureTransformRotation(std::f32::consts::FRAC_PI_2),
            scale: TextureTransformScale([2.0, 3.0]),
            ..Default::default()
        };
        let [u, v] = rows(&t);
        let at = |x: f32, y: f32| [u.dot(Vec3::new(x, y, 1.0)), v.dot(Vec3::new(x, y, 1.0))];
        // A quarter turn counter-clockwise maps u (right) to -v (up).
        for (got, wanted) in [(at(0.0, 0.0), [0.1, 0.2]), (at(1.0, 0.0), [0.1, -1.8]), (at(0.0, 1.0), [3.1, 0.2])] {
            assert!((got[0] - wanted[0]).abs() < 1e-5 && (got[1] - wanted[1]).abs() < 1e-5, "{got:?} {wanted:?}");
        }
    }
}
