#ifndef LIB_REPROJECTION_GLSL
#define LIB_REPROJECTION_GLSL
#include "lib/gbuffer.glsl"
#include "lib/vector.glsl"
#include "shared/scene.glsl"
#include "shared/view.glsl"
// Where things were one frame ago, and whether what an image of that frame holds there belongs to them. Positions on the screen are uv
// without jitter, so that what stands still stays at its pixel, and a history there becomes the mean over the pixel.

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

// False outside the screen. False for a NaN too.
bool on_screen(vec2 uv) {
    return all(greaterThanEqual(uv, vec2(0.0))) && all(lessThan(uv, vec2(1.0)));
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

#endif
