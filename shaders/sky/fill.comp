#version 460
#extension GL_GOOGLE_include_directive : require
#include "lib/bindless.glsl"
#include "lib/gbuffer.glsl"
#include "lib/precision.glsl"
#include "lib/sky.glsl"
#include "shared/sky.glsl"
// Draws the sky into background pixels, in place. Without a sky the background is black.
layout(local_size_x = 8, local_size_y = 8) in;
layout(push_constant, scalar) uniform Push { FillParams params; };

void main() {
    ViewBuffer view = ViewBuffer(params.view);
    ivec2 pixel = ivec2(gl_GlobalInvocationID.xy);
    if (!inside(pixel, view.at[0].size)) return;
    if (load(params.depth, pixel).r > 0.0) return;
    vec3 radiance = vec3(0.0);
    if (view.at[0].has_sky != 0u) {
        radiance = sky_radiance_with_sun(view.at[0].sky, normalize(pixel_ray(view, pixel)));
    }
    store(params.lit, pixel, vec4(representable(radiance, params.greatest), 1.0));
}
