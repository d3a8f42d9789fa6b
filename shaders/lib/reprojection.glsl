#ifndef LIB_REPROJECTION_GLSL
#define LIB_REPROJECTION_GLSL
#include "lib/gbuffer.glsl"
#include "lib/vector.glsl"
#include "shared/scene.glsl"
#include "shared/view.glsl"
// Where things were one frame ago, and whether what an image of that frame holds there belongs to them. Positions on the screen are uv
// without jitter, so that what stands still stays at its pixel, and a history there becomes the mean over the pixel.

// uv of a pixel's centre in an image of the frame's size.
vec2 uv_of(ViewBuffer view, ivec2 pixel) {
    return (vec2(pixel) + 0.5) / vec2(view.at[0].size);
}

// uv now minus uv one frame ago of what a pixel shows at reversed depth `depth`. `motion` is what the G-buffer says, which knows nothing
// of the background: that is infinitely far, and only the camera's turns move it. Far outside for what was behind the camera.
vec2 motion_of(ViewBuffer view, ivec2 pixel, float depth, vec2 motion) {
    if (depth > 0.0) return motion;
    vec4 direction = vec4(pixel_ray(view, pixel), 0.0);
    vec3 now = (view.at[0].steady_clip_from_world * direction).xyw;
    vec3 before = (view.at[0].previous_clip_from_world * direction).xyw;
    if (before.z <= 0.0) return vec2(2.0);
    return 0.5 * (now.xy / now.z - before.xy / before.z);
}

// uv one frame ago of what a pixel shows.
vec2 previous_uv(ViewBuffer view, ivec2 pixel, float depth, vec2 motion) {
    return uv_of(view, pixel) - motion_of(view, pixel, depth, motion);
}

// False outside the screen. False for a NaN too.
bool on_screen(vec2 uv) {
    return all(greaterThanEqual(uv, vec2(0.0))) && all(lessThan(uv, vec2(1.0)));
}

// World position, metres, of a pixel of the frame before at its reversed depth, above 0: where that frame saw a surface, its own jitter
// included. As world_position of lib/gbuffer.glsl.
vec3 previous_world_position(ViewBuffer view, ivec2 pixel, float depth) {
    mat4 m = view.at[0].previous_world_from_clip;
    precise vec2 ndc = uv_of(view, pixel) * 2.0 - 1.0;
    precise vec3 ray = m[0].xyz * ndc.x + m[1].xyz * ndc.y + m[3].xyz;
    precise vec3 position = view.at[0].previous_eye + ray / (depth * m[2].w);
    return position;
}

// Where a point of an instance was one frame ago, world, metres. Instances are taken as rigid: what bends within one is not followed.
vec3 position_before(Instance instance, vec3 position) {
    vec3 object = transform_point(instance.object_from_world, position);
    return transform_point(instance.previous_world_from_object, object);
}

// Reversed depth that a point had one frame ago; 0 for what was behind the camera.
float depth_before(ViewBuffer view, vec3 position_before) {
    vec4 clip = view.at[0].previous_clip_from_world * vec4(position_before, 1.0);
    return clip.w > 0.0 ? clip.z / clip.w : 0.0;
}

// Whether a point that the frame before saw lies on the plane of a surface, to within `pixels` widths of a pixel there. What lies on one
// plane is on it however the two frames were jittered, and however steeply they look at it.
bool on_plane(ViewBuffer view, vec3 point, vec3 normal, vec3 seen, float pixels) {
    float width = pixel_spread(view) * distance(seen, view.at[0].previous_eye);
    return abs(dot(normal, seen - point)) <= pixels * width;
}

#endif
