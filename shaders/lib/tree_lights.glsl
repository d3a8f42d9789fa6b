#ifndef LIB_TREE_LIGHTS_GLSL
#define LIB_TREE_LIGHTS_GLSL
#include "lib/lamp_walk.glsl"
#include "lib/lobe_rays.glsl"
#include "lib/not_finite.glsl"
#include "lib/sequence.glsl"
#include "shared/direct.glsl"
// Direct light of local lights and emissive surfaces, reflected once: one light of each cluster into
// which the light tree is split, with a shadow ray, and a ray along the specular lobe of smooth surfaces. What either finds has its weight by the
// balance heuristic (Veach 1997, section 9.2.4: the multi-sample model). With TINTED, surfaces may transmit light, as in lib/tinted.glsl.

// From one cluster to the next, of the numbers that choose a point of its light.
const vec2 POINT_STEP = vec2(0.754878, 0.569840);

// Whether any surface is so smooth that there is a ray along its lobe.
layout(constant_id = 2) const bool HAS_LOBE_RAYS = true;

// What the pixel's lights are chosen by.
LightTree pixel_tree;
LightCut pixel_cut;

LitPoint lit_point_of(Seen s) {
    return lit_point(s.start.position, s.around[2], false);
}

// Light that a ray along the lobe has found, over the density of both ways. `pdf`: of sampling that direction by the light with this entry, once it is
// chosen.
vec3 over_density(SceneBuffer scene, LightTables lights, Seen s, vec3 l, vec3 radiance, uint entry, float pdf) {
    float probability = pixel_cut.count > 0u ? trail_probability(scene, pixel_tree, lights, entry, lit_point_of(s), pixel_cut) : 0.0;
    float density = bsdf_pdf(s.bsdf, s.v, l, LOBE_SPECULAR) + probability * pdf;
    return density > 0.0 ? radiance / density : vec3(0.0);
}

vec3 emission_found(SceneBuffer scene, LightTables lights, Seen s, vec3 l, Hit hit, SurfacePoint met) {
    uint first = WordBuffer(lights.emitters).at[hit.instance];
    if (met.emission == vec3(0.0) || first == NO_EMITTER) return vec3(0.0);
    float pdf = hit_emitter_pdf(scene, hit, s.start.position, met.start.position);
    return over_density(scene, lights, s, l, met.emission, first + hit.primitive, pdf);
}

// Lamps that the ray meets before `end`, over their density. They occlude nothing. `nearest`: distance to the first, or to the end.
vec3 lamps_along(SceneBuffer scene, LightTables lights, Seen s, vec3 l, float end, out float nearest) {
    vec3 direction = s.around * l;
    vec3 position = s.start.position;
    vec3 sum = vec3(0.0);
    nearest = end;
    LampWalk walk = lamp_walk(pixel_tree, position, direction, end);
    uint entry;
    while (next_lamp(pixel_tree, walk, entry)) {
        Light lamp = LightBuffer(scene.at[0].lights).at[LightChoiceBuffer(lights.near).at[entry].light];
        float distance, pdf;
        vec3 radiance;
        if (!meet_light(lamp, position, direction, distance, radiance, pdf) || distance > end) continue;
        nearest = min(nearest, distance);
#ifdef TINTED
        radiance *= seen_along(scene, surface_ray_to(s.start, position + distance * direction), light_rays_traced);
#endif
        sum += over_density(scene, lights, s, l, radiance, entry, pdf);
    }
    return sum;
}

// A sample along the lobe.
Found found_by_lobe(SceneBuffer scene, LightTables lights, Seen s, vec2 u) {
    vec3 l;
    if (!sample_lobe(s, u, l)) return NOTHING_FOUND;
    float end, nearest;
    vec3 light = emission_along(scene, lights, s, l, end);
    light += lamps_along(scene, lights, s, l, end, nearest);
    return reflected_find(s, l, light, nearest);
}

// A sample of one light of a cluster. `which`: chooses the light; `u`: its point.
Found found_in_cluster(SceneBuffer scene, LightTables lights, Seen s, LightCluster cluster, vec2 which, vec2 u) {
    float probability;
    uint entry = choose_in_cluster(scene, pixel_tree, lit_point_of(s), cluster, which, probability);
    LightChoice choice = LightChoiceBuffer(lights.near).at[entry];
    Incident from;
    bool found = choice.light == CHOICE_EMITTER ? sample_emitter(scene, choice, s.start.position, u, from)
        : sample_sized_light(LightBuffer(scene.at[0].lights).at[choice.light], s.start.position, u, from);
    return found ? arriving_find(scene, s, from, probability, s.lobe_probability) : NOTHING_FOUND;
}

// Light of one pixel.
void light_pixel(TreeLightParams params) {
    ViewBuffer view = ViewBuffer(params.view);
    ivec2 pixel = ivec2(RAY_INVOCATION.xy);
    if (!inside(pixel, view.at[0].size)) return;
    SceneBuffer scene = SceneBuffer(params.scene);
    LightTables lights = LightTablesBuffer(params.lights).at[0];
    Seen s = seen_nothing();
    Lobes sum = DARK;
    // To what a ray along the lobe has met, or without one to the light of which most is reflected by the specular lobes.
    float distance = INFINITELY_FAR;
    if (seen_at(view, scene, params.gbuffer, params.lobes, pixel, s)) {
        if (!HAS_LOBE_RAYS || narrowest_alpha(s.bsdf) >= params.widest_alpha) s.lobe_probability = 0.0;
        pixel_tree = LightTreeBuffer(params.tree).at[0];
        light_cut(scene, pixel_tree, lit_point_of(s), params.split, pixel_cut);
        uint frame = view.at[0].frame;
        uint seed = view.at[0].seed;
        vec2 u = sequence2(pixel, frame, SEQUENCE_EMITTERS, seed);
        vec2 which = sequence2(pixel, frame, SEQUENCE_EMITTERS + 1u, seed);
        float most = 0.0;
        for (uint i = 0u; i < pixel_cut.count; i++) {
            vec2 own = fract(which + float(i) * CLUSTER_STEP);
            Found found = found_in_cluster(scene, lights, s, pixel_cut.clusters[i], own, fract(u + float(i) * POINT_STEP));
            sum = plus(sum, found.light);
            float shown = luminance(found.light.specular);
            if (shown > most) most = shown, distance = found.distance;
        }
        if (HAS_LOBE_RAYS && s.lobe_probability > 0.0) {
            Found found = found_by_lobe(scene, lights, s, sequence2(pixel, frame, SEQUENCE_EMITTERS + 2u, seed));
            sum = plus(sum, found.light);
            distance = found.distance;
        }
        if (!is_taken(params.not_finite, sum.diffuse + sum.specular)) sum = DARK;
    }
    store_lobes(view, params.lobes, pixel, reflecting(view, s), sum, distance);
    count_rays(params.rays, light_rays_traced.x, light_rays_traced.y);
}

#endif
