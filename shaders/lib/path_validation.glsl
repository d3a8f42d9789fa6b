#ifndef LIB_PATH_VALIDATION_GLSL
#define LIB_PATH_VALIDATION_GLSL
#include "lib/path_samples.glsl"
#include "lib/path_history.glsl"
#include "lib/pixel_list.glsl"
// Old samples are traced again, before they are merged with new ones. With the same random numbers a path finds the same light, unless
// something has changed: at rest nothing happens, whatever noise there is.

// Share of its distance by which the point that a path meets may move, and share of its radiance by which that may change.
const float LEAST_MOVE = 0.01;
const float LEAST_CHANGE = 0.25;

layout(buffer_reference, scalar, buffer_reference_align = 4) buffer ChangeCounters { PathChanges at[]; };

// Traces a sample again in its direction, and forgets most of what was known where it has changed, which is returned. Its weight is that of
// the direction, so it stays.
bool validate(ViewBuffer view, ValidateParams params, Receiver here, inout Lender lender) {
    vec3 eye = view.at[0].eye;
    PathSample before = sample_of(lender.reservoir, eye);
    float cosine = cosine_of(here, before);
    vec3 direction = direction_to(here, before);
    Path path = path_of(params.hits, params.modes, params.regularization);
    PathSample now = traced(view, SceneBuffer(params.scene), path, here, direction, source_pdf(params.modes, cosine), lender.reservoir.path >> 8u);
    if (!is_taken(params.not_finite, now.radiance)) return false;
    bool moved = now.is_sky != before.is_sky;
    if (!moved && !now.is_sky) moved = distance(now.place, before.place) > LEAST_MOVE * distance(now.place, here.start.position);
    vec3 change = abs(now.radiance - before.radiance);
    vec3 most = max(now.radiance, before.radiance);
    bool changed = moved || max(change.r, max(change.g, change.b)) > LEAST_CHANGE * max(most.r, max(most.g, most.b));
    if (!moved) {
        now.place = before.place;
        now.normal = before.normal;
    }
    put_sample(lender.reservoir, now, eye);
    lender.reservoir.path &= ~255u;
    if (changed) lender.reservoir.confidence = pack_confidence(1u, 0u);
    return changed;
}

void validate_listed(ValidateParams params) {
    ViewBuffer view = ViewBuffer(params.view);
    ivec2 cell;
    if (listed_pixel(params.list, RAY_INVOCATION.xy, cell)) {
        uint index = grid_index(view, params.modes, cell);
        vec3 eye = view.at[0].eye;
        Random random = random_of(index, view.at[0].frame, view.at[0].seed ^ SALT_PATH_TEMPORAL);
        Borrower b;
        b.receiver = unpack_receiver(PathReceiverBuffer(params.receivers).at[index], eye);
        b.own = PathReservoirBuffer(params.samples).at[index];
        b.eye = eye;
        b.modes = params.modes;
        b.stretch = params.stretch;
        b.cap = params.cap;
        b.borrows_glossy = true;
        Lender lender = Lender(PathReservoirBuffer(params.resampled).at[index], b.receiver);
        uint most = confidence_of(lender.reservoir);
        bool changed = validate(view, params, b.receiver, lender);
        ChangeCounters tile = ChangeCounters(params.changes);
        uint at = tile_index(view, params.modes, cell);
        atomicAdd(tile.at[at].traced, 1u);
        if (changed) atomicAdd(tile.at[at].changed, 1u);
        PathReservoirBufferWrite(params.resampled).at[index] = merged_with(b, lender, most, params.not_finite, random);
    }
    count_rays(params.rays, paths_traced.x, paths_traced.y);
}

#endif
