#ifndef LIB_REFLECTION_RAYS_GLSL
#define LIB_REFLECTION_RAYS_GLSL
#include "lib/gbuffer.glsl"
#include "lib/hit_shading.glsl"
#include "lib/found_ray.glsl"
#include "lib/path.glsl"
#include "lib/precision.glsl"
#include "lib/ray_cells.glsl"
#include "lib/ray_count.glsl"
#include "lib/reflector.glsl"
#include "lib/roughness_limit.glsl"
#include "lib/sky_lobe.glsl"
#include "shared/reflections.glsl"
// Specular indirect light by rays along the lobe, each followed over some bounces. What lights and emissive surfaces send to the pixel
// directly is not in it: the slot `direct` has that.
// With TINTED, surfaces may transmit light, as in lib/tinted.glsl.

// Counters: closest-hit and any-hit rays.
uvec2 reflections_traced = uvec2(0u);

// At the last hit lights are sampled. For specular lobes with a brighter peak than this, BRDF times cosine in the mirror direction, that alone
// would be mostly noise: one more ray along them finds the sky, lights and what the previous frame shows, but no surface is shaded there. White
// paint has 1 / pi.
const float BRIGHT_PEAK = 4.0 / PI;

// The lobes along which a path goes on from its last hit. `v`: towards the viewer, local.
uint lobes_beyond(Bsdf b, vec3 v, uint lobes) {
    vec3 peak = bsdf_cosine(b, v, vec3(-v.xy, v.z), LOBE_SPECULAR);
    return max(peak.r, max(peak.g, peak.b)) > BRIGHT_PEAK ? lobes & LOBE_SPECULAR : 0u;
}

