#ifndef LIB_REFERENCE_GLSL
#define LIB_REFERENCE_GLSL
#include "lib/gbuffer.glsl"
#include "lib/hit_shading.glsl"
#include "lib/random.glsl"
#include "lib/ray.glsl"
#include "lib/surface.glsl"
#include "lib/tinted.glsl"
#include "shared/reference.glsl"
// Shared by the passes of the reference: camera rays, primary hits, and running means.

uint closest_traced = 0u;
uint any_traced = 0u;

// Limit on transmitting surfaces along a ray: none.
const uint ANY_NUMBER = 4294967295u;

// Transmittance along a ray, per colour channel.
vec3 unhidden(SceneBuffer scene, Ray ray, uint flags) {
    if ((flags & PATH_CLEAR) == 0u) {
        any_traced++;
        return trace_any(scene, ray) ? vec3(0.0) : vec3(1.0);
    }
    uvec2 traced = uvec2(0u);
    float farthest;
    vec3 share = light_through(scene, ray, ANY_NUMBER, traced, farthest);
    closest_traced += traced.x;
    any_traced += traced.y;
    return share;
}

// Running mean and sum of squared deviations (Welford 1962, "Note on a Method for Calculating Corrected Sums of Squares and Products").
struct Mean {
    vec3 mean;
    vec3 squares;
};

void add_sample(inout Mean m, vec3 value, uint number) {
    vec3 apart = value - m.mean;
    m.mean += apart / float(number);
    m.squares += apart * (value - m.mean);
}

// A camera ray, through the pixel's centre or a random point in it. `direction` has unit view depth. It begins at the near plane, and culls
// the same back faces as the raster.
Ray camera_ray(ViewBuffer view, ivec2 pixel, vec2 jitter, uint flags) {
    precise vec2 at = vec2(pixel) + ((flags & PATH_CENTRE) != 0u ? vec2(0.5) : jitter);
    precise vec2 ndc = at / vec2(view.at[0].size) * 2.0 - 1.0;
    mat4 m = view.at[0].world_from_clip;
    precise vec3 along = m[0].xyz * ndc.x + m[1].xyz * ndc.y + m[3].xyz;
    Ray ray = make_ray(view.at[0].eye, 1.0 / view.at[0].world_from_clip[2].w, along, 1e30);
    ray.cull = RAY_CULL_BACK;
    if ((flags & PATH_CENTRE) != 0u) ray.cone_spread = pixel_spread(view);
    return ray;
}

// Texture footprint of a pixel on the plane that a camera ray has hit; none if samples are spread over the pixel.
Footprint camera_footprint(ViewBuffer view, SceneBuffer scene, Ray ray, Hit hit, uint flags) {
    if ((flags & PATH_CENTRE) == 0u) return NO_FOOTPRINT;
    RayStart start = hit_start(scene, ray, hit);
    mat4 m = view.at[0].world_from_clip;
    vec3 across = m[0].xyz * (2.0 / float(view.at[0].size.x));
    vec3 down = m[1].xyz * (2.0 / float(view.at[0].size.y));
    float facing = dot(ray.direction, start.normal);
    if (facing == 0.0) return NO_FOOTPRINT;
    // Distance from the eye: a ray restarts at surfaces that it passes straight through.
    float t = hit.t + dot(ray.origin - view.at[0].eye, ray.direction) / dot(ray.direction, ray.direction);
    // The neighbouring pixel's ray meets the plane a little nearer or further.
    return Footprint(
        t * (across - ray.direction * (dot(across, start.normal) / facing)),
        t * (down - ray.direction * (dot(down, start.normal) / facing))
    );
}

// The first surface visible in a pixel. False if there is none.
bool first_surface(ViewBuffer view, SceneBuffer scene, PathParams params, ivec2 pixel, vec2 jitter, out Ray ray, out SurfacePoint surface) {
    ray = camera_ray(view, pixel, jitter, params.flags);
    Hit hit;
    closest_traced++;
    if (!trace_closest(scene, ray, hit)) return false;
    surface = surface_at(scene, ray, hit, camera_footprint(view, scene, ray, hit, params.flags));
    return true;
}

// The pixel of this invocation; false outside.
bool reference_pixel(PathParams params, ViewBuffer view, out ivec2 pixel) {
    pixel = ivec2(params.tile + RAY_INVOCATION.xy);
    return inside(pixel, view.at[0].size);
}

Random reference_random(PathParams params, ViewBuffer view, ivec2 pixel, uint number) {
    uint index = uint(pixel.y) * view.at[0].size.x + uint(pixel.x);
    return random_of(index, params.first_sample + number, view.at[0].seed);
}

void store_mean(PathParams params, Mean m) {
    ivec2 at = ivec2(RAY_INVOCATION.xy);
    store(params.mean, at, vec4(m.mean, 1.0));
    store(params.squares, at, vec4(m.squares, 1.0));
    count_rays(params.rays, closest_traced, any_traced);
}

#endif
