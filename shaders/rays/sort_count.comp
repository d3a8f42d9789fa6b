#version 460
#extension GL_GOOGLE_include_directive : require
#include "lib/bindless.glsl"
#include "shared/rays.glsl"
// Computes each ray's key and counts the rays per key. Rays with the same key have a similar direction and origin.
layout(local_size_x = SORT_GROUP) in;
layout(push_constant, scalar) uniform Push { SortParams params; };

layout(buffer_reference, scalar, buffer_reference_align = 4) buffer Words { uint at[]; };

// Moves bits 0, 1, 2 to 0, 3, 6.
uint spread(uint x) {
    return (x & 1u) | (x & 2u) << 2 | (x & 4u) << 4;
}

void main() {
    uint index = gl_GlobalInvocationID.x;
    if (index >= params.count) return;
    RayTask ray = RayTaskBuffer(params.rays).at[index];
    uvec3 cell = uvec3(clamp((ray.origin - params.lower) * params.scale, vec3(0.0), vec3(7.0)));
    uvec3 side = uvec3(lessThan(ray.direction, vec3(0.0)));
    uint octant = side.x | side.y << 1 | side.z << 2;
    uint key = octant << 9 | spread(cell.x) | spread(cell.y) << 1 | spread(cell.z) << 2;
    Words(params.keys).at[index] = key;
    atomicAdd(Words(params.counts).at[key], 1u);
}
