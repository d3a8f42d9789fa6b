#ifndef LIB_SHADOW_RAYS_GLSL
#define LIB_SHADOW_RAYS_GLSL
#include "lib/gbuffer.glsl"
#include "lib/light_sampling.glsl"
#include "lib/ray.glsl"
#include "lib/sequence.glsl"
#include "shared/denoise.glsl"
#include "shared/shadows.glsl"
// Shadow rays from a surface to points of up to four lights, uniform over the light's area or over the cone that it subtends. The share of
// unoccluded rays multiplies the unshadowed light of the whole light source (ratio estimator: Heitz, Hill and McGuire 2018, "Combining
// Analytic Direct Illumination and Stochastic Shadows").

uint rays_traced = 0u;

// A shadow receiver.
struct Receiver {
    Surface surface;
    RayStart start;
    float pixel;  // width of a pixel at the surface, metres
};

// The receiver of a pixel: its surface, and `ids` of the G-buffer.
Receiver receiver_of(ViewBuffer view, SceneBuffer scene, ivec2 pixel, Surface surface, uvec2 ids) {
    vec3 eye = view.at[0].eye;
    RayStart start = seen_start(scene, ids, eye, pixel_ray(view, pixel), surface.position);
    return Receiver(surface, start, pixel_spread(view) * distance(surface.position, eye));
}

// Which lights to sample, and how.
struct ShadowRays {
    uvec4 lights;
    uint count;
    uint samples;  // rays per light; 0 for one to its centre
    uint wanted;   // a bit for each light to trace; visibility of the others is 0
};

// The ray to a point of a light. False if the surface faces away from it.
bool shadow_ray(Receiver at, Incident from, out Ray ray) {
    ray = make_ray(vec3(0.0), 0.0, vec3(0.0), 0.0);
    Surface surface = at.surface;
    if (dot(surface.normal, from.direction) <= 0.0 || dot(surface.geometric_normal, from.direction) <= 0.0) return false;
    ray = from.distance >= INFINITELY_FAR ? surface_ray(at.start, from.direction, INFINITELY_FAR)
        : surface_ray_to(at.start, at.start.position + from.distance * from.direction);
    // The target has no extent, so the cone keeps the pixel's width at the surface.
    ray = with_cone(ray, at.pixel, 0.0);
    return true;
}

// Penumbrae widen with 1 / cosine of the incident light, limited at this cosine: occluders at grazing angles are mostly smaller than that.
const float FLATTEST = 0.2;

// Penumbra width on the screen, pixels, for an occluder `blocker` metres before the surface: by similar triangles, widened at grazing
// incidence. An upper bound, as foreshortening towards the viewer is ignored.
float penumbra_pixels(Receiver at, Light light, Incident from, float blocker) {
    float width;
    if (light.kind == LIGHT_DIRECTIONAL) {
        width = 2.0 * tan(light.radius) * blocker;
    } else {
        float size = light.kind == LIGHT_RECTANGLE ? max(length(light.half_u), length(light.half_v)) : light.radius;
        width = 2.0 * size * blocker / max(from.distance - blocker, 1e-3 * from.distance);
    }
    return width / (at.pixel * max(dot(at.surface.geometric_normal, from.direction), FLATTEST));
}

// Sine of half the angle that a light subtends.
float light_extent(Light light, LightSample centre) {
    if (light.kind == LIGHT_DIRECTIONAL) return sin(light.radius);
    float size = light.kind == LIGHT_RECTANGLE ? length(light.half_u) + length(light.half_v) : light.radius;
    return min(size / max(centre.distance, MIN_LIGHT_DISTANCE), 1.0);
}

// Penumbra width, pixels, that is assumed where the surface's own horizon cuts the light. The true width depends on curvature; this grows
// with the size of the light. 0 if the light is fully above or fully below the horizon.
float horizon_penumbra(Surface surface, Light light, LightSample centre) {
    float height = min(dot(surface.normal, centre.direction), dot(surface.geometric_normal, centre.direction));
    float extent = light_extent(light, centre);
    return abs(height) < extent ? WIDEST_NOISE * extent : 0.0;
}

// 1 if this point of the light is unoccluded. 0 without a ray if the surface faces away. `penumbra` is raised to the width at the hit,
// pixels.
float visibility(SceneBuffer scene, Receiver at, Light light, Incident from, inout float penumbra) {
    Ray ray;
    if (!shadow_ray(at, from, ray)) return 0.0;
    rays_traced++;
    float t;
    if (!trace_any_at(scene, ray, t)) return 1.0;
    penumbra = max(penumbra, penumbra_pixels(at, light, from, t * length(ray.direction)));
    return 0.0;
}

// Encodes widths for the image: 0 stands for no penumbra.
vec4 encode_penumbra(vec4 pixels) {
    return mix(vec4(0.0), clamp(pixels / WIDEST_NOISE, 1.0 / 255.0, 1.0), greaterThan(pixels, vec4(0.0)));
}

// Visibility of each light, by the points that pixel `drawn_at` used or uses in frame `frame`, and the penumbra width, pixels.
vec4 visibilities(ViewBuffer view, SceneBuffer scene, Receiver at, ShadowRays rays, ivec2 drawn_at, uint frame, out vec4 penumbra) {
    penumbra = vec4(0.0);
    vec3 position = at.start.position;
    vec4 seen = vec4(0.0);
    for (uint k = 0u; k < rays.count; k++) {
        if ((rays.wanted & (1u << k)) == 0u) continue;
        Light light = LightBuffer(scene.at[0].lights).at[rays.lights[k]];
        LightSample centre = sample_light(light, position);
        // Outside the light's cone or range, or behind it.
        if (centre.irradiance == vec3(0.0)) continue;
        if (rays.samples == 0u || !has_size(light)) {
            Incident from = Incident(centre.direction, centre.distance, centre.irradiance, 0.0);
            float none = 0.0;  // a point light has no penumbra
            seen[k] = visibility(scene, at, light, from, none);
            continue;
        }
        penumbra[k] = horizon_penumbra(at.surface, light, centre);
        for (uint i = 0u; i < rays.samples; i++) {
            vec2 u = sequence2(drawn_at, frame * rays.samples + i, SEQUENCE_SHADOWS + rays.lights[k], view.at[0].seed);
            Incident from;
            if (sample_sized_light(light, position, u, from)) seen[k] += visibility(scene, at, light, from, penumbra[k]);
        }
        seen[k] /= float(rays.samples);
    }
    return seen;
}

#endif
