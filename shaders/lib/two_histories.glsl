#ifndef LIB_TWO_HISTORIES_GLSL
#define LIB_TWO_HISTORIES_GLSL
#include "lib/noise_width.glsl"
#include "lib/not_finite.glsl"
#include "lib/same_surface.glsl"
#include "lib/signal.glsl"
#include "lib/taps.glsl"
#include "lib/virtual_image.glsl"
// Two sources of history: where the surface was, and where the image was that it reflects (Stachowiak 2018, "Stochastic All The Things").
// Each counts by the frames that it has and by how well it agrees with the samples around.

// Half of the side of the square of samples that a history is compared with.
const int AROUND = 2;
// A history further from the mean of these samples is out of date, standard deviations.
const float FARTHEST = 2.0;

// The samples around a pixel: mean and variance of each channel.
struct Samples {
    vec4 mean;
    vec4 variance;
    vec4 mean_beside;       // without the pixel's own
    vec4 variance_beside;
    float count_beside;
};

// The channels of a sample that there are, in place of what the image's format has beside them.
vec4 channels_of(vec4 texel, uint packing) {
    if (packing == SIGNAL_ONE) return vec4(texel.x, vec3(0.0));
    if (packing == SIGNAL_TWO) return vec4(texel.xy, vec2(0.0));
    return packing == SIGNAL_RADIANCE ? vec4(texel.rgb, 0.0) : texel;
}

Samples samples_around(ivec2 pixel, uvec2 size, NoisyImage noisy) {
    vec4 sum = vec4(0.0), squares = vec4(0.0);
    float count = 0.0;
    Samples s = Samples(sum, squares, sum, squares, 0.0);
    // The pixel itself comes last.
    const int SIDE = 2 * AROUND + 1;
    const int OWN = SIDE * SIDE / 2;
    for (int k = 1; k <= SIDE * SIDE; k++) {
        int place = k == SIDE * SIDE ? OWN : k > OWN ? k : k - 1;
        if (k == SIDE * SIDE) {
            s.mean_beside = sum;
            s.variance_beside = squares / max(count, 1.0);
            s.count_beside = count;
        }
        ivec2 at = pixel + ivec2(place % SIDE, place / SIDE) - AROUND;
        if (!inside(at, size)) continue;
        vec4 there = load(noisy.image, at);
        if (!is_finite(there) || (is_weighted(noisy) && there.a == 0.0)) continue;
        there = channels_of(there, noisy.packing);
        // As a running mean and sum of squares, which have no cancellation (Welford 1962).
        count += 1.0;
        vec4 apart = there - sum;
        sum += apart / count;
        squares += apart * (there - sum);
    }
    s.mean = sum;
    s.variance = squares / max(count, 1.0);
    return s;
}

// Variance of what weights compare.
vec4 compared_variance(vec4 variance, uint packing) {
    if (packing != SIGNAL_RADIANCE) return variance;
    // Of the luminance, if the channels vary together.
    float deviation = luminance(sqrt(variance.rgb));
    return vec4(deviation * deviation);
}

struct Past {
    float weight;   // 0 if there is none
    vec4 value;
    vec4 variance;  // of a sample
    vec4 frames;    // of each channel
    vec4 fast;      // mean over the last few frames, of what weights compare
    float image;    // share of the source where the reflected image was; the surface's has the rest
};

const Past NO_PAST = Past(0.0, vec4(0.0), vec4(0.0), vec4(0.0), vec4(0.0), 0.0);

// What a pixel of the previous frame had. One channel of `frames` counts for all where there is no more.
Past past_at(HistoryImages history, NoisyImage noisy, uvec2 not_finite, ivec2 first, vec4 shares) {
    Past past = NO_PAST;
    for (int k = 0; k < 4; k++) {
        if (shares[k] == 0.0) continue;
        ivec2 at = first + ivec2(k & 1, k >> 1);
        Signal there = load_signal(history.values, history.deviations, at, noisy.packing);
        past.value += shares[k] * there.value;
        past.variance += shares[k] * there.variance;
        past.frames += shares[k] * load(history.frames, at);
        if (history.fast != NO_IMAGE) past.fast += shares[k] * load(history.fast, at);
    }
    bool is_single = history.fast == NO_IMAGE || noisy.packing == SIGNAL_RADIANCE || noisy.packing == SIGNAL_ONE;
    if (is_single) past.frames = past.frames.xxxx;
    if (noisy.packing == SIGNAL_RADIANCE) past.fast = past.fast.xxxx;
    if (is_taken(not_finite, past.value + past.variance + past.frames + past.fast)) past.weight = 1.0;
    else past = NO_PAST;
    return past;
}

