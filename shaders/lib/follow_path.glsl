#ifndef LIB_FOLLOW_PATH_GLSL
#define LIB_FOLLOW_PATH_GLSL
#include "lib/found_ray.glsl"
#include "lib/hit_shading.glsl"
#include "lib/path.glsl"
#ifdef SURFELS
#include "lib/surfel_cache.glsl"
#endif
// Indirect light along a ray, followed over some bounces. What lights and emissive surfaces send to the pixel directly is not in it: the slot
// `direct` has that. Paths end at surfaces whose indirect light surfels know, where there are any. With TINTED, surfaces may transmit light, as in
// lib/tinted.glsl; SURFELS: the paths are those of surfels; KEEPS_FIRST: `first_met` is what the last path met first.

// Counters: closest-hit and any-hit rays.
uvec2 paths_traced = uvec2(0u);

// At the last hit lights are sampled. For specular lobes with a brighter peak than this, BRDF times cosine in the mirror direction, that alone
// would be mostly noise: one more ray along them finds the sky, lights and what the previous frame shows, but no surface is shaded there. White
// paint has 1 / pi.
const float BRIGHT_PEAK = 4.0 / PI;

// The lobes along which a path goes on from its last hit. `v`: towards the viewer, local.
uint lobes_beyond(Bsdf b, vec3 v, uint lobes) {
    vec3 peak = bsdf_cosine(b, v, vec3(-v.xy, v.z), LOBE_SPECULAR);
    return max(peak.r, max(peak.g, peak.b)) > BRIGHT_PEAK ? lobes & LOBE_SPECULAR : 0u;
}

#ifdef KEEPS_FIRST
// The first surface that a path does not pass straight through.
struct FirstMet {
    bool exists;
    vec3 position;   // world, metres
    vec3 normal;     // geometric, on the side where the path came from
    bool is_glossy;  // see there
};

FirstMet first_met;

// Whether a surface sends much more light one way than others: straight back a lobe is brighter than white paint, 1 / pi, or it transmits.
bool is_glossy(Bsdf b) {
    vec3 f0 = b.fresnel.f0;
    float coat = b.coat * DIELECTRIC_F0;
    return b.transmission > 0.0 || max(f0.r, max(f0.g, f0.b)) > 4.0 * b.alpha * b.alpha || coat > 4.0 * b.coat_alpha * b.coat_alpha;
}
#endif

// How paths are followed.
struct Path {
    HitShadingParams hits;
    uint bounces;           // greatest number of surfaces that are shaded, at least 1
    float regularization;   // share of the spread so far that lobes have at least for small lights, 0 to 1
#ifdef SURFELS
    uvec2 pool;             // of surfels
    bool seeks_emitters;    // whether the path goes on from its last hit to find emissive surfaces near it
#endif
};

