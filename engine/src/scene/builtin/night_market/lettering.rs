//! Letters and pictures as strokes, for tubes of neon. Each fits a box from (0, 0) at the lower left to (1, 1).
use glam::Vec2;
use std::f32::consts::TAU;

/// A line of points.
pub type Stroke = Vec<Vec2>;

fn stroke(points: &[[f32; 2]]) -> Stroke {
    points.iter().map(|p| Vec2::from(*p)).collect()
}

/// A part of an ellipse, from one angle to another, in turns, counter-clockwise from the right.
fn arc([x, y]: [f32; 2], [a, b]: [f32; 2], from: f32, to: f32) -> Stroke {
    let steps = ((to - from).abs() * 24.0).ceil().max(2.0) as usize;
    (0..=steps)
        .map(|i| from + (to - from) * i as f32 / steps as f32)
        .map(|turn| Vec2::new(x + a * (TAU * turn).cos(), y + b * (TAU * turn).sin()))
        .collect()
}

/// A smooth line through points (Catmull and Rom 1974).
fn through(points: &[[f32; 2]]) -> Stroke {
    const STEPS: usize = 5;
    let p = stroke(points);
    let last = p.len() - 1;
    let mut line = vec![p[0]];
    for i in 0..last {
        let (a, b, c, d) = (p[i.saturating_sub(1)], p[i], p[i + 1], p[(i + 2).min(last)]);
        line.extend((1..=STEPS).map(|k| k as f32 / STEPS as f32).map(|t| {
            let bend =
                (c - a) * t + (2.0 * a - 5.0 * b + 4.0 * c - d) * (t * t) + (3.0 * b - a - 3.0 * c + d) * (t * t * t);
            b + 0.5 * bend
        }));
    }
    line
}

/// A capital letter or a digit; nothing for those that no sign has.
pub fn letter(which: char) -> Vec<Stroke> {
    let s = stroke;
    match which {
        'A' => vec![s(&[[0.0, 0.0], [0.5, 1.0], [1.0, 0.0]]), s(&[[0.19, 0.36], [0.81, 0.36]])],
        'D' => vec![s(&[[0.05, 1.0], [0.05, 0.0]]), arc([0.05, 0.5], [0.85, 0.5], -0.25, 0.25)],
        'E' => vec![s(&[[0.95, 0.0], [0.05, 0.0], [0.05, 1.0], [0.95, 1.0]]), s(&[[0.05, 0.52], [0.75, 0.52]])],
        'H' => vec![s(&[[0.08, 0.0], [0.08, 1.0]]), s(&[[0.92, 0.0], [0.92, 1.0]]), s(&[[0.08, 0.5], [0.92, 0.5]])],
        'L' => vec![s(&[[0.08, 1.0], [0.08, 0.0], [0.9, 0.0]])],
        'N' => vec![s(&[[0.06, 0.0], [0.06, 1.0], [0.94, 0.0], [0.94, 1.0]])],
        'O' => vec![arc([0.5, 0.5], [0.48, 0.5], 0.0, 1.0)],
        'S' => vec![through(&[
            [0.90, 0.84],
            [0.62, 1.0],
            [0.22, 0.94],
            [0.12, 0.72],
            [0.50, 0.52],
            [0.88, 0.30],
            [0.76, 0.05],
            [0.36, 0.0],
            [0.06, 0.17],
        ])],
        'T' => vec![s(&[[0.0, 1.0], [1.0, 1.0]]), s(&[[0.5, 1.0], [0.5, 0.0]])],
        _ => Vec::new(),
    }
}

/// 夜, night.
pub fn night() -> Vec<Stroke> {
    [
        &[[0.50, 1.0], [0.50, 0.88]][..],
        &[[0.04, 0.85], [0.96, 0.85]],
        &[[0.32, 0.77], [0.06, 0.40]],
        &[[0.21, 0.58], [0.21, 0.0]],
        &[[0.58, 0.77], [0.38, 0.36]],
        &[[0.53, 0.65], [0.86, 0.65], [0.72, 0.30], [0.40, 0.0]],
        &[[0.56, 0.50], [0.68, 0.41]],
        &[[0.52, 0.36], [0.96, 0.0]],
    ]
    .map(stroke)
    .to_vec()
}

/// 市, market.
pub fn market() -> Vec<Stroke> {
    [
        &[[0.50, 1.0], [0.50, 0.88]][..],
        &[[0.06, 0.83], [0.94, 0.83]],
        &[[0.20, 0.14], [0.20, 0.62], [0.80, 0.62], [0.80, 0.20], [0.68, 0.16]],
        &[[0.50, 0.83], [0.50, 0.0]],
    ]
    .map(stroke)
    .to_vec()
}

