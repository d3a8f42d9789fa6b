#version 460
#extension GL_GOOGLE_include_directive : require
#extension GL_EXT_scalar_block_layout : require
#extension GL_EXT_buffer_reference : require
#extension GL_EXT_buffer_reference2 : require
#extension GL_EXT_buffer_reference_uvec2 : require
#include "lib/bench.glsl"
// One pass over buffers. It does not use the bindless set, so that every library can run it.
layout(local_size_x = CELLS) in;
layout(push_constant, scalar) uniform Push { BufferParams params; };

void main() {
    uint lane = gl_LocalInvocationID.x;
    uint first = params.number > 0u ? CellBuffer(params.first).at[lane].value : 0u;
    uint second = params.number > 1u ? CellBuffer(params.second).at[lane].value : 0u;
    CellBufferWrite(params.result).at[lane].value = bench_value(first, second, params.number, lane);
}
