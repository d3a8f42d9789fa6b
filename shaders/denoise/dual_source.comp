#version 460
#extension GL_GOOGLE_include_directive : require
#include "lib/bindless.glsl"
#include "lib/noise_width.glsl"
#include "lib/not_finite.glsl"
#include "lib/same_surface.glsl"
#include "lib/signal.glsl"
#include "lib/taps.glsl"
#include "lib/virtual_image.glsl"
// Mean over frames with two sources of history: where the surface was, and where the image that it reflects was (Stachowiak 2018, "Stochastic
// All The Things"). Each counts by the frames that it has and by how well it agrees with the samples around.
layout(local_size_x = 8, local_size_y = 8) in;
layout(push_constant, scalar) uniform Push { DualSourceParams params; };

// Half of the side of the square of samples that a history is compared with.
const int AROUND = 2;
// A history further from the mean of these samples is out of date, standard deviations.
const float FARTHEST = 2.0;
// The deviation over frames is trusted from this many on.
const float FEW = 4.0;

// The samples around a pixel: mean and variance of each channel.
struct Samples {
    vec4 mean;
    vec4 variance;
};

Samples samples_around(ivec2 pixel, uvec2 size) {
    vec4 sum = vec4(0.0), squares = vec4(0.0);
    float count = 0.0;
    for (int y = -AROUND; y <= AROUND; y++) {
        for (int x = -AROUND; x <= AROUND; x++) {
            ivec2 at = pixel + ivec2(x, y);
            if (!inside(at, size)) continue;
            vec4 there = load(params.noisy, at);
            if (!is_finite(there) || (params.weighted != 0u && there.a == 0.0)) continue;
            // As a running mean and sum of squares, which have no cancellation (Welford 1962).
            count += 1.0;
            vec4 apart = there - sum;
            sum += apart / count;
            squares += apart * (there - sum);
        }
    }
    return Samples(sum, squares / max(count, 1.0));
}

struct Past {
    float weight;   // 0 if there is none
    vec4 value;
    vec4 variance;  // of a sample
    float frames;
};

const Past NONE = Past(0.0, vec4(0.0), vec4(0.0), 0.0);

Past past_at(ivec2 first, vec4 shares) {
    Past past = NONE;
    for (int k = 0; k < 4; k++) {
        if (shares[k] == 0.0) continue;
        ivec2 at = first + ivec2(k & 1, k >> 1);
        Signal there = load_signal(params.previous, params.previous_deviation, at, params.packing);
        past.value += shares[k] * there.value;
        past.variance += shares[k] * there.variance;
        past.frames += shares[k] * load(params.previous_frames, at).r;
    }
    if (is_taken(params.not_finite, past.value + past.variance)) past.weight = 1.0;
    else past = NONE;
    return past;
}

// How well a history agrees with the samples around: 1 at their mean, 1/2 at the farthest that is let pass.
float agreement(Past past, Samples samples, vec4 spatial) {
    vec4 deviation = sqrt(spatial + past.variance / max(past.frames, 1.0));
    vec4 off = abs(compared(past.value, params.packing) - compared(samples.mean, params.packing));
    vec4 far = off / max(FARTHEST * deviation, vec4(1e-6) + 1e-3 * abs(samples.mean));
    float farthest = max(max(far.x, far.y), max(far.z, far.w));
    return exp2(-farthest * farthest);
}

// Variance of what weights compare.
vec4 compared_variance(Samples samples) {
    if (params.packing != SIGNAL_RADIANCE) return samples.variance;
    // Of the luminance, if the channels vary together.
    float deviation = luminance(sqrt(samples.variance.rgb));
    return vec4(deviation * deviation);
}

