#ifndef LIB_ROUGHNESS_LIMIT_GLSL
#define LIB_ROUGHNESS_LIMIT_GLSL
#include "lib/colour.glsl"
#include "lib/gbuffer.glsl"
#include "lib/specular_albedo.glsl"
#include "shared/reflections.glsl"
// Reflections that are not worth their rays, because the surface is too rough or reflects too little. Something cheaper stands for them, the
// fallback.

// Perceptual roughness of the smoothest lobe, of base or coat.
float least_roughness(Surface s) {
    return s.coat > 0.0 ? min(s.roughness, s.coat_roughness) : s.roughness;
}

// 1 for smooth surfaces, falling to 0 from ROUGHNESS_FADE times the limit to the limit.
float below_roughness(float roughness, float limit) {
    return 1.0 - smoothstep(ROUGHNESS_FADE * limit, limit, roughness);
}

// Share of a surface's reflection that rays give, 0 to 1; the fallback has the rest. A limit of 1 is none. It falls to 0 as well where the
// albedo of the lobe falls below `faint`; 0 is no limit.
float share_of_rays(Surface s, float limit, float faint) {
    float share = 1.0;
    if (limit < 1.0) {
        float roughness = least_roughness(s);
        share = roughness < limit ? below_roughness(roughness, limit) : 0.0;
    }
    if (faint > 0.0 && share > 0.0) share *= smoothstep(ROUGHNESS_FADE * faint, faint, luminance(specular_albedo(s)));
    return share;
}

#endif
