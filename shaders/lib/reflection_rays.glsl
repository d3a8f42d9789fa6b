#ifndef LIB_REFLECTION_RAYS_GLSL
#define LIB_REFLECTION_RAYS_GLSL
#include "lib/gbuffer.glsl"
#include "lib/hit_shading.glsl"
#include "lib/path.glsl"
#include "lib/sequence.glsl"
#include "lib/specular_albedo.glsl"
#include "shared/reflections.glsl"
// Specular indirect light by rays: directions of visible normals of GGX (Heitz 2018, "Sampling the GGX Distribution of Visible Normals"),
// each followed over some bounces. What lights and emissive surfaces send to the pixel directly is not in it: the slot `direct` has that.
// With TINTED, surfaces may transmit light, as in lib/tinted.glsl.

// Counters: closest-hit and any-hit rays.
uvec2 reflections_traced = uvec2(0u);

// From this bounce on, paths end by Russian roulette, with this greatest probability to continue.
const uint ROULETTE_FROM = 3u;
const float MAX_CONTINUE_PROBABILITY = 0.95;
// At the last hit lights are sampled and no ray follows. For lobes narrower than this alpha that would be mostly noise: there the sky
// stands for what they reflect.
const float NARROW_ALPHA = 0.05;
// Distance of what is infinitely far, metres: the greatest number of 16-bit floats.
const float SKY_DISTANCE = 65504.0;

// Light that the last surface of a path sends back: lights sampled, and the sky in place of further bounces of a narrow lobe.
vec3 light_at_the_end(ViewBuffer view, SceneBuffer scene, LightTables lights, SurfacePoint s, vec3 to_viewer, uint lobes, inout Random random) {
    vec3 light = vec3(0.0);
    if (widest_alpha(s.bsdf) < NARROW_ALPHA) {
        lobes &= ~LOBE_SPECULAR;
        if (view.at[0].has_sky != 0u) {
            light = specular_albedo(s.bsdf, max(dot(s.normal, to_viewer), 1e-4)) * sky_radiance(view.at[0].sky, reflect(-to_viewer, s.normal));
        }
    }
    return light + direct_light_at(view, scene, lights, s, to_viewer, lobes, false, random, reflections_traced);
}

// Radiance along a ray that was sampled with a pdf, and the distance to what it hits first, metres.
vec3 follow(ViewBuffer view, SceneBuffer scene, TraceParams params, Ray ray, float pdf, inout Random random, out float first_distance) {
    LightTables lights = LightTablesBuffer(params.hits.lights).at[0];
    vec3 radiance = vec3(0.0);
    vec3 throughput = vec3(1.0);
    vec3 vertex = ray.origin;
    vec3 absorption = vec3(0.0);
    uint bounce = 1u;
    first_distance = SKY_DISTANCE;
    // Every turn is a bounce or passes a sheet.
    for (uint turn = 0u; turn < MOST_TURNS; turn++) {
        Hit hit;
        reflections_traced.x++;
        bool met = trace_closest(scene, ray, hit);
        vec3 direction = normalize(ray.direction);
        float t_max = hit.t * length(ray.direction);
        if (bounce > 1u) add_lights_met(radiance, throughput, scene, lights, ray, vertex, pdf, absorption, t_max, met, 0u);
        if (!met) {
            if (view.at[0].has_sky == 0u) break;
            // The pixel itself does not sample the sky.
            if (bounce == 1u) radiance += throughput * sky_radiance(view.at[0].sky, direction);
            else add_sky_met(radiance, throughput, view, lights, direction, pdf, 0u);
            break;
        }
        SurfacePoint s = surface_at(scene, ray, hit, NO_FOOTPRINT);
        throughput *= exp(-absorption * t_max);
        uint lobes = LOBE_ALL;
#ifdef TINTED
        // Straight on past what a blended surface leaves uncovered, and through thin smooth glass, as shadow rays do.
        bool passes = s.coverage < 1.0 && random4(random).x >= s.coverage;
        if (!passes) {
            vec3 through = solid_through(s, direction);
            float probability = max(through.r, max(through.g, through.b));
            if (probability > 0.0) {
                passes = random4(random).x < probability;
                throughput *= passes ? through / probability : vec3(1.0 / (1.0 - probability));
                lobes &= ~LOBE_TRANSMISSION;
            }
        }
        if (passes) {
            ray = surface_ray(s.start, direction, UNBOUNDED);
            continue;
        }
#endif
        if (bounce == 1u) first_distance = min(distance(s.start.position, vertex), SKY_DISTANCE);
        // Emissive surfaces that rays of the pixel hit are direct light; unlit ones are lit by nothing, and not sampled.
        if (bounce > 1u) add_emission_met(radiance, throughput, scene, lights, s, hit, vertex, pdf, 0u);
        else if (s.black) radiance += throughput * s.emission;
        if (s.black) break;
        vec3 seen;
        if (s.emission == vec3(0.0) && previous_light_at(view, scene, params.hits, s, hit.instance, -direction, seen)) {
            radiance += throughput * seen;
            break;
        }
        if (bounce == params.bounces) {
            radiance += throughput * light_at_the_end(view, scene, lights, s, -direction, lobes, random);
            break;
        }
        radiance += throughput * direct_light_at(view, scene, lights, s, -direction, lobes, true, random, reflections_traced);

        mat3 frame = frame_of(s.normal);
        vec3 v = -direction * frame;
        vec4 u = random4(random);
        vec3 l;
        if (!bsdf_sample(s.bsdf, v, lobes, u.x, u.yz, l)) break;
        vec3 next = frame * l;
        bool refracted = dot(s.start.normal, next) < 0.0;
        if (refracted != (l.z < 0.0)) break;
        pdf = bsdf_pdf(s.bsdf, v, l, lobes);
        if (!(pdf > 0.0)) break;
        throughput *= bsdf_cosine(s.bsdf, v, l, lobes) / pdf;
        if (refracted) absorption = s.absorption;
        bounce++;
        if (bounce >= ROULETTE_FROM) {
            float probability = min(max(throughput.r, max(throughput.g, throughput.b)), MAX_CONTINUE_PROBABILITY);
            if (u.w >= probability) break;
            throughput /= probability;
        }
        vertex = s.start.position;
        ray = surface_ray(s.start, next, UNBOUNDED);
    }
    return radiance;
}

