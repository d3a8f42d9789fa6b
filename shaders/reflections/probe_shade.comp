#version 460
#extension GL_GOOGLE_include_directive : require
#include "lib/bindless.glsl"
#include "lib/precision.glsl"
#include "lib/probe.glsl"
#include "lib/sky_lobe.glsl"
#include "shared/sky_light.glsl"
// Specular light of the probes, and of the sky where none reaches.
layout(local_size_x = 8, local_size_y = 8) in;
layout(push_constant, scalar) uniform Push { ProbeShadeParams params; };

// Direction in which a lobe of GGX has its mean: rough lobes lean from the mirror direction towards the normal.
vec3 dominant_direction(vec3 n, vec3 mirror, float roughness) {
    float to_mirror = 1.0;
    // Paananen 2016, equation 6.19.
    if (params.direction == PROBE_DIRECTION_CUBIC) to_mirror = 1.0 - roughness * roughness * roughness;
    // Lagarde and de Rousiers 2014, "Moving Frostbite to Physically Based Rendering", listing 22; their roughness is alpha.
    if (params.direction == PROBE_DIRECTION_FIT) {
        float alpha = roughness * roughness;
        float smoothness = 1.0 - alpha;
        to_mirror = smoothness * (sqrt(smoothness) + alpha);
    }
    // A mapped normal may be opposite to the mirror direction.
    return safe_normalize(mix(n, mirror, to_mirror), n);
}

// Mean radiance over a surface's specular lobe.
vec3 light_in_lobe(ViewBuffer view, Surface s, float openness) {
    vec3 mirror = reflect(-s.to_eye, s.normal);
    ProbeLight found = probe_light(params.probes, params.not_finite, s.position, dominant_direction(s.normal, mirror, s.roughness), s.roughness);
    // As in sky_in_lobe: a mapped normal may turn the mirror direction below the surface.
    float horizon = clamp(1.0 + dot(mirror, s.geometric_normal), 0.0, 1.0);
    float n_v = max(dot(s.normal, s.to_eye), 0.0);
    float reaches = params.occlusion != 0u ? min(s.occlusion, specular_openness(openness, n_v, s.roughness * s.roughness)) : s.occlusion;
    vec3 light = found.radiance * (horizon * horizon * reaches);
    if (found.weight < 1.0) light += (1.0 - found.weight) * sky_in_lobe(view, s, openness);
    return light;
}

vec3 shade(ViewBuffer view, ivec2 pixel) {
    Surface s = load_surface(view, pixel, params.gbuffer);
    if (!s.exists || !reflects(s) || s.occlusion <= 0.0) return vec3(0.0);
    float openness = params.openness == NO_IMAGE ? 1.0 : load(params.openness, pixel).r;
    Bsdf b = bsdf_of(s);
    vec3 v = vec3(0.0, 0.0, eye_cosine(s));
    vec3 light = below_coat(b, v) * environment_brdf(b.fresnel, b.lobe) * light_in_lobe(view, s, openness);
    if (s.coat > 0.0) {
        Surface coat = s;
        coat.roughness = s.coat_roughness;
        light += coat_albedo(b, v) * light_in_lobe(view, coat, openness);
    }
    return light;
}

void main() {
    ViewBuffer view = ViewBuffer(params.view);
    ivec2 pixel = ivec2(gl_GlobalInvocationID.xy);
    if (!inside(pixel, view.at[0].size)) return;
    store(params.radiance, pixel, vec4(representable(shade(view, pixel), params.greatest), 1.0));
}
