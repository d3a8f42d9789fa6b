#version 460
#extension GL_GOOGLE_include_directive : require
#include "lib/bindless.glsl"
#include "lib/gbuffer.glsl"
#include "lib/lights.glsl"
#include "lib/ray.glsl"
#include "shared/shadows.glsl"
// One hard shadow ray per pixel towards the key light.
layout(local_size_x = 8, local_size_y = 8) in;
layout(push_constant, scalar) uniform Push { TraceParams params; };

// The ray ends this much of its length before a local light, so that a lamp's own surface does not hide it.
const float LIGHT_MARGIN = 1e-3;

// Rounding of the depth buffer and of its interpolation over long triangles moves the surface by some 1e-6 to 1e-5 of the
// distance to the eye. The origin is lifted by twice that: a fiftieth of a pixel.
const float DEPTH_ROUNDING = 2e-5;

// 1 where the key light reaches the surface. What it cannot light anyway, background and far sides, is 0 without a ray.
float visibility(ViewBuffer view, ivec2 pixel) {
    if (view.at[0].key_light == NO_LIGHT) return 0.0;
    Surface surface = load_geometry(view, pixel, params.depth, params.normal);
    if (!surface.exists) return 0.0;

    SceneBuffer scene = SceneBuffer(view.at[0].scene);
    Light light = LightBuffer(scene.at[0].lights).at[view.at[0].key_light];
    LightSample towards = sample_light(light, surface.position);
    if (dot(surface.normal, towards.direction) <= 0.0) return 0.0;
    if (dot(surface.geometric_normal, towards.direction) <= 0.0) return 0.0;
    if (towards.irradiance == vec3(0.0)) return 0.0;

    // From the moved origin a local light lies elsewhere.
    float lift = DEPTH_ROUNDING * distance(surface.position, view.at[0].eye);
    vec3 origin = offset_origin(surface.position + lift * surface.geometric_normal, surface.geometric_normal);
    float t_max = INFINITELY_FAR;
    if (light.kind != LIGHT_DIRECTIONAL) {
        towards = sample_light(light, origin);
        t_max = towards.distance * (1.0 - LIGHT_MARGIN);
    }
    return trace_any(scene.at[0], Ray(origin, 0.0, towards.direction, t_max)) ? 0.0 : 1.0;
}

void main() {
    ViewBuffer view = ViewBuffer(params.view);
    ivec2 pixel = ivec2(gl_GlobalInvocationID.xy);
    if (!inside(pixel, view.at[0].size)) return;
    store(params.visibility, pixel, vec4(visibility(view, pixel)));
}
