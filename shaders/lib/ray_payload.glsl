// Payload of the ray-tracing pipeline: 32 bytes.
#ifndef LIB_RAY_PAYLOAD_GLSL
#define LIB_RAY_PAYLOAD_GLSL
#include "lib/ray_types.glsl"

struct RayPayload {
    float t;
    uint instance;  // NO_HIT after a miss
    uint primitive;
    vec2 barycentric;
    uint front;  // before the hit RAY_BLENDED or 0, for the alpha test
    float cone_width;  // of the ray, for the alpha test
    float cone_spread;
};

// Hit kinds of spheres, beside Vulkan's for triangles.
const uint SPHERE_OUTSIDE = 0u;
const uint SPHERE_INSIDE = 1u;

#endif
