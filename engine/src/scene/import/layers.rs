//! Material extensions around the base surface: KHR_materials_transmission, ior, specular, volume and clearcoat.
use super::material::{Slot, finite, unit};
use crate::scene::error::Fault;
use crate::scene::{ColourSpace, Material};
use glam::Vec3;
use gltf::json;
use json::extensions::material::{Material as Extensions, Specular, Volume};
use json::texture::Info;
use serde::Deserialize;

/// The `gltf` crate has no type for this extension.
pub(super) const CLEARCOAT: &str = "KHR_materials_clearcoat";

/// Factors, clamped to their ranges, and the textures that multiply them.
pub(super) struct Layers<'a> {
    pub transmission: f32,
    pub ior: f32,
    pub specular: f32,
    pub specular_colour: Vec3,
    pub thickness: f32,
    pub attenuation_colour: Vec3,
    pub attenuation_distance: f32,
    pub clearcoat: Clearcoat,
    specular_texture: Option<&'a Info>,
    specular_colour_texture: Option<&'a Info>,
    transmission_texture: Option<&'a Info>,
}

/// KHR_materials_clearcoat as in the file.
#[derive(Default, Deserialize)]
#[serde(default)]
pub(super) struct Clearcoat {
    #[serde(rename = "clearcoatFactor")]
    pub factor: f32,
    #[serde(rename = "clearcoatRoughnessFactor")]
    pub roughness: f32,
    #[serde(rename = "clearcoatTexture")]
    texture: Option<Info>,
    #[serde(rename = "clearcoatRoughnessTexture")]
    roughness_texture: Option<Info>,
    #[serde(rename = "clearcoatNormalTexture")]
    normal_texture: Option<json::Value>,
}

impl<'a> Layers<'a> {
    /// Reads the five extensions of a material; for missing ones, the default values of glTF.
    pub fn read(from: Option<&'a Extensions>, name: &str, notices: &mut Vec<String>) -> Result<Self, Fault> {
        let none = Material::default();
        let mut layers = Self {
            transmission: none.transmission,
            ior: none.ior,
            specular: none.specular,
            specular_colour: none.specular_colour,
            thickness: none.thickness,
            attenuation_colour: none.attenuation_colour,
            attenuation_distance: none.attenuation_distance,
            clearcoat: Clearcoat::default(),
            specular_texture: None,
            specular_colour_texture: None,
            transmission_texture: None,
        };
        let Some(from) = from else { return Ok(layers) };
        if let Some(t) = &from.transmission {
            layers.transmission = unit(t.transmission_factor.0, "transmissionFactor", name, notices)?;
            layers.transmission_texture = t.transmission_texture.as_ref();
        }
        if let Some(i) = &from.ior {
            layers.ior = ior(i.ior.0, name, notices)?;
        }
        if let Some(s) = &from.specular {
            layers.specular(s, name, notices)?;
        }
        if let Some(v) = &from.volume {
            layers.volume(v, name, notices)?;
        }
        if let Some(value) = from.others.get(CLEARCOAT) {
            layers.clearcoat = Clearcoat::read(value, name, notices)?;
        }
        Ok(layers)
    }

    fn specular(&mut self, from: &'a Specular, name: &str, notices: &mut Vec<String>) -> Result<(), Fault> {
        self.specular = unit(from.specular_factor.0, "specularFactor", name, notices)?;
        // Colours above white are allowed; shaders limit the resulting reflectance to 1.
        for (to, c) in self.specular_colour.as_mut().iter_mut().zip(from.specular_color_factor.0) {
            let value = finite(c, "specularColorFactor")?;
            if value < 0.0 {
                notices.push(format!("material {name}: specularColorFactor {value} is below 0: 0 is used"));
            }
            *to = value.max(0.0);
        }
        self.specular_texture = from.specular_texture.as_ref();
        self.specular_colour_texture = from.specular_color_texture.as_ref();
        Ok(())
    }

    fn volume(&mut self, from: &Volume, name: &str, notices: &mut Vec<String>) -> Result<(), Fault> {
        let thickness = finite(from.thickness_factor.0, "thicknessFactor")?;
        if thickness < 0.0 {
            notices.push(format!("material {name}: thicknessFactor {thickness} is below 0: 0 is used"));
        }
        self.thickness = thickness.max(0.0);
        for (to, c) in self.attenuation_colour.as_mut().iter_mut().zip(from.attenuation_color.0) {
            *to = unit(c, "attenuationColor", name, notices)?;
        }
        // An infinite distance means no attenuation, as does a missing one.
        let distance = from.attenuation_distance.0;
        if distance.is_nan() || distance <= 0.0 {
            let (what, wanted) = ("attenuationDistance", "a number above 0");
            return Err(Fault::Value { what, got: distance.to_string(), wanted });
        }
        self.attenuation_distance = distance;
        if from.thickness_texture.is_some() {
            notices.push(format!(
                "material {name}: thicknessTexture is ignored: the geometry says how far light goes through the volume"
            ));
        }
        Ok(())
    }

    pub fn specular_slot(&self) -> Option<Slot<'a>> {
        Slot::of("specularTexture", self.specular_texture, ColourSpace::Linear)
    }

    pub fn specular_colour_slot(&self) -> Option<Slot<'a>> {
        Slot::of("specularColorTexture", self.specular_colour_texture, ColourSpace::Srgb)
    }

    pub fn transmission_slot(&self) -> Option<Slot<'a>> {
        Slot::of("transmissionTexture", self.transmission_texture, ColourSpace::Linear)
    }
}

/// An index of refraction, at least 1. KHR_materials_ior uses 0 for a dielectric that reflects everything, which is not supported.
fn ior(value: f32, name: &str, notices: &mut Vec<String>) -> Result<f32, Fault> {
    let value = finite(value, "ior")?;
    if value == 0.0 {
        let ior = Material::default().ior;
        notices.push(format!("material {name}: an ior of 0 is not supported: {ior} is used"));
        return Ok(ior);
    }
    if value < 1.0 {
        notices.push(format!("material {name}: ior {value} is below 1: 1 is used"));
    }
    Ok(value.max(1.0))
}

impl Clearcoat {
    fn read(value: &json::Value, name: &str, notices: &mut Vec<String>) -> Result<Self, Fault> {
        let mut coat: Self = json::deserialize::from_value(value.clone()).map_err(|e| Fault::Value {
            what: CLEARCOAT,
            got: e.to_string(),
            wanted: "clearcoatFactor, clearcoatRoughnessFactor and their textures",
        })?;
        coat.factor = unit(coat.factor, "clearcoatFactor", name, notices)?;
        coat.roughness = unit(coat.roughness, "clearcoatRoughnessFactor", name, notices)?;
        if coat.normal_texture.is_some() {
            notices.push(format!(
                "material {name}: clearcoatNormalTexture is ignored: the coat has the normals of the surface"
            ));
        }
        Ok(coat)
    }

    pub fn slot(&self) -> Option<Slot<'_>> {
        Slot::of("clearcoatTexture", self.texture.as_ref(), ColourSpace::Linear)
    }

    pub fn roughness_slot(&self) -> Option<Slot<'_>> {
        Slot::of("clearcoatRoughnessTexture", self.roughness_texture.as_ref(), ColourSpace::Linear)
    }
}
