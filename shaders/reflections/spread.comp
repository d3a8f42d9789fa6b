#version 460
#extension GL_GOOGLE_include_directive : require
#include "lib/bindless.glsl"
#include "lib/precision.glsl"
#include "lib/upsample.glsl"
#include "shared/screen_reflections.glsl"
// Four images of half resolution to full, along surfaces. The weights are found once for all of them. A pixel without a texel on its surface, and
// one that is too rough for a ray of its own, takes nothing: what others reflect is worse than the fallback.
layout(local_size_x = 8, local_size_y = 8) in;
layout(push_constant, scalar) uniform Push { SpreadParams params; };

void main() {
    ViewBuffer view = ViewBuffer(params.view);
    ivec2 pixel = ivec2(gl_GlobalInvocationID.xy);
    if (!inside(pixel, view.at[0].size)) return;
    Surface here = load_geometry(view, pixel, params.gbuffer);
    vec4 weights = vec4(0.0);
    if (here.exists && load(params.gbuffer.material, pixel).g < params.roughness_limit) {
        bool alike;
        weights = upsampling_weights(view, pixel, here, params.gbuffer, alike);
        if (!alike) weights = vec4(0.0);
    }
    for (int image = 0; image < 4; image++) {
        vec4 value = weighted_texels(params.half_size[image], pixel, weights);
        if (image == 0) value.rgb = representable(value.rgb, params.greatest);
        store(params.full_size[image], pixel, value);
    }
}
