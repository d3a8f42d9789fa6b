// Origins of rays that leave a surface.
//
// A ray must not hit the surface that it leaves. This is ensured in two steps, and no effect has an epsilon of its own:
//
// 1. The origin is a point of the triangle or sphere as rays intersect it, computed from its corners instead of the depth buffer or the
//    distance along a ray: then an error of depth or distance only moves it along the surface (Waechter and Binder 2019, "A Fast and Robust
//    Method for Avoiding Self-Intersection", Ray Tracing Gems, chapter 6; Pharr, Jakob and Humphreys 2023, "Physically Based Rendering",
//    4th edition, section 6.8).
// 2. It is moved off the surface by `Instance.rounding`, a bound of the rounding errors of both the transform and the traversal.
//    docs/ray-origins.md derives it and states its cost.
#ifndef LIB_RAY_ORIGIN_GLSL
#define LIB_RAY_ORIGIN_GLSL
#include "lib/bindless.glsl"
#include "lib/ray_types.glsl"
#include "lib/vector.glsl"

// A surface point as the origin of rays.
struct RayStart {
    vec3 position;   // world, metres
    vec3 normal;     // geometric normal, unit, to the side from which the point was seen
    float rounding;  // bound of its distance from the surface during traversal, metres, above 0
};

// A ray towards a point ends this share of its length before it, so that the surface of a light does not occlude the light.
const float BEFORE_THE_END = 1e-3;

// The point of a triangle with these barycentric weights of its second and third corner.
vec3 triangle_point(vec3 a, vec3 b, vec3 c, vec2 weights)
{
    precise vec3 p = (1.0 - weights.x - weights.y) * a + weights.x * b + weights.y * c;
    return p;
}

// Barycentric weights where a line through the origin meets a triangle; of a point nearby if it just misses.
vec2 met_weights(vec3 a, vec3 b, vec3 c, vec3 along)
{
    vec3 across = b - a;
    vec3 up = c - a;
    vec3 normal = cross(across, up);
    vec3 from_a = (dot(normal, a) / dot(normal, along)) * along - a;
    vec2 weights = vec2(dot(cross(from_a, up), normal), dot(cross(across, from_a), normal)) / dot(normal, normal);
    // A triangle seen edge on is thinner than the raster's grid, so any of its points will do. Written so that NaN counts too.
    if (!all(lessThan(abs(weights), vec2(1e6)))) return vec2(1.0 / 3.0);
    weights = max(weights, 0.0);
    return weights / max(weights.x + weights.y, 1.0);
}

RayStart triangle_start(Instance instance, vec3 a, vec3 b, vec3 c, vec2 weights)
{
    precise vec3 position = transform_point(instance.world_from_object, triangle_point(a, b, c, weights));
    vec3 normal = transform_normal(instance.object_from_world, cross(b - a, c - a));
    return RayStart(position, safe_normalize(normal, vec3(0.0)), instance.rounding);
}

// `near`: a point close to the sphere, in object space.
RayStart sphere_start(Instance instance, vec4 sphere, vec3 near)
{
    vec3 outwards = safe_normalize(near - sphere.xyz, vec3(0.0, 1.0, 0.0));
    precise vec3 position = transform_point(instance.world_from_object, sphere.xyz + sphere.w * outwards);
    vec3 normal = transform_normal(instance.object_from_world, outwards);
    return RayStart(position, safe_normalize(normal, vec3(0.0)), instance.rounding);
}

// The surface point that a ray has hit. `normal` is on the side where the ray came from.
RayStart hit_start(SceneBuffer scene, Ray ray, Hit hit)
{
    Instance instance = InstanceBuffer(scene.at[0].instances).at[hit.instance];
    Mesh mesh = MeshBuffer(scene.at[0].meshes).at[instance.mesh];
    RayStart start;
    if ((instance.flags & INSTANCE_SPHERES) != 0u) {
        vec3 near = transform_point(instance.object_from_world, ray.origin + hit.t * ray.direction);
        start = sphere_start(instance, SphereBuffer(mesh.positions).at[hit.primitive], near);
    } else {
        PositionBuffer corners = PositionBuffer(mesh.positions);
        uvec3 at = TriangleBuffer(mesh.ray_indices).at[hit.primitive];
        start = triangle_start(instance, corners.at[at.x], corners.at[at.y], corners.at[at.z], hit.barycentric);
    }
    start.normal = hit.front ? start.normal : -start.normal;
    return start;
}

// The surface point visible from `eye` in the direction `along`: `ids` of the G-buffer, so instance + 1 and primitive, and a `position`
// near it. `normal` is on the side of the eye.
RayStart seen_start(SceneBuffer scene, uvec2 ids, vec3 eye, vec3 along, vec3 position)
{
    Instance instance = InstanceBuffer(scene.at[0].instances).at[ids.x - 1u];
    Mesh mesh = MeshBuffer(scene.at[0].meshes).at[instance.mesh];
    RayStart start;
    if ((instance.flags & INSTANCE_SPHERES) != 0u) {
        start = sphere_start(instance, SphereBuffer(mesh.positions).at[ids.y], transform_point(instance.object_from_world, position));
    } else {
        PositionBuffer corners = PositionBuffer(mesh.positions);
        uvec3 at = TriangleBuffer(mesh.indices).at[ids.y];
        vec3 a = corners.at[at.x];
        vec3 b = corners.at[at.y];
        vec3 c = corners.at[at.z];
        vec3 from = transform_point(instance.object_from_world, eye);
        vec2 weights = met_weights(a - from, b - from, c - from, transform_vector(instance.object_from_world, along));
        start = triangle_start(instance, a, b, c, weights);
    }
    start.normal = dot(start.normal, along) > 0.0 ? -start.normal : start.normal;
    return start;
}

// Origin of a ray that leaves a surface towards `direction`, on either side.
vec3 surface_origin(RayStart from, vec3 direction)
{
    float side = dot(from.normal, direction) < 0.0 ? -1.0 : 1.0;
    return from.position + side * from.rounding * from.normal;
}

// A ray that leaves a surface. Hits that may be the surface itself lie before t_min.
Ray surface_ray(RayStart from, vec3 direction, float t_max)
{
    return make_ray(surface_origin(from, direction), min(from.rounding / length(direction), t_max), direction, t_max);
}

// A ray that leaves a surface towards a point, and ends just before it.
Ray surface_ray_to(RayStart from, vec3 point)
{
    from.position = surface_origin(from, point - from.position);
    vec3 direction = point - from.position;
    // The point coincides with the origin: any direction will do, as nothing is in between.
    direction = direction == vec3(0.0) ? from.normal : direction;
    float t_max = 1.0 - BEFORE_THE_END;
    return make_ray(from.position, min(from.rounding / length(direction), t_max), direction, t_max);
}

#endif
