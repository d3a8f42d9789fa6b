#version 460
#extension GL_GOOGLE_include_directive : require
#include "lib/bindless.glsl"
#include "lib/gbuffer.glsl"
#include "lib/tiles.glsl"
// The variance, blurred over 3x3 pixels: an estimate from few samples is itself noisy (Schied et al. 2017, section 4.3).
layout(local_size_x = 8, local_size_y = 8) in;
layout(push_constant, scalar) uniform Push { BlurVarianceParams params; };

void main() {
    ivec2 pixel = listed_pixel(params.list, gl_WorkGroupID.x, gl_LocalInvocationID.xy);
    if (!inside(pixel, params.size)) return;
    vec4 sum = vec4(0.0);
    float weights = 0.0;
    for (int y = -1; y <= 1; y++) {
        for (int x = -1; x <= 1; x++) {
            ivec2 at = pixel + ivec2(x, y);
            if (!inside(at, params.size)) continue;
            // A Gaussian: 1/4, 1/2, 1/4 in each direction.
            float weight = 1.0 / float((1 + abs(x)) * (1 + abs(y)));
            sum += weight * load(params.error, at);
            weights += weight;
        }
    }
    store(params.blurred, pixel, sum / weights);
}
