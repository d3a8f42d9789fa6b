#version 460
#extension GL_GOOGLE_include_directive : require
#include "lib/bindless.glsl"
#include "lib/alike_samples.glsl"
#include "lib/gbuffer.glsl"
#include "lib/history_limits.glsl"
#include "lib/not_finite.glsl"
#include "lib/signal.glsl"
#include "lib/taps.glsl"
// Temporal accumulation: the mean over the frames in which a surface was seen, and the variance of its samples. Mean and variance rather
// than two moments, whose difference loses the digits of small variances (Welford 1962; for exponential weights Finch 2009, "Incremental
// calculation of weighted mean and variance", equations 138 and 143).
layout(local_size_x = 8, local_size_y = 8) in;
layout(push_constant, scalar) uniform Push { AccumulateParams params; };

// History length, frames, up to which the filtered history is used in full.
const float FEW = 4.0;

// Packing of `moments`: of radiance it holds one number.
uint moments_packing() {
    return params.noisy.packing == SIGNAL_RADIANCE ? SIGNAL_ONE : params.noisy.packing;
}

vec4 reprojected(uint image, Taps taps) {
    vec4 sum = vec4(0.0);
    for (int k = 0; k < 4; k++) {
        if (taps.shares[k] > 0.0) sum += taps.shares[k] * load(image, taps.first + ivec2(k & 1, k >> 1));
    }
    return sum;
}

// Mean and variance of the samples before this frame; the luminance of radiance in all channels.
Signal reprojected_moments(Taps taps) {
    Signal sum = Signal(vec4(0.0), vec4(0.0));
    for (int k = 0; k < 4; k++) {
        if (!(taps.shares[k] > 0.0)) continue;
        ivec2 at = taps.first + ivec2(k & 1, k >> 1);
        Signal there = load_signal(params.previous_moments, params.previous_moments_deviation, at, moments_packing());
        sum.value += taps.shares[k] * there.value;
        sum.variance += taps.shares[k] * there.variance;
    }
    return params.noisy.packing == SIGNAL_RADIANCE ? Signal(sum.value.xxxx, sum.variance.xxxx) : sum;
}

// The filtered result of the previous frame: of one and two channels their deviations are in the same image.
vec4 reprojected_filtered(Taps taps) {
    vec4 texel = reprojected(params.previous_filtered, taps);
    if (params.noisy.packing == SIGNAL_ONE) return vec4(texel.x, vec3(0.0));
    if (params.noisy.packing == SIGNAL_TWO) return vec4(texel.xy, vec2(0.0));
    if (params.noisy.packing == SIGNAL_RADIANCE) return vec4(texel.rgb, 0.0);
    return texel;
}

// In a penumbra narrower than this, pixels, both lit and shadowed samples are nearby: a mean outside of their range is out of date.
const float NARROW = 4.0;
const int AROUND = 2;

// Range of the samples in the neighbourhood.
void samples_around(ivec2 pixel, uvec2 size, inout vec4 least, inout vec4 most) {
    for (int y = -AROUND; y <= AROUND; y++) {
        for (int x = -AROUND; x <= AROUND; x++) {
            ivec2 at = pixel + ivec2(x, y);
            if (!inside(at, size)) continue;
            vec4 there = load(params.noisy.image, at);
            if (!is_finite(there)) continue;
            least = min(least, there);
            most = max(most, there);
        }
    }
}

