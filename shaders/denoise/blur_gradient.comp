#version 460
#extension GL_GOOGLE_include_directive : require
#include "lib/bindless.glsl"
#include "lib/gbuffer.glsl"
#include "shared/denoise.glsl"
// Changes are measured in few pixels, so they are blurred over 5x5 texels, `step` apart. The last blur turns the mean into the share of the
// history to discard.
layout(local_size_x = 8, local_size_y = 8) in;
layout(push_constant, scalar) uniform Push { BlurGradientParams params; };

// A mean change from which on the whole history is discarded.
const float WHOLE_CHANGE = 0.08;
// A mean change up to which none is: one pixel out of 25 may see an edge cross a pixel's centre.
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
