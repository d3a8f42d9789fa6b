#ifndef LIB_SURFEL_CACHE_GLSL
#define LIB_SURFEL_CACHE_GLSL
#include "lib/surfel_binding.glsl"
// What the paths of surfels tell of the places where they look for light: that a surfel is in use, and where none is.

// Where the path lacks a surfel first; bound to nothing if it does not.
SurfelBinding surfel_wish = SurfelBinding(0u, 0u, vec2(0.0), 0u);
vec3 surfel_wish_position = vec3(0.0);

void note_use(ViewBuffer view, SceneBuffer scene, uvec2 pool, SurfelLight found, RayStart start, Ray ray, Hit hit) {
    if (found.exists && found.known) SurfelPool(pool).at[found.most].last_used = view.at[0].frame;
    if (found.known || found.full || surfel_wish.instance != 0u) return;
    surfel_wish = hit_binding(scene, ray, hit);
    surfel_wish_position = start.position;
}

#endif
