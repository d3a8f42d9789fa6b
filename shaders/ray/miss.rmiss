#version 460
#extension GL_GOOGLE_include_directive : require
#extension GL_EXT_ray_tracing : require
#include "lib/bindless.glsl"
#include "lib/ray_payload.glsl"
// Miss shader: marks the payload as a miss.
layout(location = 0) rayPayloadInEXT RayPayload payload;

void main() {
    payload.instance = NO_HIT;
}
