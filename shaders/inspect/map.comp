#version 460
#extension GL_GOOGLE_include_directive : require
#include "lib/bindless.glsl"
#include "lib/colour.glsl"
#include "lib/not_finite.glsl"
#include "lib/random.glsl"
#include "shared/inspect.glsl"
// An image of any format as colours to look at. It is scaled without a filter, so that its own pixels are seen.
layout(local_size_x = 8, local_size_y = 8) in;
layout(push_constant, scalar) uniform Push { InspectMapParams params; };

// Beside the image.
const vec3 BESIDE = vec3(24.0 / 255.0);
// What is not finite: squares of magenta and of one of these.
const vec3 MAGENTA = vec3(1.0, 0.0, 1.0);
const vec3 WITH_NAN = vec3(0.0);
const vec3 WITH_ABOVE = vec3(1.0, 1.0, 0.0);
const vec3 WITH_BELOW = vec3(0.0, 1.0, 1.0);
// Their side, pixels of the target.
const int SQUARE = 4;

// False colours: nine of the 256 colours of viridis, evenly spaced, with straight lines between. Nathaniel Smith and Stefan van der Walt
// 2015, "A Better Default Colormap for Matplotlib" (SciPy 2015); the table is in the public domain (CC0).
const int LAST = 8;
const vec3 VIRIDIS[LAST + 1] = vec3[](
    vec3(68.0, 1.0, 84.0), vec3(71.0, 45.0, 123.0), vec3(59.0, 82.0, 139.0), vec3(44.0, 114.0, 142.0), vec3(33.0, 145.0, 140.0),
    vec3(40.0, 174.0, 128.0), vec3(94.0, 201.0, 98.0), vec3(173.0, 220.0, 48.0), vec3(253.0, 231.0, 37.0)
);

// From blue over light grey to red: the ends and the middle of the map in Kenneth Moreland 2009, "Diverging Color Maps for Scientific
// Visualization" (ISVC 2009), with straight lines between.
const vec3 COOL = vec3(59.0, 76.0, 192.0);
const vec3 NEITHER = vec3(221.0, 221.0, 221.0);
const vec3 WARM = vec3(180.0, 4.0, 38.0);

vec3 false_colour(float x) {
    float at = x * float(LAST);
    int below = min(int(at), LAST - 1);
    return mix(VIRIDIS[below], VIRIDIS[below + 1], at - float(below)) / 255.0;
}

vec3 signed_colour(float x) {
    return (x < 0.5 ? mix(COOL, NEITHER, 2.0 * x) : mix(NEITHER, WARM, 2.0 * x - 1.0)) / 255.0;
}

// Whether this channel is shown.
bool is_shown(uint i) {
    if (i >= params.channels) return false;
    bool is_one = params.channel >= INSPECT_RED && params.channel < INSPECT_LUMINANCE;
    return is_one ? i == params.channel - INSPECT_RED : i < 3u;
}

vec3 distinct_colour(uvec4 bits) {
    uvec4 shown = uvec4(0u);
    for (uint i = 0u; i < 4u; i++) {
        if (is_shown(i)) shown[i] = bits[i];
    }
    if (all(equal(shown, uvec4(0u)))) return vec3(0.0);
    return 0.2 + 0.8 * vec3(hash4(shown).xyz >> 24u) / 255.0;
}

// The one number that is shown of a pixel.
float number_of(vec4 value) {
    if (params.channel == INSPECT_LENGTH) return length(value.rgb);
    if (params.channel == INSPECT_RGB || params.channel == INSPECT_LUMINANCE) {
        return params.channels < 3u ? value.r : luminance(value.rgb);
    }
    return value[params.channel - INSPECT_RED];
}

// 0..1 over the range.
vec3 in_range(vec3 x) {
    return clamp(x * params.gain + params.bias, 0.0, 1.0);
}

vec3 colour_of(uvec4 bits, vec4 value) {
    if (params.colours == INSPECT_DISTINCT) return distinct_colour(bits);
    float number = number_of(value);
    if (params.colours == INSPECT_FALSE) return false_colour(in_range(vec3(number)).x);
    if (params.colours == INSPECT_SIGNED) return signed_colour(in_range(vec3(number)).x);
    bool is_grey = params.channel != INSPECT_RGB || params.channels == 1u;
    vec3 plain = in_range(is_grey ? vec3(number) : value.rgb);
    // A channel that the format lacks is black, wherever the range begins.
    if (!is_grey && params.channels == 2u) plain.b = 0.0;
    return params.encodes == 1u ? srgb_encode(plain) : plain;
}

void main() {
    ivec2 target = ivec2(gl_GlobalInvocationID.xy);
    if (!inside(target, params.target_size)) return;
    vec2 at = (vec2(target) + 0.5 - params.place.xy) / params.place.zw * vec2(params.size);
    if (any(lessThan(at, vec2(0.0))) || any(greaterThanEqual(at, vec2(params.size)))) {
        store(params.target, target, vec4(BESIDE, 1.0));
        return;
    }
    uvec4 bits;
    if (params.is_uint == 1u) bits = load_uint(params.image, ivec2(at));
    else bits = floatBitsToUint(load(params.image, ivec2(at)));
    vec4 value = params.is_uint == 1u ? vec4(bits) : uintBitsToFloat(bits);

    bool has_nan = false;
    bool has_above = false;
    bool has_below = false;
    for (uint i = 0u; i < 4u; i++) {
        if (params.is_uint == 1u || !is_shown(i)) continue;
        bool is_negative = (bits[i] & 0x80000000u) != 0u;
        has_nan = has_nan || is_nan_bits(bits[i]);
        has_above = has_above || (is_infinite_bits(bits[i]) && !is_negative);
        has_below = has_below || (is_infinite_bits(bits[i]) && is_negative);
    }
    vec3 colour;
    if (has_nan || has_above || has_below) {
        bool is_even = ((target.x / SQUARE + target.y / SQUARE) & 1) == 0;
        colour = is_even ? MAGENTA : has_nan ? WITH_NAN : has_above ? WITH_ABOVE : WITH_BELOW;
    } else {
        colour = colour_of(bits, value);
    }
    store(params.target, target, vec4(colour, 1.0));
}
