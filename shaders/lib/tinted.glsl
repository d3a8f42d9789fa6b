#ifndef LIB_TINTED_GLSL
#define LIB_TINTED_GLSL
#include "lib/alpha.glsl"
#include "lib/bsdf.glsl"
#include "lib/random.glsl"
#include "lib/ray.glsl"
#include "lib/surface.glsl"
#include "shared/hit_shading.glsl"
// Straight transmission of light: past the coverage of blended surfaces, and through thin smooth sheets of glass, tinted by base colour,
// Fresnel and transmission. Surfaces that refract or scatter light count as opaque here: volumes (their light is a caustic) and rough
// sheets.

// Transmittance, per channel, of the covered part of a surface. `towards`: along the ray, any length.
vec3 solid_through(SurfacePoint s, vec3 towards) {
    return s.sheet && !s.black ? straight_transmission(s.bsdf, abs(dot(s.normal, normalize(towards)))) : vec3(0.0);
}

// The same of the whole surface, the uncovered part included.
vec3 surface_through(SurfacePoint s, vec3 towards) {
    return mix(vec3(1.0), solid_through(s, towards), min(s.coverage, 1.0));
}

// Whether a ray that has met a surface goes straight on, by chance, with `throughput` divided by the probability of what happens. If not, the
// straight transmission is taken from the `lobes` that the surface scatters by.
bool goes_straight_on(SurfacePoint s, vec3 direction, inout Random random, inout vec3 throughput, inout uint lobes) {
    if (s.coverage < 1.0 && random4(random).x >= s.coverage) return true;
    vec3 through = solid_through(s, direction);
    float probability = max(through.r, max(through.g, through.b));
    if (!(probability > 0.0)) return false;
    bool passes = random4(random).x < probability;
    throughput *= passes ? through / probability : vec3(1.0 / (1.0 - probability));
    if (!passes) lobes &= ~LOBE_TRANSMISSION;
    return passes;
}

// Footprint of a cone of this width, metres, on a plane that it meets along `direction`, for texture filtering.
Footprint cone_footprint(vec3 direction, vec3 normal, float width) {
    float facing = dot(direction, normal);
    if (!(width > 0.0) || facing == 0.0) return NO_FOOTPRINT;
    mat3 around = frame_of(normalize(direction));
    vec3 dx = width * around[0];
    vec3 dy = width * around[1];
    return Footprint(dx - direction * (dot(dx, normal) / facing), dy - direction * (dot(dy, normal) / facing));
}

// Transmittance along a ray, per channel. First one any-hit ray against opaque instances; if it hits nothing, transmitting surfaces are
// visited one after another, at most `most` of them: beyond that counts as occluded. `traced`: closest-hit and any-hit rays. `farthest`:
// distance of the last surface met, metres; 0 if there was none.
//
// The alpha test is skipped: the coverage of blended surfaces is looked up instead.
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
