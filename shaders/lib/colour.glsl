#ifndef LIB_COLOUR_GLSL
#define LIB_COLOUR_GLSL
// Colour: linear Rec.709 in, display values out.

// Luminance of the primaries of linear Rec.709.
const vec3 LUMINANCE = vec3(0.2126, 0.7152, 0.0722);

float luminance(vec3 c) {
    return dot(c, LUMINANCE);
}

// sRGB encoding (IEC 61966-2-1) of 0..1.
vec3 srgb_encode(vec3 c) {
    vec3 low = 12.92 * c;
    vec3 high = 1.055 * pow(c, vec3(1.0 / 2.4)) - 0.055;
    return mix(high, low, lessThanEqual(c, vec3(0.0031308)));
}

// CIE xyY, given as (Y, x, y) with y above 0, to linear Rec.709 with white D65. Out-of-gamut colours have negative components.
vec3 rec709_of_yxy(vec3 yxy) {
    vec3 xyz = vec3(yxy.y, yxy.z, 1.0 - yxy.y - yxy.z) * (yxy.x / yxy.z);
    return vec3(
        dot(xyz, vec3(3.2404542, -1.5371385, -0.4985314)),
        dot(xyz, vec3(-0.9692660, 1.8760108, 0.0415560)),
        dot(xyz, vec3(0.0556434, -0.2040259, 1.0572252))
    );
}

// AgX (Troy Sobotka 2022): primaries pulled inwards, log2 over a fixed range, one contrast curve, primaries pushed back.
// Matrices and the sixth-degree fit of the default curve as published by Benjamin Wrensch 2023, "Minimal AgX
// Implementation". In: linear, 0 and up. Out: linear display light, 0..1.
vec3 agx(vec3 c) {
    const mat3 inset = mat3(
        0.842479062253094, 0.0423282422610123, 0.0423756549057051,
        0.0784335999999992, 0.878468636469772, 0.0784336,
        0.0792237451477643, 0.0791661274605434, 0.879142973793104
    );
    const mat3 outset = mat3(
        1.19687900512017, -0.0528968517574562, -0.0529716355144438,
        -0.0980208811401368, 1.15190312990417, -0.0980434501171241,
        -0.0990297440797205, -0.0989611768448433, 1.15107367264116
    );
    const float min_ev = -12.47393;
    const float max_ev = 4.026069;

    // The range's lower end is also what keeps black out of the logarithm.
    vec3 x = clamp(log2(max(inset * c, vec3(exp2(min_ev)))), min_ev, max_ev);
    x = (x - min_ev) / (max_ev - min_ev);

    vec3 x2 = x * x;
    vec3 x4 = x2 * x2;
    vec3 curve = 15.5 * x4 * x2 - 40.14 * x4 * x + 31.96 * x4 - 6.868 * x2 * x + 0.4298 * x2 + 0.1191 * x - 0.00232;

    // The fit is -0.002 at black, and the outset may leave the gamut. The curve's output is encoded with the exponent 2.2.
    return pow(clamp(outset * curve, 0.0, 1.0), vec3(2.2));
}

// ACES reference rendering and output transforms for an sRGB display: rational fit by Stephen Hill, in the "BakingLab" sources of
// Matt Pettineo and David Neubelt (2016). In: linear, 0 and up. Out: linear display light, 0..1.
vec3 aces(vec3 c) {
    // Rec.709 to the rendering primaries AP1 with the desaturation of the RRT, by rows.
    vec3 x = vec3(
        dot(c, vec3(0.59719, 0.35458, 0.04823)),
        dot(c, vec3(0.07600, 0.90834, 0.01566)),
        dot(c, vec3(0.02840, 0.13383, 0.83777))
    );
    // From here the curve is flat to 1e-5, and much further its squares would overflow.
    x = min(x, vec3(65504.0));
    x = (x * (x + 0.0245786) - 0.000090537) / (x * (0.983729 * x + 0.4329510) + 0.238081);
    vec3 display = vec3(
        dot(x, vec3(1.60475, -0.53108, -0.07367)),
        dot(x, vec3(-0.10208, 1.10813, -0.00605)),
        dot(x, vec3(-0.00327, -0.07276, 1.07602))
    );
    return clamp(display, 0.0, 1.0);
}

// Linear Rec.709 to luma and two differences, and back, exactly invertible but for rounding (Malvar and Sullivan 2003, "YCoCg-R: A Color
// Space with RGB Reversibility and Low Dynamic Range").
vec3 ycocg_of(vec3 c) {
    return vec3(dot(c, vec3(0.25, 0.5, 0.25)), 0.5 * (c.r - c.b), dot(c, vec3(-0.25, 0.5, -0.25)));
}

vec3 rgb_of_ycocg(vec3 c) {
    float around = c.x - c.z;
    return vec3(around + c.y, c.x + c.z, around - c.y);
}

// Luma-based weight of a YCoCg colour in a mean, so that a few bright samples do not dominate: Karis 2013, "Tone Mapping" (Graphic Rants).
float tone_weight(vec3 ycocg, float exposure) {
    return 1.0 / (1.0 + exposure * ycocg.x);
}

// A YCoCg colour times exposure and that weight: luma in 0 to below 1.
vec3 tone_compress(vec3 ycocg, float exposure) {
    return ycocg * (exposure * tone_weight(ycocg, exposure));
}

// The inverse. Luma of 1 and more has none and is clamped to the greatest that has one in 32 bits.
vec3 tone_expand(vec3 compressed, float exposure) {
    float rest = 1.0 - compressed.x;
    return compressed / (exposure * (rest < 1e-7 ? 1e-7 : rest));
}

#endif
