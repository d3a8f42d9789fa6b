#version 460
#extension GL_GOOGLE_include_directive : require
#include "lib/bindless.glsl"
#include "lib/precision.glsl"
#include "lib/sky_lobe.glsl"
#include "lib/specular_albedo.glsl"
#include "shared/denoise.glsl"
#include "shared/screen_reflections.glsl"
// What was found on the screen, over what stands in for the rest of the lobe: mix(fallback, found, confidence), times the albedo of the lobe.
// `found` is multiplied with confidence already. Without confidence nothing of it is left, to the last bit.
layout(local_size_x = 8, local_size_y = 8) in;
layout(push_constant, scalar) uniform Push { BlendParams params; };

// What is reflected where the screen knows nothing.
vec3 fallback_reflected(ViewBuffer view, Surface s, float openness) {
    return sky_reflected(view, s, openness);
}

void main() {
    ViewBuffer view = ViewBuffer(params.view);
    ivec2 pixel = ivec2(gl_GlobalInvocationID.xy);
    if (!inside(pixel, view.at[0].size)) return;
    Surface s = load_receiver(view, pixel, params.gbuffer);
    vec3 radiance = vec3(0.0);
    if (s.exists) {
        float openness = params.openness == NO_IMAGE ? 1.0 : load(params.openness, pixel).r;
        radiance = fallback_reflected(view, s, openness);
    }
    if (params.found != NO_IMAGE) {
        float confidence = MOST_CONFIDENCE * load(params.found_confidence, pixel).r;
        // Noise of the two may leave less than nothing.
        radiance = non_negative(radiance * (1.0 - confidence) + load(params.found, pixel).rgb * specular_albedo(s));
        store(params.confidence, pixel, vec4(min(confidence, 1.0)));
    }
    store(params.radiance, pixel, vec4(representable(radiance, params.greatest), 1.0));
}
