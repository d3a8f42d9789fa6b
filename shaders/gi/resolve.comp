#version 460
#extension GL_GOOGLE_include_directive : require
#include "lib/bindless.glsl"
#include "lib/gbuffer.glsl"
#include "lib/precision.glsl"
#include "shared/gi.glsl"
// Denoised radiance times the albedo that it was divided by.
layout(local_size_x = 8, local_size_y = 8) in;
layout(push_constant, scalar) uniform Push { ResolveParams params; };

void main() {
    ViewBuffer view = ViewBuffer(params.view);
    ivec2 pixel = ivec2(gl_GlobalInvocationID.xy);
    if (!inside(pixel, view.at[0].size)) return;
    Surface s = load_surface(view, pixel, params.gbuffer);
    vec3 radiance = s.exists ? load(params.denoised, pixel).rgb * diffuse_albedo(s) : vec3(0.0);
    store(params.radiance, pixel, vec4(representable(radiance, params.greatest), 1.0));
}
