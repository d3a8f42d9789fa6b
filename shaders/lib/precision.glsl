#ifndef LIB_PRECISION_GLSL
#define LIB_PRECISION_GLSL
// Storing radiance in formats of less range than 32-bit floats have.

// Brings each channel down to `greatest`, the greatest number that the target's format holds; infinite for 32-bit floats. Chosen by
// comparison, which keeps a NaN for the scan to find; min and clamp may not. Of 32-bit floats an infinity stays one as well.
vec3 at_most(vec3 x, float greatest) {
    return mix(x, vec3(greatest), greaterThan(x, vec3(greatest)));
}

#endif
