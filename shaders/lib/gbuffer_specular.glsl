#ifndef LIB_GBUFFER_SPECULAR_GLSL
#define LIB_GBUFFER_SPECULAR_GLSL
#include "lib/brdf.glsl"
// The reflection of the dielectric part in blue and alpha of the G-buffer's material: 30 bits in two numbers of 15, which both RGBA16 snorm
// and 32-bit floats hold exactly. Six bits of f90, and eight for the root of each channel of f0. Exact are an f0 of 0, 0.04 and 1, and an
// f90 of 0 and 1; elsewhere f0 is at most sqrt(f0) / 255 off, and f90 1 / 126.

// Value for images without blue and alpha: the plain dielectric of index 1.5.
const vec2 NO_SPECULAR_CODE = vec2(0.0, 1.0);

vec2 encode_dielectric(Dielectric d) {
    if (d.f0 == PLAIN_DIELECTRIC.f0 && d.f90 == PLAIN_DIELECTRIC.f90) return NO_SPECULAR_CODE;
    uvec3 root = uvec3(sqrt(clamp(d.f0, 0.0, 1.0)) * 255.0 + 0.5);
    uint grazing = uint(clamp(d.f90, 0.0, 1.0) * 63.0 + 0.5);
    uint low = ((root.g & 127u) << 8u) | root.b;
    uint high = (grazing << 9u) | (root.r << 1u) | (root.g >> 7u);
    // The code of the plain dielectric is reserved. It would decode to a coloured f0 with an f90 of 0, which no material has.
    if (high == 0u && low == 32767u) low--;
    return vec2(high, low) / 32767.0;
}

Dielectric decode_dielectric(vec2 code) {
    if (code == NO_SPECULAR_CODE) return PLAIN_DIELECTRIC;
    uvec2 words = uvec2(code * 32767.0 + 0.5);
    vec3 root = vec3((words.x >> 1u) & 255u, ((words.x & 1u) << 7u) | (words.y >> 8u), words.y & 255u) / 255.0;
    return Dielectric(root * root, float(words.x >> 9u) / 63.0);
}

#endif
