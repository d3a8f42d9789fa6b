//! The materials of the market.
use super::super::foliage::leaf_texture;
use super::super::stage::{Stage, dielectric, matte, metal};
use super::textures::{BRICKS_SIZE, Maps, PLASTER_SIZE, SETTS_SIZE, bricks, plaster, setts, window};
use crate::scene::{AlphaMode, Material, Sampler, Texture, TextureUse, Wrap};
use glam::{Vec2, Vec3};

/// Size of a window's pane, metres: its texture fills it.
pub const PANE: Vec2 = Vec2::new(0.92, 1.34);

/// Indices of materials.
pub struct Palette {
    pub setts: u32,
    pub granite: u32,
    pub asphalt: u32,
    /// Of the houses.
    pub walls: [u32; 7],
    pub trim: u32,
    pub frame: u32,
    pub glass: u32,
    /// Lit windows, warm and cold.
    pub lit: [u32; 3],
    pub shutters: [u32; 3],
    pub door: u32,
    pub wood: u32,
    pub pale_wood: u32,
    pub dark_wood: u32,
    pub iron: u32,
    pub steel: u32,
    pub copper: u32,
    pub brass: u32,
    pub rubber: u32,
    pub tiles: u32,
    pub board: u32,
    pub red: u32,
    pub white: u32,
    /// Cloth of awnings, in pairs.
    pub cloth: [u32; 8],
    /// Glossy paints and glazes.
    pub glaze: [u32; 6],
    pub bottles: [u32; 3],
    pub fruit: [u32; 6],
    pub bamboo: u32,
    pub clay: u32,
    pub leaves: u32,
    pub shade: u32,
    pub bark: u32,
    pub soil: u32,
}

/// Adds a texture that repeats every `size` metres.
fn repeated(stage: &mut Stage, texture: Texture, size: Vec2) -> TextureUse {
    stage.scene.textures.push(texture);
    let rows = [Vec3::X / size.x, Vec3::Y / size.y];
    TextureUse { texture: stage.scene.textures.len() as u32 - 1, sampler: 0, uv_set: 0, rows }
}

fn textured(stage: &mut Stage, material: Material, maps: Maps, size: Vec2) -> Material {
    Material {
        roughness: 1.0,
        base_colour_texture: Some(repeated(stage, maps.base_colour, size)),
        metallic_roughness_texture: Some(repeated(stage, maps.roughness, size)),
        normal_texture: Some(repeated(stage, maps.normals, size)),
        ..material
    }
}

