#ifndef LIB_SURFEL_GUIDE_GLSL
#define LIB_SURFEL_GUIDE_GLSL
#include "lib/colour.glsl"
#include "lib/surfels.glsl"
// From where a surfel's light comes, learned from its own paths and those of surfels around. Directions are drawn from a unit square that is mapped to the
// hemisphere by its cosine; cells of that square in which the square of the luminance was greater before are drawn more often. Each sample is divided by the density that it was
// drawn with, so the mean is what it is without a guide (adaptive importance sampling; for hemispheres: Müller et al. 2017, "Practical Path Guiding").

const uint GUIDE_CELLS = GUIDE_SIDE * GUIDE_SIDE;
// Share of the samples that the guide draws at most: what has been dark is looked at all the same, and no sample counts more than 1 / (1 - GUIDED).
const float GUIDED = 0.5;
// Contrast of cells at which half of that share is left.
const float ALIKE = 0.1;
// Paths between changes of the chances, fewer at first. Points of a low-discrepancy sequence depend on those before. Were the chances to follow each sample,
// the mean would be wrong; so they stay for a block of paths, and each block has a sequence of its own.
const uint GUIDE_BLOCK = 32u;
const uint FIRST_BLOCK = 8u;
// Share of the newest sample in the mean of a cell.
const float LEARNED = 0.15;
// Squares of more are not representable. No less than the other is stored: 0 is a cell that no path went to.
const float GUIDE_LIMIT = 1e18;
const float GUIDE_LEAST = 1e-30;

// A point of the square.
struct Guided {
    vec2 u;
    uint cell;
    float density;  // over that of even points
};

// The first path of the block of a path.
uint block_start(uint path) {
    return path - path % (path < GUIDE_BLOCK ? FIRST_BLOCK : GUIDE_BLOCK);
}

float guide_at(uint guide[GUIDE_CELLS / 2], uint cell) {
    vec2 pair = unpack_upper(guide[cell / 2u]);
    return (cell & 1u) == 0u ? pair.x : pair.y;
}

// The chances of cells for a block of paths, by the mean square of what was found in each, times any factor.
uvec4 chances_of(float squares[GUIDE_CELLS]) {
    float sum = 0.0;
    float most = 0.0;
    float sum_of_squares = 0.0;
    for (uint cell = 0u; cell < GUIDE_CELLS; cell++) {
        float found = sqrt(squares[cell]);
        sum += found;
        most = max(most, found);
        sum_of_squares += squares[cell];
    }
    uvec4 chances = uvec4(0u);
    if (!(sum > 0.0)) return chances;
    // 0 where cells are alike, whose differences are then only noise; 1 where one cell has all light.
    float contrast = max(1.0 - sum * sum / (float(GUIDE_CELLS) * sum_of_squares), 0.0);
    float share = GUIDED * contrast * contrast / (contrast * contrast + ALIKE * ALIKE);
    float even = (1.0 - share) / float(GUIDE_CELLS);
    float scale = 255.0 / (even + share * most / sum);
    for (uint cell = 0u; cell < GUIDE_CELLS; cell++) {
        uint chance = uint(max(scale * (even + share * sqrt(squares[cell]) / sum), 1.0));
        chances[cell / 4u] |= min(chance, 255u) << (8u * (cell % 4u));
    }
    return chances;
}

// Maps even points to guided ones, first by rows, then within a row, so that points which are well distributed stay so.
Guided guided(uvec4 chances, vec2 u) {
    if (chances[0] == 0u) {
        uvec2 at = min(uvec2(u * float(GUIDE_SIDE)), GUIDE_SIDE - 1u);
        return Guided(u, at.y * GUIDE_SIDE + at.x, 1.0);
    }
    float rows[GUIDE_SIDE];
    float all = 0.0;
    for (uint row = 0u; row < GUIDE_SIDE; row++) {
        uvec4 bytes = (uvec4(chances[row]) >> uvec4(0u, 8u, 16u, 24u)) & 0xffu;
        rows[row] = float(bytes.x + bytes.y + bytes.z + bytes.w);
        all += rows[row];
    }
    uint row = 0u;
    float left = u.y * all;
    while (row < GUIDE_SIDE - 1u && left >= rows[row]) left -= rows[row++];
    u.y = clamp(left / rows[row], 0.0, 1.0 - 6e-8);
    vec4 chance = vec4((uvec4(chances[row]) >> uvec4(0u, 8u, 16u, 24u)) & 0xffu);
    uint column = 0u;
    left = u.x * rows[row];
    while (column < GUIDE_SIDE - 1u && left >= chance[column]) left -= chance[column++];
    u.x = clamp(left / chance[column], 0.0, 1.0 - 6e-8);
    return Guided((vec2(column, row) + u) / float(GUIDE_SIDE), row * GUIDE_SIDE + column, float(GUIDE_CELLS) * chance[column] / all);
}

// Learns from what a sample of a cell has found.
void learn(inout uint guide[GUIDE_CELLS / 2], uint cell, vec3 radiance) {
    float found = min(luminance(radiance), GUIDE_LIMIT);
    vec2 pair = unpack_upper(guide[cell / 2u]);
    bool is_first = (cell & 1u) == 0u;
    float before = is_first ? pair.x : pair.y;
    float learned = max(mix(before, found * found, before > 0.0 ? LEARNED : 1.0), GUIDE_LEAST);
    guide[cell / 2u] = pack_upper(is_first ? vec2(learned, pair.y) : vec2(pair.x, learned));
}

// Surfels around whose guides one takes.
const uint GUIDES = 32u;

// Adds a guide to the sums over guides: of squares, and of the weights of those that know a cell.
void add_guide(inout vec2 sums[GUIDE_CELLS], uint guide[GUIDE_CELLS / 2], float weight) {
    for (uint cell = 0u; cell < GUIDE_CELLS; cell++) {
        float square = guide_at(guide, cell);
        if (square > 0.0) sums[cell] += weight * vec2(square, 1.0);
    }
}

// The chances of directions for a surfel's next paths, by what it and those within so many radii have found.
uvec4 chances_around(SurfelGrid grid, SurfelPool pool, vec3 eye, PlacedSurfel s, uint surfel, float reach) {
    uvec2 list = cell_list(grid, eye, s.position);
    vec2 sums[GUIDE_CELLS];
    for (uint cell = 0u; cell < GUIDE_CELLS; cell++) sums[cell] = vec2(0.0);
    add_guide(sums, pool.at[surfel].guide, 1.0);
    uint step = max(list.y / GUIDES, 1u);
    for (uint i = surfel % step; i < list.y; i += step) {
        uint other = SurfelWords(grid.references).at[list.x + i];
        float weight = other == surfel ? 0.0 : surfel_weight(grid, other, s.position, s.normal, reach).y;
        if (weight > 0.0) add_guide(sums, pool.at[other].guide, weight);
    }
    float squares[GUIDE_CELLS];
    for (uint cell = 0u; cell < GUIDE_CELLS; cell++) squares[cell] = sums[cell].x / max(sums[cell].y, 1e-6);
    return chances_of(squares);
}

#endif
