#ifndef LIB_PRECISION_GLSL
#define LIB_PRECISION_GLSL
// Storing radiance in formats of less range than 32-bit floats have.

// Clamps each channel to `greatest`, the greatest number of the target's format; infinite for 32-bit floats, which keeps infinities. By
// comparison, which keeps NaN for `--check` to find; min and clamp may not.
vec3 at_most(vec3 x, float greatest) {
    return mix(x, vec3(greatest), greaterThan(x, vec3(greatest)));
}

#endif
