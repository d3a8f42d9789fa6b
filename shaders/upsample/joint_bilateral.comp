#version 460
#extension GL_GOOGLE_include_directive : require
#include "lib/bindless.glsl"
#include "lib/upsample.glsl"
#include "shared/upsample.glsl"
// Upsamples values, and directions beside them, from half to full resolution.
layout(local_size_x = 8, local_size_y = 8) in;
layout(push_constant, scalar) uniform Push { UpsampleParams params; };

void main() {
    ViewBuffer view = ViewBuffer(params.view);
    ivec2 pixel = ivec2(gl_GlobalInvocationID.xy);
    if (!inside(pixel, view.at[0].size)) return;
    Surface here = load_geometry(view, pixel, params.gbuffer);
    bool has_direction = params.direction != NO_DIRECTION;
    vec4 value = has_direction ? vec4(vec3(0.0), params.background) : vec4(params.background);
    if (here.exists) value = joint_bilateral(view, pixel, here, params.gbuffer, params.half_size);
    store(params.value, pixel, has_direction ? vec4(value.a) : value);
    if (has_direction) store(params.direction, pixel, vec4(octahedral_encode(value.rgb), 0.0, 0.0));
}
