#ifndef LIB_SURFEL_CELLS_GLSL
#define LIB_SURFEL_CELLS_GLSL
#include "lib/surfels.glsl"
// The cells that a surfel touches.

struct TouchedCells {
    uint count;
    uint at[CELLS_OF_SURFEL];
};

TouchedCells touched_cells(SurfelGrid grid, vec3 eye, PlacedSurfel s) {
    TouchedCells cells;
    cells.count = 0u;
    vec3 from_eye = s.position - eye;
    float distance = length(from_eye);
    int last = cell_level(distance + s.radius);
    for (int level = cell_level(distance - s.radius); level <= last; level++) {
        ivec3 low = cell_of(grid, from_eye - s.radius, level);
        ivec3 high = cell_of(grid, from_eye + s.radius, level);
        for (int z = low.z; z <= high.z; z++) {
            for (int y = low.y; y <= high.y; y++) {
                for (int x = low.x; x <= high.x; x++) {
                    if (cells.count < CELLS_OF_SURFEL) cells.at[cells.count++] = cell_index(grid, ivec3(x, y, z), level);
                }
            }
        }
    }
    return cells;
}

#endif
