#ifndef LIB_NOT_FINITE_GLSL
#define LIB_NOT_FINITE_GLSL
#include "lib/bindless.glsl"
// NaN and infinity by their bits: a compiler may assume that floats are finite and fold isnan() away.
// IEEE 754-2019, 3.4: all ones in the exponent; the rest is zero for an infinity.
//
// Values that are not finite are never kept or averaged. Each effect asks `is_taken` once about each value that it takes in, and once about
// its history; a rejected value is counted and treated as missing, with no substitute.

const uint EXPONENT_BITS = 0x7f800000u;
const uint MANTISSA_BITS = 0x007fffffu;

layout(buffer_reference, scalar, buffer_reference_align = 4) buffer NotFiniteCounter { uint count; };

bool is_nan_bits(uint bits) {
    return (bits & EXPONENT_BITS) == EXPONENT_BITS && (bits & MANTISSA_BITS) != 0u;
}

bool is_infinite_bits(uint bits) {
    return (bits & EXPONENT_BITS) == EXPONENT_BITS && (bits & MANTISSA_BITS) == 0u;
}

// Neither NaN nor infinity in any channel.
bool is_finite(vec4 value) {
    return all(notEqual(floatBitsToUint(value) & EXPONENT_BITS, uvec4(EXPONENT_BITS)));
}

bool is_finite(vec3 value) {
    return is_finite(vec4(value, 0.0));
}

// Whether a value may be used; one that is not finite is counted at `counter` (`Record::not_finite`).
bool is_taken(uvec2 counter, vec4 value) {
    if (is_finite(value)) return true;
    atomicAdd(NotFiniteCounter(counter).count, 1u);
    return false;
}

bool is_taken(uvec2 counter, vec3 value) {
    return is_taken(counter, vec4(value, 0.0));
}

// For a pixel without a usable value: the mean of its finite neighbours; 0 if there are none.
vec4 finite_beside(uint image, ivec2 pixel, uvec2 size) {
    vec4 sum = vec4(0.0);
    float count = 0.0;
    for (int k = 0; k < 9; k++) {
        ivec2 at = pixel + ivec2(k % 3, k / 3) - 1;
        if (k == 4 || any(greaterThanEqual(uvec2(at), size))) continue;
        vec4 there = load(image, at);
        if (!is_finite(there)) continue;
        sum += there;
        count += 1.0;
    }
    return count > 0.0 ? sum / count : vec4(0.0);
}

#endif
