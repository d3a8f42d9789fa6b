#ifndef LIB_SHADOW_RAYS_GLSL
#define LIB_SHADOW_RAYS_GLSL
#include "lib/gbuffer.glsl"
#include "lib/light_sampling.glsl"
#include "lib/ray.glsl"
#include "lib/sequence.glsl"
#include "shared/shadows.glsl"
// Shadow rays from a surface to points of up to four lights: uniform over a light's disc or area, or over the cone that it fills. Light of
// the whole lamp, unshadowed, is multiplied with the share of them that arrive (Heitz, Hill and McGuire 2018, "Combining Analytic
// Direct Illumination and Stochastic Shadows").

uint rays_traced = 0u;

// A surface that light falls on.
struct Receiver {
    Surface surface;
    RayStart start;
    float pixel;  // width of a pixel there, metres
};

// What a pixel shows: its surface, and `ids` of the G-buffer.
Receiver receiver_of(ViewBuffer view, ivec2 pixel, Surface surface, uvec2 ids) {
    vec3 eye = view.at[0].eye;
    RayStart start = seen_start(SceneBuffer(view.at[0].scene), ids, eye, pixel_ray(view, pixel), surface.position);
    return Receiver(surface, start, pixel_spread(view) * distance(surface.position, eye));
}

// Which lights, and how many points of each.
struct ShadowRays {
    uvec4 lights;
    uint count;
    uint samples;  // 0 for one ray to the centre
    uint wanted;   // a bit for each light that rays go to; the others are given as 0
};

// The ray to a point of a light. False where that cannot light the surface anyway.
bool shadow_ray(Receiver at, Incident from, out Ray ray) {
    ray = make_ray(vec3(0.0), 0.0, vec3(0.0), 0.0);
    Surface surface = at.surface;
    if (dot(surface.normal, from.direction) <= 0.0 || dot(surface.geometric_normal, from.direction) <= 0.0) return false;
    ray = from.distance >= INFINITELY_FAR ? surface_ray(at.start, from.direction, INFINITELY_FAR)
        : surface_ray_to(at.start, at.start.position + from.distance * from.direction);
    // A point has no size: the ray stays as wide as the pixel is at the surface.
    ray = with_cone(ray, at.pixel, 0.0);
    return true;
}

// The flattest light, as a cosine, whose penumbrae are stretched in full: things that it grazes are mostly smaller than that.
const float FLATTEST = 0.2;

// Width on the screen, pixels, of the penumbra that an edge throws which the light meets `blocker` metres before the surface: that of similar
// triangles, stretched where the light comes in flat. Seen at an angle it is narrower on the screen.
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

// Half of what a light's size fills of the view from a surface: the sine of the angle.
float light_extent(Light light, LightSample centre) {
    if (light.kind == LIGHT_DIRECTIONAL) return sin(light.radius);
    float size = light.kind == LIGHT_RECTANGLE ? length(light.half_u) + length(light.half_v) : light.radius;
    return min(size / max(centre.distance, MIN_LIGHT_DISTANCE), 1.0);
}

// Width taken for the penumbra where the surface's own horizon cuts the light, pixels: it is as wide as the surface bends slowly, the more so
// the larger the light. Nothing where the light is all above the horizon or all below.
float horizon_penumbra(Surface surface, Light light, LightSample centre) {
    float height = min(dot(surface.normal, centre.direction), dot(surface.geometric_normal, centre.direction));
    float extent = light_extent(light, centre);
    return abs(height) < extent ? PENUMBRA_MOST * extent : 0.0;
}

// 1 where nothing hides this point of the light. What it cannot light anyway is 0 without a ray. `penumbra` becomes the widest one so far, in
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

// What is stored of a width: 0 stands for none.
vec4 encode_penumbra(vec4 pixels) {
    return mix(vec4(0.0), clamp(pixels / PENUMBRA_MOST, 1.0 / 255.0, 1.0), greaterThan(pixels, vec4(0.0)));
}

// The share of each light that is seen, by the points that `drawn_at` had or has in frame `frame`, and the width of penumbrae, pixels.
vec4 visibilities(ViewBuffer view, Receiver at, ShadowRays rays, ivec2 drawn_at, uint frame, out vec4 penumbra) {
    penumbra = vec4(0.0);
    SceneBuffer scene = SceneBuffer(view.at[0].scene);
    vec3 position = at.start.position;
    vec4 seen = vec4(0.0);
    for (uint k = 0u; k < rays.count; k++) {
        if ((rays.wanted & (1u << k)) == 0u) continue;
        Light light = LightBuffer(scene.at[0].lights).at[rays.lights[k]];
        LightSample centre = sample_light(light, position);
        // Outside of its cone, its range or its front.
        if (centre.irradiance == vec3(0.0)) continue;
        if (rays.samples == 0u || !has_size(light)) {
            Incident from = Incident(centre.direction, centre.distance, centre.irradiance, 0.0);
            float none = 0.0;  // of a point
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
