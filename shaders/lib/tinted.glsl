#ifndef LIB_TINTED_GLSL
#define LIB_TINTED_GLSL
#include "lib/alpha.glsl"
#include "lib/bsdf.glsl"
#include "lib/ray.glsl"
#include "lib/surface.glsl"
// Light that goes straight through surfaces: past the share that a blended one covers, and through thin sheets of smooth glass, where
// base colour, Fresnel and transmission tint it. What bends or scatters light stops it here: volumes (their light is a caustic) and
// rough sheets.

// Behind so many of them frames give light up: more than 16 panes in a row are dark anyway, and a ray has an end.
const uint MOST_SHEETS = 16u;

// The share of light, in each colour, that the solid part of a surface lets straight through. `towards`: along the ray, any length.
vec3 solid_through(SurfacePoint s, vec3 towards) {
    return s.sheet && !s.black ? straight_transmission(s.bsdf, abs(dot(s.normal, normalize(towards)))) : vec3(0.0);
}

// The same of the whole surface, what it does not cover included.
vec3 surface_through(SurfacePoint s, vec3 towards) {
    return mix(vec3(1.0), solid_through(s, towards), min(s.coverage, 1.0));
}

// What a cone of this width, metres, covers of a plane that it meets along `direction`, for the filter of textures.
Footprint cone_footprint(vec3 direction, vec3 normal, float width) {
    float facing = dot(direction, normal);
    if (!(width > 0.0) || facing == 0.0) return NO_FOOTPRINT;
    mat3 around = frame_of(normalize(direction));
    vec3 dx = width * around[0];
    vec3 dy = width * around[1];
    return Footprint(dx - direction * (dot(dx, normal) / facing), dy - direction * (dot(dy, normal) / facing));
}

// The share of light, in each colour, that comes along a ray. First one ray to what lets nothing through; where it meets nothing, the
// others are met one after another, `most` of them: what lies behind so many counts as hidden. `traced`: closest-hit and any-hit rays.
// `farthest`: how far away the last thing was that the light met, metres; 0 where it met nothing.
//
// The coverage of blended surfaces is looked up: the alpha test that stands for it elsewhere is left out.
vec3 light_through(SceneBuffer scene, Ray ray, uint most, inout uvec2 traced, out float farthest) {
    ray.mask = INSTANCE_MASK_SOLID;
    traced.y++;
    float t;
    farthest = 0.0;
    if (trace_any_at(scene, ray, t)) {
        farthest = t * length(ray.direction);
        return vec3(0.0);
    }
    ray.mask = INSTANCE_MASK_CLEAR;
    ray.cull |= RAY_UNTESTED;
    vec3 share = vec3(1.0);
    for (uint met = 0u;; met++) {
        Hit hit;
        traced.x++;
        if (!trace_closest(scene, ray, hit)) return share;
        if (met == most) return vec3(0.0);
        farthest += hit.t * length(ray.direction);
        RayStart start = hit_start(scene, ray, hit);
        float width = cone_width_at(ray, hit.t);
        SurfacePoint s = surface_at(scene, ray, hit, cone_footprint(ray.direction, start.normal, width));
        share *= surface_through(s, ray.direction);
        if (share == vec3(0.0)) return share;
        Ray on = surface_ray(s.start, ray.direction, ray.t_max - hit.t);
        on.mask = ray.mask;
        on.cull = ray.cull;
        ray = with_cone(on, width, ray.cone_spread);
    }
}

#endif
