#version 460
#extension GL_GOOGLE_include_directive : require
#include "lib/bindless.glsl"
#include "lib/gbuffer.glsl"
#include "shared/post.glsl"
// Resizes the picture bilinearly.
layout(local_size_x = 8, local_size_y = 8) in;
layout(push_constant, scalar) uniform Push { UpscaleParams params; };

void main() {
    ivec2 pixel = ivec2(gl_GlobalInvocationID.xy);
    if (!inside(pixel, params.size)) return;
    vec2 uv = (vec2(pixel) + 0.5) / vec2(params.size);
    store(params.radiance, pixel, vec4(sample_bilinear(params.colour, params.sampler_id, uv).rgb, 1.0));
}
