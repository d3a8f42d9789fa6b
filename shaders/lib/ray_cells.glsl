#ifndef LIB_RAY_CELLS_GLSL
#define LIB_RAY_CELLS_GLSL
#include "lib/bindless.glsl"
#include "shared/view.glsl"
// Fewer rays than pixels: one for each cell of 1, 2x1, 2x2 or 4x4 pixels, in turn from each pixel of the cell.

// Width and height of cells of 1, 2 or 4 pixels.
ivec2 side_of(uint pixels) {
    return ivec2(pixels > 1u ? 2 : 1, pixels > 2u ? 2 : 1);
}

// The cell of 2x2 pixels that has the ray of a cell of 4x4 in this frame. It goes on by one more after each round, so that 16 frames cover
// all 16 pixels.
ivec2 ray_quarter(ViewBuffer view, ivec2 cell) {
    uint turn = view.at[0].frame + (view.at[0].frame >> 2u) + uint(cell.x) + 2u * uint(cell.y);
    return 2 * cell + ivec2(turn & 1u, (turn ^ (turn >> 1u)) & 1u);
}

// The pixel of `cell`, of `side` pixels, that has the ray of this frame. Cells next to each other begin their turns at different pixels.
ivec2 ray_pixel(ViewBuffer view, ivec2 cell, ivec2 side) {
    if (side.y == 4) {
        cell = ray_quarter(view, cell);
        side = ivec2(2);
    }
    uint turn = view.at[0].frame + uint(cell.x) + 2u * uint(cell.y);
    // Diagonally first, so that two frames cover both columns and both rows.
    uint place = turn & uint(side.x * side.y - 1);
    ivec2 offset = side.y == 1 ? ivec2(place, 0) : ivec2(place & 1u, (place ^ (place >> 1u)) & 1u);
    return min(cell * side + offset, ivec2(view.at[0].size) - 1);
}

// How often a pixel has had a ray before.
uint ray_turns(ViewBuffer view, ivec2 side) {
    return view.at[0].frame / uint(side.x * side.y);
}

#endif
