#ifndef LIB_SCREEN_LIGHT_GLSL
#define LIB_SCREEN_LIGHT_GLSL
#include "lib/found_ray.glsl"
#include "lib/not_finite.glsl"
#include "lib/previous_light.glsl"
#include "lib/screen_march.glsl"
// Light along a ray, from what the previous frame saw of the surface that the ray meets on the screen.

struct ScreenFound {
    vec3 radiance;     // towards the ray's origin; 0 without confidence
    float confidence;  // 0 to 1
    float distance;    // of what the ray meets, metres
    float alpha;       // of its narrowest lobe
    float known;       // share of the pixels around the hit that the previous frame showed it in, 0 to 1
    bool emits;
    bool was_behind;   // on its way the ray passed behind something, which may be thicker than assumed
    uint steps;        // look-ups of depth
};

// Mean of the pixels of the previous frame around a point that showed its surface, and the share of the bilinear weights that they have.
vec3 radiance_before(ViewBuffer view, ScreenLight p, uvec2 not_finite, uint instance, vec3 plane, PlaceBefore before, out float known) {
    vec2 first = floor(before.pixels - 0.5);
    vec2 f = before.pixels - 0.5 - first;
    vec3 sum = vec3(0.0);
    known = 0.0;
    for (int k = 0; k < 4; k++) {
        ivec2 at = ivec2(k & 1, k >> 1);
        float weight = (at.x == 1 ? f.x : 1.0 - f.x) * (at.y == 1 ? f.y : 1.0 - f.y);
        ivec2 pixel = ivec2(first) + at;
        if (weight == 0.0 || !showed(view, p.previous_guide, pixel, instance, plane, before.depth)) continue;
        vec4 there = load(p.previous_radiance, pixel);
        if (!is_taken(not_finite, there) || there.a <= 0.0) continue;
        sum += weight * there.rgb;
        known += weight;
    }
    return known > 0.0 ? sum / known : vec3(0.0);
}

// Emission that a pixel and its neighbours may have put into the picture, at most. Light of surfaces that emit is sampled by the slot
// `direct`, and that of surfaces that show a light by the light; that of unlit ones is nowhere else.
vec3 sampled_emission(ViewBuffer view, SceneBuffer scene, GBufferImages gbuffer, ivec2 pixel, uint instance) {
    vec3 most = vec3(0.0);
    // Each of the four texels that the picture is read from is among these.
    for (int k = 0; k < 9; k++) {
        ivec2 at = clamp(pixel + ivec2(k % 3, k / 3) - 1, ivec2(0), ivec2(view.at[0].size) - 1);
        most = max(most, load(gbuffer.emission, at).rgb);
    }
    if (most == vec3(0.0)) return most;
    uint material = InstanceBuffer(scene.at[0].instances).at[instance].material;
    return (MaterialBuffer(scene.at[0].materials).at[material].flags & MATERIAL_UNLIT) != 0u ? vec3(0.0) : most;
}

// What is left of a picture without emission: their difference, times its share in the picture. The second factor makes rounding of the
// picture, and a lamp that has moved by a part of a pixel, as small as their squares.
vec3 without_emission(vec3 seen, vec3 emission) {
    float strongest = max(seen.r, max(seen.g, seen.b));
    float emitted = max(emission.r, max(emission.g, emission.b));
    if (emitted <= 0.0) return seen;
    return emitted < strongest ? max(seen - emission, vec3(0.0)) * (1.0 - emitted / strongest) : vec3(0.0);
}

// Falls to 0 at the border of the picture: what lies beyond is not known.
float edge_confidence(ViewBuffer view, vec2 place, float edge) {
    vec2 inwards = min(place, vec2(view.at[0].size) - place) / (vec2(view.at[0].size) * max(edge, 1e-6));
    return smoothstep(0.0, 1.0, inwards.x) * smoothstep(0.0, 1.0, inwards.y);
}

// Falls to 0 at the greatest length of rays, over its last quarter.
float distance_confidence(float distance, float most) {
    return 1.0 - smoothstep(0.75 * most, most, distance);
}

// Falls to 0 for rays that come back to the camera: they meet what it sees at a flat angle, if at all.
float direction_confidence(vec3 direction, vec3 to_eye) {
    return 1.0 - smoothstep(0.5, 0.9, dot(direction, to_eye));
}

// Albedo of a surface for light towards `to_viewer`, unit.
vec3 surface_albedo(ViewBuffer view, Surface s, vec3 to_viewer) {
    float n_v = max(dot(s.normal, to_viewer), 1e-4);
    return reflectance(towards_viewer(view.at[0].lobe_albedo, bsdf_of(s), n_v), n_v);
}

// Light along a ray from a surface. `direction` unit; `stride` and `jitter` as in march_screen.
ScreenFound light_on_screen(
    ViewBuffer view, SceneBuffer scene, ScreenLight p, GBufferImages gbuffer, uvec2 not_finite, Surface from, vec3 direction, float stride,
    float jitter
) {
    ScreenFound found = ScreenFound(vec3(0.0), 0.0, SKY_DISTANCE, 0.0, 0.0, false, false, 0u);
    vec3 origin = march_origin(view, from);
    ScreenHit hit = march_screen(view, p.march, gbuffer, origin, direction, stride, jitter);
    found.steps = hit.steps;
    if (!hit.met) return found;
    uint id = load_uint(gbuffer.ids, hit.pixel).x;
    if (id == 0u) return found;
    uint instance = id - 1u;
    vec3 position = hit_position(view, hit);
    found.distance = min(distance(origin, position), SKY_DISTANCE);
    PlaceBefore before;
    if (!place_before(view, scene, instance, position, before)) return found;
    Surface there = load_surface(view, hit.pixel, gbuffer);
    vec3 seen = radiance_before(view, p, not_finite, instance, there.geometric_normal, before, found.known);
    // A single pixel of four has at least a quarter of the weights where it is the nearest.
    found.confidence = min(4.0 * found.known, 1.0) * edge_confidence(view, hit.place, p.edge) * distance_confidence(found.distance, p.march.distance)
        * direction_confidence(direction, from.to_eye);
    if (found.confidence <= 0.0) return found;
    found.alpha = narrowest_alpha(bsdf_of(there));
    found.was_behind = hit.was_behind;
    if (p.has_emission != 0u) {
        vec3 emission = sampled_emission(view, scene, gbuffer, hit.pixel, instance);
        found.emits = emission != vec3(0.0);
        seen = without_emission(seen, emission);
    }
    // What the camera saw is not what the surface sends along the ray. The share that its albedo tells is made good, as in
    // previous_light_at; what a smooth surface reflects differently to both is not.
    vec3 to_eye_before = safe_normalize(view.at[0].previous_eye - before.position, there.normal);
    seen *= surface_albedo(view, there, -direction) / surface_albedo(view, there, to_eye_before);
    found.radiance = seen;
    return found;
}

#endif
