#version 460
#extension GL_GOOGLE_include_directive : require
#include "lib/bindless.glsl"
#include "lib/blur_taps.glsl"
#include "lib/history_limits.glsl"
#include "lib/two_histories.glsl"
// Mean over frames of samples and of what the previous frame blurred, with the two sources of history of `lib/two_histories.glsl`, and beside it
// one over the last few frames that follows changes fast.
layout(local_size_x = 8, local_size_y = 8) in;
layout(push_constant, scalar) uniform Push { AccumulateBlurredParams params; };

const uint TAPS = 8u;
// Fewer samples around than this say nothing about outliers.
const float ENOUGH = 8.0;

// Width of the noise. That of radiance is as noisy as the distance at which a ray hits something, so it is the mean of 3x3 pixels; where no
// filter reaches another pixel it stays as it is.
vec4 steady_width(ivec2 pixel, uvec2 size) {
    vec4 own = width_at(params.noisy.width, pixel, params.noisy.packing);
    if (params.noisy.width == NO_IMAGE || params.noisy.packing != SIGNAL_RADIANCE || own.x < 2.0) return own;
    vec2 sum = vec2(0.0);
    for (int k = 0; k < 9; k++) {
        ivec2 at = pixel + ivec2(k % 3, k / 3) - 1;
        if (!inside(at, size)) continue;
        float width = noise_width(params.noisy.width, at, params.noisy.packing).x;
        if (width >= 2.0) sum += vec2(width, 1.0);
    }
    return vec4(sum.x / sum.y);
}

// The sample, blurred over its neighbours, for channels with hardly any history.
vec4 blurred(ViewBuffer view, ivec2 pixel, vec4 now, vec4 reach) {
    Guide here = load_guide(params.history.guide, pixel);
    if (!is_surface(here)) return now;
    vec2 gradient = depth_gradient(view, pixel, here);
    vec4 sum = now, weights = vec4(1.0);
    float turn = disc_turn(view, pixel, 1u), farthest = greatest_of(reach);
    uint normals = params.noisy.packing == SIGNAL_RADIANCE ? params.history.normal : NO_IMAGE;
    here.normal = load_guide(params.history.guide, normals, pixel).normal;
    for (uint i = 1u; i <= TAPS; i++) {
        ivec2 offset = ivec2(round(farthest * disc_tap(i, TAPS, turn)));
        ivec2 at = pixel + offset;
        if (offset == ivec2(0) || !inside(at, view.at[0].size)) continue;
        vec4 there = load(params.noisy.image, at);
        if (!is_finite(there)) continue;
        vec4 weight = both_reach(view, params.noisy.width, at, params.noisy.packing, length(vec2(offset)), reach);
        weight *= edge_weight(here, gradient, load_guide(params.history.guide, normals, at), vec2(offset));
        if (is_weighted(params.noisy)) weight *= there.a;
        if (!(greatest_of(weight) > 0.0)) continue;
        weights += weight;
        // A running mean: of equal values it is exactly that value.
        sum += (weight / weights) * (channels_of(there, params.noisy.packing) - sum);
    }
    return sum;
}

void main() {
    ViewBuffer view = ViewBuffer(params.view);
    uvec2 size = view.at[0].size;
    ivec2 pixel = ivec2(gl_GlobalInvocationID.xy);
    if (!inside(pixel, size)) return;
    uint packing = params.noisy.packing;
    bool is_radiance = packing == SIGNAL_RADIANCE;
    vec4 now = load(params.noisy.image, pixel);
    bool taken = is_taken(params.not_finite, now);
    if (!taken) now = finite_beside(params.noisy.image, pixel, size);
    float counts = !taken ? 0.0 : is_weighted(params.noisy) ? now.a : 1.0;
    now = channels_of(now, packing);
    vec4 width = steady_width(pixel, size);
    if (params.width != NO_IMAGE) store(params.width, pixel, width / WIDEST_NOISE);

    Samples samples;
    if (is_radiance) samples = samples_around(pixel, size, params.noisy);
    vec2 was = vec2(pixel) - load(params.motion, pixel).xy * vec2(size);
    Taps taps = load_taps(params.taps, pixel, was);
    vec4 spatial = is_radiance ? compared_variance(samples.variance, packing) : vec4(0.0);
    Past past = past_of(view, pixel, was, taps, params.history, params.noisy, params.not_finite, samples, spatial);
    bool known = past.weight > 0.0;
    vec4 forgotten = params.gradient == NO_IMAGE ? vec4(0.0) : load(params.gradient, pixel / int(GRADIENT_STRATUM));
    vec4 frames = past.frames * (1.0 - forgotten);
    if (is_radiance) frames = vec4(frames_after(frames.x, counts, params.noisy, pixel, is_blurred(view, params.noisy, was), params.longest));
    else frames = min(frames + counts, vec4(params.longest));
    if (!is_radiance && params.noisy.width != NO_IMAGE) {
        bool between = is_between(was) || taps.beside;
        frames = min(frames, history_limits(view, width, was, between, params.moved, forgotten).longest);
    }
    float few = 0.5 * params.fast_longest;
    if (!is_radiance && least_of(frames_used(frames, packing)) <= few) {
        samples = samples_around(pixel, size, params.noisy);
        spatial = samples.variance;
    }

    vec4 sampled = compared(now, packing);
    vec4 before = compared(past.value, packing);
    vec4 reach = blur_reach(view, frames, params.longest, params.radius, width);
    // A sample far brighter than those around and before is limited. What the history has seen once passes from then on: its variance has it.
    if (is_radiance && samples.count_beside >= ENOUGH && reach.x >= 1.0) {
        float deviation = sqrt(compared_variance(samples.variance_beside, packing).x);
        float limit = luminance(samples.mean_beside.rgb) + params.outliers * deviation;
        if (known) limit = max(limit, before.x + params.outliers * sqrt(past.variance.x));
        if (sampled.x > limit) now *= max(limit, 0.0) / sampled.x;
    }
    vec4 limited = compared(now, packing);

    vec4 part = mix(vec4(0.0), min(vec4(counts) / frames, vec4(1.0)), greaterThan(frames, vec4(0.0)));
    vec4 fast_part = mix(vec4(0.0), min(vec4(counts) / min(frames, vec4(params.fast_longest)), vec4(1.0)), greaterThan(frames, vec4(0.0)));
    vec4 fast = known ? past.fast + fast_part * (limited - past.fast) : limited;
    vec4 wide = reach * fresh_share(frames, few);
    if (greatest_of(wide) >= 1.0) now = blurred(view, pixel, now, wide);
    vec4 value = now, variance = spatial;
    if (known) {
        vec4 apart = sampled - before;
        value = past.value + part * (now - past.value);
        variance = (1.0 - part) * (past.variance + part * apart * apart);
        // A few samples may happen to be alike.
        variance = mix(max(variance, spatial), variance, clamp(frames - 1.0, 0.0, 1.0));
    }
    store_signal(params.accumulated, params.accumulated_deviation, pixel, packing, params.greatest, Signal(value, variance));
    store(params.frames, pixel, frames);
    store(params.fast, pixel, is_radiance ? representable(fast.xxx, params.greatest).xxxx : fast);
}
