// Backend: ray-tracing pipeline. Only the ray-generation shader traces, so the recursion depth is 1; the other shaders are in the folder
// `ray`. Hit groups: 0 for triangles, 1 for spheres; one miss shader.
#ifndef LIB_RAY_PIPELINE_GLSL
#define LIB_RAY_PIPELINE_GLSL
#include "lib/ray_driver.glsl"
#include "lib/ray_payload.glsl"

layout(location = 0) rayPayloadEXT RayPayload payload;

// Whether the ray hits anything.
bool trace_any(SceneBuffer scene, Ray ray)
{
    // No closest-hit shader runs: the payload starts as a hit, and the miss shader resets it.
    payload.instance = 0u;
    payload.cone_width = ray.cone_width;
    payload.cone_spread = ray.cone_spread;
    payload.front = ray.cull & RAY_BLENDED;
    uint flags = driver_flags(ray) | gl_RayFlagsTerminateOnFirstHitEXT | gl_RayFlagsSkipClosestHitShaderEXT;
    traceRayEXT(accelerationStructureEXT(scene.at[0].tlas), flags, ray.mask, 0, 0, 0, ray.origin, ray.t_min, ray.direction, ray.t_max, 0);
    return payload.instance != NO_HIT;
}

// The same, with the distance of the hit that was found first, which need not be the nearest; `ray.t_max` on a miss.
bool trace_any_at(SceneBuffer scene, Ray ray, out float t)
{
    payload.instance = NO_HIT;
    payload.cone_width = ray.cone_width;
    payload.cone_spread = ray.cone_spread;
    payload.front = ray.cull & RAY_BLENDED;
    uint flags = driver_flags(ray) | gl_RayFlagsTerminateOnFirstHitEXT;
    traceRayEXT(accelerationStructureEXT(scene.at[0].tlas), flags, ray.mask, 0, 0, 0, ray.origin, ray.t_min, ray.direction, ray.t_max, 0);
    bool met = payload.instance != NO_HIT;
    t = met ? payload.t : ray.t_max;
    return met;
}

// The nearest hit. On a miss `hit.instance` is NO_HIT and `hit.t` is `ray.t_max`.
bool trace_closest(SceneBuffer scene, Ray ray, out Hit hit)
{
    payload.instance = NO_HIT;
    payload.cone_width = ray.cone_width;
    payload.cone_spread = ray.cone_spread;
    payload.front = ray.cull & RAY_BLENDED;
    traceRayEXT(accelerationStructureEXT(scene.at[0].tlas), driver_flags(ray), ray.mask, 0, 0, 0, ray.origin, ray.t_min, ray.direction,
        ray.t_max, 0);
    if (payload.instance == NO_HIT) {
        hit = Hit(ray.t_max, NO_HIT, NO_HIT, vec2(0.0), false);
        return false;
    }
    hit = Hit(payload.t, payload.instance, payload.primitive, payload.barycentric, payload.front != 0u);
    return true;
}

#endif
