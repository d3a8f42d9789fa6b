#ifndef LIB_SURFEL_CACHE_GLSL
#define LIB_SURFEL_CACHE_GLSL
#include "lib/hit_shading.glsl"
#include "lib/surfel_binding.glsl"
// Indirect light of surfels at the hits of rays, and where paths lack them.

struct SurfelCache {
    SurfelGrid grid;
    uvec2 pool;
    uint is_used;   // 0: paths go on as if there were none
};

// Where the path lacks a surfel first; bound to nothing if it does not.
SurfelBinding surfel_wish = SurfelBinding(0u, 0u, vec2(0.0), 0u);
vec3 surfel_wish_position = vec3(0.0);

// What a surface scatters of the indirect light that reaches it, the sky's included, as if it were diffuse. False where no surfels know, and for
// surfaces too smooth for that.
bool surfels_light(SceneBuffer scene, SurfelCache cache, ViewBuffer view, SurfacePoint s, Ray ray, Hit hit, vec3 to_viewer, out vec3 light) {
    light = vec3(0.0);
    if (cache.is_used == 0u || narrowest_alpha(s.bsdf) < LEAST_REUSED_ALPHA) return false;
    SurfelLight found = surfel_lookup(cache.grid, view.at[0].eye, s.start.position, s.start.normal, s.normal);
    if (!found.known && !found.full && surfel_wish.instance == 0u) {
        surfel_wish = hit_binding(scene, ray, hit);
        surfel_wish_position = s.start.position;
    }
    if (!found.exists || !found.known) return false;
    SurfelPool(cache.pool).at[found.most].last_used = view.at[0].frame;
    light = albedo_towards(scene, s, to_viewer) * found.light;
    return true;
}

#endif
