#ifndef LIB_PRECISION_GLSL
#define LIB_PRECISION_GLSL
// Storing radiance in formats of less range and precision than 32-bit floats have.

// The nearest number that the target's format holds, for formats of 16-bit floats: `greatest` is the greatest of them, which larger values
// become. For 32-bit floats it is infinite, and everything stays as it is, infinities included. Comparisons keep NaN for `--check` to find;
// min and clamp may not.
//
// Vulkan lets a device round stores towards zero, which would darken the picture with each pass, and a mean over frames with each frame.
vec3 representable(vec3 x, float greatest) {
    if (greatest > 65504.0) return x;
    // To 10 bits of mantissa, ties to even.
    uvec3 bits = floatBitsToUint(x);
    vec3 nearest = uintBitsToFloat((bits + 0xfffu + ((bits >> 13u) & 1u)) & ~0x1fffu);
    vec3 kept = mix(x, nearest, lessThan(abs(x), vec3(greatest)));
    return mix(kept, vec3(greatest), greaterThan(x, vec3(greatest)));
}

#endif
