#version 460
#extension GL_GOOGLE_include_directive : require
#include "lib/bindless.glsl"
#include "lib/gbuffer.glsl"
#include "lib/precision.glsl"
#include "shared/compose.glsl"
// The sum of the lighting slots.
layout(local_size_x = 8, local_size_y = 8) in;
layout(push_constant, scalar) uniform Push { SumParams params; };

void main() {
    ivec2 pixel = ivec2(gl_GlobalInvocationID.xy);
    if (!inside(pixel, params.size)) return;
    vec3 radiance = load(params.direct, pixel).rgb;
    if (params.gi != NO_INPUT) radiance += load(params.gi, pixel).rgb;
    if (params.reflections != NO_INPUT) radiance += load(params.reflections, pixel).rgb;
    store(params.lit, pixel, vec4(representable(radiance, params.greatest), 1.0));
}
