#version 460
#extension GL_GOOGLE_include_directive : require
#include "lib/bindless.glsl"
#include "lib/not_finite.glsl"
#include "lib/precision.glsl"
#include "shared/previous_radiance.glsl"
// Keeps the lit picture for the next frame.
layout(local_size_x = 8, local_size_y = 8) in;
layout(push_constant, scalar) uniform Push { KeepParams params; };

void main() {
    ivec2 pixel = ivec2(gl_GlobalInvocationID.xy);
    if (any(greaterThanEqual(uvec2(pixel), params.size))) return;
    vec3 radiance = load(params.radiance, pixel).rgb;
    bool known = is_taken(params.not_finite, radiance);
    store(params.kept, pixel, known ? vec4(representable(radiance, params.greatest), 1.0) : vec4(0.0));
}
