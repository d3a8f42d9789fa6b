#ifndef LIB_EMITTER_RAYS_GLSL
#define LIB_EMITTER_RAYS_GLSL
#include "lib/gbuffer.glsl"
#include "lib/hit_shading.glsl"
#include "lib/sequence.glsl"
#include "shared/direct.glsl"
// Direct light of emissive surfaces, reflected once, divided by the surface's albedo (`reflectance`). Every ray goes either to a point of
// an emissive triangle or sphere, chosen by power, or along the specular lobe, weighted by the pdf of both strategies (Veach 1997, section
// 9.2.4: the one-sample model with the balance heuristic). With TINTED, surfaces may transmit light, as in lib/tinted.glsl.

// Counters: closest-hit and any-hit rays.
uvec2 emitter_traced = uvec2(0u);

// A visible surface and its material. Local directions as in lib/bsdf.glsl.
struct Seen {
    RayStart start;
    mat3 around;
    vec3 v;
    Bsdf bsdf;
    float lobe_probability;  // probability of sampling the lobe: 0 for roughness 1, 1/2 for mirrors
};

// Contribution of a surface that a lobe ray has hit, without its coverage, which the caller applies.
vec3 found_by_lobe_at(SceneBuffer scene, LightTables lights, Seen s, vec3 l, Hit hit, SurfacePoint met) {
    if (met.emission == vec3(0.0) || WordBuffer(lights.emitters).at[hit.instance] == NO_EMITTER) return vec3(0.0);
    float own = bsdf_pdf(s.bsdf, s.v, l, LOBE_SPECULAR);
    float other = emitter_pdf(scene, lights, hit, s.start.position, met.start.position);
    float density = mix(other, own, s.lobe_probability);
    return density > 0.0 ? bsdf_cosine(s.bsdf, s.v, l, LOBE_DIFFUSE | LOBE_SPECULAR) * met.emission / density : vec3(0.0);
}

// A sample along the lobe. Surfaces in between that transmit light attenuate and tint what lies behind them, and emit by their coverage.
vec3 found_by_lobe(SceneBuffer scene, LightTables lights, Seen s, vec2 u) {
    vec3 l;
    bool above = sample_specular(s.bsdf, s.v, u, l);
    vec3 direction = s.around * l;
    if (!above || dot(s.start.normal, direction) <= 0.0) return vec3(0.0);
    Ray ray = surface_ray(s.start, direction, UNBOUNDED);
#ifdef TINTED
    // First ray to the nearest opaque surface, then on through all transmitting ones before it.
    ray.mask = INSTANCE_MASK_SOLID;
    vec3 behind = vec3(0.0);
    vec3 before = vec3(0.0);
    vec3 share = vec3(1.0);
    for (uint met = 0u;; met++) {
        Hit hit;
        emitter_traced.x++;
        bool found = trace_closest(scene, ray, hit);
        if (met > 0u && !found) return before + share * behind;
        // The limit of light_through.
        if (met > MOST_SHEETS) return before;
        float left = ray.t_max;
        if (found) {
            SurfacePoint p = surface_at(scene, ray, hit, NO_FOOTPRINT);
            vec3 light = found_by_lobe_at(scene, lights, s, l, hit, p);
            if (met == 0u) {
                behind = light;
                left = hit.t;
            } else {
                before += share * min(p.coverage, 1.0) * light;
                share *= surface_through(p, direction);
                if (share == vec3(0.0)) return before;
                ray = surface_ray(p.start, direction, ray.t_max - hit.t);
                left = ray.t_max;
            }
        }
        ray.t_max = left;
        ray.mask = INSTANCE_MASK_CLEAR;
        ray.cull |= RAY_UNTESTED;
    }
#else
    Hit hit;
    emitter_traced.x++;
    if (!trace_closest(scene, ray, hit) || WordBuffer(lights.emitters).at[hit.instance] == NO_EMITTER) return vec3(0.0);
    return found_by_lobe_at(scene, lights, s, l, hit, surface_at(scene, ray, hit, NO_FOOTPRINT));
#endif
}

// A sample of a point on an emitter.
vec3 found_by_emitter(SceneBuffer scene, LightTables lights, Seen s, vec2 which, vec2 u) {
    LightChoiceBuffer table = LightChoiceBuffer(lights.near);
    // The entry is chosen by 24 bits of the number.
    LightChoice choice = table.at[choose(table, lights.near_count, uint(which.x * 16777216.0) << 8u, which.y)];
    Incident from;
    if (!sample_emitter(scene, choice, s.start.position, u, from)) return vec3(0.0);
    vec3 l = from.direction * s.around;
    if (l.z <= 0.0 || dot(s.start.normal, from.direction) <= 0.0) return vec3(0.0);
    vec3 scattered = bsdf_cosine(s.bsdf, s.v, l, LOBE_DIFFUSE | LOBE_SPECULAR);
    if (scattered == vec3(0.0)) return vec3(0.0);
    vec3 share = seen_along(scene, surface_ray_to(s.start, s.start.position + from.distance * from.direction), emitter_traced);
    float other = s.lobe_probability * bsdf_pdf(s.bsdf, s.v, l, LOBE_SPECULAR);
    return share * scattered * from.radiance / (choice.probability * (1.0 - s.lobe_probability) + other / from.pdf);
}

// Radiance over albedo for one pixel.
vec3 emitter_radiance(ViewBuffer view, EmitterParams params, ivec2 pixel) {
    Surface surface = load_surface(view, pixel, params.gbuffer);
    if (!surface.exists) return vec3(0.0);
    Seen s;
    s.bsdf = bsdf_of(surface);
    bool has_lobe = reflects(surface);
    // Black, as unlit surfaces are: a metal with a black base colour.
    if (!has_lobe && (1.0 - surface.metalness) * surface.base_colour == vec3(0.0)) return vec3(0.0);
    SceneBuffer scene = SceneBuffer(params.scene);
    LightTables lights = LightTablesBuffer(params.lights).at[0];
    s.start = seen_start(scene, load_uint(params.gbuffer.ids, pixel).xy, view.at[0].eye, pixel_ray(view, pixel), surface.position);
    s.around = frame_of(surface.normal);
    s.v = surface.to_eye * s.around;
    s.v.z = eye_cosine(surface);
    s.lobe_probability = has_lobe ? 0.5 * (1.0 - sqrt(narrowest_alpha(s.bsdf))) : 0.0;
    uint seed = view.at[0].seed;
    vec3 sum = vec3(0.0);
    for (uint i = 0u; i < params.samples; i++) {
        uint index = view.at[0].frame * params.samples + i;
        vec2 u = sequence2(pixel, index, SEQUENCE_EMITTERS, seed);
        vec2 which = sequence2(pixel, index, SEQUENCE_EMITTERS + 1u, seed);
        bool by_lobe = sequence2(pixel, index, SEQUENCE_EMITTERS + 2u, seed).x < s.lobe_probability;
        sum += by_lobe ? found_by_lobe(scene, lights, s, u) : found_by_emitter(scene, lights, s, which, u);
    }
    return sum / (float(params.samples) * reflectance(s.bsdf, s.v.z));
}

#endif
