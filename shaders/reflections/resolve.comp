#version 460
#extension GL_GOOGLE_include_directive : require
#include "lib/bindless.glsl"
#include "lib/precision.glsl"
#include "lib/roughness_limit.glsl"
#include "lib/sky_lobe.glsl"
#include "shared/denoise.glsl"
#include "shared/reflections.glsl"
// Denoised radiance times the albedo that it was divided by, over the fallback.
layout(local_size_x = 8, local_size_y = 8) in;
layout(push_constant, scalar) uniform Push { ResolveParams params; };

vec3 fallback_at(ViewBuffer view, ivec2 pixel, Surface s) {
    if (params.fallback != NO_IMAGE) return load(params.fallback, pixel).rgb;
    return sky_reflected(view, s, params.openness == NO_IMAGE ? 1.0 : load(params.openness, pixel).r);
}

void main() {
    ViewBuffer view = ViewBuffer(params.view);
    ivec2 pixel = ivec2(gl_GlobalInvocationID.xy);
    if (!inside(pixel, view.at[0].size)) return;
    Surface s = load_surface(view, pixel, params.gbuffer);
    vec3 radiance = vec3(0.0);
    if (s.exists && reflects(s)) {
        float share = share_of_rays(s, params.roughness_limit, params.faint);
        if (share > 0.0) radiance = share * load(params.denoised, pixel).rgb * specular_albedo(s);
        if (share < 1.0) radiance += (1.0 - share) * fallback_at(view, pixel, s);
    }
    store(params.radiance, pixel, vec4(representable(radiance, params.greatest), 1.0));
}