// What the rays of a pixel found.
struct Reflected {
    vec3 radiance;   // over the albedo of the lobe (`specular_albedo`)
    float distance;  // of the nearest hit, metres
    float width;     // of the lobe on the screen, pixels: the neighbours within it reflect the same things
};

// Width on the screen of what a lobe reflects at some distance: seen from the eye, the lobe's cone behind the surface is as wide as this.
float lobe_width(ViewBuffer view, Surface s, float alpha, float hit_distance) {
    float eye_distance = distance(s.position, view.at[0].eye);
    float share = hit_distance / (hit_distance + eye_distance);
    return 2.0 * alpha * share / pixel_spread(view);
}

Reflected reflected_at(ViewBuffer view, TraceParams params, ivec2 pixel) {
    Reflected found = Reflected(vec3(0.0), SKY_DISTANCE, 0.0);
    Surface surface = load_surface(view, pixel, params.gbuffer);
    if (!surface.exists || !reflects(surface)) return found;
    SceneBuffer scene = SceneBuffer(params.scene);
    uvec2 ids = load_uint(params.gbuffer.ids, pixel).xy;
    RayStart start = seen_start(scene, ids, view.at[0].eye, pixel_ray(view, pixel), surface.position);
    Bsdf bsdf = bsdf_of(surface);
    mat3 around = frame_of(surface.normal);
    vec3 v = surface.to_eye * around;
    v.z = eye_cosine(surface);
    uint seed = view.at[0].seed;
    for (uint i = 0u; i < params.samples; i++) {
        uint index = view.at[0].frame * params.samples + i;
        vec3 l;
        bool above = sample_specular(bsdf, v, sequence2(pixel, index, SEQUENCE_REFLECTIONS, seed), l);
        vec3 direction = around * l;
        if (!above || dot(direction, start.normal) <= 0.0) continue;
        float pdf = bsdf_pdf(bsdf, v, l, LOBE_SPECULAR);
        if (!(pdf > 0.0)) continue;
        vec3 share = bsdf_cosine(bsdf, v, l, LOBE_SPECULAR) / pdf;
        Random random = random_of(uint(pixel.y) * view.at[0].size.x + uint(pixel.x), index, seed);
        float distance;
        found.radiance += share * follow(view, scene, params, surface_ray(start, direction, UNBOUNDED), pdf, random, distance);
        found.distance = min(found.distance, distance);
    }
    found.radiance /= float(params.samples) * specular_albedo(surface);
    found.width = lobe_width(view, surface, strongest_alpha(bsdf, v), found.distance);
    return found;
}

#endif
