#ifndef LIB_HIT_SHADING_GLSL
#define LIB_HIT_SHADING_GLSL
#include "lib/light_sampling.glsl"
#include "lib/previous_light.glsl"
#include "lib/random.glsl"
#include "lib/ray.glsl"
#include "lib/regularization.glsl"
#include "lib/surface.glsl"
#include "lib/surfels.glsl"
#ifdef TINTED
#include "lib/tinted.glsl"
#endif
#include "shared/hit_shading.glsl"
// Light that leaves a surface which a ray has hit: direct light by sampling every kind of light, or all light that the previous frame saw
// there. The reference samples lights with the same functions. With TINTED, surfaces may transmit light, as in lib/tinted.glsl.

// Rays have no end here, metres.
const float UNBOUNDED = 1e30;

// What a surface scatters of the light of one sample: BSDF times cosine for the directions `v` and `l`, both local to `frame`, whose third
// axis is the shading normal. False if nothing: the sample's direction lies on one side by the shading normal and on the other by the
// geometric normal, or the BSDF is 0.
bool scatter(RayStart start, Bsdf bsdf, mat3 frame, vec3 v, uint lobes, Incident from, out vec3 l, out vec3 scattered) {
    l = from.direction * frame;
    scattered = vec3(0.0);
    bool through = dot(start.normal, from.direction) < 0.0;
    if (through != (l.z < 0.0)) return false;
    scattered = bsdf_cosine(bsdf, v, l, lobes);
    return scattered != vec3(0.0);
}

// The shadow ray of a light sample.
Ray ray_towards(SurfacePoint s, Incident from) {
    return from.distance >= INFINITELY_FAR ? surface_ray(s.start, from.direction, UNBOUNDED)
        : surface_ray_to(s.start, s.start.position + from.distance * from.direction);
}

// Transmittance along a shadow ray, per colour channel. `traced`: closest-hit and any-hit rays.
vec3 seen_along(SceneBuffer scene, Ray ray, inout uvec2 traced) {
#ifdef TINTED
    float farthest;
    return light_through(scene, ray, MOST_SHEETS, traced, farthest);
#else
    traced.y++;
    return trace_any(scene, ray) ? vec3(0.0) : vec3(1.0);
#endif
}

// Direct light, the sky's included, that some lobes of a surface scatter towards `to_viewer`: one sample of each group of lights, of which
// one, chosen by its luminance before occlusion, gets a shadow ray. Unbiased: what is chosen is divided by the probability of that choice.
// `followed`: of these lobes a ray in a sampled direction finds the same light, so each of the two has its weight by the power heuristic. 0: none.
// `least_alpha`: of lib/regularization.glsl.
vec3 direct_light_at(
    ViewBuffer view, SceneBuffer scene, LightTables lights, SurfacePoint s, vec3 to_viewer, uint lobes, uint followed, float least_alpha,
    inout Random random, inout uvec2 traced
) {
    mat3 frame = frame_of(s.normal);
    vec3 v = to_viewer * frame;
    float choice = random4(random).x;
    float sum = 0.0;
    float chosen_luminance = 0.0;
    vec3 chosen_light = vec3(0.0);
    Incident chosen;
    for (uint group = 0u; group < LIGHT_GROUPS; group++) {
        if (lights_in(lights, group) == 0u) continue;
        Incident from;
        float probability;
        vec3 l, scattered;
        if (!sample_group(group, view, scene, lights, lit_surface(s), random_words(random), from, probability)) continue;
        bool small = from.pdf == 0.0 || is_small(probability * from.pdf, least_alpha);
        Bsdf bsdf = s.bsdf;
        if (small) bsdf = widened(scene.at[0].lobe_albedo, bsdf, least_alpha, v.z);
        if (!scatter(s.start, bsdf, frame, v, lobes, from, l, scattered)) continue;
        if (followed != 0u && !small) {
            vec3 shared_light = followed == lobes ? scattered : bsdf_cosine(s.bsdf, v, l, followed);
            float weight = mis_weight(probability * from.pdf, bsdf_pdf(s.bsdf, v, l, followed), true);
            scattered = max(scattered - (1.0 - weight) * shared_light, vec3(0.0));
        }
        vec3 light = scattered * from.radiance / probability;
        float luminance_here = luminance(light);
        if (!(luminance_here > 0.0)) continue;
        // Reservoir with room for one (Chao 1982, "A General Purpose Unequal Probability Sampling Plan"); the random number is rescaled.
        sum += luminance_here;
        float share = luminance_here / sum;
        if (choice < share) {
            choice /= share;
            chosen = from;
            chosen_light = light;
            chosen_luminance = luminance_here;
        } else {
            choice = (choice - share) / (1.0 - share);
        }
    }
    if (chosen_luminance == 0.0) return vec3(0.0);
    return chosen_light * (sum / chosen_luminance) * seen_along(scene, ray_towards(s, chosen), traced);
}

