#ifndef LIB_PATH_GLSL
#define LIB_PATH_GLSL
#include "lib/light_sampling.glsl"
#include "lib/ray.glsl"
#include "lib/regularization.glsl"
#include "lib/surface.glsl"
#include "shared/reference.glsl"
#include "shared/view.glsl"
// Light that the rays of a path meet, for the reference and for effects that follow light over several bounces. The surfaces where rays
// begin sample lights too, so both are weighted (Veach 1997, chapter 9). All functions add to `radiance`, times `throughput`. `least_alpha`:
// of lib/regularization.glsl, where the direction was sampled.

// From this scattering on, paths end by Russian roulette (Arvo and Kirk 1990, "Particle Transport and Image Synthesis"). The first is at the
// surface that the camera sees.
const uint ROULETTE_FROM = 4u;

// Probability with which such a path goes on.
float continue_probability(vec3 throughput) {
    const float MOST = 0.95;
    return min(max(throughput.r, max(throughput.g, throughput.b)), MOST);
}

// Weight of light found by one strategy with pdf `own`, which the other one has with pdf `other`, both per steradian. `met`: found by a ray
// rather than by light sampling. `flags`: PATH_* bits that choose strategies; 0 for both, by the power heuristic.
float path_weight(float own, float other, bool met, uint flags) {
    if ((flags & PATH_NO_LIGHT_SAMPLES) != 0u) return 1.0;
    if ((flags & PATH_NO_LIGHT_HITS) != 0u) return met && other > 0.0 ? 0.0 : 1.0;
    return mis_weight(own, other, (flags & PATH_BALANCE) == 0u);
}

// Adds lights with a size that a ray meets before `t_max` metres; directional lights only if it hits nothing (`met` is false). Lights do
// not occlude. `vertex` is where the direction was sampled, with `pdf`: the ray may have begun anew since at surfaces that it passes
// straight through. `absorption`: per metre, of what is around the ray.
void add_lights_met(
    inout vec3 radiance, vec3 throughput, SceneBuffer scene, LightTables lights, Ray ray, vec3 vertex, float pdf, float least_alpha, vec3 absorption,
    float t_max, bool met, uint flags
) {
    vec3 direction = normalize(ray.direction);
    float begin = dot(ray.origin - vertex, direction);
    for (uint i = 0u; i < lights.area_count; i++) {
        AreaLight area = AreaLightBuffer(lights.areas).at[i];
        Light light = LightBuffer(scene.at[0].lights).at[area.light];
        bool is_far = light.kind == LIGHT_DIRECTIONAL;
        if (is_far && met) continue;
        float distance, other;
        vec3 light_radiance;
        if (!meet_light(light, vertex, direction, distance, light_radiance, other)) continue;
        if (!is_far && (distance < begin || (met && distance - begin > t_max))) continue;
        other *= area.probability;
        if (is_small(other, least_alpha)) continue;
        float weight = path_weight(pdf, other, true, flags);
        vec3 left = is_far ? vec3(1.0) : exp(-absorption * distance);
        radiance += throughput * left * light_radiance * weight;
    }
}

// Adds the sky in a unit direction.
void add_sky_met(
    inout vec3 radiance, vec3 throughput, ViewBuffer view, LightTables lights, vec3 direction, float pdf, float least_alpha, uint flags
) {
    float other = sky_pdf(lights, direction);
    if (is_small(other, least_alpha)) return;
    float weight = path_weight(pdf, other, true, flags);
    radiance += throughput * sky_radiance(view.at[0].sky, direction) * weight;
}

// Adds the emission of a surface that a ray hits, unless it depicts a light.
void add_emission_met(
    inout vec3 radiance, vec3 throughput, SceneBuffer scene, LightTables lights, SurfacePoint s, Hit hit, vec3 vertex, float pdf,
    float least_alpha, uint flags
) {
    if (s.shows_light || s.emission == vec3(0.0)) return;
    float other = emitter_pdf(scene, lights, hit, vertex, s.start.position);
    if (is_small(other, least_alpha)) return;
    radiance += throughput * s.emission * path_weight(pdf, other, true, flags);
}

#endif
