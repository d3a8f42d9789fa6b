#ifndef LIB_ROUGHNESS_LIMIT_GLSL
#define LIB_ROUGHNESS_LIMIT_GLSL
#include "lib/gbuffer.glsl"
#include "lib/sky_lobe.glsl"
#include "lib/specular_albedo.glsl"
#include "shared/denoise.glsl"
#include "shared/reflections.glsl"
// Reflections that are left to the sky because the surface is too rough for rays to be worth their time.

// Perceptual roughness of the smoothest lobe, of base or coat.
float least_roughness(Surface s) {
    return s.coat > 0.0 ? min(s.roughness, s.coat_roughness) : s.roughness;
}

// 1 for smooth surfaces, falling to 0 from ROUGHNESS_FADE times the limit to the limit.
float below_roughness(float roughness, float limit) {
    return 1.0 - smoothstep(ROUGHNESS_FADE * limit, limit, roughness);
}

// Share of a surface's reflection that rays give, the sky having the rest. A limit of 1 is none: all of it then.
float share_of_rays(Surface s, float limit) {
    if (limit >= 1.0) return 1.0;
    float roughness = least_roughness(s);
    return roughness < limit ? below_roughness(roughness, limit) : 0.0;
}

// What the sky gives over the albedo of the specular lobe. `openness`: image of ambient occlusion, or NO_IMAGE.
vec3 sky_over_albedo(ViewBuffer view, Surface s, uint openness, ivec2 pixel) {
    float open = openness == NO_IMAGE ? 1.0 : load(openness, pixel).r;
    return sky_reflected(view, s, open) / specular_albedo(s);
}

#endif
