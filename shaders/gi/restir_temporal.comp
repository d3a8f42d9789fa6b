#version 460
#extension GL_GOOGLE_include_directive : require
#include "lib/bindless.glsl"
#include "lib/path_history.glsl"
#include "lib/pixel_list.glsl"
#include "lib/taps.glsl"
// Merges the samples of a frame with the reservoirs of the one before, and lists pixels whose old sample is to be traced again first.
layout(local_size_x = CHANGES_TILE, local_size_y = CHANGES_TILE) in;
layout(push_constant, scalar) uniform Push { PathTemporalParams params; };

// Share of the samples around a pixel that have changed from which on it forgets what it had.
const float MOST_CHANGED = 0.25;

// The cell of the grid that showed the surface in the previous frame: of four pixels each by its share, or the one that is in the grid. False
// if none did.
bool previous_cell(ViewBuffer view, ivec2 pixel, float u, out ivec2 cell) {
    vec2 was = vec2(pixel) - load(params.motion, pixel).xy * vec2(view.at[0].size);
    Taps taps = load_taps(params.taps, pixel, was);
    ivec2 step = grid_step(params.modes);
    bool found = false;
    for (int k = 0; k < 4 && taps.any && !found; k++) {
        ivec2 at = taps.first + ivec2(k & 1, k >> 1);
        if (taps.shares[k] == 0.0 || !inside(at, view.at[0].size)) continue;
        cell = at / step;
        found = step.x == 1 ? u < taps.shares[k] : at == cell * step;
        u -= taps.shares[k];
    }
    return found;
}

// Greatest confidence of what a cell had: less where samples around it have changed, which its own may not show, or not yet.
uint confidence_left(ViewBuffer view, ivec2 cell) {
    ivec2 tile = cell / int(CHANGES_TILE);
    uvec2 sum = uvec2(0u);
    for (int k = 0; k < 9; k++) {
        ivec2 at = tile + ivec2(k % 3, k / 3) - 1;
        if (!inside(at, tiles_of(view, params.modes))) continue;
        PathChanges changes = PathChangesBuffer(params.previous_changes).at[tile_index(view, params.modes, at * int(CHANGES_TILE))];
        sum += uvec2(changes.traced, changes.changed);
    }
    float changed = float(sum.y) / float(max(sum.x, 1u));
    return uint(mix(float(params.cap), 1.0, min(changed / MOST_CHANGED, 1.0)));
}

// The reservoir of a pixel. `due`: it is to be traced again.
PathReservoir reuse_previous(ViewBuffer view, ivec2 cell, uint index, out bool due) {
    due = false;
    PathReservoir own = PathReservoirBuffer(params.samples).at[index];
    PathReceiver receiver = PathReceiverBuffer(params.receivers).at[index];
    if (!receives(receiver)) return own;
    Random random = random_of(index, view.at[0].frame, view.at[0].seed ^ SALT_PATH_TEMPORAL);
    ivec2 before;
    if (!previous_cell(view, cell * grid_step(params.modes), random4(random).x, before)) return own;
    uint at = grid_index(view, params.modes, before);
    Lender lender;
    if (!carried_over(view, params.previous_receivers, params.previous, params.not_finite, at, lender)) return own;
    if (params.life > 0u && age_of(lender.reservoir) > params.life) return own;
    uint most = params.validate > 0u ? confidence_left(view, before) : params.cap;
    due = params.validate > 0u && frames_since_traced(lender.reservoir) >= params.validate && lender.reservoir.weight > 0.0;
    Receiver here = unpack_receiver(receiver, view.at[0].eye);
    if (due) {
        move_to(here, params.modes, params.stretch, view.at[0].eye, lender);
        due = lender.reservoir.weight > 0.0;
    }
    if (due) {
        PathReservoir left = lender.reservoir;
        left.confidence = pack_confidence(min(confidence_of(left), most), age_of(left));
        return left;
    }
    Borrower b;
    b.receiver = here;
    b.own = own;
    b.eye = view.at[0].eye;
    b.modes = params.modes;
    b.stretch = params.stretch;
    b.cap = params.cap;
    b.borrows_glossy = true;
    return merged_with(b, lender, most, params.not_finite, random);
}

void main() {
    ViewBuffer view = ViewBuffer(params.view);
    ivec2 cell = ivec2(gl_GlobalInvocationID.xy);
    bool due = false;
    if (inside(cell, grid_size(view, params.modes))) {
        uint index = grid_index(view, params.modes, cell);
        PathReservoirBufferWrite(params.resampled).at[index] = reuse_previous(view, cell, index, due);
    }
    if (params.validate == 0u) return;
    if (gl_LocalInvocationIndex == 0u) PathChangesBufferWrite(params.changes).at[tile_index(view, params.modes, cell)] = PathChanges(0u, 0u);
    append_pixel(params.list, cell, due);
}
