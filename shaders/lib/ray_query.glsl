// Backend: ray queries. The driver traverses; this shader decides about non-opaque candidates.
#ifndef LIB_RAY_QUERY_GLSL
#define LIB_RAY_QUERY_GLSL
#include "lib/alpha.glsl"
#include "lib/intersect.glsl"
#include "lib/ray_driver.glsl"
#include "lib/ray_types.glsl"

// The driver's traversal, with `flags` added to those of the ray. Opaque triangles are committed without a candidate.
void query_scene(rayQueryEXT query, SceneBuffer scene, Ray ray, uint flags)
{
    rayQueryInitializeEXT(query, accelerationStructureEXT(scene.at[0].tlas), flags | driver_flags(ray), ray.mask, ray.origin, ray.t_min,
        ray.direction, ray.t_max);
    while (rayQueryProceedEXT(query)) {
        uint instance = uint(rayQueryGetIntersectionInstanceCustomIndexEXT(query, false));
        uint primitive = uint(rayQueryGetIntersectionPrimitiveIndexEXT(query, false));
        if (rayQueryGetIntersectionTypeEXT(query, false) == gl_RayQueryCandidateIntersectionTriangleEXT) {
            float width = cone_width_at(ray, rayQueryGetIntersectionTEXT(query, false));
            vec2 barycentric = rayQueryGetIntersectionBarycentricsEXT(query, false);
            uvec3 corners = driver_corners(scene, instance, primitive);
            bool blended = (ray.cull & RAY_BLENDED) != 0u;
            if (alpha_passes(scene, instance, corners, barycentric, ray.direction, width, blended)) {
                rayQueryConfirmIntersectionEXT(query);
            }
        } else {
            bool committed = rayQueryGetIntersectionTypeEXT(query, true) != gl_RayQueryCommittedIntersectionNoneEXT;
            float t_max = committed ? rayQueryGetIntersectionTEXT(query, true) : ray.t_max;
            vec4 sphere = driver_sphere(scene, instance, primitive);
            vec3 origin = rayQueryGetIntersectionObjectRayOriginEXT(query, false);
            vec3 direction = rayQueryGetIntersectionObjectRayDirectionEXT(query, false);
            SurfaceHit found;
            if (hit_sphere(origin, direction, sphere.xyz, sphere.w, ray.t_min, t_max, found)
                && !is_culled(ray, InstanceBuffer(scene.at[0].instances).at[instance].flags, found.front)) {
                rayQueryGenerateIntersectionEXT(query, found.t);
            }
        }
    }
}

// Whether the ray hits anything.
bool trace_any(SceneBuffer scene, Ray ray)
{
    rayQueryEXT query;
    query_scene(query, scene, ray, gl_RayFlagsTerminateOnFirstHitEXT);
    return rayQueryGetIntersectionTypeEXT(query, true) != gl_RayQueryCommittedIntersectionNoneEXT;
}

// The same, with the distance of the hit that was found first, which need not be the nearest; `ray.t_max` on a miss.
bool trace_any_at(SceneBuffer scene, Ray ray, out float t)
{
    rayQueryEXT query;
    query_scene(query, scene, ray, gl_RayFlagsTerminateOnFirstHitEXT);
    bool met = rayQueryGetIntersectionTypeEXT(query, true) != gl_RayQueryCommittedIntersectionNoneEXT;
    t = ray.t_max;
    if (met) t = rayQueryGetIntersectionTEXT(query, true);
    return met;
}

// The nearest hit. On a miss `hit.instance` is NO_HIT and `hit.t` is `ray.t_max`.
bool trace_closest(SceneBuffer scene, Ray ray, out Hit hit)
{
    rayQueryEXT query;
    query_scene(query, scene, ray, gl_RayFlagsNoneEXT);
    uint type = rayQueryGetIntersectionTypeEXT(query, true);
    if (type == gl_RayQueryCommittedIntersectionNoneEXT) {
        hit = Hit(ray.t_max, NO_HIT, NO_HIT, vec2(0.0), false);
        return false;
    }
    hit.t = rayQueryGetIntersectionTEXT(query, true);
    hit.instance = uint(rayQueryGetIntersectionInstanceCustomIndexEXT(query, true));
    hit.primitive = uint(rayQueryGetIntersectionPrimitiveIndexEXT(query, true));
    if (type == gl_RayQueryCommittedIntersectionTriangleEXT) {
        hit.barycentric = rayQueryGetIntersectionBarycentricsEXT(query, true);
        hit.front = rayQueryGetIntersectionFrontFaceEXT(query, true);
    } else {
        vec4 sphere = driver_sphere(scene, hit.instance, hit.primitive);
        vec3 from_centre = rayQueryGetIntersectionObjectRayOriginEXT(query, true) - sphere.xyz;
        vec3 at = from_centre + hit.t * rayQueryGetIntersectionObjectRayDirectionEXT(query, true);
        hit.barycentric = vec2(0.0);
        hit.front = dot(at, rayQueryGetIntersectionObjectRayDirectionEXT(query, true)) < 0.0;
    }
    return true;
}

#endif
