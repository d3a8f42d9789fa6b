#version 460
#extension GL_GOOGLE_include_directive : require
#include "lib/bindless.glsl"
#include "lib/colour.glsl"
#include "lib/guide.glsl"
#include "lib/reach.glsl"
#include "lib/tiles.glsl"
// One level of the edge-avoiding à-trous wavelet filter (Dammertz et al. 2010), guided by depth, normal and variance (Schied et al. 2017,
// section 4.4): 3x3 taps of a linear B-spline, `step` pixels apart. The paper's 5x5 taps of a cubic one take 2.5 times as long for the same
// error.
layout(local_size_x = 8, local_size_y = 8) in;
layout(push_constant, scalar) uniform Push { LevelParams params; };

const float SPLINE[2] = float[](1.0 / 2.0, 1.0 / 4.0);
// Added to the standard deviation, so that no weight is 0 / 0.
const float LEAST_DIFFERENCE = 1e-6;

vec4 compared(vec4 colour) {
    return params.radiance != 0u ? vec4(luminance(colour.rgb)) : colour;
}

// exp(-x) of the channels in use.
vec4 falloff(vec4 x) {
    if (params.channels == 1u) return vec4(exp(-x.x));
    if (params.channels == 2u) return exp(-x.xyxy);
    return exp(-x);
}

void main() {
    ViewBuffer view = ViewBuffer(params.view);
    ivec2 pixel = listed_pixel(params.list, gl_WorkGroupID.x, gl_LocalInvocationID.xy);
    if (!inside(pixel, view.at[0].size)) return;
    vec4 colour = load(params.colour, pixel);
    vec4 blurred = load_error(params.blurred, pixel, params.channels);
    Guide here = load_guide(params.guide, params.normals, pixel);
    // Without variance the colour stays the same to the last bit.
    if (!is_surface(here) || blurred == vec4(0.0)) {
        store(params.filtered, pixel, colour);
        store(params.filtered_error, pixel, load(params.error, pixel));
        return;
    }
    vec2 gradient = depth_gradient(view, pixel, here);
    vec4 value = compared(colour);
    vec4 farthest = vec4(1e9);
    // Half the width to each side is shared by this level and those before it, which reach (step - 1) pixels together.
    if (params.reach != NO_IMAGE) {
        farthest = 0.5 * averaged_width(view, penumbra_around(params.reach, pixel)) / (2.0 - 1.0 / float(params.step));
    }
    vec4 apart = params.sigma * sqrt(blurred) + LEAST_DIFFERENCE;
    vec4 sum = vec4(0.0), errors = vec4(0.0), weights = vec4(0.0);
    for (int y = -1; y <= 1; y++) {
        for (int x = -1; x <= 1; x++) {
            ivec2 offset = ivec2(x, y) * int(params.step);
            ivec2 at = pixel + offset;
            if (!inside(at, view.at[0].size)) continue;
            vec2 edges = offset == ivec2(0) ? vec2(0.0, 1.0)
                : edge_terms(here, gradient, load_guide(params.guide, params.normals, at), vec2(offset));
            if (!(edges.y > 0.0)) continue;
            vec4 there = load(params.colour, at);
            vec4 weight = (SPLINE[abs(x)] * SPLINE[abs(y)] * edges.y) * falloff(edges.x + abs(compared(there) - value) / apart);
            weight = mix(weight, vec4(0.0), greaterThan(vec4(length(vec2(offset))), farthest));
            sum += weight * there;
            errors += weight * weight * load(params.error, at);
            weights += weight;
        }
    }
    // A channel without variance stays as it is; radiance has one weight for all channels.
    vec4 filtered = sum / weights;
    bvec4 still = params.radiance != 0u ? bvec4(false) : equal(blurred, vec4(0.0));
    store(params.filtered, pixel, mix(filtered, colour, still));
    store(params.filtered_error, pixel, errors / (weights * weights));
}
