#ifndef LIB_SKY_LOBE_GLSL
#define LIB_SKY_LOBE_GLSL
#include "lib/gbuffer.glsl"
#include "lib/occlusion.glsl"
#include "lib/sky.glsl"

// Mean radiance of sky and ground over a surface's specular lobe, to be multiplied with the lobe's albedo, without the sun's disc, which is
// a light source of its own. `openness`: of ambient occlusion, 1 where there is none.
vec3 sky_in_lobe(ViewBuffer view, Surface s, float openness) {
    if (view.at[0].has_sky == 0u) return vec3(0.0);

    // A mirror reflects the sky itself, a fully rough lobe the cosine-weighted mean around its axis. In between the two are blended by
    // roughness, instead of a prefiltered sky: both ends are exact, the middle is partly too sharp and partly too smooth.
    vec3 axis = reflect(-s.to_eye, s.normal);
    Sky sky = view.at[0].sky;
    vec3 incident = mix(sky_radiance(sky, axis), sky_irradiance(sky, axis) / PI, s.roughness);

    // A normal map can turn the axis below the surface, which occludes it itself (Russell 2015, "Horizon Occlusion for Normal Mapped
    // Reflections").
    float horizon = clamp(1.0 + dot(axis, s.geometric_normal), 0.0, 1.0);
    float n_v = max(dot(s.normal, s.to_eye), 0.0);
    float reaches = min(s.occlusion, specular_openness(openness, n_v, s.roughness * s.roughness));
    return incident * (horizon * horizon * reaches);
}

// Light of sky and ground that the specular lobes of base and coat reflect towards the eye.
vec3 sky_reflected(ViewBuffer view, Surface s, float openness) {
    Bsdf b = bsdf_of(s);
    vec3 v = vec3(0.0, 0.0, eye_cosine(s));
    vec3 light = below_coat(b, v) * environment_brdf(b.fresnel, b.lobe) * sky_in_lobe(view, s, openness);
    if (s.coat > 0.0) {
        Surface coat = s;
        coat.roughness = s.coat_roughness;
        light += coat_albedo(b, v) * sky_in_lobe(view, coat, openness);
    }
    return light;
}

#endif
