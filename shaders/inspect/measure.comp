#version 460
#extension GL_GOOGLE_include_directive : require
#extension GL_KHR_shader_subgroup_basic : require
#extension GL_KHR_shader_subgroup_arithmetic : require
#include "lib/bindless.glsl"
#include "lib/not_finite.glsl"
#include "shared/inspect.glsl"
// The least and the greatest finite value of each channel of an image, how many pixels are not finite, and the values of one pixel.
layout(local_size_x = 8, local_size_y = 8) in;
layout(push_constant, scalar) uniform Push { InspectMeasureParams params; };

// Of the workgroup.
shared uint least[4];
shared uint greatest[4];
shared uint nan;
shared uint above;
shared uint below;

// Grows with the value: as floats are, so are these.
uint key_of(uint bits) {
    if (params.is_uint == 1u) return bits;
    return (bits & 0x80000000u) != 0u ? ~bits : bits | 0x80000000u;
}

void main() {
    uint index = gl_LocalInvocationIndex;
    if (index < 4u) {
        least[index] = ~0u;
        greatest[index] = 0u;
    }
    if (index == 0u) {
        nan = 0u;
        above = 0u;
        below = 0u;
    }
    barrier();

    MeasuredBufferWrite measured = MeasuredBufferWrite(params.measured);
    ivec2 pixel = ivec2(gl_GlobalInvocationID.xy);
    bool is_inside = inside(pixel, params.size);
    uvec4 bits = uvec4(0u);
    if (is_inside) {
        if (params.is_uint == 1u) bits = load_uint(params.image, pixel);
        else bits = floatBitsToUint(load(params.image, pixel));
        if (all(equal(uvec2(pixel), params.pixel))) measured.at[0].bits = bits;
    }
    bool has_nan = false;
    bool has_above = false;
    bool has_below = false;
    for (uint i = 0u; i < params.channels; i++) {
        bool is_nan = params.is_uint == 0u && is_nan_bits(bits[i]);
        bool is_infinite = params.is_uint == 0u && is_infinite_bits(bits[i]);
        bool is_negative = (bits[i] & 0x80000000u) != 0u;
        has_nan = has_nan || is_nan;
        has_above = has_above || (is_infinite && !is_negative);
        has_below = has_below || (is_infinite && is_negative);
        bool counts = is_inside && !is_nan && !is_infinite;
        uint low = subgroupMin(counts ? key_of(bits[i]) : ~0u);
        uint high = subgroupMax(counts ? key_of(bits[i]) : 0u);
        if (subgroupElect()) {
            atomicMin(least[i], low);
            atomicMax(greatest[i], high);
        }
    }
    if (has_nan) atomicAdd(nan, 1u);
    if (has_above) atomicAdd(above, 1u);
    if (has_below) atomicAdd(below, 1u);
    barrier();

    if (index < params.channels) {
        atomicMin(measured.at[0].least[index], least[index]);
        atomicMax(measured.at[0].greatest[index], greatest[index]);
    }
    if (index == 0u) {
        if (nan > 0u) atomicAdd(measured.at[0].nan, nan);
        if (above > 0u) atomicAdd(measured.at[0].above, above);
        if (below > 0u) atomicAdd(measured.at[0].below, below);
    }
}
