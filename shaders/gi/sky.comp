#version 460
#extension GL_GOOGLE_include_directive : require
#include "lib/bindless.glsl"
#include "lib/brdf.glsl"
#include "lib/gbuffer.glsl"
#include "lib/occlusion.glsl"
#include "lib/precision.glsl"
#include "lib/sky.glsl"
#include "shared/sky_light.glsl"
// Diffuse light of sky and ground, dimmed by the occlusion map or ambient occlusion, whichever is darker.
layout(local_size_x = 8, local_size_y = 8) in;
layout(push_constant, scalar) uniform Push { SkyLightParams params; };

vec3 shade(ViewBuffer view, ivec2 pixel) {
    if (view.at[0].has_sky == 0u) return vec3(0.0);
    Surface s = load_receiver(view, pixel, params.gbuffer);
    if (!s.exists) return vec3(0.0);
    // The minimum of occlusion map and ambient occlusion: both see the same folds, and their product would count them twice.
    vec3 reaches = vec3(s.occlusion);
    vec3 from = s.normal;
    if (params.openness != NO_IMAGE) {
        vec3 diffuse = (1.0 - s.metalness) * s.base_colour;
        reaches = min(reaches, multi_bounce(load(params.openness, pixel).r, diffuse));
    }
    if (params.bent_normal != NO_IMAGE) from = octahedral_decode(load(params.bent_normal, pixel).rg);
    return diffuse_albedo(s) * sky_irradiance(view.at[0].sky, from) * (reaches / PI);
}

void main() {
    ViewBuffer view = ViewBuffer(params.view);
    ivec2 pixel = ivec2(gl_GlobalInvocationID.xy);
    if (!inside(pixel, view.at[0].size)) return;
    store(params.radiance, pixel, vec4(representable(shade(view, pixel), params.greatest), 1.0));
}
