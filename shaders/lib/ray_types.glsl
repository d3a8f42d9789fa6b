// A ray and what it hits, the same for every way to trace.
#ifndef LIB_RAY_TYPES_GLSL
#define LIB_RAY_TYPES_GLSL
#include "shared/scene.glsl"

// Hits count for t_min < t < t_max, in lengths of `direction`, which need not be a unit vector. `mask`: instances that share a bit
// with it are seen. `cull`: RAY_* bits. Make one with `make_ray`.
//
// The ray stands for a cone, which says at which mip textures are read (lib/alpha.glsl): metres wide at the origin, and by how many
// metres wider with each length of `direction`. One without width reads the finest mip.
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
    bool front;        // the side from which the corners run counter-clockwise in object space; the outside of a sphere
};

// `Hit.instance` of a miss.
const uint NO_HIT = 4294967295u;

// Faces that a ray goes through, unless their material is double-sided.
const uint RAY_CULL_BACK = 1u;
const uint RAY_CULL_FRONT = 2u;
// Another bit of `cull`: alpha is not tested, every surface is there. Who traces asks for its coverage.
const uint RAY_UNTESTED = 4u;

// A ray that every instance stops, whichever side it shows.
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

// Whether the ray goes through a face for its side.
bool is_culled(Ray ray, uint instance_flags, bool front)
{
    return (ray.cull & (front ? RAY_CULL_FRONT : RAY_CULL_BACK)) != 0u && (instance_flags & INSTANCE_DOUBLE_SIDED) == 0u;
}

#endif
