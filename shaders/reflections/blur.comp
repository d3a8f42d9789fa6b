#version 460
#extension GL_GOOGLE_include_directive : require
#include "lib/bindless.glsl"
#include "lib/guide.glsl"
#include "lib/not_finite.glsl"
#include "lib/precision.glsl"
#include "lib/reflection_blur.glsl"
#include "shared/screen_reflections.glsl"
// One axis of a level of the blurred reflection: a Gaussian that halves the size. Radiance is multiplied with confidence before, and divided
// by its mean after all levels, so that pixels in which nothing was found add nothing. Pixels without a ray do not count at all. With a guide,
// neither do taps on other surfaces.
layout(local_size_x = 8, local_size_y = 8) in;
layout(push_constant, scalar) uniform Push { BlurParams params; };

void main() {
    ViewBuffer view = ViewBuffer(params.view);
    ivec2 target = ivec2(gl_GlobalInvocationID.xy);
    if (!inside(target, params.size)) return;
    ivec2 along = params.axis == 0u ? ivec2(1, 0) : ivec2(0, 1);
    ivec2 halved = ivec2(params.halved);
    ivec2 last = ivec2(params.source_size) - 1;
    ivec2 size = ivec2(view.at[0].size);
    ivec2 centre = stands_for(target, halved + along, size);
    bool is_guided = params.guide != NO_IMAGE;
    Guide here = Guide(0.0, vec3(0.0), vec3(0.0), 0u);
    vec2 gradient = vec2(0.0);
    if (is_guided) {
        here = load_guide(params.guide, centre);
        gradient = depth_gradient(view, centre, here);
    }
    vec4 sum = vec4(0.0);
    float weights = 0.0;
    for (int k = 0; k < BLUR_TAPS; k++) {
        ivec2 at = target + along * (target + blur_offset(k));
        // Beyond the border there is nothing, which is not the same as the border again.
        if (any(lessThan(at, ivec2(0))) || any(greaterThan(at, last))) continue;
        float weight = blur_weight(k);
        if (is_guided) {
            ivec2 there = stands_for(at, halved, size);
            weight *= edge_weight(here, gradient, load_guide(params.guide, there), vec2(there - centre));
        }
        vec4 value = load_mip(params.source, at, int(params.source_mip));
        if (params.confidence != NO_IMAGE) value.a = value.a == 0.0 ? -1.0 : MOST_CONFIDENCE * load(params.confidence, at).r;
        if (weight == 0.0 || !is_taken(params.not_finite, value) || value.a < 0.0) continue;
        sum += weight * value;
        weights += weight;
    }
    vec4 mean = weights > 0.0 ? sum / weights : vec4(vec3(0.0), -1.0);
    store(params.blurred, target, vec4(representable(mean.rgb, params.greatest), mean.a));
}
