#version 460
#extension GL_GOOGLE_include_directive : require
#include "lib/bindless.glsl"
#include "lib/colour.glsl"
#include "lib/guide.glsl"
#include "lib/reach.glsl"
// Where the history is too short for a temporal variance, uses the variance over the 7x7 pixels around on the same surface (Schied et al.
// 2017, section 4.2).
layout(local_size_x = 8, local_size_y = 8) in;
layout(push_constant, scalar) uniform Push { SpatialVarianceParams params; };

const int RADIUS = 3;
// History length, frames, from which on the temporal variance is used.
const float ENOUGH = 4.0;

void main() {
    ViewBuffer view = ViewBuffer(params.view);
    if (gl_GlobalInvocationID.xy == uvec2(0u)) TilesBufferWrite(params.tiles).at[0] = Tiles(0u, 1u, 1u);
    ivec2 pixel = ivec2(gl_GlobalInvocationID.xy);
    if (!inside(pixel, view.at[0].size)) return;
    vec4 error = load(params.error, pixel);
    vec4 frames = round(load(params.frames, pixel) * LONGEST);
    Guide here = load_guide(params.guide, params.normals, pixel);
    // Channels that the images do not have read as 0 frames.
    bvec4 short_one = bvec4(uvec4(lessThan(frames, vec4(ENOUGH))) & uvec4(greaterThan(uvec4(params.channels), uvec4(0u, 1u, 2u, 3u))));
    // Outside of penumbrae there is no noise: differences between neighbours are edges.
    bvec4 noisy = bvec4(true);
    if (params.reach != NO_IMAGE) noisy = greaterThan(averaged_width(view, penumbra_around(params.reach, pixel)), vec4(0.0));
    short_one = bvec4(uvec4(short_one) & uvec4(noisy));
    if (is_surface(here) && any(short_one)) {
        vec2 gradient = depth_gradient(view, pixel, here);
        // Starting with the pixel itself keeps the sum of weights at 1 or more.
        vec4 own = load(params.accumulated, pixel);
        vec4 mean = params.radiance != 0u ? vec4(luminance(own.rgb)) : own, squares = vec4(0.0);
        float weights = 1.0;
        for (int y = -RADIUS; y <= RADIUS; y++) {
            for (int x = -RADIUS; x <= RADIUS; x++) {
                ivec2 at = pixel + ivec2(x, y);
                if (ivec2(x, y) == ivec2(0) || !inside(at, view.at[0].size)) continue;
                float weight = edge_weight(here, gradient, load_guide(params.guide, params.normals, at), vec2(x, y));
                if (!(weight > 0.0)) continue;
                vec4 there = load(params.accumulated, at);
                vec4 value = params.radiance != 0u ? vec4(luminance(there.rgb)) : there;
                // Incremental weighted mean and sum of squares (West 1979, "Updating Mean and Variance Estimates").
                weights += weight;
                vec4 apart = value - mean;
                // As a square, since the product of the differences before and after the update may round to below 0.
                squares += weight * (1.0 - weight / weights) * apart * apart;
                mean += apart * (weight / weights);
            }
        }
        // Variance of the accumulated means, which are what is filtered. The estimate itself is noisy, so it is raised while the history is
        // short.
        error = mix(error, squares / weights * (ENOUGH / max(frames, vec4(1.0))), short_one);
    }
    store(params.variance, pixel, mix(vec4(0.0), error, noisy));
}
