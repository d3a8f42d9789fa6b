#ifndef LIB_SURFEL_CHANGE_GLSL
#define LIB_SURFEL_CHANGE_GLSL
#include "lib/colour.glsl"
#include "lib/surfel_estimator.glsl"
#include "lib/surfels.glsl"
// Changes of light. What one surfel finds is too noisy to tell a lamp that went out from a few dark directions. Many surfels together tell: the
// differences of their newest light from their means, each over its own standard deviation, have a mean of 0 while nothing changes.

layout(buffer_reference, scalar, buffer_reference_align = 4) buffer SurfelChanges { SurfelChange at[]; };

// Samples from which on a surfel has a say.
const float HAS_SAY = 4.0;
// Standard errors that count as a change, as few as chance reaches in hardly any place in hundreds of frames; more where few surfels are asked.
const float CHANGED = 3.5;
const float CHANGED_FEW = 10.0;
// Tests: 0 of luminance by the newest samples, then of colour by the same, and of luminance over a longer window.
const uint COLOUR = 1u;
const uint SHORT = 2u;
// What a test of colour has found counts for so much: single channels differ by chance more often, from surfel to surfel alike.
const float OF_COLOUR = 0.7;
// Standard errors beyond which a surfel counts no more.
const float FARTHEST = 16.0;
// Shares of all surfels whose light has clearly changed of late between which a change anywhere is ever likelier.
const vec2 CHANGES_ELSEWHERE = vec2(0.005, 0.05);

// How likely the light changes anywhere, by how many surfels have noticed it: 0 to 1.
float change_elsewhere(SurfelCounts counts) {
    return smoothstep(CHANGES_ELSEWHERE.x, CHANGES_ELSEWHERE.y, float(counts.changed[1]) / float(max(counts.live, 1u)));
}

// Where the changes of a surfel's cell and block are.
uvec2 change_places(SurfelGrid grid, vec3 from_eye) {
    int level = cell_level(length(from_eye));
    ivec3 cell = cell_of(grid, from_eye, level);
    ivec3 block = ivec3(floor(vec3(cell) / float(CHANGE_BLOCK)));
    return uvec2(cell_index(grid, cell, level), grid.cell_mask + 1u + cell_index(grid, block, level + 256));
}

// Light of late: of `Estimator::newest`, or of `Estimator::short_mean`, which tells of lesser changes later.
vec3 light_of_late(Estimator e, uint test) {
    return test == SHORT ? vec3(e.short_mean) : vec3(e.newest);
}

// How far the light of late is from the mean, in standard errors. Luminance misses most of a change of colour: a test of its own looks at red and at blue, frame
// by frame in turn.
float change_of(Estimator e, uint test, uint frame) {
    vec3 channels = test != COLOUR ? LUMINANCE : (frame & 1u) == 0u ? vec3(1.0, 0.0, 0.0) : vec3(0.0, 0.0, 1.0);
    float share = test == SHORT ? SHORT_WINDOW : share_of_newest(e);
    float mean = dot(channels, vec3(e.mean));
    float deviation = dot(channels, sqrt(max(vec3(e.variance), 0.0))) + 0.02 * mean;
    float apart = dot(channels, light_of_late(e, test)) - mean;
    float error = deviation * sqrt(share / (2.0 - share) + noise_of_mean(e));
    return apart == 0.0 ? 0.0 : clamp(apart / max(error, 1e-30), -FARTHEST, FARTHEST);
}

// Standard errors by which the surfels of a place differ from their means, over those that count as a change: beyond 1 it is one. Errors are the
// greater of what the variance of samples gives, and of what the differences scatter.
float change_at(SurfelChange c) {
    if (c.count == 0u) return 0.0;
    float count = float(c.count);
    float sum = float(c.sum) / 256.0;
    float scatter = float(c.squares) / 64.0 - sum * sum / count;
    return sum / ((CHANGED + CHANGED_FEW / count) * sqrt(max(count, scatter)));
}

#endif