// Albedo of a surface for light towards `to_viewer`, unit.
vec3 albedo_towards(SceneBuffer scene, SurfacePoint s, vec3 to_viewer) {
    float n_v = max(dot(s.normal, to_viewer), 1e-4);
    return reflectance(towards_viewer(scene.at[0].lobe_albedo, s.bsdf, n_v), n_v);
}

// All light that a surface sends towards `to_viewer`, from what it sent to the camera one frame ago, by the ratio of its albedos in both
// directions. False where the camera did not see it, or if it is too smooth for that.
bool previous_light_at(
    ViewBuffer view, SceneBuffer scene, HitShadingParams p, SurfacePoint s, uint instance, vec3 to_viewer, out vec3 light
) {
    light = vec3(0.0);
    if (p.previous_radiance == NO_IMAGE || narrowest_alpha(s.bsdf) < LEAST_REUSED_ALPHA) return false;
    PlaceBefore before;
    if (!place_before(view, scene, instance, s.start.position, before)) return false;
    ivec2 pixel = ivec2(floor(before.pixels));
    if (!showed(view, p.previous_guide, pixel, instance, s.start.normal, before.depth)) return false;
    vec4 found = load(p.previous_radiance, pixel);
    vec3 to_previous_eye = safe_normalize(view.at[0].previous_eye - before.position, s.normal);
    light = found.rgb * albedo_towards(scene, s, to_viewer) / albedo_towards(scene, s, to_previous_eye);
    return found.a > 0.0;
}

// What a surface scatters of the indirect light that reaches it, the sky's included, as if it were diffuse, from the surfels around it. False where
// no surfels know it, and for surfaces too smooth for that. `found`: what surfels say of the place; `full` where none were asked.
bool cached_light_at(ViewBuffer view, SceneBuffer scene, HitShadingParams p, SurfacePoint s, vec3 to_viewer, out vec3 light, out SurfelLight found) {
    light = vec3(0.0);
    found = SurfelLight(false, false, true, vec3(0.0), 0.0, 0.0, -1.0, 0u);
    if (p.cache == uvec2(0u) || narrowest_alpha(s.bsdf) < LEAST_REUSED_ALPHA) return false;
    found = surfel_lookup(SurfelGridBuffer(p.cache).at[0], view.at[0].eye, s.start.position, s.start.normal, s.normal);
    if (!found.exists || !found.known) return false;
    light = albedo_towards(scene, s, to_viewer) * found.light;
    return true;
}

// Light that a hit sends back along a ray.
struct HitLight {
    vec3 emitted;
    vec3 scattered;
};

// Shades a hit. Emission is apart, for effects beside which emissive surfaces are sampled as lights: what the previous frame saw of a
// surface that emits contains both, and is not used. `direction`: of the ray, unit.
HitLight shade_hit(ViewBuffer view, SceneBuffer scene, HitShadingParams p, Hit hit, SurfacePoint s, vec3 direction, inout Random random, inout uvec2 traced) {
    HitLight light = HitLight(s.emission, vec3(0.0));
    if (s.black) return light;
    if (s.emission == vec3(0.0) && previous_light_at(view, scene, p, s, hit.instance, -direction, light.scattered)) return light;
    LightTables lights = LightTablesBuffer(p.lights).at[0];
    vec3 indirect;
    SurfelLight found;
    // Surfels have the light of the sky too.
    if (cached_light_at(view, scene, p, s, -direction, indirect, found)) lights.sky_count = 0u;
    light.scattered = indirect + direct_light_at(view, scene, lights, s, -direction, LOBE_ALL, 0u, 0.0, random, traced);
    return light;
}

#endif
