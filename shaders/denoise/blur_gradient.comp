#version 460
#extension GL_GOOGLE_include_directive : require
#include "lib/bindless.glsl"
#include "lib/gbuffer.glsl"
#include "shared/denoise.glsl"
// Changes are found in few pixels: their mean over the 5x5 around, `step` apart. After the last blur it is the share of the history that
// is to be forgotten.
layout(local_size_x = 8, local_size_y = 8) in;
layout(push_constant, scalar) uniform Push { BlurGradientParams params; };

// Changes of this mean forget everything.
const float WHOLE_CHANGE = 0.08;
// What is left of one pixel out of 25 that saw an edge cross a pixel's centre is no change.
const float NO_CHANGE = 0.01;

void main() {
    ivec2 pixel = ivec2(gl_GlobalInvocationID.xy);
    if (!inside(pixel, params.size)) return;
    const float SPLINE[3] = float[](3.0 / 8.0, 1.0 / 4.0, 1.0 / 16.0);
    vec4 sum = vec4(0.0);
    float weights = 0.0;
    for (int y = -2; y <= 2; y++) {
        for (int x = -2; x <= 2; x++) {
            ivec2 at = pixel + ivec2(x, y) * int(params.step);
            if (!inside(at, params.size)) continue;
            float weight = SPLINE[abs(x)] * SPLINE[abs(y)];
            sum += weight * load(params.change, at);
            weights += weight;
        }
    }
    vec4 mean = sum / weights;
    if (params.is_last != 0u) mean = clamp((mean - NO_CHANGE) / (WHOLE_CHANGE - NO_CHANGE), 0.0, 1.0);
    store(params.blurred, pixel, mean);
}
