#version 460
#extension GL_GOOGLE_include_directive : require
#include "lib/bindless.glsl"
#include "shared/tiles.glsl"
// Empties a list of tiles.
layout(local_size_x = 1) in;
layout(push_constant, scalar) uniform Push { TileParams params; };

layout(buffer_reference, scalar, buffer_reference_align = 4) writeonly buffer Groups { uvec3 count; };

void main() {
    Groups(params.groups).count = uvec3(0u, 1u, 1u);
}
