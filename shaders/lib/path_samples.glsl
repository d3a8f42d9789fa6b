#ifndef LIB_PATH_SAMPLES_GLSL
#define LIB_PATH_SAMPLES_GLSL
#define KEEPS_FIRST
#include "lib/follow_path.glsl"
#include "lib/gbuffer.glsl"
#include "lib/not_finite.glsl"
#include "lib/path_reservoirs.glsl"
#include "lib/ray_count.glsl"
#include "lib/sequence.glsl"
// Paths whose first points are samples.

Path path_of(HitShadingParams hits, uint modes, float regularization) {
    return Path(hits, modes >> PATH_BOUNCES, regularization);
}

// Density of directions by which samples are drawn, per steradian.
float source_pdf(uint modes, float cosine) {
    return (modes & PATH_UNIFORM) != 0u ? 1.0 / (2.0 * PI) : cosine / PI;
}

// Follows a path from a surface. The same key gives the same path.
PathSample traced(ViewBuffer view, SceneBuffer scene, Path path, Receiver from, vec3 direction, float pdf, uint key) {
    Random random = random_of(key, 0u, view.at[0].seed ^ SALT_PATH);
    float distance;
    PathSample s;
    s.radiance = follow(view, scene, path, surface_ray(from.start, direction, UNBOUNDED), pdf, random, distance);
    s.is_sky = !first_met.exists;
    s.place = s.is_sky ? direction : first_met.position;
    s.normal = s.is_sky ? -direction : first_met.normal;
    s.is_glossy = !s.is_sky && first_met.is_glossy;
    return s;
}

// The sample of a pixel in this frame.
PathReservoir drawn(ViewBuffer view, PathSampleParams params, ivec2 pixel, Receiver receiver) {
    PathReservoir r = NO_PATH;
    r.confidence = pack_confidence(1u, 0u);
    vec2 u = sequence2(pixel, view.at[0].frame, SEQUENCE_GI, view.at[0].seed);
    vec3 local = sample_cosine(u);
    if ((params.modes & PATH_UNIFORM) != 0u) {
        local = sample_sphere(u);
        local.z = abs(local.z);
    }
    vec3 direction = frame_of(receiver.normal) * local;
    // The surface itself hides what lies below its plane.
    if (local.z <= 0.0 || dot(direction, receiver.start.normal) <= 0.0) return r;
    float pdf = source_pdf(params.modes, local.z);
    uvec4 words = hash4(uvec4(uvec2(pixel), view.at[0].frame, view.at[0].seed ^ SALT_PATH));
    Path path = path_of(params.hits, params.modes, params.regularization);
    PathSample s = traced(view, SceneBuffer(params.scene), path, receiver, direction, pdf, words.x >> 8u);
    if (!is_taken(params.not_finite, s.radiance)) return r;
    put_sample(r, s, view.at[0].eye);
    r.weight = 1.0 / pdf;
    // Some wait less for their first turn to be traced again, so that turns do not come all at once.
    r.path = (words.x & ~255u) | (params.validate * (words.y >> 16u) >> 16u);
    return r;
}

void draw_samples(PathSampleParams params) {
    ViewBuffer view = ViewBuffer(params.view);
    ivec2 cell = ivec2(RAY_INVOCATION.xy);
    if (!inside(cell, grid_size(view, params.modes))) return;
    uint index = grid_index(view, params.modes, cell);
    ivec2 pixel = cell * grid_step(params.modes);
    Surface s = load_surface(view, pixel, params.gbuffer);
    PathReceiver receiver = NO_RECEIVER;
    PathReservoir r = NO_PATH;
    if (scatters(s)) {
        vec3 eye = view.at[0].eye;
        RayStart start = seen_start(SceneBuffer(params.scene), load_uint(params.gbuffer.ids, pixel).xy, eye, pixel_ray(view, pixel), s.position);
        receiver = pack_receiver(start, s.normal, eye);
        r = drawn(view, params, pixel, unpack_receiver(receiver, eye));
    }
    PathReceiverBufferWrite(params.receivers).at[index] = receiver;
    PathReservoirBufferWrite(params.samples).at[index] = r;
    count_rays(params.rays, paths_traced.x, paths_traced.y);
}

#endif
