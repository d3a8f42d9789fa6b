#ifndef LIB_TAPS_GLSL
#define LIB_TAPS_GLSL
#include "lib/bindless.glsl"
// The result of reprojection in one word: weights of four pixels of the previous frame, 8 bits each but for the last, which makes the sum
// 1, and the offset of these pixels from the reprojected position.

struct Taps {
    bool any;       // false if the surface was not visible
    bool beside;    // the four are not those around the reprojected position
    ivec2 first;    // upper left of the four
    vec4 shares;    // upper left, upper right, lower left, lower right; they sum to 1
};

const uint TAPS_ANY = 1u << 31u;

// `shares` are not negative, and not all 0; `offset` is -1 to 1 in each direction.
uint pack_taps(vec4 shares, ivec2 offset) {
    uvec3 parts = uvec3(round(255.0 * shares.xyz / (shares.x + shares.y + shares.z + shares.w)));
    // If the fourth weight is 0, rounding must not make it positive, nor take it from a third that is 0.
    if (shares.w == 0.0) {
        if (shares.z > 0.0) parts.z = 255u - parts.x - parts.y;
        else if (shares.y > 0.0) parts.y = 255u - parts.x;
    }
    parts.z = min(parts.z, 255u - parts.x - parts.y);
    uvec2 places = uvec2(offset + 1);
    return TAPS_ANY | parts.x | (parts.y << 8u) | (parts.z << 16u) | (places.x << 24u) | (places.y << 26u);
}

// `was`: the reprojected position, pixels.
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
