#ifndef LIB_SURFEL_ESTIMATOR_GLSL
#define LIB_SURFEL_ESTIMATOR_GLSL
#include "lib/colour.glsl"
#include "shared/surfels.glsl"
// Means over time of what a surfel gathers, which follow changes of light.

// Window of the short mean, as the share of the newest sample.
const float SHORT_WINDOW = 0.08;
// Most samples that the running mean stands for.
const float MOST_SAMPLES = 512.0;
// Share of the newest sample in the mean that paths take. Light that is passed on from surfel to surfel needs 1 / (share * (1 - albedo)) frames to
// spread, and the mean of the picture keeps what it lacked until then; the noise is averaged by those who take it.
const float NEWEST = 0.5;
// With fewer samples the newest alone: light then spreads by a bounce in each frame.
const float SPREADING = 16.0;

// Share of the newest sample in `Estimator::newest`.
float share_of_newest(Estimator e) {
    return e.samples < SPREADING ? 1.0 : NEWEST;
}

// Samples below which their weights in the running mean rise with the third power of their number, and with the second; from there on with their number.
const float FEW = 24.0;
const float SOME = 64.0;

// Variance of the running mean, over that of samples: about, as it depends on the power.
float noise_of_mean(Estimator e) {
    return 2.0 / max(e.samples, 1.0);
}

// Variance of the luminance of the running mean.
float variance_of_mean(Estimator e) {
    return luminance(max(vec3(e.variance), 0.0)) * noise_of_mean(e);
}

// Samples from which on their variance tells what is bright. Before, samples are limited to so many times the brightest one nearby.
const float LIMITED_FROM = 8.0;
const float YOUNG = 32.0;
// Light that is no more than so many times as bright as the brightest nearby is no accident.
const float BRIGHTER = 4.0;

// What a path has brought.
struct Sample {
    vec3 radiance;
    float density;  // of its direction, over that of cosine-distributed ones
    vec3 along;     // part of the direction in the plane
    float nearby;   // luminance of the brightest radiance of late of surfels around, 0 for none
};

// Share of the brightest sample of late that another sample takes from it.
const float FADING = 0.001;

// A sample whose luminance is above a limit, scaled down to it: one such sample may be an accident. If light nearly as bright came before, to this surfel
// or to one nearby, it comes from few directions, and the sample is taken as it is, however rarely its direction is drawn. Where all was dark any light is let in.
vec3 limited(inout Estimator e, Sample new, float limit) {
    float bright = luminance(new.radiance);
    float known = max(e.brightest, new.nearby);
    float most = max(e.samples < LIMITED_FROM ? YOUNG * known : limit * new.density, BRIGHTER * known);
    e.brightest = max(bright, (1.0 - FADING) * e.brightest);
    return new.radiance / new.density * (bright > most && known > 0.0 ? most / bright : 1.0);
}

// Blend of the multi-scale mean (Andersson and others, SEED, "Multiscale Mean Estimator", published with Halen and others 2021, "Global
// Illumination Based on Surfels"). Two things differ: a sample far above the others is scaled down, where the original subtracts what is too much,
// which turns an infinite sample into NaN; and the limit has no constant part, so that it holds for dim and bright scenes alike.
vec3 add_to_multi_scale(inout Estimator e, Sample new, out float blend) {
    if (e.samples == 0.0) {
        vec3 y = limited(e, new, 0.0);
        e.mean = y;
        e.short_mean = y;
        e.variance = y * y;
        e.variance_blend = 1.0;
        e.inconsistency = 1.0;
        blend = 1.0;
        return y;
    }
    vec3 deviation = sqrt(e.variance);
    vec3 y = limited(e, new, luminance(1.1 * e.short_mean + 8.0 * deviation));
    vec3 before = y - e.short_mean;
    e.short_mean = mix(e.short_mean, y, SHORT_WINDOW);
    vec3 after = y - e.short_mean;
    e.variance = mix(e.variance, before * after, 0.5 * SHORT_WINDOW);
    deviation = max(sqrt(max(e.variance, 0.0)), 1e-4 * e.short_mean + 1e-12);
    float difference = luminance(abs(e.mean - e.short_mean) / deviation);
    e.inconsistency = mix(e.inconsistency, difference, 0.08);
    float fast = smoothstep(0.0, 1.0, difference * max(0.02, e.inconsistency - 0.2));
    blend = clamp(fast, 1.0 / 256.0, 1.0) * e.variance_blend;
    e.variance_blend = mix(e.variance_blend, clamp(luminance(0.5 * e.short_mean / deviation), 1.0 / 32.0, 1.0), 0.1);
    e.mean = mix(e.mean, y, blend);
    return y;
}

// Mean over all samples. Later ones count more, as the first were taken before light had spread, or while it still changed; from MOST_SAMPLES on the mean
// is exponential. Where the light changes, surfel_refresh.comp lets it begin anew.
vec3 add_to_running_mean(inout Estimator e, Sample new, out float blend) {
    float count = min(e.samples + 1.0, MOST_SAMPLES);
    float power = count < FEW ? 3.0 : count < SOME ? 2.0 : 1.0;
    blend = (power + 1.0) / (count + power);
    vec3 y = limited(e, new, 4.0 * luminance(e.mean) + 8.0 * luminance(sqrt(max(vec3(e.variance), 0.0))));
    vec3 before = y - e.mean;
    e.mean += blend * before;
    e.variance = mix(e.variance, before * before, 1.0 / count);
    e.short_mean = mix(e.short_mean, y, max(1.0 / count, SHORT_WINDOW));
    return y;
}

// Adds what a path has brought.
void add_sample(inout Estimator e, Sample new, uint kind) {
    float blend;
    vec3 y = kind == MULTI_SCALE ? add_to_multi_scale(e, new, blend) : add_to_running_mean(e, new, blend);
    e.newest = mix(e.newest, y, share_of_newest(e));
    for (int channel = 0; channel < 3; channel++) e.tilt[channel] = mix(e.tilt[channel], y[channel] * new.along, blend);
    e.samples = min(e.samples + 1.0, MOST_SAMPLES);
}

#endif