pub fn palette(stage: &mut Stage) -> Palette {
    stage.scene.samplers.push(Sampler::default());
    stage.scene.samplers.push(Sampler { wrap: [Wrap::Clamp; 2], ..Sampler::default() });
    let ground = textured(stage, dielectric("setts", [1.0; 3], 1.0), setts(), SETTS_SIZE);
    let brick = textured(stage, dielectric("bricks", [1.0; 3], 1.0), bricks(), BRICKS_SIZE);
    let stains = repeated(stage, plaster(), PLASTER_SIZE);
    let curtains = TextureUse { sampler: 1, ..repeated(stage, window(), PANE) };
    stage.scene.textures.push(leaf_texture());
    let leaf = stage.scene.textures.len() as u32 - 1;

    let mut add = |material: Material| stage.material(material);
    let brickwork = |name: &str, tint: [f32; 3]| Material {
        name: name.to_owned(),
        base_colour: Vec3::from(tint).extend(1.0),
        ..brick.clone()
    };
    let stained = |name: &str, tint| Material { base_colour_texture: Some(stains), ..matte(name, tint) };
    let glowing = |name: &str, glow: [f32; 3]| Material {
        emission: Vec3::from(glow),
        emission_texture: Some(curtains),
        ..dielectric(name, [0.02; 3], 0.12)
    };
    let cloth = |name: &str, colour| Material { double_sided: true, ..matte(name, colour) };
    let leaves = Material {
        alpha: AlphaMode::Mask(0.4),
        double_sided: true,
        base_colour_texture: Some(TextureUse { texture: leaf, sampler: 1, uv_set: 0, rows: [Vec3::X, Vec3::Y] }),
        ..dielectric("leaves", [0.85, 0.95, 0.75], 0.5)
    };
    Palette {
        setts: add(ground),
        granite: add(dielectric("wet granite", [0.17, 0.17, 0.18], 0.28)),
        asphalt: add(dielectric("wet asphalt", [0.035, 0.035, 0.038], 0.35)),
        walls: [
            add(brickwork("red bricks", [0.72, 0.66, 0.62])),
            add(stained("ochre plaster", [0.42, 0.29, 0.14])),
            add(stained("rose plaster", [0.38, 0.20, 0.17])),
            add(brickwork("grey bricks", [0.44, 0.50, 0.56])),
            add(stained("teal plaster", [0.12, 0.25, 0.26])),
            add(stained("sand plaster", [0.42, 0.37, 0.29])),
            add(stained("slate plaster", [0.19, 0.22, 0.28])),
        ],
        trim: add(dielectric("pale stone", [0.44, 0.41, 0.37], 0.6)),
        frame: add(dielectric("window frames", [0.10, 0.085, 0.075], 0.45)),
        glass: add(dielectric("dark panes", [0.012, 0.014, 0.018], 0.04)),
        lit: [
            add(glowing("lamplit panes", [2.3, 1.35, 0.55])),
            add(glowing("dim panes", [0.95, 0.50, 0.20])),
            add(glowing("bluish panes", [0.50, 0.85, 1.25])),
        ],
        shutters: [
            add(dielectric("green shutters", [0.055, 0.15, 0.13], 0.4)),
            add(dielectric("grey shutters", [0.24, 0.25, 0.26], 0.38)),
            add(dielectric("blue shutters", [0.055, 0.10, 0.21], 0.4)),
        ],
        door: add(dielectric("lacquered doors", [0.20, 0.035, 0.025], 0.25)),
        wood: add(dielectric("planks", [0.30, 0.18, 0.09], 0.5)),
        pale_wood: add(dielectric("pale planks", [0.46, 0.32, 0.18], 0.6)),
        dark_wood: add(dielectric("dark wood", [0.085, 0.048, 0.028], 0.45)),
        iron: add(metal("iron", [0.26, 0.25, 0.25], 0.42)),
        steel: add(metal("steel", [0.62, 0.61, 0.60], 0.24)),
        copper: add(metal("copper", [0.955, 0.638, 0.538], 0.26)),
        brass: add(metal("brass", [0.887, 0.789, 0.434], 0.30)),
        rubber: add(dielectric("rubber", [0.022, 0.022, 0.024], 0.5)),
        tiles: add(dielectric("roof tiles", [0.075, 0.10, 0.105], 0.30)),
        board: add(dielectric("sign boards", [0.014, 0.014, 0.020], 0.16)),
        red: add(dielectric("red lacquer", [0.42, 0.028, 0.018], 0.22)),
        white: add(dielectric("white enamel", [0.72, 0.71, 0.68], 0.18)),
        cloth: [
            add(cloth("red cloth", [0.54, 0.06, 0.04])),
            add(cloth("cream cloth", [0.72, 0.62, 0.44])),
            add(cloth("blue cloth", [0.05, 0.15, 0.36])),
            add(cloth("white cloth", [0.70, 0.70, 0.68])),
            add(cloth("green cloth", [0.05, 0.25, 0.13])),
            add(cloth("yellow cloth", [0.70, 0.44, 0.07])),
            add(cloth("violet cloth", [0.22, 0.07, 0.28])),
            add(cloth("rose cloth", [0.66, 0.28, 0.30])),
        ],
        glaze: [
            add(dielectric("cobalt glaze", [0.022, 0.075, 0.40], 0.12)),
            add(dielectric("celadon glaze", [0.30, 0.46, 0.36], 0.12)),
            add(dielectric("oxblood glaze", [0.34, 0.02, 0.018], 0.10)),
            add(dielectric("ivory glaze", [0.72, 0.66, 0.52], 0.14)),
            add(dielectric("saffron paint", [0.75, 0.36, 0.035], 0.25)),
            add(dielectric("turquoise paint", [0.03, 0.36, 0.38], 0.25)),
        ],
        bottles: [
            add(dielectric("green bottles", [0.012, 0.10, 0.035], 0.04)),
            add(dielectric("amber bottles", [0.22, 0.075, 0.008], 0.04)),
            add(dielectric("dark bottles", [0.03, 0.015, 0.02], 0.04)),
        ],
        fruit: [
            add(dielectric("oranges", [0.83, 0.30, 0.025], 0.38)),
            add(dielectric("apples", [0.55, 0.035, 0.02], 0.22)),
            add(dielectric("limes", [0.20, 0.42, 0.04], 0.32)),
            add(dielectric("lemons", [0.86, 0.66, 0.06], 0.36)),
            add(dielectric("plums", [0.13, 0.025, 0.10], 0.28)),
            add(dielectric("peaches", [0.80, 0.42, 0.24], 0.6)),
        ],
        bamboo: add(dielectric("bamboo", [0.62, 0.46, 0.22], 0.5)),
        clay: add(dielectric("clay", [0.42, 0.18, 0.095], 0.7)),
        leaves: add(leaves),
        shade: add(matte("inner leaves", [0.035, 0.060, 0.020])),
        bark: add(matte("bark", [0.16, 0.11, 0.08])),
        soil: add(matte("soil", [0.06, 0.04, 0.03])),
    }
}
