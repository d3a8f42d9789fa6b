#version 460
#extension GL_GOOGLE_include_directive : require
#include "lib/bindless.glsl"
#include "lib/upsample.glsl"
#include "shared/shadows.glsl"
// Upsamples visibility from half to full resolution.
layout(local_size_x = 8, local_size_y = 8) in;
layout(push_constant, scalar) uniform Push { UpsampleParams params; };

void main() {
    ViewBuffer view = ViewBuffer(params.view);
    ivec2 pixel = ivec2(gl_GlobalInvocationID.xy);
    if (!inside(pixel, view.at[0].size)) return;
    Surface here = load_geometry(view, pixel, params.gbuffer);
    vec4 visibility = vec4(0.0);
    if (here.exists) visibility = joint_bilateral(view, pixel, here, params.gbuffer, params.half_visibility);
    store(params.visibility, pixel, visibility);
}
