#version 460
#extension GL_GOOGLE_include_directive : require
#extension GL_EXT_ray_tracing : require
#include "lib/bindless.glsl"
#include "lib/ray_payload.glsl"
// Closest-hit shader of triangles and spheres: fills the payload.
layout(location = 0) rayPayloadInEXT RayPayload payload;
hitAttributeEXT vec2 barycentric;

void main() {
    bool is_triangle = gl_HitKindEXT == gl_HitKindFrontFacingTriangleEXT || gl_HitKindEXT == gl_HitKindBackFacingTriangleEXT;
    payload.t = gl_HitTEXT;
    payload.instance = uint(gl_InstanceCustomIndexEXT);
    payload.primitive = uint(gl_PrimitiveID);
    payload.barycentric = is_triangle ? barycentric : vec2(0.0);
    payload.front = uint(gl_HitKindEXT == gl_HitKindFrontFacingTriangleEXT || gl_HitKindEXT == SPHERE_OUTSIDE);
}
