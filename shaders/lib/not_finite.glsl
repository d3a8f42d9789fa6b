#ifndef LIB_NOT_FINITE_GLSL
#define LIB_NOT_FINITE_GLSL
// NaN and infinity by their bits: a compiler may assume that floats are finite and fold isnan() away.
// IEEE 754-2019, 3.4: all ones in the exponent; the rest is zero for an infinity.

const uint EXPONENT_BITS = 0x7f800000u;
const uint MANTISSA_BITS = 0x007fffffu;

bool is_nan_bits(uint bits) {
    return (bits & EXPONENT_BITS) == EXPONENT_BITS && (bits & MANTISSA_BITS) != 0u;
}

bool is_infinite_bits(uint bits) {
    return (bits & EXPONENT_BITS) == EXPONENT_BITS && (bits & MANTISSA_BITS) == 0u;
}

#endif
