#version 460
#extension GL_GOOGLE_include_directive : require
#include "lib/bindless.glsl"
#include "lib/random.glsl"
#include "shared/resampling.glsl"
#include "shared/view.glsl"
// What reservoirs hold, as images.
layout(local_size_x = 8, local_size_y = 8) in;
layout(push_constant, scalar) uniform Push { ShowReservoirsParams params; };

void main() {
    ViewBuffer view = ViewBuffer(params.view);
    ivec2 pixel = ivec2(gl_GlobalInvocationID.xy);
    if (!inside(pixel, view.at[0].size)) return;
    Reservoir r = ReservoirBuffer(params.reservoirs).at[uint(pixel.y) * view.at[0].size.x + uint(pixel.x)];
    vec3 colour = r.light == NO_SAMPLE ? vec3(0.0) : unit_floats(hash4(uvec4(r.light, 0u, 0u, 0u))).rgb;
    store(params.light, pixel, vec4(colour, 1.0));
    store(params.weight, pixel, vec4(r.weight));
    store(params.confidence, pixel, vec4(float(r.confidence & 65535u)));
    store(params.age, pixel, vec4(float(r.confidence >> 16u)));
}
