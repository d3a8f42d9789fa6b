#version 460
#extension GL_GOOGLE_include_directive : require
#include "lib/bindless.glsl"
#include "lib/precision.glsl"
#include "lib/sky_lobe.glsl"
#include "shared/sky_light.glsl"
// Specular light of sky and ground.
layout(local_size_x = 8, local_size_y = 8) in;
layout(push_constant, scalar) uniform Push { SkyLightParams params; };

vec3 shade(ViewBuffer view, ivec2 pixel) {
    if (view.at[0].has_sky == 0u) return vec3(0.0);
    Surface s = load_receiver(view, pixel, params.gbuffer);
    if (!s.exists) return vec3(0.0);
    float openness = params.openness == NO_IMAGE ? 1.0 : load(params.openness, pixel).r;
    return sky_reflected(view, s, openness);
}

void main() {
    ViewBuffer view = ViewBuffer(params.view);
    ivec2 pixel = ivec2(gl_GlobalInvocationID.xy);
    if (!inside(pixel, view.at[0].size)) return;
    store(params.radiance, pixel, vec4(representable(shade(view, pixel), params.greatest), 1.0));
}
