// A ray and its hit, for every backend.
#ifndef LIB_RAY_TYPES_GLSL
#define LIB_RAY_TYPES_GLSL
#include "shared/scene.glsl"

// Hits count for t_min < t < t_max, in lengths of `direction`, which need not be a unit vector. `mask`: only instances that share a bit
// with it are hit. `cull`: RAY_* bits. Construct with `make_ray`.
//
// The ray is the axis of a cone, which selects the mip level of textures (lib/alpha.glsl): its width at the origin, metres, and how many
// metres it widens per length of `direction`. A width of 0 reads the finest mip.
struct Ray {
    vec3 origin;
    float t_min;
    vec3 direction;
    float t_max;
    uint mask;
    uint cull;
    float cone_width;
    float cone_spread;
};

// `instance` indexes the scene's instances, `primitive` the triangles or spheres of its mesh.
struct Hit {
    float t;
    uint instance;
    uint primitive;
    vec2 barycentric;  // weights of the second and third corner; zero on spheres
    bool front;        // hit on the front: corners counter-clockwise in object space, or the outside of a sphere
};

// `Hit.instance` of a miss.
const uint NO_HIT = 4294967295u;

// Faces that a ray ignores, unless their material is double-sided.
const uint RAY_CULL_BACK = 1u;
const uint RAY_CULL_FRONT = 2u;
// Skips the alpha test, so that every surface is hit; the caller looks up coverage itself.
const uint RAY_UNTESTED = 4u;
// Hits blended surfaces wherever they cover anything, instead of where they cover half; the caller looks up coverage itself.
const uint RAY_BLENDED = 8u;

// A ray that hits every instance from either side.
Ray make_ray(vec3 origin, float t_min, vec3 direction, float t_max)
{
    return Ray(origin, t_min, direction, t_max, INSTANCE_MASK_ALL, 0u, 0.0, 0.0);
}

// The same ray as a cone.
Ray with_cone(Ray ray, float width, float spread)
{
    ray.cone_width = width;
    ray.cone_spread = spread;
    return ray;
}

// Width of the cone at a distance, metres.
float cone_width_at(Ray ray, float t)
{
    return ray.cone_width + ray.cone_spread * t;
}

// Whether the ray ignores a face because of its side.
bool is_culled(Ray ray, uint instance_flags, bool front)
{
    return (ray.cull & (front ? RAY_CULL_FRONT : RAY_CULL_BACK)) != 0u && (instance_flags & INSTANCE_DOUBLE_SIDED) == 0u;
}

#endif