// Radiance along a ray that was sampled with a pdf, and the distance to what it hits first, metres.
vec3 follow(ViewBuffer view, SceneBuffer scene, Path path, Ray ray, float pdf, inout Random random, out float first_distance) {
    LightTables lights = LightTablesBuffer(path.hits.lights).at[0];
    vec3 radiance = vec3(0.0);
    vec3 throughput = vec3(1.0);
    LitPoint vertex = lit_point(ray.origin, vec3(0.0), false);
    vec3 absorption = vec3(0.0);
    uint bounce = 1u;
    bool ends = false;  // at surfels, which have all light but that of lamps and emissive surfaces
    // Lobes are at least so wide for small lights: where the ray starts, and where it ends.
    float least_alpha = 0.0;
    float next_least = path.regularization * alpha_of_pdf(pdf);
    first_distance = SKY_DISTANCE;
#ifdef KEEPS_FIRST
    first_met.exists = false;
#endif
    // Every turn is a bounce or passes a sheet.
    for (uint turn = 0u; turn < MOST_TURNS; turn++) {
        Hit hit;
#ifdef TINTED
        ray.cull |= RAY_BLENDED;
#endif
        paths_traced.x++;
        bool met = trace_closest(scene, ray, hit);
        vec3 direction = normalize(ray.direction);
        float t_max = hit.t * length(ray.direction);
        if (bounce > 1u) add_lights_met(radiance, throughput, scene, lights, ray, vertex, pdf, least_alpha, absorption, t_max, met, 0u);
        if (!met) {
            if (view.at[0].has_sky == 0u || ends) break;
            // The pixel itself does not sample the sky.
            if (bounce == 1u) radiance += throughput * sky_radiance(view.at[0].sky, direction);
            else add_sky_met(radiance, throughput, view, lights, direction, pdf, least_alpha, 0u);
            break;
        }
        SurfacePoint s = surface_at(scene, ray, hit, NO_FOOTPRINT);
        throughput *= exp(-absorption * t_max);
        uint lobes = LOBE_ALL;
#ifdef TINTED
        // Straight on past what a blended surface leaves uncovered, and through thin smooth glass, as shadow rays do.
        if (goes_straight_on(s, direction, random, throughput, lobes)) {
            ray = surface_ray(s.start, direction, UNBOUNDED);
            continue;
        }
#endif
        if (bounce == 1u) first_distance = min(distance(s.start.position, vertex.position), SKY_DISTANCE);
#ifdef KEEPS_FIRST
        if (bounce == 1u) first_met = FirstMet(true, s.start.position, s.start.normal, is_glossy(s.bsdf));
#endif
        // Emissive surfaces that rays of the pixel hit are direct light; unlit ones are lit by nothing, and not sampled.
        if (bounce > 1u) add_emission_met(radiance, throughput, scene, lights, s, hit, vertex, pdf, least_alpha, 0u);
        else if (s.black && !s.shows_light) radiance += throughput * s.emission;
        if (s.black) break;
        vec3 seen;
        if (s.emission == vec3(0.0) && previous_light_at(view, scene, path.hits, s, hit.instance, -direction, seen)) {
            radiance += throughput * seen;
            break;
        }
        if (bounce > path.bounces) break;
        vec3 indirect;
        SurfelLight found;
        ends = cached_light_at(view, scene, path.hits, s, -direction, indirect, found);
#ifdef SURFELS
        note_use(view, scene, path.pool, found, s.start, ray, hit);
#endif
        if (ends) {
            // They have the light of the sky too.
            lights.sky_count = 0u;
            radiance += throughput * indirect;
            bounce = path.bounces;
        }
        mat3 frame = frame_of(s.normal);
        vec3 v = -direction * frame;
        uint beyond = ends ? 0u : lobes_beyond(s.bsdf, v, lobes);
#ifdef SURFELS
        // Sampled points of emissive surfaces alone would be mostly noise where those are near.
        if (path.seeks_emitters) beyond = lobes;
#endif
        uint followed = bounce < path.bounces ? lobes : beyond;
        radiance += throughput * direct_light_at(view, scene, lights, s, -direction, lobes, followed, next_least, random, paths_traced);
        if (followed == 0u) break;

        vec4 u = random4(random);
        vec3 l;
        if (!bsdf_sample(s.bsdf, v, followed, u.x, u.yz, l)) break;
        vec3 next = frame * l;
        bool refracted = dot(s.start.normal, next) < 0.0;
        if (refracted != (l.z < 0.0)) break;
        pdf = bsdf_pdf(s.bsdf, v, l, followed);
        if (!(pdf > 0.0)) break;
        least_alpha = next_least;
        next_least = max(least_alpha, path.regularization * alpha_of_pdf(pdf));
        throughput *= bsdf_cosine(s.bsdf, v, l, followed) / pdf;
        if (refracted) absorption = s.absorption;
        bounce++;
        if (bounce + 1u >= ROULETTE_FROM) {
            float probability = continue_probability(throughput);
            if (u.w >= probability) break;
            throughput /= probability;
        }
        vertex = lit_surface(s);
        ray = surface_ray(s.start, next, UNBOUNDED);
    }
    return radiance;
}

#endif
