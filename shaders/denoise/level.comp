#version 460
#extension GL_GOOGLE_include_directive : require
#include "lib/bindless.glsl"
#include "lib/guide.glsl"
#include "lib/noise_width.glsl"
#include "lib/signal.glsl"
// One level of the edge-avoiding à-trous wavelet filter (Dammertz et al. 2010), guided by depth, normal and variance (Schied et al. 2017,
// section 4.4): 3x3 taps of a linear B-spline, `step` pixels apart. The paper's 5x5 taps of a cubic one take 2.5 times as long for the same
// error.
layout(local_size_x = 8, local_size_y = 8) in;
layout(push_constant, scalar) uniform Push { LevelParams params; };

const float SPLINE[2] = float[](1.0 / 2.0, 1.0 / 4.0);
// Added to the standard deviation, so that no weight is 0 / 0.
const float LEAST_DIFFERENCE = 1e-6;

// exp(-x) of the channels in use.
vec4 falloff(vec4 x) {
    if (params.packing == SIGNAL_ONE || params.packing == SIGNAL_RADIANCE) return vec4(exp(-x.x));
    if (params.packing == SIGNAL_TWO) return exp(-x.xyxy);
    return exp(-x);
}

Signal load_input(ivec2 at) {
    return load_signal(params.signal, params.signal_deviation, at, params.packing);
}

// Whether this tile or one beside it has any variance; the variance of tiles further away does not reach this one.
bool varies_around(ivec2 tile, uvec2 size) {
    ivec2 last = (ivec2(size) - 1) / int(TILE);
    for (int y = -1; y <= 1; y++) {
        for (int x = -1; x <= 1; x++) {
            if (load(params.varied_tiles, clamp(tile + ivec2(x, y), ivec2(0), last)).r > 0.0) return true;
        }
    }
    return false;
}

// The variance, blurred over 3x3 pixels: an estimate from few samples is itself noisy (Schied et al. 2017, section 4.3).
vec4 blurred_variance(ivec2 pixel, uvec2 size) {
    vec4 sum = vec4(0.0);
    float weights = 0.0;
    for (int y = -1; y <= 1; y++) {
        for (int x = -1; x <= 1; x++) {
            ivec2 at = pixel + ivec2(x, y);
            if (!inside(at, size)) continue;
            // A Gaussian: 1/4, 1/2, 1/4 in each direction.
            float weight = 1.0 / float((1 + abs(x)) * (1 + abs(y)));
            sum += weight * load_variance(params.signal, params.signal_deviation, at, params.packing);
            weights += weight;
        }
    }
    return sum / weights;
}

// The weighted mean of the taps. `blurred` is the variance by which values are compared.
Signal filtered(ViewBuffer view, ivec2 pixel, Signal own, Guide here, vec4 blurred) {
    vec2 gradient = depth_gradient(view, pixel, here);
    vec4 value = compared(own.value, params.packing);
    vec4 farthest = vec4(1e9);
    // Half the width to each side is shared by this level and those before it, which reach (step - 1) pixels together.
    if (params.noise_width != NO_IMAGE) {
        farthest = 0.5 * averaged_width(view, noise_width(params.noise_width, pixel, params.packing)) / (2.0 - 1.0 / float(params.step));
    }
    vec4 apart = params.sigma * sqrt(blurred) + LEAST_DIFFERENCE;
    vec4 sum = vec4(0.0), variances = vec4(0.0), weights = vec4(0.0);
    for (int y = -1; y <= 1; y++) {
        for (int x = -1; x <= 1; x++) {
            ivec2 offset = ivec2(x, y) * int(params.step);
            ivec2 at = pixel + offset;
            if (!inside(at, view.at[0].size)) continue;
            vec2 edges = offset == ivec2(0) ? vec2(0.0, 1.0)
                : edge_terms(here, gradient, load_guide(params.guide, params.normals, at), vec2(offset));
            if (!(edges.y > 0.0)) continue;
            Signal there = load_input(at);
            vec4 difference = abs(compared(there.value, params.packing) - value);
            vec4 weight = (SPLINE[abs(x)] * SPLINE[abs(y)] * edges.y) * falloff(edges.x + difference / apart);
            weight = mix(weight, vec4(0.0), greaterThan(vec4(length(vec2(offset))), farthest));
            sum += weight * there.value;
            variances += weight * weight * there.variance;
            weights += weight;
        }
    }
    // A channel without variance stays as it is; radiance has one weight for all channels.
    bvec4 still = params.packing == SIGNAL_RADIANCE ? bvec4(false) : equal(blurred, vec4(0.0));
    return Signal(mix(sum / weights, own.value, still), variances / (weights * weights));
}

void main() {
    ViewBuffer view = ViewBuffer(params.view);
    uvec2 size = view.at[0].size;
    ivec2 pixel = ivec2(gl_GlobalInvocationID.xy);
    if (!inside(pixel, size)) return;
    Signal signal = load_input(pixel);
    // Without variance the value stays the same to the last bit.
    if (varies_around(ivec2(gl_WorkGroupID.xy), size)) {
        vec4 blurred = blurred_variance(pixel, size);
        if (blurred != vec4(0.0)) {
            Guide here = load_guide(params.guide, params.normals, pixel);
            if (is_surface(here)) signal = filtered(view, pixel, signal, here, blurred);
        }
    }
    if (params.filtered != NO_IMAGE) {
        store_signal(params.filtered, params.filtered_deviation, pixel, params.packing, params.greatest, signal);
    }
    if (params.result != NO_IMAGE) store(params.result, pixel, vec4(representable(signal.value.rgb, params.greatest), signal.value.a));
}