/// 茶, tea.
pub fn tea() -> Vec<Stroke> {
    [
        &[[0.06, 0.87], [0.94, 0.87]][..],
        &[[0.32, 1.0], [0.32, 0.75]],
        &[[0.68, 1.0], [0.68, 0.75]],
        &[[0.50, 0.76], [0.06, 0.42]],
        &[[0.50, 0.76], [0.94, 0.42]],
        &[[0.22, 0.40], [0.78, 0.40]],
        &[[0.50, 0.54], [0.50, 0.0]],
        &[[0.40, 0.30], [0.18, 0.08]],
        &[[0.60, 0.30], [0.82, 0.08]],
    ]
    .map(stroke)
    .to_vec()
}

/// A bowl, and steam above it.
pub fn bowl() -> [Vec<Stroke>; 2] {
    let wave = |x: f32| through(&[[x, 0.58], [x + 0.06, 0.68], [x - 0.05, 0.80], [x + 0.05, 0.92], [x, 1.0]]);
    let sticks = [stroke(&[[0.62, 0.50], [0.98, 0.86]]), stroke(&[[0.70, 0.48], [1.02, 0.76]])];
    let [first, second] = sticks;
    [
        vec![
            arc([0.5, 0.44], [0.46, 0.40], 0.5, 1.0),
            stroke(&[[0.0, 0.44], [1.0, 0.44]]),
            stroke(&[[0.32, 0.0], [0.68, 0.0]]),
            first,
            second,
        ],
        vec![wave(0.22), wave(0.40), wave(0.56)],
    ]
}

/// A magpie on a twig: its outline, and wing, breast and twig.
pub fn magpie() -> [Vec<Stroke>; 2] {
    let outline = through(&[
        [0.045, 0.77],
        [0.14, 0.81],
        [0.20, 0.90],
        [0.29, 0.93],
        [0.38, 0.86],
        [0.44, 0.74],
        [0.58, 0.61],
        [0.72, 0.44],
        [0.90, 0.14],
        [1.0, 0.0],
    ]);
    let below = through(&[
        [0.045, 0.77],
        [0.15, 0.745],
        [0.18, 0.64],
        [0.17, 0.50],
        [0.22, 0.36],
        [0.33, 0.28],
        [0.47, 0.27],
        [0.60, 0.30],
        [0.76, 0.17],
        [0.93, 0.0],
        [1.0, 0.0],
    ]);
    let wing = through(&[[0.34, 0.66], [0.36, 0.52], [0.46, 0.42], [0.60, 0.38], [0.70, 0.36]]);
    let breast = through(&[[0.19, 0.60], [0.26, 0.52], [0.29, 0.42], [0.30, 0.31]]);
    let eye = arc([0.245, 0.825], [0.018, 0.018], 0.0, 1.0);
    let legs = [stroke(&[[0.36, 0.27], [0.35, 0.155]]), stroke(&[[0.45, 0.26], [0.45, 0.155]])];
    let twig = through(&[[0.0, 0.10], [0.20, 0.15], [0.42, 0.14], [0.60, 0.10]]);
    let [left, right] = legs;
    [vec![outline, below, left, right], vec![wing, breast, eye, twig]]
}

/// A ring, and an arrow that points down.
pub fn ring() -> Vec<Stroke> {
    vec![arc([0.5, 0.5], [0.5, 0.5], 0.0, 1.0)]
}

pub fn arrow() -> Vec<Stroke> {
    vec![
        through(&[[0.95, 1.0], [0.98, 0.62], [0.72, 0.34], [0.30, 0.22]]),
        stroke(&[[0.34, 0.46], [0.04, 0.16], [0.42, 0.0]]),
    ]
}

/// Parts of a line without a corner sharper than 35 degrees, since a tube cannot follow one.
pub fn without_corners(line: &[Vec2]) -> Vec<Stroke> {
    const LEAST_COSINE: f32 = 0.82;
    let mut parts: Vec<Stroke> = vec![vec![line[0]]];
    for i in 1..line.len() {
        let last = parts.len() - 1;
        parts[last].push(line[i]);
        let turns = line.get(i + 1).is_some_and(|next| {
            (line[i] - line[i - 1]).normalize_or(Vec2::X).dot((*next - line[i]).normalize_or(Vec2::X)) < LEAST_COSINE
        });
        if turns {
            parts.push(vec![line[i]]);
        }
    }
    parts
}

#[cfg(test)]
mod tests {
    use super::*;

    #[test]
    fn corners_part_a_line_and_bends_do_not() {
        assert_eq!(without_corners(&letter('L')[0]).len(), 2);
        assert_eq!(without_corners(&letter('O')[0]).len(), 1);
        assert_eq!(without_corners(&stroke(&[[0.0, 0.0], [1.0, 0.0]])).len(), 1);
    }
}
