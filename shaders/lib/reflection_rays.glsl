#ifndef LIB_REFLECTION_RAYS_GLSL
#define LIB_REFLECTION_RAYS_GLSL
#include "lib/follow_path.glsl"
#include "lib/gbuffer.glsl"
#include "lib/precision.glsl"
#include "lib/ray_cells.glsl"
#include "lib/ray_count.glsl"
#include "lib/reflector.glsl"
#include "lib/roughness_limit.glsl"
#include "lib/sky_lobe.glsl"
#include "shared/reflections.glsl"
// Specular indirect light by rays along the lobe.

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
    Path path = Path(params.hits, params.bounces, params.regularization);
    found.radiance = follow(view, SceneBuffer(params.scene), path, ray, found.pdf, random, found.distance);
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
            samples = params.density;
            start = reflector_start(view, params, pixel, r);
        }
        for (uint i = 0u; i < samples; i++) {
            uint index = view.at[0].frame * params.density + i;
            LobeSample s = sample_lobe(view, r, pixel, index);
            if (!s.exists) continue;
            Reflected found = reflect_along(view, params, pixel, r, start, s, index);
            radiance += bsdf_cosine(r.bsdf, r.v, s.l, LOBE_SPECULAR) / s.pdf * found.radiance;
            nearest = min(nearest, found.distance);
        }
        // Without rays the sky, for denoisers that take it for that of a neighbour.
        if (!has_rays) radiance = float(params.density) * sky_reflected(view, r.surface, 1.0);
        radiance /= float(params.density) * specular_albedo(r.surface);
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
    ivec2 side = side_of(params.density);
    trace_found(view, params, ray_pixel(view, cell, side), ray_turns(view, side), cell);
}

// Which of both `params` asks for, at `at` of the launch.
void trace_reflections(TraceParams params, ivec2 at) {
    ViewBuffer view = ViewBuffer(params.view);
    uvec2 side = uvec2(side_of(params.rays_found == NO_IMAGE ? 1u : params.density));
    uvec2 cells = (view.at[0].size + side - 1u) / side;
    if (!inside(at, cells)) return;
    if (params.rays_found == NO_IMAGE) trace_pixel(view, params, at);
    else trace_cell(view, params, at);
    count_rays(params.rays, paths_traced.x, paths_traced.y);
}

#endif
