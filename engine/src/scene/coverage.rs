//! Mips of alpha-tested textures that keep the coverage of the full image (Castaño 2010, "Computing Alpha Mipmaps").
use super::{AlphaMode, Scene, Texture};
use rayon::prelude::*;

/// Number of alpha steps in the histogram: four for each 8-bit code.
const STEPS: usize = 1021;

/// Scales alpha in the mips of every alpha-tested texture, so that distant foliage keeps its density. Filtering alone would leave
/// thin features below the cut-off everywhere. If several materials test a texture, the first one decides.
pub(super) fn preserve_coverage(scene: &mut Scene) {
    let mut cutoffs: Vec<Option<f32>> = vec![None; scene.textures.len()];
    for material in &scene.materials {
        let cutoff = match material.alpha {
            AlphaMode::Opaque => continue,
            AlphaMode::Mask(cutoff) => cutoff,
            AlphaMode::Blend => 0.5,
        };
        let used = material.base_colour_texture.and_then(|t| cutoffs.get_mut(t.texture as usize));
        if let Some(slot @ None) = used {
            *slot = Some(cutoff / material.base_colour.w);
        }
    }
    let tested = scene.textures.par_iter_mut().zip(cutoffs);
    tested.filter_map(|(t, c)| Some((t, c?))).filter(|(_, c)| *c > 0.0 && *c <= 1.0).for_each(|(t, c)| keep(t, c));
}

/// Scales all mips so that the fraction of texels above a cut-off (0 to 1) is that of the full image.
fn keep(texture: &mut Texture, cutoff: f32) {
    let wanted = Histogram::new(&texture.mips[0], texture.mip_size(0)).share(step(cutoff));
    if wanted == 0.0 || wanted == 1.0 {
        return;
    }
    for mip in 1..texture.mips.len() {
        let here = Histogram::new(&texture.mips[mip], texture.mip_size(mip));
        // The threshold that the same fraction of this mip exceeds; among equally good ones, the nearest to the cut-off.
        let off = |t: usize| ((here.share(t) - wanted).abs(), t.abs_diff(step(cutoff)));
        let Some(threshold) =
            (1..STEPS).min_by(|a, b| off(*a).partial_cmp(&off(*b)).unwrap_or(std::cmp::Ordering::Equal))
        else {
            continue;
        };
        let scale = step(cutoff) as f32 / threshold as f32;
        for texel in texture.mips[mip].chunks_exact_mut(4) {
            texel[3] = (f32::from(texel[3]) * scale).round().min(255.0) as u8;
        }
    }
}

/// The first step at or above an alpha.
fn step(alpha: f32) -> usize {
    (alpha * (STEPS - 1) as f32).ceil() as usize
}

/// Cumulative histogram of alpha in a mip: `above[i]` is the number of samples at or above step `i`.
struct Histogram {
    above: Vec<u64>,
}

impl Histogram {
    /// Samples the bilinearly filtered image, as the alpha test sees it, at 4 x 4 points per texel.
    fn new(rgba: &[u8], [width, height]: [u32; 2]) -> Self {
        // The points are 1/8 and 3/8 of a texel from its centre: direction of the neighbouring texel, and its weight in eighths.
        const POINTS: [(isize, usize); 4] = [(-1, 3), (-1, 1), (1, 1), (1, 3)];
        let (width, height) = (width as usize, height as usize);
        let beside = |at: usize, by: isize, size: usize| at.saturating_add_signed(by).min(size - 1);
        let alpha = |x: usize, y: usize| usize::from(rgba[4 * (y * width + x) + 3]);
        let count = |y: usize| {
            let mut counts = vec![0_u64; STEPS];
            for x in 0..width {
                for (dy, part_y) in POINTS {
                    let ny = beside(y, dy, height);
                    for (dx, part_x) in POINTS {
                        let nx = beside(x, dx, width);
                        let here = (8 - part_x) * alpha(x, y) + part_x * alpha(nx, y);
                        let there = (8 - part_x) * alpha(x, ny) + part_x * alpha(nx, ny);
                        counts[((8 - part_y) * here + part_y * there) / 16] += 1;
                    }
                }
            }
            counts
        };
        let add = |mut a: Vec<u64>, b: Vec<u64>| {
            a.iter_mut().zip(b).for_each(|(a, b)| *a += b);
            a
        };
        let mut above = (0..height).into_par_iter().map(count).reduce(|| vec![0; STEPS], add);
        for i in (1..STEPS).rev() {
            above[i - 1] += above[i];
        }
        Self { above }
    }

    /// Fraction of samples at or above a step, 0 to 1.
    fn share(&self, step: usize) -> f64 {
        self.above.get(step).map_or(0.0, |n| *n as f64 / self.above[0] as f64)
    }
}

#[cfg(test)]
mod tests {
    use super::*;
    use crate::scene::{ColourSpace, Material, TextureUse};
    use glam::{Vec3, Vec4};

    /// Blades of grass, three of every sixteen texels wide.
    fn grass() -> Texture {
        let alpha = |i: usize| if i % 16 < 3 { 255 } else { 0 };
        let rgba = (0..128 * 128).flat_map(|i| [10, 20, 30, alpha(i % 128)]).collect();
        Texture::new("grass".to_owned(), [128, 128], ColourSpace::Srgb, rgba)
    }

    fn shares(texture: &Texture, cutoff: f32) -> Vec<f64> {
        let share = |m: usize| Histogram::new(&texture.mips[m], texture.mip_size(m)).share(step(cutoff));
        (0..texture.mips.len()).map(share).collect()
    }

    #[test]
    fn mips_cover_as_much() {
        let tested = |alpha, cutoff_of: f32| {
            let base_colour_texture = Some(TextureUse { texture: 0, sampler: 0, uv_set: 0, rows: [Vec3::X, Vec3::Y] });
            let material = Material {
                alpha,
                base_colour: Vec4::new(1.0, 1.0, 1.0, 0.8),
                base_colour_texture,
                ..Material::default()
            };
            let mut scene = Scene { textures: vec![grass()], materials: vec![material], ..Scene::default() };
            let before = scene.textures[0].clone();
            preserve_coverage(&mut scene);
            let made = scene.textures.remove(0);
            assert_eq!(made.mips[0], before.mips[0], "the image itself stays");
            for (a, b) in made.mips.iter().zip(&before.mips) {
                assert!(a.chunks_exact(4).zip(b.chunks_exact(4)).all(|(a, b)| a[..3] == b[..3]), "colours stay");
            }
            (shares(&before, cutoff_of), shares(&made, cutoff_of), made.mips == before.mips)
        };
        let (before, after, _) = tested(AlphaMode::Mask(0.4), 0.5);
        println!("before {before:.3?}\nafter {after:.3?}");
        assert_eq!(before[3], 0.0, "a mip with a texel for eight has lost every blade");
        // Down to the mip with one texel per blade and one per gap. There, four of the eight sample points across both see more than half
        // of the blade and two see most of it; fractions are multiples of a quarter, so the nearest is at most an eighth off.
        for (mip, off) in [(1, 0.07), (2, 0.07), (3, 0.125)] {
            assert!((after[mip] - after[0]).abs() < off, "mip {mip}");
        }
        let (_, _, same) = tested(AlphaMode::Opaque, 0.5);
        assert!(same, "what is not tested stays");
    }
}
