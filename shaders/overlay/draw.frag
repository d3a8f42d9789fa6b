#version 460
#extension GL_GOOGLE_include_directive : require
#include "lib/bindless.glsl"
#include "shared/overlay.glsl"
// Colour times image, inside of the mesh's rectangle. Display values are blended as they are, as user interfaces expect.
layout(push_constant, scalar) uniform Push { OverlayParams params; };

layout(location = 0) in vec2 uv;
layout(location = 1) in vec4 colour;

layout(location = 0) out vec4 result;       // display values times alpha, and alpha

void main() {
    vec2 at = gl_FragCoord.xy;
    if (any(lessThan(at, params.clip.xy)) || any(greaterThanEqual(at, params.clip.zw))) discard;
    vec4 texel = sample_bilinear(params.image, params.sampler_id, uv);
    if (params.is_opaque != 0u) texel.a = 1.0;
    result = colour * texel;
}
