#ifndef LIB_RANDOM_GLSL
#define LIB_RANDOM_GLSL
// Independent random numbers, by hashing a key: no state in memory, and the same picture with every way to trace.

struct Random {
    uvec4 key;  // pixel, sample, seed, and how many numbers were drawn so far
};

Random random_of(uint pixel, uint sample_index, uint seed) {
    return Random(uvec4(pixel, sample_index, seed, 0u));
}

// Four words that differ in about half of their bits wherever the key differs (Jarzynski and Olano 2020, "Hash Functions for GPU
// Rendering", JCGT 9(3): pcg4d).
uvec4 hash4(uvec4 v) {
    v = v * 1664525u + 1013904223u;
    v.x += v.y * v.w;
    v.y += v.z * v.x;
    v.z += v.x * v.y;
    v.w += v.y * v.z;
    v ^= v >> 16u;
    v.x += v.y * v.w;
    v.y += v.z * v.x;
    v.z += v.x * v.y;
    v.w += v.y * v.z;
    return v;
}

uvec4 random_words(inout Random random) {
    random.key.w++;
    return hash4(random.key);
}

// In [0, 1), in steps of 2^-24.
vec4 unit_floats(uvec4 words) {
    return vec4(words >> 8u) * (1.0 / 16777216.0);
}

vec4 random4(inout Random random) {
    return unit_floats(random_words(random));
}

#endif
