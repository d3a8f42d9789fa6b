#ifndef LIB_SHADOW_RAYS_GLSL
#define LIB_SHADOW_RAYS_GLSL
#include "lib/gbuffer.glsl"
#include "lib/light_sampling.glsl"
#include "lib/ray.glsl"
#include "lib/sequence.glsl"
// Shadow rays from a surface to points of up to four lights: uniform over a light's disc or area, or over the cone that it fills. Light of
// the whole lamp, unshadowed, is multiplied with the share of them that arrive (Heitz, Hill and McGuire 2018, "Combining Analytic
// Direct Illumination and Stochastic Shadows").

uint rays_traced = 0u;

// Which lights, and how many points of each.
struct ShadowRays {
    uvec4 lights;
    uint count;
    uint samples;  // 0 for one ray to the centre
    uint wanted;   // a bit for each light that rays go to; the others are given as 0
};

// The ray to a point of a light. False where that cannot light the surface anyway.
bool shadow_ray(ViewBuffer view, Surface surface, RayStart start, Incident from, out Ray ray) {
    ray = make_ray(vec3(0.0), 0.0, vec3(0.0), 0.0);
    if (dot(surface.normal, from.direction) <= 0.0 || dot(surface.geometric_normal, from.direction) <= 0.0) return false;
    ray = from.distance >= INFINITELY_FAR ? surface_ray(start, from.direction, INFINITELY_FAR)
        : surface_ray_to(start, start.position + from.distance * from.direction);
    // A point has no size: the ray stays as wide as the pixel is at the surface.
    float width = pixel_spread(view) * distance(surface.position, view.at[0].eye);
    ray = with_cone(ray, width, 0.0);
    return true;
}

// 1 where nothing hides this point of the light. What it cannot light anyway is 0 without a ray.
float visibility(ViewBuffer view, SceneBuffer scene, Surface surface, RayStart start, Incident from) {
    Ray ray;
    if (!shadow_ray(view, surface, start, from, ray)) return 0.0;
    rays_traced++;
    return trace_any(scene, ray) ? 0.0 : 1.0;
}

// The share of each light that is seen, by the points that `drawn_at` had or has in frame `frame`.
vec4 visibilities(ViewBuffer view, Surface surface, uvec2 ids, ivec2 pixel, ShadowRays rays, ivec2 drawn_at, uint frame) {
    SceneBuffer scene = SceneBuffer(view.at[0].scene);
    RayStart start = seen_start(scene, ids, view.at[0].eye, pixel_ray(view, pixel), surface.position);
    vec4 seen = vec4(0.0);
    for (uint k = 0u; k < rays.count; k++) {
        if ((rays.wanted & (1u << k)) == 0u) continue;
        Light light = LightBuffer(scene.at[0].lights).at[rays.lights[k]];
        LightSample centre = sample_light(light, start.position);
        // Outside of its cone, its range or its front.
        if (centre.irradiance == vec3(0.0)) continue;
        if (rays.samples == 0u || !has_size(light)) {
            seen[k] = visibility(view, scene, surface, start, Incident(centre.direction, centre.distance, centre.irradiance, 0.0));
            continue;
        }
        for (uint i = 0u; i < rays.samples; i++) {
            vec2 u = sequence2(drawn_at, frame * rays.samples + i, SEQUENCE_SHADOWS + k, view.at[0].seed);
            Incident from;
            if (sample_sized_light(light, start.position, u, from)) seen[k] += visibility(view, scene, surface, start, from);
        }
        seen[k] /= float(rays.samples);
    }
    return seen;
}

#endif
