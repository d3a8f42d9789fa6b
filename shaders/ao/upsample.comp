#version 460
#extension GL_GOOGLE_include_directive : require
#include "lib/bindless.glsl"
#include "lib/upsample.glsl"
#include "shared/ao.glsl"
// Upsamples openness, and bent normals where there are any, from half to full resolution.
layout(local_size_x = 8, local_size_y = 8) in;
layout(push_constant, scalar) uniform Push { UpsampleParams params; };

void main() {
    ViewBuffer view = ViewBuffer(params.view);
    ivec2 pixel = ivec2(gl_GlobalInvocationID.xy);
    if (!inside(pixel, view.at[0].size)) return;
    Surface here = load_geometry(view, pixel, params.gbuffer);
    bool is_bent = params.bent_normal != NO_BENT_NORMAL;
    vec4 value = vec4(is_bent ? vec3(0.0) : vec3(1.0), 1.0);
    if (here.exists) value = joint_bilateral(view, pixel, here, params.gbuffer, params.half_size);
    store(params.openness, pixel, vec4(is_bent ? value.a : value.r));
    if (is_bent) store(params.bent_normal, pixel, vec4(octahedral_encode(value.rgb), 0.0, 0.0));
}
