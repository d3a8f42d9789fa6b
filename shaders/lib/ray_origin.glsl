// Where a ray starts that leaves a surface.
#ifndef LIB_RAY_ORIGIN_GLSL
#define LIB_RAY_ORIGIN_GLSL

// Moves a point off a surface, to the side of the unit normal `n`, by just more than the rounding error of its coordinates
// (Waechter and Binder 2019, "A Fast and Robust Method for Avoiding Self-Intersection", Ray Tracing Gems, chapter 6).
// The step is a number of representable floats, so it grows with the coordinate; near the origin it is a fixed length.
vec3 offset_origin(vec3 p, vec3 n)
{
    const float STEPS = 256.0;
    const float NEAR_ZERO = 1.0 / 32.0;
    const float SHORT_STEP = 1.0 / 65536.0;
    ivec3 steps = ivec3(STEPS * n);
    // Integers count away from zero on both sides of it.
    ivec3 moved = floatBitsToInt(p) + mix(steps, -steps, lessThan(p, vec3(0.0)));
    return mix(intBitsToFloat(moved), p + SHORT_STEP * n, lessThan(abs(p), vec3(NEAR_ZERO)));
}

#endif
