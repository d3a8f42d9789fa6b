#version 460
#extension GL_GOOGLE_include_directive : require
#include "lib/bindless.glsl"
#include "lib/guide.glsl"
#include "lib/precision.glsl"
#include "lib/reflection_blur.glsl"
#include "shared/screen_reflections.glsl"
// The reflection of a lobe from the blurred pyramid of the sharp reflection: the radius of the lobe's cone where the mirror ray hits,
// projected to the screen, chooses the level.
layout(local_size_x = 8, local_size_y = 8) in;
layout(push_constant, scalar) uniform Push { ConeParams params; };

vec4 sharp_at(ivec2 pixel) {
    return vec4(load(params.sharp, pixel).rgb, MOST_CONFIDENCE * load(params.confidence, pixel).r);
}

// Bilinear in one level, level 0 being the sharp reflection. Texels without rays have no weight, and with a guide those of other surfaces.
vec4 level_at(ViewBuffer view, ivec2 pixel, int level, Guide here, vec2 gradient) {
    if (level == 0) return sharp_at(pixel);
    ivec2 size = textureSize(images[params.blurred], level - 1);
    vec2 at = (vec2(pixel) + 0.5) / float(1 << level) - 0.5;
    ivec2 low = ivec2(floor(at));
    vec2 f = at - vec2(low);
    vec4 sum = vec4(0.0);
    float weights = 0.0;
    for (int k = 0; k < 4; k++) {
        ivec2 corner = ivec2(k & 1, k >> 1);
        ivec2 texel = clamp(low + corner, ivec2(0), size - 1);
        float weight = (corner.x == 1 ? f.x : 1.0 - f.x) * (corner.y == 1 ? f.y : 1.0 - f.y);
        if (params.guide != NO_IMAGE) {
            ivec2 there = stands_for(texel, ivec2(level), ivec2(view.at[0].size));
            weight *= edge_weight(here, gradient, load_guide(params.guide, there), vec2(there - pixel));
        }
        vec4 there = load_mip(params.blurred, texel, level - 1);
        if (there.a < 0.0) continue;
        sum += weight * there;
        weights += weight;
    }
    // A surface narrower than the level's pixels has no texel: its own reflection is left.
    return weights > 1e-4 ? sum / weights : sharp_at(pixel);
}

// Radiance times confidence, and confidence.
vec4 gather(ViewBuffer view, ivec2 pixel, Surface s, out float level) {
    float hit_distance = load(params.hit_distance, pixel).r;
    float eye_distance = distance(s.position, view.at[0].eye);
    // A mirror shows the cone's base at both distances together.
    float radius = cone_radius(alpha_of_roughness(s.roughness), params.xi, hit_distance);
    float pixels = radius / ((hit_distance + eye_distance) * pixel_spread(view));
    level = min(blur_level(pixels), float(params.levels));
    Guide here = Guide(0.0, vec3(0.0), vec3(0.0), 0u);
    vec2 gradient = vec2(0.0);
    if (params.guide != NO_IMAGE) {
        here = load_guide(params.guide, pixel);
        gradient = depth_gradient(view, pixel, here);
    }
    int below = int(floor(level));
    float between = level - float(below);
    vec4 value = level_at(view, pixel, below, here, gradient);
    if (between > 0.0) value = mix(value, level_at(view, pixel, below + 1, here, gradient), between);
    return value;
}

void main() {
    ViewBuffer view = ViewBuffer(params.view);
    ivec2 pixel = ivec2(gl_GlobalInvocationID.xy);
    if (!inside(pixel, view.at[0].size)) return;
    Surface s = load_surface(view, pixel, params.gbuffer);
    vec4 value = vec4(0.0);
    float level = 0.0;
    // Steps are 0 where no ray was marched: nothing is taken from neighbours there.
    if (s.exists && load(params.sharp, pixel).a > 0.0) value = gather(view, pixel, s, level);
    store(params.radiance, pixel, vec4(representable(value.rgb, params.greatest), level));
    store(params.blurred_confidence, pixel, vec4(value.a / MOST_CONFIDENCE));
}
