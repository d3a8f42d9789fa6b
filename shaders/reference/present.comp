#version 460
#extension GL_GOOGLE_include_directive : require
#include "lib/bindless.glsl"
#include "shared/reference.glsl"
// Converts three floats per pixel to an image, for later passes.
layout(local_size_x = 8, local_size_y = 8) in;
layout(push_constant, scalar) uniform Push { PresentParams params; };

void main() {
    uvec2 pixel = gl_GlobalInvocationID.xy;
    if (any(greaterThanEqual(pixel, params.size))) return;
    vec3 value = PositionBuffer(params.values).at[pixel.y * params.size.x + pixel.x];
    store(params.image, ivec2(pixel), vec4(value, 1.0));
}
