#ifndef LIB_PREVIOUS_LIGHT_GLSL
#define LIB_PREVIOUS_LIGHT_GLSL
#include "lib/guide.glsl"
#include "lib/reprojection.glsl"
// Where the previous frame showed a point of an instance, and whether its pixels there show that surface.

// The previous frame's pixel must show the point itself: as in reproject.comp.
const float LEAST_COSINE = 0.9;
const float DEPTH_SLACK = 0.01;

// Surfaces smoother than this alpha reflect too differently to the camera and to another viewer.
const float LEAST_REUSED_ALPHA = 0.25;

// A point one frame ago.
struct PlaceBefore {
    vec3 position;  // world, metres
    vec2 pixels;    // on the screen, so that its whole part is the pixel whose sample lay next to it
    float depth;    // along the view, metres
};

// False if the camera did not look there.
bool place_before(ViewBuffer view, SceneBuffer scene, uint instance, vec3 position, out PlaceBefore before) {
    before.position = position_before(InstanceBuffer(scene.at[0].instances).at[instance], position);
    vec4 clip = view.at[0].previous_clip_from_world * vec4(before.position, 1.0);
    before.depth = clip.w;
    if (!(clip.w > 0.0)) return false;
    vec2 uv = clip.xy / clip.w * 0.5 + 0.5;
    before.pixels = uv * vec2(view.at[0].size) - view.at[0].previous_jitter;
    return on_screen(uv);
}

// Whether a pixel of the previous frame showed a surface: the instance (of 256), a geometric normal within 26 degrees of `plane`, and the
// depth along its own plane.
bool showed(ViewBuffer view, uint previous_guide, ivec2 pixel, uint instance, vec3 plane, float depth) {
    if (!inside(pixel, view.at[0].size)) return false;
    Guide there = load_guide(previous_guide, pixel);
    if (!is_surface(there) || there.instance != ((instance + 1u) & 0xffu) || dot(there.plane, plane) < LEAST_COSINE) return false;
    vec2 gradient = depth_gradient(view, pixel, there);
    return abs(there.depth - depth) <= abs(gradient.x) + abs(gradient.y) + DEPTH_SLACK * depth;
}

#endif
