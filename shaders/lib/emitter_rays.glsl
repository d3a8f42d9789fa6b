#ifndef LIB_EMITTER_RAYS_GLSL
#define LIB_EMITTER_RAYS_GLSL
#include "lib/lobe_rays.glsl"
#include "lib/sequence.glsl"
// Direct light of emissive surfaces, reflected once. Every ray goes either to a point of an emissive triangle or sphere, chosen by power, or along
// the specular lobe, weighted by the pdf of both strategies (Veach 1997, section 9.2.4: the one-sample model with the balance heuristic). With
// TINTED, surfaces may transmit light, as in lib/tinted.glsl.

vec3 emission_found(SceneBuffer scene, LightTables lights, Seen s, vec3 l, Hit hit, SurfacePoint met) {
    if (met.emission == vec3(0.0) || WordBuffer(lights.emitters).at[hit.instance] == NO_EMITTER) return vec3(0.0);
    float own = bsdf_pdf(s.bsdf, s.v, l, LOBE_SPECULAR);
    float other = emitter_pdf(scene, lights, hit, lit_point(s.start.position, s.around[2], false), met.start.position);
    float density = mix(other, own, s.lobe_probability);
    return density > 0.0 ? met.emission / density : vec3(0.0);
}

// A sample along the lobe.
Found found_by_lobe(SceneBuffer scene, LightTables lights, Seen s, vec2 u) {
    vec3 l;
    if (!sample_lobe(s, u, l)) return NOTHING_FOUND;
    float end;
    vec3 light = emission_along(scene, lights, s, l, end);
    return reflected_find(s, l, light, end);
}

// A sample of a point on an emitter.
Found found_by_emitter(SceneBuffer scene, LightTables lights, Seen s, vec2 which, vec2 u) {
    LightChoiceBuffer table = LightChoiceBuffer(lights.near);
    // The entry is chosen by 24 bits of the number.
    LightChoice choice = table.at[choose(table, lights.near_count, uint(which.x * 16777216.0) << 8u, which.y)];
    Incident from;
    if (!sample_emitter(scene, choice, s.start.position, u, from)) return NOTHING_FOUND;
    return arriving_find(scene, s, from, choice.probability * (1.0 - s.lobe_probability), s.lobe_probability);
}

// Light of one pixel.
void trace_emitters(EmitterParams params) {
    ViewBuffer view = ViewBuffer(params.view);
    ivec2 pixel = ivec2(RAY_INVOCATION.xy);
    if (!inside(pixel, view.at[0].size)) return;
    SceneBuffer scene = SceneBuffer(params.scene);
    LightTables lights = LightTablesBuffer(params.lights).at[0];
    Seen s = seen_nothing();
    Lobes sum = DARK;
    // Distances to what rays along the lobe meet, and to points of emitters, for pixels without such a ray.
    float met = INFINITELY_FAR, shown = INFINITELY_FAR;
    bool any_lobe = false;
    if (seen_at(view, scene, params.gbuffer, params.lobes, pixel, s)) {
        s.lobe_probability *= 0.5 * (1.0 - sqrt(narrowest_alpha(s.bsdf)));
        uint seed = view.at[0].seed;
        for (uint i = 0u; i < params.samples; i++) {
            uint index = view.at[0].frame * params.samples + i;
            vec2 u = sequence2(pixel, index, SEQUENCE_EMITTERS, seed);
            vec2 which = sequence2(pixel, index, SEQUENCE_EMITTERS + 1u, seed);
            bool by_lobe = sequence2(pixel, index, SEQUENCE_EMITTERS + 2u, seed).x < s.lobe_probability;
            Found found = by_lobe ? found_by_lobe(scene, lights, s, u)
                : found_by_emitter(scene, lights, s, which, u);
            sum = plus(sum, found.light);
            if (by_lobe) met = min(met, found.distance), any_lobe = true;
            else shown = min(shown, found.distance);
        }
        sum = scaled(sum, vec3(1.0 / float(params.samples)));
    }
    store_lobes(view, params.lobes, pixel, reflecting(view, s), sum, any_lobe ? met : shown);
    count_rays(params.rays, light_rays_traced.x, light_rays_traced.y);
}

#endif
