#ifndef LIB_REUSE_GLSL
#define LIB_REUSE_GLSL
#include "lib/resampling.glsl"
// Merging the reservoirs of light samples, lib/merging.glsl. They hold only samples that their pixel sees, but for those of WEIGHTS_BIASED.

// A pixel that lends its reservoir.
struct Lender {
    Reservoir reservoir;
    LitSurface surface;
    vec3 eye;            // of its frame
    bool before;         // whether it is one of the previous frame, with the lights that were there
    RayStart start;      // where its visibility is tested from
};

struct Borrower {
    SceneBuffer scene;
    LightTables lights;
    SampledPoint point;
    Reservoir own;
    float own_target;
    uint weights;        // WEIGHTS_*
    bool tests_all;      // whether samples are tested before they are merged
};

#include "lib/merging.glsl"

float target_here(Borrower b, Lender lender, out float j) {
    j = 1.0;
    Incident from;
    float target = target_of(b.scene, b.lights, b.point, lender.reservoir.light, lender.reservoir.point, from);
    return target > 0.0 && b.tests_all && !is_visible(b.scene, b.point.start, from) ? 0.0 : target;
}

bool sees_chosen(Borrower b, Stream s) {
    if (s.source == 0u || b.tests_all || b.weights == WEIGHTS_BIASED) return true;
    Incident from;
    target_of(b.scene, b.lights, b.point, s.chosen.light, s.chosen.point, from);
    return is_visible(b.scene, b.point.start, from);
}

// Target of a sample at a lender, unshadowed. `from`: the light that arrives there.
float unshadowed_target(Borrower b, Lender lender, Reservoir r, out Incident from) {
    return luminance(reflected_sample(b.scene, b.lights, sampled_point(lender.surface, lender.eye), r.light, r.point, lender.before, from));
}

float target_there(Borrower b, Lender lender) {
    Incident from;
    return unshadowed_target(b, lender, lender.reservoir, from);
}

float target_at_lender(Borrower b, Lender lender, Reservoir r) {
    Incident from;
    float target = unshadowed_target(b, lender, r, from);
    return target > 0.0 && is_visible(b.scene, lender.start, from) ? target : 0.0;
}

Reservoir finished(Borrower b, Stream s, float normalization, uint confidence) {
    return finished(s, normalization, confidence);
}

// Merges the pixel's reservoir with those of `others` lenders at most.
Reservoir merged(Borrower b, uint others, inout Random random) {
    return merged(b, stream_from(NO_RESERVOIR), others, b.weights, random);
}

#endif
