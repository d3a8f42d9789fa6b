#ifndef LIB_TEMPORAL_REUSE_GLSL
#define LIB_TEMPORAL_REUSE_GLSL
#include "lib/reprojection.glsl"
#include "lib/reuse.glsl"
#include "lib/taps.glsl"
// Reuse of the reservoir that the previous frame had where it showed the surface.

// Greatest distance between the place of a pixel and that in the previous frame, over the distance from the eye: more is motion.
const float GREATEST_MOVE = 0.02;

Lender reuse_previous_lender;

bool lender_at(uint k, out Lender lender) {
    lender = reuse_previous_lender;
    return true;
}

// One of the pixels of the previous frame that showed the surface, each by its share. False if none did.
bool previous_pixel(ViewBuffer view, ResampleParams params, ivec2 pixel, float u, out ivec2 at) {
    vec2 was = vec2(pixel) - load(params.motion, pixel).xy * vec2(view.at[0].size);
    Taps taps = load_taps(params.taps, pixel, was);
    at = taps.first;
    if (!taps.any) return false;
    for (int k = 0; k < 4; k++) {
        if (taps.shares[k] == 0.0) continue;
        at = taps.first + ivec2(k & 1, k >> 1);
        if (u < taps.shares[k]) break;
        u -= taps.shares[k];
    }
    return inside(at, view.at[0].size);
}

void reuse_previous(ResampleParams params) {
    ViewBuffer view = ViewBuffer(params.view);
    ivec2 pixel = ivec2(RAY_INVOCATION.xy);
    if (!inside(pixel, view.at[0].size)) return;
    uint index = pixel_index(view, pixel);
    LitSurface surface = LitSurfaceBuffer(params.surfaces).at[index];
    Reservoir r = ReservoirBuffer(params.reservoirs).at[index];
    Random random = random_of(index, view.at[0].frame, view.at[0].seed ^ SALT_TEMPORAL);
    ivec2 before;
    if (is_lit(surface) && previous_pixel(view, params, pixel, random4(random).x, before)) {
        uint at = pixel_index(view, before);
        Lender lender;
        lender.surface = LitSurfaceBuffer(params.previous_surfaces).at[at];
        lender.reservoir = ReservoirBuffer(params.previous).at[at];
        lender.eye = view.at[0].previous_eye;
        lender.before = true;
        if (is_lit(lender.surface) && is_taken(params.not_finite, vec3(lender.reservoir.weight))) {
            uint confidence = min(confidence_of(lender.reservoir), params.cap);
            lender.reservoir.confidence = pack_confidence(confidence, age_of(lender.reservoir) + 1u);
            lender.start = RayStart(
                lender.eye + lender.surface.from_eye, octahedral_decode(unpackSnorm2x16(lender.surface.geometric_normal)), lender.surface.rounding
            );
            Borrower b;
            b.scene = SceneBuffer(params.scene);
            b.lights = LightTablesBuffer(params.lights).at[0];
            b.point = sampled_point(surface, view.at[0].eye);
            // Where the surface moved, the scene of this frame says nothing of what its old place saw.
            float moved = distance(lender.start.position, b.point.start.position);
            if (moved > GREATEST_MOVE * length(surface.from_eye)) lender.start = b.point.start;
            b.own = r;
            b.tests_all = params.tests_all != 0u;
            b.weights = params.weights;
            Incident from;
            b.own_target = target_of(b.scene, b.lights, b.point, r.light, r.point, from);
            reuse_previous_lender = lender;
            Reservoir all = merged(b, 1u, random);
            if (is_taken(params.not_finite, vec3(all.weight))) r = all;
        }
    }
    ReservoirBufferWrite(params.resampled).at[index] = r;
    count_rays(params.rays, resampling_traced.x, resampling_traced.y);
}

#endif
