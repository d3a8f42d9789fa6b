#ifndef LIB_LISTED_RAYS_GLSL
#define LIB_LISTED_RAYS_GLSL
#include "lib/ray_rate.glsl"
#include "lib/reflection_rays.glsl"
#include "lib/pixel_list.glsl"

// Traces the ray of an invocation's pixel in a list.
void trace_listed(HybridTraceParams params, uvec2 invocation) {
    ViewBuffer view = ViewBuffer(params.view);
    ivec2 pixel;
    if (listed_pixel(params.list, invocation, pixel)) {
        TraceParams p;
        p.view = params.view;
        p.scene = params.scene;
        p.rays = params.rays;
        p.gbuffer = params.gbuffer;
        p.hits = params.hits;
        p.radiance = params.found;
        p.rays_found = params.rays_found;
        p.bounces = params.bounces;
        p.regularization = params.regularization;
        p.greatest = params.greatest;
        // Whoever made the list has left out what is not worth a ray.
        p.roughness_limit = 1.0;
        trace_found(view, p, pixel, turns_at(view, rate_at(params.rate, pixel)), pixel);
    }
    count_rays(params.rays, paths_traced.x, paths_traced.y);
}

#endif
