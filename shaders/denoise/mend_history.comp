#version 460
#extension GL_GOOGLE_include_directive : require
#include "lib/bindless.glsl"
#include "lib/blur_taps.glsl"
#include "lib/guide.glsl"
#include "lib/not_finite.glsl"
#include "lib/signal.glsl"
// Mends means over frames: one that the last few frames contradict is clamped to what they have around, and gets a short history; one with a
// short history takes what pixels around with longer ones know.
layout(local_size_x = 8, local_size_y = 8) in;
layout(push_constant, scalar) uniform Push { MendHistoryParams params; };

const int AROUND = 2;
// The mean may be this many deviations from the mean of the last few frames around.
const float FARTHEST = 2.0;
// History length, frames, of pixels that know nothing.
const float LEAST = 0.1;

// Range of the last few frames around. The pixel's own lies in it, so that what stands still, and is bright alone, stays.
void fast_range(ivec2 pixel, uvec2 size, vec4 own_variance, out vec4 least, out vec4 most) {
    vec4 sum = vec4(0.0), squares = vec4(0.0);
    float count = 0.0;
    vec4 own = vec4(0.0);
    for (int k = 0; k < (2 * AROUND + 1) * (2 * AROUND + 1); k++) {
        ivec2 offset = ivec2(k % (2 * AROUND + 1), k / (2 * AROUND + 1)) - AROUND;
        if (!inside(pixel + offset, size)) continue;
        vec4 there = load(params.fast, pixel + offset);
        if (params.noisy.packing == SIGNAL_RADIANCE) there = there.xxxx;
        if (offset == ivec2(0)) own = there;
        count += 1.0;
        vec4 apart = there - sum;
        sum += apart / count;
        squares += apart * (there - sum);
    }
    // Few samples around may have missed what is rare: the variance over the whole history has it.
    vec4 reach = FARTHEST * sqrt(squares / count + own_variance);
    least = min(sum - reach, own);
    most = max(sum + reach, own);
}

// The mean of pixels around with the weight of their histories, no farther than `reach`.
vec4 filled(ViewBuffer view, ivec2 pixel, Guide here, vec4 own, vec4 frames, vec4 reach) {
    vec2 gradient = depth_gradient(view, pixel, here);
    float stride = 0.5 * greatest_of(reach);
    vec4 sum = own, weights = max(frames, vec4(LEAST));
    for (int k = 0; k < 25; k++) {
        ivec2 place = ivec2(k % 5, k / 5) - 2;
        ivec2 offset = ivec2(round(stride * vec2(place)));
        ivec2 at = pixel + offset;
        // Without the corners.
        if (k == 12 || abs(place.x) + abs(place.y) == 4 || !inside(at, view.at[0].size)) continue;
        float edges = edge_weight(here, gradient, load_guide(params.guide, params.normals, at), vec2(offset));
        if (!(edges > 0.0)) continue;
        vec4 weight = both_reach(view, params.noisy.width, at, params.noisy.packing, length(vec2(offset)), reach);
        weight *= edges * frames_at(params.frames, at, params.noisy.packing);
        weights += weight;
        vec4 there = load_signal(params.accumulated, params.accumulated_deviation, at, params.noisy.packing).value;
        sum += (weight / weights) * (there - sum);
    }
    return sum;
}

void main() {
    ViewBuffer view = ViewBuffer(params.view);
    uvec2 size = view.at[0].size;
    ivec2 pixel = ivec2(gl_GlobalInvocationID.xy);
    if (!inside(pixel, size)) return;
    uint packing = params.noisy.packing;
    Signal signal = load_signal(params.accumulated, params.accumulated_deviation, pixel, packing);
    vec4 frames = frames_at(params.frames, pixel, packing);
    vec4 width = width_at(params.noisy.width, pixel, packing);
    Guide here = load_guide(params.guide, params.normals, pixel);
    vec4 value = signal.value;
    float few = 0.5 * params.fast_longest;
    if (is_surface(here)) {
        bvec4 long_ones = greaterThan(frames, vec4(params.fast_longest));
        if (any(long_ones)) {
            vec4 least, most;
            fast_range(pixel, size, signal.variance / params.fast_longest, least, most);
            vec4 slow = compared(value, packing);
            vec4 near = mix(slow, clamp(slow, least, most), long_ones);
            vec4 apart = abs(near - slow) / max(max(abs(near), abs(slow)), vec4(1e-6));
            if (packing != SIGNAL_RADIANCE) value = near;
            else if (near.x != slow.x) value = slow.x > 0.0 ? value * (near.x / slow.x) : near;
            vec4 shorter = 1.0 / (1.0 + apart * frames / few);
            frames = mix(frames, mix(min(frames, vec4(few)), frames, shorter), greaterThan(apart, vec4(0.0)));
        }
        vec4 reach = blur_reach(view, frames, params.longest, params.radius, width);
        vec4 wide = reach * fresh_share(frames, few);
        if (greatest_of(wide) >= 1.0) value = filled(view, pixel, here, value, frames, wide);
        if (packing != SIGNAL_RADIANCE && params.noisy.width != NO_IMAGE && is_jittered(view)) {
            // See `history_limits`: the sample is used as it is, the history waits.
            vec4 now = load(params.noisy.image, pixel);
            if (is_finite(now)) value = mix(value, now, equal(averaged_width(view, width), vec4(0.0)));
        }
    }
    signal = Signal(value, signal.variance / max(frames, vec4(1.0)));
    store_signal(params.mended, params.mended_deviation, pixel, packing, params.greatest, signal);
    store(params.mended_frames, pixel, frames);
}
