#ifndef LIB_GI_RAYS_GLSL
#define LIB_GI_RAYS_GLSL
#include "lib/follow_path.glsl"
#include "lib/gbuffer.glsl"
#include "lib/gradient.glsl"
#include "lib/not_finite.glsl"
#include "lib/precision.glsl"
#include "lib/ray_count.glsl"
#include "lib/sequence.glsl"
#include "shared/gi.glsl"
// Diffuse indirect light by cosine-distributed rays.

// In place of the luminance of a surface without a ray.
const float NO_RAY = -1.0;

// Radiance along the ray of a sample, and its direction around the shading normal. 0 below the plane of the surface, which hides what is there.
vec3 sampled(ViewBuffer view, SceneBuffer scene, Path path, ivec2 pixel, vec3 normal, RayStart start, uint index, out vec3 local) {
    local = sample_cosine(sequence2(pixel, index, SEQUENCE_GI, view.at[0].seed));
    vec3 direction = frame_of(normal) * local;
    if (dot(direction, start.normal) <= 0.0) return vec3(0.0);
    Random random = random_of(uint(pixel.y) * view.at[0].size.x + uint(pixel.x), index, view.at[0].seed ^ SEQUENCE_GI);
    float distance;
    return follow(view, scene, path, surface_ray(start, direction, UNBOUNDED), local.z / PI, random, distance);
}

// The mean over the rays of a pixel, over its diffuse albedo; and the luminance that the first ray finds, or NO_RAY.
vec3 gathered(ViewBuffer view, TraceParams params, ivec2 pixel, out float first) {
    first = NO_RAY;
    Surface s = load_surface(view, pixel, params.gbuffer);
    if (!scatters(s)) return vec3(0.0);
    SceneBuffer scene = SceneBuffer(params.scene);
    RayStart start = seen_start(scene, load_uint(params.gbuffer.ids, pixel).xy, view.at[0].eye, pixel_ray(view, pixel), s.position);
    Path path = Path(params.hits, params.bounces, params.regularization);
    vec3 sum = vec3(0.0);
    for (uint i = 0u; i < params.samples; i++) {
        vec3 local;
        vec3 radiance = sampled(view, scene, path, pixel, s.normal, start, view.at[0].frame * params.samples + i, local);
        if (i == 0u) first = luminance(radiance);
        sum += diffuse_weight(s.fresnel, local.z) * radiance;
    }
    return sum / float(params.samples);
}

void trace_gi(TraceParams params, ivec2 pixel) {
    ViewBuffer view = ViewBuffer(params.view);
    if (!inside(pixel, view.at[0].size)) return;
    float first;
    store(params.radiance, pixel, vec4(representable(gathered(view, params, pixel, first), params.greatest), 1.0));
    if (params.surfaces != NO_IMAGE && remember(view, pixel, params.surfaces, params.gbuffer)) {
        store(params.luminance, pixel / int(GRADIENT_STRATUM), vec4(first));
    }
    count_rays(params.rays, paths_traced.x, paths_traced.y);
}

// Change of the luminance that the first ray of one pixel out of each square finds.
void trace_gi_gradient(GradientParams params, ivec2 square) {
    ViewBuffer view = ViewBuffer(params.view);
    if (!inside(square * int(GRADIENT_STRATUM), view.at[0].size)) return;
    vec3 change = vec3(0.0);
    ivec2 before = square_before(view, square, params.motion);
    if (params.valid != 0u && inside(before * int(GRADIENT_STRATUM), view.at[0].size)) {
        SceneBuffer scene = SceneBuffer(params.scene);
        float was = load(params.previous_luminance, before).r;
        Remembered at;
        if (was != NO_RAY && remembered(view, scene, params.previous, before, at)) {
            vec3 local;
            Path path = Path(params.hits, params.bounces, params.regularization);
            float now = luminance(sampled(view, scene, path, at.pixel, at.normal, at.start, (view.at[0].frame - 1u) * params.samples, local));
            if (is_finite(vec3(now - was))) change = vec3(now - was, (now - was) * (now - was), max(now, was));
        }
    }
    store(params.change, square, vec4(change, abs(change.x)));
    count_rays(params.rays, paths_traced.x, paths_traced.y);
}

#endif
