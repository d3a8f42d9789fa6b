#ifndef LIB_PATH_GLSL
#define LIB_PATH_GLSL
#include "lib/lamp_walk.glsl"
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

// A ray that looks for lights, of unit direction.
struct Seeker {
    LitPoint vertex;   // where the direction was sampled; the ray may have begun anew since at surfaces that it passes straight through
    vec3 direction;
    float pdf;         // of the direction, per steradian
    float begin, end;  // metres from the vertex, of local lights that count
    float least_alpha;
    vec3 absorption;   // per metre, of what is around the ray
    uint flags;
};

// Light of one light, `index`, if the ray meets it. `entry`: in `LightTables::near`, of local lights. `probability`: of directional lights.
vec3 light_met(SceneBuffer scene, LightTables lights, Seeker seeker, uint index, uint entry, float probability) {
    Light light = LightBuffer(scene.at[0].lights).at[index];
    bool is_far = light.kind == LIGHT_DIRECTIONAL;
    float distance, other;
    vec3 radiance;
    if (!meet_light(light, seeker.vertex.position, seeker.direction, distance, radiance, other)) return vec3(0.0);
    if (!is_far && (distance < seeker.begin || distance > seeker.end)) return vec3(0.0);
    other *= is_far ? probability : near_probability(scene, lights, seeker.vertex, entry);
    if (is_small(other, seeker.least_alpha)) return vec3(0.0);
    vec3 left = is_far ? vec3(1.0) : exp(-seeker.absorption * distance);
    return left * radiance * path_weight(seeker.pdf, other, true, seeker.flags);
}

// Adds lights with a size that a ray meets before `t_max` metres; directional lights only if it hits nothing (`met` is false). Lights do
// not occlude. `vertex` is where the direction was sampled, with `pdf`: the ray may have begun anew since at surfaces that it passes
// straight through. `absorption`: per metre, of what is around the ray. Local lights are found by the light tree, if there is one, else one by
// one.
void add_lights_met(
    inout vec3 radiance, vec3 throughput, SceneBuffer scene, LightTables lights, Ray ray, LitPoint vertex, float pdf, float least_alpha,
    vec3 absorption, float t_max, bool met, uint flags
) {
    vec3 direction = normalize(ray.direction);
    float begin = dot(ray.origin - vertex.position, direction);
    float end = met ? begin + t_max : INFINITELY_FAR;
    Seeker seeker = Seeker(vertex, direction, pdf, begin, end, least_alpha, absorption, flags);
    AreaLightBuffer areas = AreaLightBuffer(lights.areas);
    vec3 sum = vec3(0.0);
    uint first = 0u;
    if (has_tree(lights)) {
        LightTree tree = LightTreeBuffer(lights.tree).at[0];
        LampWalk walk = lamp_walk(tree, vertex.position, direction, end);
        uint entry;
        while (next_lamp(tree, walk, entry)) sum += light_met(scene, lights, seeker, LightChoiceBuffer(lights.near).at[entry].light, entry, 0.0);
        first = lights.first_far_area;
    }
    uint count = met ? lights.first_far_area : lights.area_count;
    for (uint i = first; i < count; i++) {
        sum += light_met(scene, lights, seeker, areas.at[i].light, areas.at[i].entry, areas.at[i].probability);
    }
    radiance += throughput * sum;
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
    inout vec3 radiance, vec3 throughput, SceneBuffer scene, LightTables lights, SurfacePoint s, Hit hit, LitPoint vertex, float pdf,
    float least_alpha, uint flags
) {
    if (s.shows_light || s.emission == vec3(0.0)) return;
    float other = emitter_pdf(scene, lights, hit, vertex, s.start.position);
    if (is_small(other, least_alpha)) return;
    radiance += throughput * s.emission * path_weight(pdf, other, true, flags);
}

#endif
