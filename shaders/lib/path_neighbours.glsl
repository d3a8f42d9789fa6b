#ifndef LIB_PATH_NEIGHBOURS_GLSL
#define LIB_PATH_NEIGHBOURS_GLSL
#include "lib/hit_shading.glsl"
#include "lib/not_finite.glsl"
#include "lib/path_reuse.glsl"
#include "lib/ray_count.glsl"
#include "shared/denoise.glsl"
// Reuse of the reservoirs of pixels around, from one buffer into another.

// Least cosine between the shading normals of a pixel and a neighbour: 25 degrees.
const float LEAST_ALIKE = 0.9063;
// Greatest distance of a neighbour from the pixel's plane, over the distance from the eye.
const float GREATEST_STEP = 0.02;

// Counters: closest-hit and any-hit rays.
uvec2 neighbours_traced = uvec2(0u);

ViewBuffer around_view;
PathSpatialParams around_params;
ivec2 asked[MAX_PATH_NEIGHBOURS];
// Neighbours in the picture, and those of them on another surface.
uvec2 found_around = uvec2(0u);

bool lender_at(uint k, out Lender lender) {
    if (asked[k].x < 0) return false;
    uint index = grid_index(around_view, around_params.modes, asked[k]);
    lender.reservoir = PathReservoirBuffer(around_params.reservoirs).at[index];
    lender.receiver = unpack_receiver(PathReceiverBuffer(around_params.receivers).at[index], around_view.at[0].eye);
    return true;
}

bool is_clear(Receiver r, PathSample s) {
    if ((around_params.modes & PATH_VISIBILITY) == 0u) return true;
    Ray ray = s.is_sky ? surface_ray(r.start, s.place, UNBOUNDED) : surface_ray_to(r.start, s.place);
    return seen_along(SceneBuffer(around_params.scene), ray, neighbours_traced) != vec3(0.0);
}

// Whether a pixel's reservoir is of use for a surface.
bool is_alike(PathReceiver here, PathReceiver there) {
    if (!receives(there)) return false;
    vec3 normal = octahedral_decode(unpackSnorm2x16(here.normal));
    return dot(normal, octahedral_decode(unpackSnorm2x16(there.normal))) >= LEAST_ALIKE
        && abs(dot(normal, there.from_eye - here.from_eye)) <= GREATEST_STEP * length(here.from_eye);
}

// Chooses the neighbours.
void choose_neighbours(ivec2 cell, PathReceiver here, inout Random random) {
    float reach = around_params.reach / float(grid_step(around_params.modes).x);
    for (uint k = 0u; k < around_params.neighbours; k++) {
        ivec2 at = cell + ivec2(round(reach * sample_disc(random4(random).xy)));
        asked[k] = ivec2(-1);
        if (at == cell || !inside(at, grid_size(around_view, around_params.modes))) continue;
        found_around.x++;
        uint index = grid_index(around_view, around_params.modes, at);
        if (is_alike(here, PathReceiverBuffer(around_params.receivers).at[index])) asked[k] = at;
        else found_around.y++;
    }
}

PathReservoir reused(ivec2 cell, uint index) {
    PathReservoir own = PathReservoirBuffer(around_params.reservoirs).at[index];
    PathReceiver receiver = PathReceiverBuffer(around_params.receivers).at[index];
    if (!receives(receiver)) return own;
    ViewBuffer view = around_view;
    Random random = random_of(index, view.at[0].frame, view.at[0].seed ^ (SALT_PATH_SPATIAL + around_params.round));
    choose_neighbours(cell, receiver, random);
    if (found_around.x == found_around.y) return own;
    Borrower b;
    b.receiver = unpack_receiver(receiver, view.at[0].eye);
    b.own = own;
    b.eye = view.at[0].eye;
    b.modes = around_params.modes;
    b.stretch = around_params.stretch;
    b.cap = around_params.cap;
    b.borrows_glossy = false;
    PathReservoir all = merged(b, around_params.neighbours, random);
    return is_taken(around_params.not_finite, vec3(all.weight)) ? all : own;
}

void reuse_neighbours(PathSpatialParams params) {
    around_params = params;
    around_view = ViewBuffer(params.view);
    ivec2 cell = ivec2(RAY_INVOCATION.xy);
    if (!inside(cell, grid_size(around_view, params.modes))) return;
    uint index = grid_index(around_view, params.modes, cell);
    PathReservoirBufferWrite(params.resampled).at[index] = reused(cell, index);
    if (params.asked != NO_IMAGE) store(params.asked, cell, vec4(found_around, jacobians));
    count_rays(params.rays, neighbours_traced.x, neighbours_traced.y);
    count_rays(params.around, found_around.x, found_around.y);
    count_rays(params.jacobians, jacobians.x, jacobians.y);
}

#endif
