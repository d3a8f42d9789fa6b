#ifndef LIB_VIRTUAL_IMAGE_GLSL
#define LIB_VIRTUAL_IMAGE_GLSL
#include "lib/gbuffer.glsl"
#include "lib/guide.glsl"
#include "lib/octahedral.glsl"
// Where a mirror shows things: the virtual image that a plane or a curved mirror makes of them, and how it moves on the screen.

// Curvature of the shading normals around a pixel, 1 over metres, positive where the surface bulges towards the viewer: the mean of what
// neighbours left and right and above and below tell. Pixels of other surfaces are left out.
float curvature_at(ViewBuffer view, ivec2 pixel, Guide here, uint guide, uint normals) {
    vec2 sum = vec2(0.0);
    for (int axis = 0; axis < 2; axis++) {
        ivec2 offset = axis == 0 ? ivec2(1, 0) : ivec2(0, 1);
        ivec2 first = pixel - offset, last = pixel + offset;
        if (!inside(first, view.at[0].size) || !inside(last, view.at[0].size)) continue;
        Guide a = load_guide(guide, first), b = load_guide(guide, last);
        if (!is_surface(a) || !is_surface(b) || a.instance != here.instance || b.instance != here.instance) continue;
        vec3 along = pixel_ray(view, last) * b.depth - pixel_ray(view, first) * a.depth;
        vec3 turned = octahedral_decode(load(normals, last).xy) - octahedral_decode(load(normals, first).xy);
        float square = dot(along, along);
        if (square > 0.0) sum += vec2(dot(turned, along) / square, 1.0);
    }
    return sum.y > 0.0 ? sum.x / sum.y : 0.0;
}

// Distance behind the surface at which a mirror of this curvature shows what is `distance` away, metres: 1/image = 1/distance + 2 curvature /
// cosine, the mirror equation. Negative where a hollow mirror has no image behind it.
float image_distance(float distance, float curvature, float cosine) {
    float factor = 1.0 + 2.0 * curvature * distance / max(cosine, 0.1);
    return factor > 0.0 ? distance / factor : -1.0;
}

// Position in the previous frame of what a pixel shows `distance` behind its surface, pixels; the thing and the mirror stand still. Far off
// the screen for what was behind the camera.
vec2 image_before(ViewBuffer view, ivec2 pixel, Guide here, float distance) {
    vec3 ray = pixel_ray(view, pixel);
    vec4 point = vec4(view.at[0].eye + ray * (here.depth + distance / length(ray)), 1.0);
    vec3 now = (view.at[0].steady_clip_from_world * point).xyw;
    vec3 before = (view.at[0].previous_clip_from_world * point).xyw;
    if (now.z <= 0.0 || before.z <= 0.0) return vec2(-1e6);
    return vec2(pixel) - 0.5 * (now.xy / now.z - before.xy / before.z) * vec2(view.at[0].size);
}

#endif
