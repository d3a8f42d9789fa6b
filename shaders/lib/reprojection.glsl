#ifndef LIB_REPROJECTION_GLSL
#define LIB_REPROJECTION_GLSL
#include "lib/gbuffer.glsl"
#include "lib/vector.glsl"
#include "shared/scene.glsl"
#include "shared/view.glsl"
// Backward reprojection, and checks that the history belongs to the same surface. Screen positions are uv without jitter, so that static
// points stay at their pixel and their history converges to the mean over the pixel.

// Motion vector (uv now minus uv one frame ago) of a pixel at reversed depth `depth`. `motion` is the G-buffer's, which is 0 for the
// background: that is infinitely far and moves by the camera's rotation only. Far off the screen for what was behind the camera.
vec2 motion_of(ViewBuffer view, ivec2 pixel, float depth, vec2 motion) {
    if (depth > 0.0) return motion;
    vec4 direction = vec4(pixel_ray(view, pixel), 0.0);
    vec3 now = (view.at[0].steady_clip_from_world * direction).xyw;
    vec3 before = (view.at[0].previous_clip_from_world * direction).xyw;
    if (before.z <= 0.0) return vec2(2.0);
    return 0.5 * (now.xy / now.z - before.xy / before.z);
}

// False outside the screen, and for NaN.
bool on_screen(vec2 uv) {
    return all(greaterThanEqual(uv, vec2(0.0))) && all(lessThan(uv, vec2(1.0)));
}

// Position of an instance's point one frame ago, world, metres. Instances are treated as rigid; deformation is ignored.
vec3 position_before(Instance instance, vec3 position) {
    vec3 object = transform_point(instance.object_from_world, position);
    return transform_point(instance.previous_world_from_object, object);
}

// Reversed depth of a point one frame ago; 0 if it was behind the camera.
float depth_before(ViewBuffer view, vec3 position_before) {
    vec4 clip = view.at[0].previous_clip_from_world * vec4(position_before, 1.0);
    return clip.w > 0.0 ? clip.z / clip.w : 0.0;
}

#endif