void main() {
    ViewBuffer view = ViewBuffer(params.view);
    ivec2 pixel = ivec2(gl_GlobalInvocationID.xy);
    if (!inside(pixel, view.at[0].size)) return;
    vec4 now = load(params.noisy.image, pixel);
    bool taken = is_taken(params.not_finite, now);
    if (!taken) now = finite_beside(params.noisy.image, pixel, view.at[0].size);
    vec4 sampled = compared(now, params.noisy.packing);

    vec2 was = vec2(pixel) - load(params.motion, pixel).xy * vec2(view.at[0].size);
    Taps taps = load_taps(params.taps, pixel, was);
    vec4 accumulated = now, mean = sampled, variance = vec4(0.0), frames = vec4(taken ? 1.0 : 0.0);
    bool between = is_between(was) || taps.beside;
    if (taps.any) {
        frames = round(reprojected(params.previous_frames, taps) * LONGEST);
        if (params.noisy.packing == SIGNAL_RADIANCE) frames = frames.xxxx;
        vec4 forgotten = vec4(0.0);
        if (params.gradient != NO_IMAGE) {
            // The history is shortened where something has changed (Schied, Peters and Dachsbacher 2018, "Gradient Estimation for Real-Time
            // Adaptive Temporal Filtering", section 3.3).
            forgotten = load(params.gradient, pixel / int(GRADIENT_STRATUM));
            if (params.noisy.packing == SIGNAL_RADIANCE) forgotten = forgotten.xxxx;
            frames *= vec4(1.0) - forgotten;
        }
        frames = min(floor(frames) + (taken ? 1.0 : 0.0), params.longest);
        Signal moments = reprojected_moments(taps);
        vec4 before = moments.value, spread = moments.variance;
        vec4 filtered = reprojected_filtered(taps);
        bool known = is_taken(params.not_finite, before + filtered + spread);
        // Channels that use the sample without its history.
        bvec4 alone = bvec4(false);
        if (params.noisy.width != NO_IMAGE) {
            vec4 width = noise_width(params.noisy.width, pixel, params.noisy.packing);
            HistoryLimits limits = history_limits(view, width, was, between, params.moved, forgotten);
            // Radiance is not clamped: outliers would widen the range.
            bool bounded = params.noisy.packing != SIGNAL_RADIANCE;
            bvec4 narrow = bvec4(uvec4(limits.moves) & uvec4(lessThan(width, vec4(NARROW))) & uvec4(bounded));
            if (any(narrow)) {
                vec4 least = now, most = now;
                samples_around(pixel, view.at[0].size, least, most);
                vec4 inside = mix(before, clamp(before, least, most), narrow);
                // The history is shortened by as much as clamping has moved its mean.
                frames = max(floor(frames * (1.0 - abs(inside - before))), vec4(1.0));
                before = inside;
                filtered = mix(filtered, clamp(filtered, least, most), narrow);
            }
            alone = limits.alone;
            frames = min(frames, limits.longest);
        }
        vec4 share = taken ? 1.0 / frames : vec4(0.0);
        vec4 apart = sampled - before;
        mean = before + share * apart;
        variance = (1.0 - share) * (spread + share * apart * apart);
        vec4 fed = filtered + share * (now - filtered);
        // The history fed back from the filter is smoother than the mean, and more so with every frame. It helps while the history is
        // short, and fades out. Radiance has no unfiltered mean to fade to.
        vec4 plain = params.noisy.packing == SIGNAL_RADIANCE ? fed : mean;
        vec4 helped = clamp((FEW - frames) / (0.5 * params.longest) + 1.0, 0.0, 1.0);
        accumulated = mix(plain + helped * (fed - plain), now, alone);
        if (!known) {
            accumulated = now, mean = sampled, variance = vec4(0.0), frames = vec4(taken ? 1.0 : 0.0);
        }
    }
    // The variance of a mean is that of one sample over their number if they are independent, as samples of different pixels are. Points of
    // one pixel's scrambled sequence are stratified: over an edge in two dimensions the variance falls with n^(3/2) (Owen 1997, "Scrambled
    // net variance for integrals of smooth functions"; Mitchell 1996, "Consequences of Stratified Sampling in Graphics").
    bool elsewhere = taps.beside || any(greaterThan(abs(was - vec2(pixel)), vec2(0.01)));
    vec4 independent = elsewhere ? vec4(1.0) : sqrt(frames);
    vec4 of_mean = params.alike > 0.0 ? vec4(variance_of_mean(frames.x, params.alike)) : 1.0 / max(frames * independent, vec4(1.0));
    Signal signal = Signal(accumulated, variance * of_mean);
    store_signal(params.accumulated, params.accumulated_deviation, pixel, params.noisy.packing, params.greatest, signal);
    store_signal(params.moments, params.moments_deviation, pixel, moments_packing(), params.greatest, Signal(mean, variance));
    store(params.frames, pixel, frames / LONGEST);
}
