#version 460
#extension GL_GOOGLE_include_directive : require
#include "lib/bindless.glsl"
#include "lib/bsdf.glsl"
#include "lib/precision.glsl"
#include "lib/ray_count.glsl"
#include "lib/roughness_limit.glsl"
#include "lib/screen_light.glsl"
#include "lib/sequence.glsl"
#include "lib/specular_albedo.glsl"
#include "shared/denoise.glsl"
#include "shared/screen_reflections.glsl"
// Reflections found on the screen: one ray of each pixel, along its specular lobe or in the mirror direction.
layout(local_size_x = 8, local_size_y = 8) in;
layout(push_constant, scalar) uniform Push { MarchParams params; };

// What the ray of a pixel has found. Radiance is over the albedo of the lobe, and both are times the sample's share of the lobe.
struct Marched {
    vec3 radiance;
    float confidence;
    float distance;
    float width;
    uint steps;
};

// Steps are farther apart for rougher surfaces, whose reflection shows less detail: whole pixels.
float stride_at(float roughness) {
    vec2 strides = vec2(params.strides & 0xffffu, params.strides >> 16u);
    return floor(mix(strides.x, strides.y, clamp(roughness / max(params.roughness_limit, 1e-6), 0.0, 1.0)));
}

Marched march(ViewBuffer view, ivec2 pixel) {
    Marched m = Marched(vec3(0.0), 0.0, SKY_DISTANCE, 0.0, 0u);
    Surface s = load_surface(view, pixel, params.gbuffer);
    float limit = params.roughness_limit;
    if (!s.exists || !reflects(s)) return m;
    float roughness = least_roughness(s);
    if (!(roughness < limit)) return m;
    Bsdf bsdf = bsdf_of(s);
    mat3 around = frame_of(s.normal);
    vec3 v = s.to_eye * around;
    v.z = eye_cosine(s);
    uint frame = view.at[0].frame, seed = view.at[0].seed;
    bool is_mirror = (params.flags & MARCH_MIRROR) != 0u;
    // Directions as those of traced reflections: visible normals (Heitz 2018), from the sequence of the pixel.
    vec3 l = vec3(-v.xy, v.z);
    bool above = is_mirror || sample_specular(bsdf, v, sequence2(pixel, frame, SEQUENCE_REFLECTIONS, seed), l);
    vec3 direction = around * l;
    if (!above || dot(direction, s.geometric_normal) <= 0.0) return m;
    vec3 share = vec3(1.0);
    if (!is_mirror) {
        float pdf = bsdf_pdf(bsdf, v, l, LOBE_SPECULAR);
        if (!(pdf > 0.0)) return m;
        share = bsdf_cosine(bsdf, v, l, LOBE_SPECULAR) / (pdf * specular_albedo(s));
    }
    float jitter = unit_floats(hash4(uvec4(uvec2(pixel), frame, seed))).x;
    SceneBuffer scene = SceneBuffer(params.scene);
    ScreenFound found =
        light_on_screen(view, scene, params.light, params.gbuffer, params.not_finite, s, direction, stride_at(roughness), jitter);
    float confidence = found.confidence * below_roughness(roughness, limit);
    m.radiance = confidence * share * found.radiance;
    m.confidence = confidence * (share.r + share.g + share.b) / 3.0;
    m.distance = found.distance;
    m.width = lobe_width(view, s, strongest_alpha(bsdf, v), found.distance);
    m.steps = max(found.steps, 1u);
    return m;
}

void main() {
    ViewBuffer view = ViewBuffer(params.view);
    ivec2 target = ivec2(gl_GlobalInvocationID.xy);
    ivec2 pixel = (params.flags & MARCH_HALF) != 0u ? 2 * target : target;
    bool exists = inside(pixel, view.at[0].size);
    Marched m;
    if (exists) m = march(view, pixel);
    count_screen_rays(params.not_finite, exists && m.steps > 0u ? 1u : 0u);
    if (!exists) return;
    store(params.radiance, target, vec4(representable(m.radiance, params.greatest), float(m.steps)));
    store(params.confidence, target, vec4(m.confidence / MOST_CONFIDENCE));
    store(params.hit_distance, target, vec4(m.distance));
    store(params.width, target, vec4(min(m.width / WIDEST_NOISE, 1.0)));
}
