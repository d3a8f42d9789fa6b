#version 460
#extension GL_GOOGLE_include_directive : require
#include "lib/bindless.glsl"
#include "lib/blur_taps.glsl"
#include "lib/guide.glsl"
#include "lib/signal.glsl"
// A bilateral blur of the pixels whose mean over frames is still noisy. All others stay as they are, to the last bit.
layout(local_size_x = 8, local_size_y = 8) in;
layout(push_constant, scalar) uniform Push { CleanUpParams params; };

const uint TAPS = 12u;
// The blur is as wide as it can be where the noise is this many times the threshold.
const float WIDEST_AT = 4.0;
// Relative to this mean radiance or visibility at least: darker noise is not seen.
const float DARKEST = 1e-3;

// Deviation of the mean over the mean, the worst of all channels.
float noise_of(Signal s, float frames) {
    vec4 relative = sqrt(s.variance / max(frames, 1.0)) / max(abs(compared(s.value, params.packing)), vec4(DARKEST));
    return max(max(relative.x, relative.y), max(relative.z, relative.w));
}

void main() {
    ViewBuffer view = ViewBuffer(params.view);
    ivec2 pixel = ivec2(gl_GlobalInvocationID.xy);
    if (!inside(pixel, view.at[0].size)) return;
    Signal signal = load_signal(params.accumulated, params.accumulated_deviation, pixel, params.packing);
    float frames = load(params.frames, pixel).r;
    float noise = noise_of(signal, frames);
    Guide here = load_guide(params.guide, params.normals, pixel);
    float reach = params.radius * clamp(noise / (WIDEST_AT * params.threshold), 0.25, 1.0);
    if (params.noise_width != NO_IMAGE) {
        vec4 width = averaged_width(view, noise_width(params.noise_width, pixel, params.packing));
        reach = min(reach, 0.5 * max(max(width.x, width.y), max(width.z, width.w)));
    }
    vec4 sum = signal.value;
    if (is_surface(here) && noise > params.threshold && reach >= 1.0) {
        vec2 gradient = depth_gradient(view, pixel, here);
        vec4 deviation = sqrt(signal.variance);
        // What has few frames gives way to what has many.
        float weights = max(frames, 0.1);
        float turn = disc_turn(view, pixel, 1u);
        for (uint i = 1u; i <= TAPS; i++) {
            ivec2 offset = ivec2(round(reach * disc_tap(i, TAPS, turn)));
            ivec2 at = pixel + offset;
            if (offset == ivec2(0) || !inside(at, view.at[0].size)) continue;
            float edges = edge_weight(here, gradient, load_guide(params.guide, params.normals, at), vec2(offset));
            if (!(edges > 0.0)) continue;
            Signal there = load_signal(params.accumulated, params.accumulated_deviation, at, params.packing);
            // Differences below the noise of both are noise. That of a bright outlier beside this pixel would let it spread.
            vec4 off = abs(compared(there.value, params.packing) - compared(signal.value, params.packing));
            vec4 unlike = off / (deviation + min(deviation, sqrt(there.variance)) + vec4(1e-6));
            float worst = max(max(unlike.x, unlike.y), max(unlike.z, unlike.w));
            float weight = edges * exp(-worst) * load(params.frames, at).r;
            if (!(weight > 0.0)) continue;
            weights += weight;
            sum += (weight / weights) * (there.value - sum);
        }
    }
    store(params.result, pixel, vec4(params.packing == SIGNAL_RADIANCE ? representable(sum.rgb, params.greatest) : sum.rgb, sum.a));
}
