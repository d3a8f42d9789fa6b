#ifndef LIB_SURFACE_CODES_GLSL
#define LIB_SURFACE_CODES_GLSL
// Depth and instance of what a pixel saw, in so few bits that each pixel can keep them for the next frame.

// Depth is stored as its logarithm, in steps of 0.07 %; a history may differ by DEPTH_TOLERANCE of them.
const float DEPTH_STEPS = 65534.0;
const float DEPTH_OCTAVES = 64.0;
const uint DEPTH_TOLERANCE = 30u;
const uint INSTANCE_BITS = 24u;
// Beside the bits of instances: whether the light is changing, whether it did so in this very frame, and how still the pixel is.
const uint CHANGES_BIT = 1u << INSTANCE_BITS;
const uint HAS_CHANGED_BIT = CHANGES_BIT << 1;
const uint STILLNESS_SHIFT = INSTANCE_BITS + 2u;
const float MOST_STILLNESS = 63.0;

// Reversed depth in 16 bits; 0 is background.
uint depth_code(float depth) {
    if (!(depth > 0.0)) return 0u;
    return 1u + uint(clamp(log2(depth) / DEPTH_OCTAVES + 1.0, 0.0, 1.0) * DEPTH_STEPS + 0.5);
}

// The inverse of depth_code, for codes above 0.
float depth_of_code(uint code) {
    return exp2((float(code - 1u) / DEPTH_STEPS - 1.0) * DEPTH_OCTAVES);
}

// One of 24 bits for each instance; consecutive instances have different ones.
uint instance_bit(uint instance) {
    return 1u << (instance % INSTANCE_BITS);
}

#endif
