#version 460
#extension GL_GOOGLE_include_directive : require
#include "lib/bindless.glsl"
#include "lib/ray_rate.glsl"
// Where each pixel's reflection comes from, in false colours.
layout(local_size_x = 8, local_size_y = 8) in;
layout(push_constant, scalar) uniform Push { SourcesParams params; };

void main() {
    ivec2 pixel = ivec2(gl_GlobalInvocationID.xy);
    if (!inside(pixel, params.size)) return;
    uint rate = rate_at(params.rate, pixel);
    float found = load(params.found, pixel).a;
    vec3 colour = vec3(0.0);
    if (rate == RATE_FALLBACK) colour = vec3(0.1, 0.15, 0.5);
    // Rays of neighbours.
    if (rate >= RATE_SIXTEENTH) colour = mix(vec3(0.1, 0.2, 0.1), vec3(0.3, 0.45, 0.3), float(rate - RATE_SIXTEENTH) / 2.0);
    if (found > 0.0) colour = found == FOUND_ON_SCREEN ? vec3(1.0, 0.85, 0.2) : vec3(1.0, 0.25, 0.1);
    store(params.colours, pixel, vec4(colour, 1.0));
}
