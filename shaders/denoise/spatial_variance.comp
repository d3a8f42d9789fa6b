#version 460
#extension GL_GOOGLE_include_directive : require
#include "lib/bindless.glsl"
#include "lib/guide.glsl"
#include "lib/noise_width.glsl"
#include "lib/signal.glsl"
// Where the history is too short for a temporal variance, uses the variance over the 7x7 pixels around on the same surface (Schied et al.
// 2017, section 4.2). Of samples that are kept from frame to frame the history of one pixel tells little for long: the mean of the temporal variances
// around stands in, which edges of the signal do not raise. Notes the tiles without any variance, which the levels then copy.
layout(local_size_x = 8, local_size_y = 8) in;
layout(push_constant, scalar) uniform Push { SpatialVarianceParams params; };

const int RADIUS = 3;
// History length, frames, from which on the temporal variance is used.
const float ENOUGH = 4.0;

shared uint varies;

// The same for samples that are alike over several frames.
float enough() {
    return ENOUGH * max(params.alike, 1.0);
}

// Of the pixels around.
struct Around {
    vec4 spatial;   // variance of the accumulated means, which are what is filtered
    vec4 temporal;  // mean of their variances
};

Around variance_around(ViewBuffer view, ivec2 pixel, Guide here, Signal own) {
    vec2 gradient = depth_gradient(view, pixel, here);
    // Starting with the pixel itself keeps the sum of weights at 1 or more.
    vec4 mean = compared(own.value, params.packing), squares = vec4(0.0), temporal = own.variance;
    float weights = 1.0;
    for (int y = -RADIUS; y <= RADIUS; y++) {
        for (int x = -RADIUS; x <= RADIUS; x++) {
            ivec2 at = pixel + ivec2(x, y);
            if (ivec2(x, y) == ivec2(0) || !inside(at, view.at[0].size)) continue;
            float weight = edge_weight(here, gradient, load_guide(params.guide, params.normals, at), vec2(x, y));
            if (!(weight > 0.0)) continue;
            Signal there = load_signal(params.accumulated, params.accumulated_deviation, at, params.packing);
            vec4 value = compared(there.value, params.packing);
            temporal += weight * there.variance;
            // Incremental weighted mean and sum of squares (West 1979, "Updating Mean and Variance Estimates").
            weights += weight;
            vec4 apart = value - mean;
            // As a square, since the product of the differences before and after the update may round to below 0.
            squares += weight * (1.0 - weight / weights) * apart * apart;
            mean += apart * (weight / weights);
        }
    }
    return Around(squares / weights, temporal / weights);
}

// The pixel's signal with its variance, which is stored. False if it has none.
bool vary(ViewBuffer view, ivec2 pixel) {
    Signal signal = load_signal(params.accumulated, params.accumulated_deviation, pixel, params.packing);
    vec4 frames = round(load(params.frames, pixel) * LONGEST);
    // Channels that the images do not have read as 0 frames.
    bvec4 short_one = bvec4(uvec4(lessThan(frames, vec4(enough()))) & uvec4(greaterThan(uvec4(params.channels), uvec4(0u, 1u, 2u, 3u))));
    if (params.packing == SIGNAL_RADIANCE) short_one = short_one.xxxx, frames = frames.xxxx;
    // Where there is no noise, differences between neighbours are edges.
    bvec4 noisy = bvec4(true);
    if (params.noise_width != NO_IMAGE) noisy = greaterThan(averaged_width(view, noise_width(params.noise_width, pixel, params.packing)), vec4(0.0));
    short_one = bvec4(uvec4(short_one) & uvec4(noisy));
    if (any(short_one)) {
        Guide here = load_guide(params.guide, params.normals, pixel);
        if (is_surface(here)) {
            Around around = variance_around(view, pixel, here, signal);
            // The estimate itself is noisy, so it is raised while the history is short.
            vec4 spatial = around.spatial * max(ENOUGH / max(frames, vec4(1.0)), vec4(1.0));
            signal.variance = mix(signal.variance, mix(around.temporal, spatial, lessThan(frames, vec4(ENOUGH))), short_one);
        }
    }
    signal.variance = mix(vec4(0.0), signal.variance, noisy);
    store_signal(params.signal, params.signal_deviation, pixel, params.packing, params.greatest, signal);
    // By !=, so that NaN counts as a variance too.
    return signal.variance != vec4(0.0);
}

void main() {
    ViewBuffer view = ViewBuffer(params.view);
    ivec2 pixel = ivec2(gl_GlobalInvocationID.xy);
    if (gl_LocalInvocationIndex == 0u) varies = 0u;
    barrier();
    if (inside(pixel, view.at[0].size) && vary(view, pixel)) varies = 1u;
    barrier();
    if (gl_LocalInvocationIndex == 0u) store(params.varied_tiles, ivec2(gl_WorkGroupID.xy), vec4(float(varies)));
}