// Radiance along a ray that was sampled with a pdf, and the distance to what it hits first, metres.
vec3 follow(ViewBuffer view, SceneBuffer scene, TraceParams params, Ray ray, float pdf, inout Random random, out float first_distance) {
    LightTables lights = LightTablesBuffer(params.hits.lights).at[0];
    vec3 radiance = vec3(0.0);
    vec3 throughput = vec3(1.0);
    vec3 vertex = ray.origin;
    vec3 absorption = vec3(0.0);
    uint bounce = 1u;
    // Lobes are at least so wide for small lights: where the ray starts, and where it ends.
    float least_alpha = 0.0;
    float next_least = params.regularization * alpha_of_pdf(pdf);
    first_distance = SKY_DISTANCE;
    // Every turn is a bounce or passes a sheet.
    for (uint turn = 0u; turn < MOST_TURNS; turn++) {
        Hit hit;
#ifdef TINTED
        ray.cull |= RAY_BLENDED;
#endif
        reflections_traced.x++;
        bool met = trace_closest(scene, ray, hit);
        vec3 direction = normalize(ray.direction);
        float t_max = hit.t * length(ray.direction);
        if (bounce > 1u) add_lights_met(radiance, throughput, scene, lights, ray, vertex, pdf, least_alpha, absorption, t_max, met, 0u);
        if (!met) {
            if (view.at[0].has_sky == 0u) break;
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
        if (bounce == 1u) first_distance = min(distance(s.start.position, vertex), SKY_DISTANCE);
        // Emissive surfaces that rays of the pixel hit are direct light; unlit ones are lit by nothing, and not sampled.
        if (bounce > 1u) add_emission_met(radiance, throughput, scene, lights, s, hit, vertex, pdf, least_alpha, 0u);
        else if (s.black && !s.shows_light) radiance += throughput * s.emission;
        if (s.black) break;
        vec3 seen;
        if (s.emission == vec3(0.0) && previous_light_at(view, scene, params.hits, s, hit.instance, -direction, seen)) {
            radiance += throughput * seen;
            break;
        }
        if (bounce > params.bounces) break;
        mat3 frame = frame_of(s.normal);
        vec3 v = -direction * frame;
        uint followed = bounce < params.bounces ? lobes : lobes_beyond(s.bsdf, v, lobes);
        radiance += throughput * direct_light_at(view, scene, lights, s, -direction, lobes, followed, next_least, random, reflections_traced);
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
        next_least = max(least_alpha, params.regularization * alpha_of_pdf(pdf));
        throughput *= bsdf_cosine(s.bsdf, v, l, followed) / pdf;
        if (refracted) absorption = s.absorption;
        bounce++;
        if (bounce + 1u >= ROULETTE_FROM) {
            float probability = continue_probability(throughput);
            if (u.w >= probability) break;
            throughput /= probability;
        }
        vertex = s.start.position;
        ray = surface_ray(s.start, next, UNBOUNDED);
    }
    return radiance;
}

// A ray along the lobe.
struct Reflected {
    bool exists;      // false where the lobe has no light in the direction
    vec3 direction;   // unit
    float pdf;        // of the direction, per steradian
    vec3 radiance;    // from that direction
    float distance;   // of the nearest hit, metres
};

RayStart reflector_start(ViewBuffer view, TraceParams params, ivec2 pixel, Reflector r) {
    uvec2 ids = load_uint(params.gbuffer.ids, pixel).xy;
    return seen_start(SceneBuffer(params.scene), ids, view.at[0].eye, pixel_ray(view, pixel), r.surface.position);
}

// Traces along a sampled direction; `index` as for the sample.
Reflected reflect_along(ViewBuffer view, TraceParams params, ivec2 pixel, Reflector r, RayStart start, LobeSample s, uint index) {
    Reflected found = Reflected(s.exists, r.around * s.l, s.pdf, vec3(0.0), SKY_DISTANCE);
    // The surface itself hides what lies below its plane.
    if (!s.exists || dot(found.direction, start.normal) <= 0.0) return found;
    Random random = random_of(uint(pixel.y) * view.at[0].size.x + uint(pixel.x), index, view.at[0].seed);
    Ray ray = surface_ray(start, found.direction, UNBOUNDED);
    found.radiance = follow(view, SceneBuffer(params.scene), params, ray, found.pdf, random, found.distance);
    return found;
}

// The mean of all rays of a pixel, over the albedo of its lobe.
void trace_pixel(ViewBuffer view, TraceParams params, ivec2 pixel) {
    Reflector r = reflector_at(view, params.gbuffer, pixel);
    vec3 radiance = vec3(0.0);
    float nearest = SKY_DISTANCE;
    float width = 0.0;
    if (r.exists) {
        bool has_rays = share_of_rays(r.surface, params.roughness_limit, 0.0) > 0.0;
        uint samples = 0u;
        RayStart start;
        if (has_rays) {
            samples = params.samples;
            start = reflector_start(view, params, pixel, r);
        }
        for (uint i = 0u; i < samples; i++) {
            uint index = view.at[0].frame * params.samples + i;
            LobeSample s = sample_lobe(view, r, pixel, index);
            if (!s.exists) continue;
            Reflected found = reflect_along(view, params, pixel, r, start, s, index);
            radiance += bsdf_cosine(r.bsdf, r.v, s.l, LOBE_SPECULAR) / s.pdf * found.radiance;
            nearest = min(nearest, found.distance);
        }
        // Without rays the sky, for denoisers that take it for that of a neighbour.
        if (!has_rays) radiance = float(params.samples) * sky_reflected(view, r.surface, 1.0);
        radiance /= float(params.samples) * specular_albedo(r.surface);
        width = lobe_width(view, r.surface, strongest_alpha(r.bsdf, r.v), nearest);
    }
    store(params.radiance, pixel, vec4(representable(radiance, params.greatest), 1.0));
    store(params.hit_distance, pixel, vec4(nearest));
    store(params.width, pixel, vec4(min(width / WIDEST_NOISE, 1.0)));
}

// One ray of a pixel, for reconstruct.comp. What it found goes to `at` of the images.
void trace_found(ViewBuffer view, TraceParams params, ivec2 pixel, uint index, ivec2 at) {
    Reflector r = reflector_at(view, params.gbuffer, pixel);
    r.exists = r.exists && share_of_rays(r.surface, params.roughness_limit, 0.0) > 0.0;
    Reflected found;
    found.exists = false;
    if (r.exists) {
        LobeSample s = draw_lobe(view, r, pixel, index);
        if (s.exists) found = reflect_along(view, params, pixel, r, reflector_start(view, params, pixel, r), s, index);
    }
    store(params.radiance, at, found.exists ? vec4(representable(found.radiance, params.greatest), 1.0) : vec4(0.0));
    store(params.rays_found, at, found.exists ? pack_ray(found.direction, found.distance, found.pdf) : vec4(0.0));
}

// The ray of a cell.
void trace_cell(ViewBuffer view, TraceParams params, ivec2 cell) {
    ivec2 side = side_of(params.pixels_per_ray);
    trace_found(view, params, ray_pixel(view, cell, side), ray_turns(view, side), cell);
}

// Which of both `params` asks for, at `at` of the launch.
void trace_reflections(TraceParams params, ivec2 at) {
    ViewBuffer view = ViewBuffer(params.view);
    uvec2 side = uvec2(side_of(params.pixels_per_ray));
    uvec2 cells = (view.at[0].size + side - 1u) / side;
    if (!inside(at, cells)) return;
    if (params.rays_found == NO_IMAGE) trace_pixel(view, params, at);
    else trace_cell(view, params, at);
    count_rays(params.rays, reflections_traced.x, reflections_traced.y);
}

#endif
