#ifndef LIB_SEQUENCE_GLSL
#define LIB_SEQUENCE_GLSL
#include "lib/random.glsl"
// Low-discrepancy points that continue from frame to frame: Owen-scrambled Sobol points (Burley 2020, "Practical Hash-based Owen
// Scrambling", JCGT 9(4)). Every pixel has its own scramble, so pixels do not correlate. Each point of a pixel is uniform, which makes
// their mean unbiased, and any 2^k consecutive points from a multiple of 2^k on are stratified over every division into 2^k elementary
// intervals.

// Values for `dimension` of `sequence2`: different values give independent points.
const uint SEQUENCE_AO = 0u;
const uint SEQUENCE_EMITTERS = 24u;           // and two after it
const uint SEQUENCE_REFLECTIONS = 28u;
const uint SEQUENCE_GI = 30u;                 // and one after it
const uint SEQUENCE_DIRECT = 32u;             // and two for each light of the scene after it
const uint SEQUENCE_SURFELS = 0x40000000u;    // and eight after it
const uint SEQUENCE_SHADOWS = 0x80000000u;    // and one for each light of the scene after it

// A permutation of the words in which each bit depends on the bits below it only (Laine and Karras 2011, "Stratified Sampling for
// Stochastic Transparency"), with the constants of Vegdahl 2021, "Building a Better LK Hash". Owen scrambling of a word read backwards.
uint scramble_upwards(uint x, uint key) {
    x ^= x * 0x3d20adeau;
    x += key;
    x *= (key >> 16u) | 1u;
    x ^= x * 0x05526c56u;
    x ^= x * 0x53a22864u;
    return x;
}

// The second coordinate of point `index` of the Sobol sequence, bit-reversed. Its matrix is Pascal's triangle modulo 2, whose five factors
// are these shifts (Sobol 1967; the factors follow from Lucas's theorem). The first coordinate, bit-reversed, is `index`.
uint sobol_second(uint index) {
    index ^= (index & 0xaaaaaaaau) >> 1u;
    index ^= (index & 0xccccccccu) >> 2u;
    index ^= (index & 0xf0f0f0f0u) >> 4u;
    index ^= (index & 0xff00ff00u) >> 8u;
    index ^= index >> 16u;
    return index;
}

// Point `index` in [0, 1)² of a pixel's sequence for `dimension`. With n samples per frame, sample s of frame f has the index f * n + s.
vec2 sequence2(ivec2 pixel, uint index, uint dimension, uint seed) {
    uvec4 key = hash4(uvec4(uvec2(pixel), dimension, seed));
    // The order is shuffled too: sequences of two dimensions would otherwise correlate.
    uint shuffled = bitfieldReverse(scramble_upwards(bitfieldReverse(index), key.z));
    uvec2 words = uvec2(scramble_upwards(shuffled, key.x), scramble_upwards(sobol_second(shuffled), key.y));
    return vec2(bitfieldReverse(words) >> 8u) * (1.0 / 16777216.0);
}

#endif
