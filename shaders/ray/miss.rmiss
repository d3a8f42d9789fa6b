#version 460
#extension GL_GOOGLE_include_directive : require
#extension GL_EXT_ray_tracing : require
#include "lib/bindless.glsl"
#include "lib/ray_payload.glsl"
// Nothing lies on the ray.
layout(location = 0) rayPayloadInEXT RayPayload payload;

void main() {
    payload.instance = NO_HIT;
}