void main() {
    ViewBuffer view = ViewBuffer(params.view);
    ivec2 pixel = ivec2(gl_GlobalInvocationID.xy);
    if (!inside(pixel, view.at[0].size)) return;
    vec4 now = load(params.noisy, pixel);
    bool taken = is_taken(params.not_finite, now);
    if (!taken) now = finite_beside(params.noisy, pixel, view.at[0].size);
    float counts = !taken ? 0.0 : params.weighted != 0u ? now.a : 1.0;
    if (params.packing == SIGNAL_RADIANCE) now.a = 0.0;
    Samples samples = samples_around(pixel, view.at[0].size);
    vec4 spatial = compared_variance(samples);

    vec2 was = vec2(pixel) - load(params.gbuffer.motion, pixel).xy * vec2(view.at[0].size);
    Taps taps = load_taps(params.taps, pixel, was);
    Past surface = NONE, image = NONE;
    if (taps.any) surface = past_at(taps.first, taps.shares);
    if (taps.any && params.hit_distance != NO_IMAGE) {
        Guide here = load_guide(params.guide, pixel);
        float cosine = dot(octahedral_decode(load(params.gbuffer.normal, pixel).xy), -normalize(pixel_ray(view, pixel)));
        float curvature = curvature_at(view, pixel, here, params.guide, params.gbuffer.normal);
        float behind = image_distance(load(params.hit_distance, pixel).r, curvature, cosine);
        vec2 image_was = image_before(view, pixel, here, behind);
        if (behind >= 0.0) {
            // The surface beside the image's place is known by the depth that its own place had.
            ivec2 nearest = taps.first + ivec2(taps.shares.y + taps.shares.w > 0.5, taps.shares.z + taps.shares.w > 0.5);
            float depth = load_guide(params.previous_guide, nearest).depth;
            Before before = Before(depth, depth_gradient(view, pixel, here), vec2(nearest));
            vec4 shares = shares_of(view, params.previous_guide, before, here, image_was);
            float sum = shares.x + shares.y + shares.z + shares.w;
            if (sum > 0.0) image = past_at(ivec2(floor(image_was)), shares / sum);
            // Where the surface was, its reflection has moved on: it helps as long as the lobe is wider than that.
            float width = params.noise_width == NO_IMAGE ? 0.0 : noise_width(params.noise_width, pixel, params.packing).x;
            float moved = distance(image_was, was) / (0.5 * width + 0.5);
            if (image.weight > 0.0) surface.weight *= exp(-moved * moved);
        }
    }
    vec4 value = now, variance = spatial;
    float frames = counts;
    float surface_counts = surface.weight * surface.frames * agreement(surface, samples, spatial);
    float image_counts = image.weight * image.frames * agreement(image, samples, spatial);
    float sum = surface_counts + image_counts;
    if (sum > 0.0) {
        float share = image_counts / sum;
        vec4 before = mix(surface.value, image.value, share);
        vec4 spread = mix(surface.variance, image.variance, share);
        float past = mix(surface.frames, image.frames, share);
        vec4 reach = FARTHEST * sqrt(samples.variance + spread / max(past, 1.0));
        vec4 near = clamp(before, samples.mean - reach, samples.mean + reach);
        // The history is shortened by as much as clamping has moved it.
        vec4 moved = abs(near - before) / max(reach, vec4(1e-6) + 1e-3 * abs(samples.mean));
        past /= 1.0 + max(max(moved.x, moved.y), max(moved.z, params.packing == SIGNAL_RADIANCE ? 0.0 : moved.w));
        frames = min(past + counts, params.longest);
        float part = frames > 0.0 ? min(counts / frames, 1.0) : 0.0;
        vec4 apart = compared(now, params.packing) - compared(near, params.packing);
        value = near + part * (now - near);
        variance = (1.0 - part) * (spread + part * apart * apart);
        // A few samples may happen to be alike.
        variance = mix(max(variance, spatial), variance, clamp(frames / FEW - 1.0, 0.0, 1.0));
    }
    store_signal(params.accumulated, params.accumulated_deviation, pixel, params.packing, params.greatest, Signal(value, variance));
    store(params.frames, pixel, vec4(frames));
    if (params.source != NO_IMAGE) store(params.source, pixel, vec4(surface_counts, image_counts, 0.0, 0.0) / max(sum, 1e-30));
}
