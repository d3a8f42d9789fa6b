#ifndef LIB_TAPS_GLSL
#define LIB_TAPS_GLSL
#include "lib/bindless.glsl"
// Where a pixel's surface was seen one frame ago, in one word: shares of four pixels of that frame, 8 bits each but for the last, which is
// what is left of 1, and which four they are, counted from the pixel at or before the place that motion leads to.

struct Taps {
    bool any;       // false where the surface was not seen
    bool beside;    // the four are not those around the place that motion leads to
    ivec2 first;    // upper left of the four
    vec4 shares;    // upper left, upper right, lower left, lower right; they sum to 1
};

const uint TAPS_ANY = 1u << 31u;

// `shares` are 0 or more, not all of them 0; `offset` is -1 to 1 each way.
uint pack_taps(vec4 shares, ivec2 offset) {
    uvec3 parts = uvec3(round(255.0 * shares.xyz / (shares.x + shares.y + shares.z + shares.w)));
    // Where the fourth has nothing, rounding shall not give it anything, nor take from the third what is not there.
    if (shares.w == 0.0) {
        if (shares.z > 0.0) parts.z = 255u - parts.x - parts.y;
        else if (shares.y > 0.0) parts.y = 255u - parts.x;
    }
    parts.z = min(parts.z, 255u - parts.x - parts.y);
    uvec2 places = uvec2(offset + 1);
    return TAPS_ANY | parts.x | (parts.y << 8u) | (parts.z << 16u) | (places.x << 24u) | (places.y << 26u);
}

// `was`: the pixel's place one frame ago, in pixels.
Taps load_taps(uint image, ivec2 pixel, vec2 was) {
    uint word = load_uint(image, pixel).x;
    ivec2 offset = ivec2((word >> 24u) & 3u, (word >> 26u) & 3u) - 1;
    uvec3 parts = uvec3(word, word >> 8u, word >> 16u) & 255u;
    Taps taps;
    taps.any = (word & TAPS_ANY) != 0u;
    taps.beside = offset != ivec2(0);
    taps.first = ivec2(floor(was)) + offset;
    taps.shares = vec4(parts, 255u - parts.x - parts.y - parts.z) / 255.0;
    return taps;
}

#endif
