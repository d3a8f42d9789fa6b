#ifndef LIB_GRADIENT_GLSL
#define LIB_GRADIENT_GLSL
#include "lib/gradient_squares.glsl"
#include "lib/octahedral.glsl"
#include "lib/ray.glsl"
#include "shared/denoise.glsl"
// Temporal gradients: one pixel out of each square of GRADIENT_STRATUM stores its surface, and its rays are traced again in the next frame
// with the same random numbers, from where that surface is by then (Schied, Peters and Dachsbacher 2018, "Gradient Estimation for Real-Time
// Adaptive Temporal Filtering", section 3.1). If nothing has changed they give the same result, regardless of noise, jitter and camera
// motion.

// Stores what a pixel shows, if it is the one of its square that is stored in this frame, in two texels of two words: reversed depth and
// shading normal, instance + 1 and primitive. Zeros for the background. Returns whether it is.
bool remember(ViewBuffer view, ivec2 pixel, uint kept, GBufferImages gbuffer) {
    ivec2 square = pixel / int(GRADIENT_STRATUM);
    if (pixel != gradient_pixel(view, square, view.at[0].frame)) return false;
    uvec2 surface = uvec2(floatBitsToUint(load(gbuffer.depth, pixel).r), packSnorm2x16(load(gbuffer.normal, pixel).xy));
    store_uint(kept, ivec2(2 * square.x, square.y), surface.xyyy);
    store_uint(kept, ivec2(2 * square.x + 1, square.y), load_uint(gbuffer.ids, pixel).xyyy);
    return true;
}

// A point, a direction and a normal of an instance, moved from the previous frame to this one.
struct Carried {
    vec3 point;
    vec3 direction;
    vec3 normal;
};

Carried carry(Instance instance, Carried was) {
    if (instance.world_from_object == instance.previous_world_from_object) return was;
    mat3 rows = mat3(instance.previous_world_from_object[0].xyz, instance.previous_world_from_object[1].xyz, instance.previous_world_from_object[2].xyz);
    vec3 shift = vec3(instance.previous_world_from_object[0].w, instance.previous_world_from_object[1].w, instance.previous_world_from_object[2].w);
    mat3 object_from_world = inverse(transpose(rows));
    Carried now;
    now.point = transform_point(instance.world_from_object, object_from_world * (was.point - shift));
    now.direction = transform_vector(instance.world_from_object, object_from_world * was.direction);
    now.normal = safe_normalize(transform_normal(instance.object_from_world, rows * was.normal), was.normal);
    return now;
}

// A surface that the previous frame stored, where it is by now.
struct Remembered {
    ivec2 pixel;    // that showed it
    RayStart start;
    vec3 position;  // world, metres
    vec3 normal;    // shading normal
    vec3 to_eye;    // unit, from where the eye would be if it moved with the surface
    float width;    // of a pixel there, metres
};

// That of a square. False if there was none.
bool remembered(ViewBuffer view, SceneBuffer scene, uint kept, ivec2 square, out Remembered at) {
    at.pixel = gradient_pixel(view, square, view.at[0].frame - 1u);
    if (!inside(at.pixel, view.at[0].size)) return false;
    uvec2 seen = load_uint(kept, ivec2(2 * square.x, square.y)).xy;
    uvec2 ids = load_uint(kept, ivec2(2 * square.x + 1, square.y)).xy;
    float depth = uintBitsToFloat(seen.x);
    if (!(depth > 0.0) || ids.x - 1u >= scene.at[0].instance_count) return false;
    mat4 m = view.at[0].previous_world_from_clip;
    vec2 size = vec2(view.at[0].size);
    precise vec2 ndc = (vec2(at.pixel) + 0.5) / size * 2.0 - 1.0;
    precise vec3 along = m[0].xyz * ndc.x + m[1].xyz * ndc.y + m[3].xyz;
    precise vec3 offset = along / (depth * m[2].w);

    Instance instance = InstanceBuffer(scene.at[0].instances).at[ids.x - 1u];
    Carried now = carry(instance, Carried(view.at[0].previous_eye, along, octahedral_decode(unpackSnorm2x16(seen.y))));
    at.position = carry(instance, Carried(view.at[0].previous_eye + offset, along, vec3(0.0))).point;
    at.to_eye = -normalize(now.direction);
    at.normal = now.normal;
    at.start = seen_start(scene, ids, now.point, now.direction, at.position);
    at.width = 2.0 * length(m[1].xyz) / size.y * length(offset);
    return true;
}

#endif
