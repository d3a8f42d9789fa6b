#version 460
#extension GL_GOOGLE_include_directive : require
#include "lib/bindless.glsl"
#include "lib/colour.glsl"
#include "lib/gbuffer.glsl"
#include "lib/not_finite.glsl"
#include "shared/post.glsl"
// Radiance to display values: exposure, curve, sRGB encoding.
layout(local_size_x = 8, local_size_y = 8) in;
layout(push_constant, scalar) uniform Push { ToneMapParams params; };

void main() {
    ivec2 pixel = ivec2(gl_GlobalInvocationID.xy);
    if (!inside(pixel, params.size)) return;
    vec3 radiance = load(params.colour, pixel).rgb;
    // 8-bit formats have no NaN: such a pixel is black, and counted.
    vec3 colour = is_taken(params.not_finite, radiance) ? radiance * params.exposure : vec3(0.0);
    vec3 display = clamp(colour, 0.0, 1.0);
    if (params.curve == CURVE_AGX) display = agx(colour);
    if (params.curve == CURVE_ACES) display = aces(colour);
    store(params.display, pixel, vec4(srgb_encode(display), 1.0));
}
