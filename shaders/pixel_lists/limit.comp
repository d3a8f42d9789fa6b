#version 460
#extension GL_GOOGLE_include_directive : require
#include "lib/pixel_list.glsl"
// The greatest key up to which all pixels fit into a list.
layout(local_size_x = 1) in;
layout(push_constant, scalar) uniform Push { ListParams params; };

layout(buffer_reference, scalar, buffer_reference_align = 4) readonly buffer Histogram { uint at[]; };

void main() {
    uint pixels = 0u;
    uint last = 0u;
    for (uint key = 1u; key <= GREATEST_KEY; key++) {
        pixels += Histogram(params.histogram).at[key];
        if (pixels > params.most) break;
        last = key;
    }
    PixelList(params.list).last_key = last;
}
