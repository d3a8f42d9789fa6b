#ifndef LIB_SIGNAL_GLSL
#define LIB_SIGNAL_GLSL
#include "lib/bindless.glsl"
#include "lib/colour.glsl"
#include "lib/precision.glsl"
#include "shared/denoise.glsl"
// A signal that is denoised and its standard deviation, packed into as few channels as they need. `packing` is one of the SIGNAL_*
// constants, `deviations` an image of its own for the deviations of SIGNAL_FOUR, else NO_IMAGE.
//
// Deviations rather than variances: in 16 bits their smallest step is a 65535th of a signal that reaches from 0 to 1, that of variances
// would be a 256th.

struct Signal {
    vec4 value;
    vec4 variance;  // of each channel; of radiance the luminance's, in all channels
};

Signal load_signal(uint image, uint deviations, ivec2 pixel, uint packing) {
    vec4 texel = load(image, pixel);
    vec4 value, deviation;
    if (packing == SIGNAL_ONE) {
        value = vec4(texel.x, vec3(0.0));
        deviation = vec4(texel.y, vec3(0.0));
    } else if (packing == SIGNAL_TWO) {
        value = vec4(texel.xy, vec2(0.0));
        deviation = vec4(texel.zw, vec2(0.0));
    } else if (packing == SIGNAL_FOUR) {
        value = texel;
        deviation = load(deviations, pixel);
    } else {
        value = vec4(texel.rgb, 0.0);
        deviation = texel.aaaa;
    }
    return Signal(value, deviation * deviation);
}

// Only the variance.
vec4 load_variance(uint image, uint deviations, ivec2 pixel, uint packing) {
    vec4 texel = load(packing == SIGNAL_FOUR ? deviations : image, pixel);
    vec4 deviation = texel;
    if (packing == SIGNAL_ONE) deviation = vec4(texel.y, vec3(0.0));
    else if (packing == SIGNAL_TWO) deviation = vec4(texel.zw, vec2(0.0));
    else if (packing == SIGNAL_RADIANCE) deviation = texel.aaaa;
    return deviation * deviation;
}

// `greatest`: the largest number that the format of radiance holds.
void store_signal(uint image, uint deviations, ivec2 pixel, uint packing, float greatest, Signal signal) {
    vec4 deviation = sqrt(signal.variance);
    if (packing == SIGNAL_ONE) {
        store(image, pixel, vec4(signal.value.x, deviation.x, 0.0, 0.0));
    } else if (packing == SIGNAL_TWO) {
        store(image, pixel, vec4(signal.value.xy, deviation.xy));
    } else if (packing == SIGNAL_FOUR) {
        store(image, pixel, signal.value);
        store(deviations, pixel, deviation);
    } else {
        store(image, pixel, vec4(representable(signal.value.rgb, greatest), representable(deviation.xxx, greatest).x));
    }
}

// What weights compare: each channel on its own, or the luminance of radiance.
vec4 compared(vec4 value, uint packing) {
    return packing == SIGNAL_RADIANCE ? vec4(luminance(value.rgb)) : value;
}

#endif
