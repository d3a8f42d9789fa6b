#version 460
#extension GL_GOOGLE_include_directive : require
#include "lib/bindless.glsl"
#include "lib/precision.glsl"
#include "lib/ray_count.glsl"
#include "lib/ray_rate.glsl"
#include "lib/reflector.glsl"
#include "lib/screen_light.glsl"
#include "lib/pixel_list.glsl"
// Marches the rays of a list through the depth image. Those of which the screen knows nothing, or not enough, go to a list of their own.
layout(local_size_x = TILE_SIDE, local_size_y = TILE_SIDE) in;
layout(push_constant, scalar) uniform Push { HybridMarchParams params; };

// Rays of lobes narrower than this alpha are traced: a mirror shows each mistake of the screen, a wide lobe their mean.
const float LEAST_MARCHED_ALPHA = 0.05;
// At the silhouette of a thing the screen does not know whether a ray passes it.
const float ALL_KNOWN = 0.99;

uint marched = 0u;

// Whether the ray of a pixel is to be traced.
bool is_left(ViewBuffer view, ivec2 pixel) {
    if (!is_marched(params.rate, pixel)) return true;
    Reflector r = reflector_at(view, params.gbuffer, pixel);
    if (r.exists && strongest_alpha(r.bsdf, r.v) < LEAST_MARCHED_ALPHA) return true;
    uint index = turns_at(view, rate_at(params.rate, pixel));
    LobeSample s = draw_lobe(view, r, pixel, index);
    if (!s.exists) return false;
    vec3 direction = r.around * s.l;
    if (dot(direction, r.surface.geometric_normal) <= 0.0) return true;
    marched = 1u;
    vec2 random = unit_floats(hash4(uvec4(uvec2(pixel), view.at[0].frame, view.at[0].seed))).yz;
    ScreenFound found = light_on_screen(view, SceneBuffer(params.scene), params.light, params.gbuffer, params.not_finite, r.surface, direction, 1.0, random.x);
    // Where confidence falls the rays of a part of the pixels are traced, so that no border shows.
    if (found.confidence <= random.y) return true;
    // Traced hits of such surfaces do not take the light of the previous frame either.
    if (found.was_behind || found.known < ALL_KNOWN || found.emits || found.alpha < LEAST_REUSED_ALPHA) return true;
    store(params.found, pixel, vec4(representable(found.radiance, params.greatest), FOUND_ON_SCREEN));
    store(params.rays_found, pixel, pack_ray(direction, found.distance, s.pdf));
    return false;
}

void main() {
    ViewBuffer view = ViewBuffer(params.view);
    ivec2 pixel = ivec2(0);
    bool is_one = listed_pixel(params.list, gl_GlobalInvocationID.xy, pixel);
    append_pixel(params.rest, pixel, is_one && is_left(view, pixel));
    count_screen_rays(params.not_finite, marched);
}
