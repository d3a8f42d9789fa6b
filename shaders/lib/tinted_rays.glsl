#ifndef LIB_TINTED_RAYS_GLSL
#define LIB_TINTED_RAYS_GLSL
#include "lib/shadow_rays.glsl"
#include "lib/tinted.glsl"
// Shadow rays to one light, in a scene with surfaces that transmit light.

// Counters: closest-hit and any-hit rays.
uvec2 tinted_traced = uvec2(0u);

vec3 tinted_point(SceneBuffer scene, Receiver at, Light light, Incident from, inout float penumbra) {
    Ray ray;
    if (!shadow_ray(at, from, ray)) return vec3(0.0);
    float farthest;
    vec3 share = light_through(scene, ray, MOST_SHEETS, tinted_traced, farthest);
    if (farthest > 0.0) penumbra = max(penumbra, penumbra_pixels(at, light, from, farthest));
    return share;
}

// Visibility of a light, per colour channel, by the points that pixel `drawn_at` used or uses in frame `frame`, and the penumbra width,
// pixels.
vec3 tinted_visibility(ViewBuffer view, SceneBuffer scene, Receiver at, uint index, uint samples, ivec2 drawn_at, uint frame, out float penumbra) {
    penumbra = 0.0;
    vec3 position = at.start.position;
    Light light = LightBuffer(scene.at[0].lights).at[index];
    LightSample centre = sample_light(light, position);
    // Outside the light's cone or range, or behind it.
    if (centre.irradiance == vec3(0.0)) return vec3(0.0);
    if (samples == 0u || !has_size(light)) {
        Incident from = Incident(centre.direction, centre.distance, centre.irradiance, 0.0);
        float none = 0.0;  // a point light has no penumbra
        return tinted_point(scene, at, light, from, none);
    }
    vec3 seen = vec3(0.0);
    penumbra = horizon_penumbra(at.surface, light, centre);
    for (uint i = 0u; i < samples; i++) {
        vec2 u = sequence2(drawn_at, frame * samples + i, SEQUENCE_SHADOWS + index, view.at[0].seed);
        Incident from;
        if (sample_sized_light(light, position, u, from)) seen += tinted_point(scene, at, light, from, penumbra);
    }
    return seen / float(samples);
}

#endif
