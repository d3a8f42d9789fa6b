#version 460
#extension GL_GOOGLE_include_directive : require
#include "lib/bindless.glsl"
#include "lib/blur_taps.glsl"
#include "lib/guide.glsl"
#include "lib/signal.glsl"
// A blur over a disc that is as wide as the history is short. Values that differ by less than their noise approach each other: what a pixel
// takes from another it gives to it, so that no light is lost or gained. The last blur also leaves the history of the next frame.
layout(local_size_x = 8, local_size_y = 8) in;
layout(push_constant, scalar) uniform Push { RecurrentBlurParams params; };

const uint TAPS = 8u;

// The signal with the variance of its mean.
Signal blurred(ViewBuffer view, ivec2 pixel, Guide here, Signal own, vec4 reach) {
    vec2 gradient = depth_gradient(view, pixel, here);
    float turn = disc_turn(view, pixel, params.result == NO_IMAGE ? 2u : 3u), farthest = greatest_of(reach);
    // Weights by place and surface alone; the share that is taken is less where values differ.
    vec4 weights = vec4(1.0), taken = vec4(0.0), change = vec4(0.0), variances = vec4(0.0);
    for (uint i = 1u; i <= TAPS; i++) {
        ivec2 offset = ivec2(round(farthest * disc_tap(i, TAPS, turn)));
        ivec2 at = pixel + offset;
        if (offset == ivec2(0) || !inside(at, view.at[0].size)) continue;
        float edges = edge_weight(here, gradient, load_guide(params.guide, params.normals, at), vec2(offset));
        if (!(edges > 0.0)) continue;
        vec4 weight = edges * both_reach(view, params.noise_width, at, params.packing, length(vec2(offset)), reach);
        Signal there = load_signal(params.signal, params.signal_deviation, at, params.packing);
        // Of radiance each channel counts: two colours may have the same luminance.
        vec4 off = compared(abs(there.value - own.value), params.packing);
        vec4 noise = params.sigma * params.sigma * (own.variance + there.variance);
        // 1 / (1 + x²), with x in deviations; without noise only what is equal is alike.
        vec4 alike = mix(noise / (noise + off * off), vec4(0.0), lessThanEqual(noise, vec4(0.0)));
        weights += weight;
        weight *= alike;
        taken += weight;
        change += weight * (there.value - own.value);
        variances += weight * weight * there.variance;
    }
    vec4 kept = weights - taken;
    return Signal(own.value + change / weights, (kept * kept * own.variance + variances) / (weights * weights));
}

void main() {
    ViewBuffer view = ViewBuffer(params.view);
    ivec2 pixel = ivec2(gl_GlobalInvocationID.xy);
    if (!inside(pixel, view.at[0].size)) return;
    Signal signal = load_signal(params.signal, params.signal_deviation, pixel, params.packing);
    vec4 frames = frames_at(params.frames, pixel, params.packing);
    vec4 width = width_at(params.noise_width, pixel, params.packing);
    Guide here = load_guide(params.guide, params.normals, pixel);
    bool is_last = params.result != NO_IMAGE;
    vec4 share = (is_last ? 2.0 : 1.0) / 3.0 * (1.0 - 2.0 * fresh_share(frames, 0.5 * params.fast_longest));
    vec4 reach = share * blur_reach(view, frames, params.longest, params.radius, width);
    if (is_surface(here) && greatest_of(reach) >= 1.0) signal = blurred(view, pixel, here, signal, reach);
    if (is_last) {
        store(params.result, pixel, vec4(representable(signal.value.rgb, params.greatest), signal.value.a));
        // The blur is fed back in full while the history is short, then less: else it would add up in every frame, and the picture would
        // never become sharp.
        vec4 fed = clamp((params.fast_longest - frames) / (0.5 * params.fast_longest) + 1.0, 0.0, 1.0);
        Signal mean = load_signal(params.accumulated, params.accumulated_deviation, pixel, params.packing);
        Signal mended = load_signal(params.mended, params.mended_deviation, pixel, params.packing);
        vec4 next = mended.value + fed * (signal.value - mended.value);
        // What is used as it is, see `mend_history.comp`, keeps its mean.
        bool waits = params.packing != SIGNAL_RADIANCE && params.noise_width != NO_IMAGE && is_jittered(view);
        if (waits) next = mix(next, mean.value, equal(averaged_width(view, width), vec4(0.0)));
        signal = Signal(next, mean.variance);
    }
    store_signal(params.blurred, params.blurred_deviation, pixel, params.packing, params.greatest, signal);
}
