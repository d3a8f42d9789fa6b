#ifndef LIB_SLICE_GLSL
#define LIB_SLICE_GLSL
#include "lib/bindless.glsl"
#include "lib/gbuffer.glsl"
// Slices of the hemisphere above a surface, planes through the view direction, in which the depth image is searched: Jimenez, Wu, Pesce and
// Jarabo 2016, "Practical Real-Time Strategies for Accurate Indirect Occlusion". Angles in a slice are counted from the direction to the viewer.

// A slice: `across` is perpendicular to the direction to the viewer and lies in the slice; `pixel_step` is its direction on the screen, one
// pixel long.
struct Slice {
    vec3 across;
    vec2 pixel_step;
    // Angles of the shading and the geometric normal after projection into the slice, and the lengths of the projections.
    float shading;
    float shading_length;
    float geometric;
    float geometric_length;
};

// The point that a pixel shows, relative to the eye: precise far from the origin, unlike `world_position`.
vec3 from_eye(ViewBuffer view, ivec2 pixel, float depth) {
    return pixel_ray(view, pixel) / (depth * view.at[0].world_from_clip[2].w);
}

// Direction on the screen, in pixels and of unit length, in which a point that `ray` shows moves along `direction`.
vec2 on_screen(ViewBuffer view, vec3 ray, vec3 direction) {
    mat4 m = view.at[0].world_from_clip;
    vec3 forward = cross(m[0].xyz, m[1].xyz);
    vec3 flat_part = direction - ray * (dot(direction, forward) / dot(ray, forward));
    vec2 ndc = vec2(dot(flat_part, m[0].xyz) / dot(m[0].xyz, m[0].xyz), dot(flat_part, m[1].xyz) / dot(m[1].xyz, m[1].xyz));
    return normalize(ndc * vec2(view.at[0].size));
}

Slice slice_of(ViewBuffer view, Surface s, vec3 ray, vec3 across) {
    vec3 axis = cross(s.to_eye, across);
    vec3 shading = s.normal - axis * dot(s.normal, axis);
    vec3 geometric = s.geometric_normal - axis * dot(s.geometric_normal, axis);
    Slice slice;
    slice.across = across;
    slice.pixel_step = on_screen(view, ray, across);
    slice.shading = atan(dot(shading, across), dot(shading, s.to_eye));
    slice.shading_length = length(shading);
    // Both normals face the viewer; edge on, the angle is pi/2 to either side.
    slice.geometric = atan(dot(geometric, across), max(dot(geometric, s.to_eye), 1e-6));
    slice.geometric_length = length(geometric);
    return slice;
}

// Cosine-weighted integral from the direction to the viewer to a horizon at angle `h`, for a normal at angle `n`.
float open_arc(float h, float n) {
    return 0.25 * (cos(n) - cos(2.0 * h - n) + 2.0 * h * sin(n));
}

// The same integral of the direction itself: its parts towards the viewer and across.
vec2 open_direction(float h, float n) {
    float to_eye = 4.0 * cos(n) - cos(3.0 * h - n) - 3.0 * cos(h + n);
    float across = 6.0 * sin(h - n) - sin(3.0 * h - n) - 3.0 * sin(h + n) + 8.0 * sin(n);
    return vec2(to_eye, across) / 12.0;
}

#endif
