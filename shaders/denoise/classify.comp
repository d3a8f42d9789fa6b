#version 460
#extension GL_GOOGLE_include_directive : require
#include "lib/bindless.glsl"
#include "lib/gbuffer.glsl"
#include "lib/tiles.glsl"
// Lists the tiles that need filtering. A tile without variance, border included, needs none: it is fully lit or fully shadowed.
layout(local_size_x = 8, local_size_y = 8) in;
layout(push_constant, scalar) uniform Push { ClassifyParams params; };

shared uint varies;

void main() {
    ivec2 pixel = ivec2(gl_GlobalInvocationID.xy);
    if (gl_LocalInvocationIndex == 0u) varies = 0u;
    barrier();
    // The tile and a border of one pixel, which the blur of the variance looks at: 100 pixels by 64 invocations.
    ivec2 corner = ivec2(gl_WorkGroupID.xy * TILE) - 1;
    const uint SIDE = TILE + 2u;
    for (uint k = gl_LocalInvocationIndex; k < SIDE * SIDE; k += TILE * TILE) {
        ivec2 at = corner + ivec2(k % SIDE, k / SIDE);
        // Compared with != so that NaN counts as variance too.
        if (inside(at, params.size) && load_error(params.error, at, params.channels) != vec4(0.0)) varies = 1u;
    }
    barrier();
    if (varies != 0u && gl_LocalInvocationIndex == 0u) {
        uint at = atomicAdd(TilesBufferWrite(params.tiles).at[0].count, 1u);
        TileListWrite(params.list).at[at] = pack_tile(gl_WorkGroupID.xy);
    }
    // All pixels are written, as the levels write listed tiles only.
    if (!inside(pixel, params.size)) return;
    vec4 colour = load(params.colour, pixel);
    store(params.first, pixel, colour);
    store(params.other, pixel, colour);
    store(params.other_error, pixel, vec4(0.0));
    store(params.blurred, pixel, vec4(0.0));
}
