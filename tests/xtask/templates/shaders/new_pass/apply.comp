#version 460
#extension GL_GOOGLE_include_directive : require
#include "lib/bindless.glsl"
#include "lib/gbuffer.glsl"
#include "shared/new_pass.glsl"
// Exposure and natural vignetting: light falls with cos^4 of the angle from the optical axis (Kolb et al. 1995).
layout(local_size_x = 8, local_size_y = 8) in;
layout(push_constant, scalar) uniform Push { ApplyParams params; };

void main() {
    ivec2 pixel = ivec2(gl_GlobalInvocationID.xy);
    ViewBuffer view = ViewBuffer(params.view);
    if (!inside(pixel, view.at[0].size)) return;
    // The ray through the centre of the picture.
    vec3 axis = normalize(view.at[0].world_from_clip[3].xyz);
    float cosine = dot(normalize(pixel_ray(view, pixel)), axis);
    float cos2 = cosine * cosine;
    float light = params.exposure * mix(1.0, cos2 * cos2, params.falloff);
    vec4 radiance = load(params.source, pixel);
    store(params.target, pixel, vec4(radiance.rgb * light, radiance.a));
}
