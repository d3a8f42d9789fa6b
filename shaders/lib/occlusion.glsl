#ifndef LIB_OCCLUSION_GLSL
#define LIB_OCCLUSION_GLSL
// Applies openness, the cosine-weighted unoccluded share of the hemisphere, to indirect light.

// Share of uniform light that reaches a diffuse surface, interreflections between occluders included: more than `openness`, and tinted by
// the albedo. It assumes occluders of the same albedo. Jimenez, Wu, Pesce and Jarabo 2016,
// "Practical Real-Time Strategies for Accurate Indirect Occlusion": a cubic fit, below which openness itself is the bound.
vec3 multi_bounce(float openness, vec3 albedo) {
    vec3 a = 2.0404 * albedo - 0.3324;
    vec3 b = 0.6417 - 4.7951 * albedo;
    vec3 c = 2.7552 * albedo + 0.6903;
    vec3 fit = ((a * openness + b) * openness + c) * openness;
    // Maximum by comparison, which keeps NaN.
    return mix(fit, vec3(openness), lessThan(fit, vec3(openness)));
}

// Share of a specular lobe that is unoccluded. Lagarde and de Rousiers 2014, "Moving Frostbite to Physically Based Rendering", section
// 4.10.2 and listing 26: an empirical curve, openness itself where the lobe is as wide as the hemisphere. Their `roughness` is alpha of GGX,
// the square of perceptual roughness, which they call linear roughness.
float specular_openness(float openness, float n_v, float alpha) {
    float share = pow(n_v + openness, exp2(-16.0 * alpha - 1.0)) - 1.0 + openness;
    share = share < 0.0 ? 0.0 : share;
    return share > 1.0 ? 1.0 : share;
}

#endif
