#ifndef LIB_GI_RAYS_GLSL
#define LIB_GI_RAYS_GLSL
#include "lib/follow_path.glsl"
#include "lib/gbuffer.glsl"
#include "lib/precision.glsl"
#include "lib/ray_count.glsl"
#include "lib/sequence.glsl"
#include "shared/gi.glsl"
// Diffuse indirect light by cosine-distributed rays.

// The mean over the rays of a pixel, over its diffuse albedo.
vec3 gathered(ViewBuffer view, TraceParams params, ivec2 pixel) {
    Surface s = load_surface(view, pixel, params.gbuffer);
    if (!scatters(s)) return vec3(0.0);
    mat3 around = frame_of(s.normal);
    RayStart start = seen_start(SceneBuffer(params.scene), load_uint(params.gbuffer.ids, pixel).xy, view.at[0].eye, pixel_ray(view, pixel), s.position);
    Path path = Path(params.hits, params.bounces, params.regularization);
    vec3 sum = vec3(0.0);
    for (uint i = 0u; i < params.samples; i++) {
        uint index = view.at[0].frame * params.samples + i;
        vec3 l = sample_cosine(sequence2(pixel, index, SEQUENCE_GI, view.at[0].seed));
        vec3 direction = around * l;
        // The surface itself hides what lies below its plane.
        if (dot(direction, start.normal) <= 0.0) continue;
        Random random = random_of(uint(pixel.y) * view.at[0].size.x + uint(pixel.x), index, view.at[0].seed ^ SEQUENCE_GI);
        float distance;
        vec3 radiance = follow(view, SceneBuffer(params.scene), path, surface_ray(start, direction, UNBOUNDED), l.z / PI, random, distance);
        sum += diffuse_weight(s.fresnel, l.z) * radiance;
    }
    return sum / float(params.samples);
}

void trace_gi(TraceParams params, ivec2 pixel) {
    ViewBuffer view = ViewBuffer(params.view);
    if (!inside(pixel, view.at[0].size)) return;
    store(params.radiance, pixel, vec4(representable(gathered(view, params, pixel), params.greatest), 1.0));
    count_rays(params.rays, paths_traced.x, paths_traced.y);
}

#endif
