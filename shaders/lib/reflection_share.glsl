#ifndef LIB_REFLECTION_SHARE_GLSL
#define LIB_REFLECTION_SHARE_GLSL
#include "lib/colour.glsl"
#include "lib/specular_albedo.glsl"
// How much of a reflection rays are worth.

// Share of the reflection that rays find, 0 to 1; the fallback has the rest. It falls to 0 over the last quarter below the roughness limit,
// and where the lobe's albedo is less than `faint`.
float traced_share(Surface s, float roughness_limit, float faint) {
    float roughness = s.coat > 0.0 ? min(s.roughness, s.coat_roughness) : s.roughness;
    float smooth_share = roughness_limit >= 1.0 ? 1.0 : 1.0 - smoothstep(0.75 * roughness_limit, roughness_limit, roughness);
    if (faint <= 0.0) return smooth_share;
    return smooth_share * smoothstep(0.75 * faint, faint, luminance(specular_albedo(s)));
}

#endif
