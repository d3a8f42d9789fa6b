#version 460
#extension GL_GOOGLE_include_directive : require
#include "lib/bindless.glsl"
#include "lib/history_limits.glsl"
#include "lib/two_histories.glsl"
// Mean over frames with the two sources of history of `lib/two_histories.glsl`, clamped to the samples around.
layout(local_size_x = 8, local_size_y = 8) in;
layout(push_constant, scalar) uniform Push { DualSourceParams params; };

// The deviation over frames is trusted from this many on.
const float FEW = 4.0;

void main() {
    ViewBuffer view = ViewBuffer(params.view);
    ivec2 pixel = ivec2(gl_GlobalInvocationID.xy);
    if (!inside(pixel, view.at[0].size)) return;
    vec4 now = load(params.noisy.image, pixel);
    bool taken = is_taken(params.not_finite, now);
    if (!taken) now = finite_beside(params.noisy.image, pixel, view.at[0].size);
    uint packing = params.noisy.packing;
    float counts = !taken ? 0.0 : is_weighted(params.noisy) ? now.a : 1.0;
    now = channels_of(now, packing);
    Samples samples = samples_around(pixel, view.at[0].size, params.noisy);
    vec4 spatial = compared_variance(samples.variance, packing);

    vec2 was = vec2(pixel) - load(params.motion, pixel).xy * vec2(view.at[0].size);
    Taps taps = load_taps(params.taps, pixel, was);
    Past history = past_of(view, pixel, was, taps, params.history, params.noisy, params.not_finite, samples, spatial);
    vec4 value = now, variance = spatial;
    float frames = counts;
    if (history.weight > 0.0) {
        vec4 before = history.value;
        vec4 spread = history.variance;
        float past = history.frames.x;
        if (params.gradient != NO_IMAGE) past *= 1.0 - load(params.gradient, pixel / int(GRADIENT_STRATUM)).r;
        vec4 reach = FARTHEST * sqrt(samples.variance + spread / max(past, 1.0));
        vec4 near = clamp(before, samples.mean - reach, samples.mean + reach);
        // The history is shortened by as much as clamping has moved it.
        vec4 moved = abs(near - before) / max(reach, vec4(1e-6) + 1e-3 * abs(samples.mean));
        past /= 1.0 + max(max(moved.x, moved.y), max(moved.z, moved.w));
        frames = frames_after(past, counts, params.noisy, pixel, is_blurred(view, params.noisy, was), params.longest);
        float part = frames > 0.0 ? min(counts / frames, 1.0) : 0.0;
        vec4 apart = compared(now, packing) - compared(near, packing);
        value = near + part * (now - near);
        variance = (1.0 - part) * (spread + part * apart * apart);
        // A few samples may happen to be alike.
        variance = mix(max(variance, spatial), variance, clamp(frames / FEW - 1.0, 0.0, 1.0));
    }
    store_signal(params.accumulated, params.accumulated_deviation, pixel, packing, params.greatest, Signal(value, variance));
    store(params.frames, pixel, vec4(frames));
    if (params.source != NO_IMAGE) store(params.source, pixel, history.weight > 0.0 ? vec4(1.0 - history.image, history.image, 0.0, 0.0) : vec4(0.0));
}
