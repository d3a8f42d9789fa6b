#version 460
#extension GL_GOOGLE_include_directive : require
#include "lib/bindless.glsl"
#include "shared/check.glsl"
// Reads another image or buffer at the place that corresponds to the first non-finite pixel or word of a scan. Images of different sizes
// correspond by their uv, everything else by the relative index.
layout(local_size_x = 1) in;
layout(push_constant, scalar) uniform Push { ProbeParams params; };

// floor(at * to / from), by long division of the 64-bit product; at < from.
uint scaled(uint at, uint from, uint to) {
    uint rest;
    uint low;
    umulExtended(at, to, rest, low);
    uint quotient = 0u;
    for (int bit = 31; bit >= 0; bit--) {
        bool carry = (rest & 0x80000000u) != 0u;
        rest = (rest << 1) | ((low >> bit) & 1u);
        if (carry || rest >= from) {
            rest -= from;
            quotient |= 1u << bit;
        }
    }
    return quotient;
}

void main() {
    CountedBuffer counted = CountedBuffer(params.counted);
    uint piece = 0u;
    while (piece < params.pieces && counted.at[piece].nan + counted.at[piece].infinite == 0u) piece++;
    if (piece == params.pieces) return;

    uint index = ~counted.at[piece].last;
    bool is_image = params.size.x > 0u;
    uint mip = is_image ? piece % params.mips : 0u;
    uvec2 size = max(params.size >> (params.mip + mip), uvec2(1u));
    uint total = is_image ? size.x * size.y : params.count;
    uint layer = is_image ? params.layer + piece / params.mips : 0u;

    uvec4 bits = uvec4(0u);
    if (params.kind == WORDS) {
        bits.x = WordBuffer(params.words).at[scaled(index, total, params.source_count)];
    } else {
        if (params.source_layer != clamp(layer, params.source_layers.x, params.source_layers.y)) return;
        uvec2 source_size = params.own == 1u ? size : params.source_size;
        uvec2 at;
        if (is_image) {
            at.x = scaled(2u * (index % size.x) + 1u, 2u * size.x, source_size.x);
            at.y = scaled(2u * (index / size.x) + 1u, 2u * size.y, source_size.y);
        } else {
            uint pixel = scaled(index, total, source_size.x * source_size.y);
            at = uvec2(pixel % source_size.x, pixel / source_size.x);
        }
        int lod = params.own == 1u ? int(mip) : 0;
        if (params.kind == UINT_IMAGE) bits = texelFetch(images_uint[params.image], ivec2(at), lod);
        else bits = floatBitsToUint(texelFetch(images[params.image], ivec2(at), lod));
    }
    SeenBufferWrite(params.seen).at[0].bits = bits;
}
