#version 460
#extension GL_GOOGLE_include_directive : require
#include "lib/bindless.glsl"
#include "shared/overlay.glsl"
// Triangles, scaled to pixels of the target. gl_VertexIndex comes from the bound index buffer.
layout(push_constant, scalar) uniform Push { OverlayParams params; };

layout(location = 0) out vec2 uv;
layout(location = 1) out vec4 colour;       // display values times alpha, and alpha

void main() {
    OverlayVertexBuffer vertices = OverlayVertexBuffer(params.vertices);
    OverlayVertex vertex = vertices.at[params.first_vertex + gl_VertexIndex];
    gl_Position = vec4(2.0 * params.scale * vertex.position / params.size - 1.0, 0.0, 1.0);
    uv = vertex.uv;
    colour = unpackUnorm4x8(vertex.colour);
}