// How well a history agrees with the samples around: 1 at their mean, 1/2 at the farthest that is let pass.
float agreement(Past past, Samples samples, vec4 spatial, uint packing) {
    vec4 deviation = sqrt(spatial + past.variance / max(past.frames, vec4(1.0)));
    vec4 off = abs(compared(past.value, packing) - compared(samples.mean, packing));
    vec4 far = off / max(FARTHEST * deviation, vec4(1e-6) + 1e-3 * abs(samples.mean));
    float farthest = max(max(far.x, far.y), max(far.z, far.w));
    return exp2(-farthest * farthest);
}

// The history of what the pixel reflects. That of the surface, `surface`, counts less the farther the image has moved against it.
Past past_of_image(ViewBuffer view, ivec2 pixel, vec2 was, Taps taps, HistoryImages history, NoisyImage noisy, uvec2 not_finite,
                   inout Past surface) {
    Guide here = load_guide(history.guide, pixel);
    float cosine = dot(octahedral_decode(load(history.normal, pixel).xy), -normalize(pixel_ray(view, pixel)));
    float curvature = curvature_at(view, pixel, here, history.guide, history.normal);
    float behind = image_distance(load(history.hit_distance, pixel).r, curvature, cosine);
    if (behind < 0.0) return NO_PAST;
    vec2 image_was = image_before(view, pixel, here, behind);
    // The surface beside the image's place is known by the depth that its own place had.
    ivec2 nearest = taps.first + ivec2(taps.shares.y + taps.shares.w > 0.5, taps.shares.z + taps.shares.w > 0.5);
    float depth = load_guide(history.previous_guide, nearest).depth;
    Before before = Before(depth, depth_gradient(view, pixel, here), vec2(nearest));
    vec4 shares = shares_of(view, history.previous_guide, before, here, image_was);
    float sum = shares.x + shares.y + shares.z + shares.w;
    if (!(sum > 0.0)) return NO_PAST;
    Past image = past_at(history, noisy, not_finite, ivec2(floor(image_was)), shares / sum);
    // Where the surface was, its reflection has moved on: it helps as long as the lobe is wider than that.
    float width = noisy.width == NO_IMAGE ? 0.0 : noise_width(noisy.width, pixel, noisy.packing).x;
    float moved = distance(image_was, was) / (0.5 * width + 0.5);
    if (image.weight > 0.0) surface.weight *= exp(-moved * moved);
    return image;
}

// The history of a pixel: of both sources that which is there and agrees.
Past past_of(ViewBuffer view, ivec2 pixel, vec2 was, Taps taps, HistoryImages history, NoisyImage noisy, uvec2 not_finite, Samples samples,
             vec4 spatial) {
    if (!taps.any) return NO_PAST;
    Past surface = past_at(history, noisy, not_finite, taps.first, taps.shares);
    if (history.hit_distance == NO_IMAGE) return surface;
    Past image = past_of_image(view, pixel, was, taps, history, noisy, not_finite, surface);
    float surface_counts = surface.weight * surface.frames.x * agreement(surface, samples, spatial, noisy.packing);
    float image_counts = image.weight * image.frames.x * agreement(image, samples, spatial, noisy.packing);
    float sum = surface_counts + image_counts;
    if (!(sum > 0.0)) return NO_PAST;
    float share = image_counts / sum;
    return Past(1.0, mix(surface.value, image.value, share), mix(surface.variance, image.variance, share),
                mix(surface.frames, image.frames, share), mix(surface.fast, image.fast, share), share);
}

#endif
