#ifndef LIB_LOBE_RAYS_GLSL
#define LIB_LOBE_RAYS_GLSL
#include "lib/gbuffer.glsl"
#include "lib/hit_shading.glsl"
#include "lib/lobes.glsl"
// Rays of visible surfaces to lights, and along the specular lobe to find emitted light. With TINTED, surfaces may transmit light, as in lib/tinted.glsl.

// Counters: closest-hit and any-hit rays.
uvec2 light_rays_traced = uvec2(0u);

// A visible surface and its material. Local directions as in lib/bsdf.glsl.
struct Seen {
    RayStart start;
    mat3 around;
    vec3 v;
    Bsdf bsdf;
    float lobe_probability;  // of a ray along the lobe, for one ray
    float apart;             // share of the specular light that is apart
};

// What rays have found.
struct Found {
    Lobes light;     // reflected towards the viewer
    float distance;  // metres
};

const Found NOTHING_FOUND = Found(DARK, INFINITELY_FAR);

// Where a pixel shows nothing.
Seen seen_nothing() {
    Seen s;
    s.start.position = vec3(0.0);
    s.v = vec3(0.0, 0.0, 1.0);
    s.bsdf = bsdf_of(no_surface());
    s.lobe_probability = 0.0;
    s.apart = 0.0;
    return s;
}

// What a pixel shows, with a `lobe_probability` of 1, or of 0 for surfaces without a specular lobe. False if nothing, or if it is black as unlit
// surfaces are: a metal with a black base colour.
bool seen_at(ViewBuffer view, SceneBuffer scene, GBufferImages images, LobeImages lobes, ivec2 pixel, inout Seen s) {
    Surface surface = load_surface(view, pixel, images);
    bool has_lobe = reflects(surface);
    if (!surface.exists || (!has_lobe && (1.0 - surface.metalness) * surface.base_colour == vec3(0.0))) return false;
    s.bsdf = bsdf_of(surface);
    s.start = seen_start(scene, load_uint(images.ids, pixel).xy, view.at[0].eye, pixel_ray(view, pixel), surface.position);
    s.around = frame_of(surface.normal);
    s.v = surface.to_eye * s.around;
    s.v.z = eye_cosine(surface);
    s.lobe_probability = has_lobe ? 1.0 : 0.0;
    s.apart = share_apart(lobes, surface);
    return true;
}

// As denoisers take it.
Reflecting reflecting(ViewBuffer view, Seen s) {
    return Reflecting(s.bsdf, s.v.z, distance(s.start.position, view.at[0].eye), s.apart);
}

// A direction along the lobe, local. False if it does not lie above the surface.
bool sample_lobe(Seen s, vec2 u, out vec3 l) {
    return sample_specular(s.bsdf, s.v, u, l) && dot(s.start.normal, s.around * l) > 0.0;
}

// What the pixel reflects of light that a ray along the lobe has found, over its density.
Found reflected_find(Seen s, vec3 l, vec3 light, float distance) {
    return Found(light == vec3(0.0) ? DARK : scaled(lobes_cosine(s.apart, s.bsdf, s.v, l), light), distance);
}

// The same of a sample of a light, by a shadow ray. `expected`: how many such samples there are of this light; `by_lobe`: of rays along the lobe,
// which find the light too if it has a size.
Found arriving_find(SceneBuffer scene, Seen s, Incident from, float expected, float by_lobe) {
    vec3 l = from.direction * s.around;
    if (l.z <= 0.0 || dot(s.start.normal, from.direction) <= 0.0) return NOTHING_FOUND;
    Found found = Found(lobes_cosine(s.apart, s.bsdf, s.v, l), from.distance);
    if (found.light == DARK) return found;
    if (from.pdf > 0.0 && by_lobe > 0.0) expected += by_lobe * bsdf_pdf(s.bsdf, s.v, l, LOBE_SPECULAR) / from.pdf;
    vec3 share = seen_along(scene, surface_ray_to(s.start, s.start.position + from.distance * from.direction), light_rays_traced);
    found.light = scaled(found.light, share * from.radiance / expected);
    return found;
}

// Light of a surface that a ray along the lobe has hit, over the density of all ways to find it; without its coverage, which the caller applies.
// Whoever includes this file says how.
vec3 emission_found(SceneBuffer scene, LightTables lights, Seen s, vec3 l, Hit hit, SurfacePoint met);

// Emitted light that a ray of the unit direction `l`, local, finds, as `emission_found` says. Surfaces in between that transmit light attenuate and
// tint what lies behind them, and emit by their coverage. `end`: distance to the opaque surface that ends the ray, metres.
vec3 emission_along(SceneBuffer scene, LightTables lights, Seen s, vec3 l, out float end) {
    vec3 direction = s.around * l;
    Ray ray = surface_ray(s.start, direction, UNBOUNDED);
    end = INFINITELY_FAR;
#ifdef TINTED
    // First ray to the nearest opaque surface, then on through all transmitting ones before it.
    ray.mask = INSTANCE_MASK_SOLID;
    vec3 behind = vec3(0.0);
    vec3 before = vec3(0.0);
    vec3 share = vec3(1.0);
    for (uint met = 0u;; met++) {
        Hit hit;
        light_rays_traced.x++;
        bool found = trace_closest(scene, ray, hit);
        if (met > 0u && !found) return before + share * behind;
        // The limit of light_through.
        if (met > MOST_SHEETS) return before;
        float left = ray.t_max;
        if (found) {
            SurfacePoint p = surface_at(scene, ray, hit, NO_FOOTPRINT);
            vec3 light = emission_found(scene, lights, s, l, hit, p);
            if (met == 0u) {
                behind = light;
                left = hit.t;
                end = distance(s.start.position, p.start.position);
            } else {
                before += share * min(p.coverage, 1.0) * light;
                share *= surface_through(p, direction);
                if (share == vec3(0.0)) return before;
                ray = surface_ray(p.start, direction, ray.t_max - hit.t);
                left = ray.t_max;
            }
        }
        ray.t_max = left;
        ray.mask = INSTANCE_MASK_CLEAR;
        ray.cull |= RAY_UNTESTED;
    }
#else
    Hit hit;
    light_rays_traced.x++;
    if (!trace_closest(scene, ray, hit)) return vec3(0.0);
    end = dot(ray.origin - s.start.position, direction) + hit.t;
    if (WordBuffer(lights.emitters).at[hit.instance] == NO_EMITTER) return vec3(0.0);
    return emission_found(scene, lights, s, l, hit, surface_at(scene, ray, hit, NO_FOOTPRINT));
#endif
}

#endif
