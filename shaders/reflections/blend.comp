#version 460
#extension GL_GOOGLE_include_directive : require
#include "lib/bindless.glsl"
#include "lib/precision.glsl"
#include "lib/sky_lobe.glsl"
#include "shared/denoise.glsl"
#include "shared/screen_reflections.glsl"
// What was found on the screen, over what stands in for the rest of the lobe: mix(fallback, found, confidence), times the albedo of the lobe.
// `found` is multiplied with confidence already. Without confidence nothing of it is left, to the last bit.
layout(local_size_x = 8, local_size_y = 8) in;
layout(push_constant, scalar) uniform Push { BlendParams params; };

// Mean radiance over a lobe where the screen knows nothing.
vec3 fallback_in_lobe(ViewBuffer view, Surface s, float openness) {
    return sky_in_lobe(view, s, openness);
}

void main() {
    ViewBuffer view = ViewBuffer(params.view);
    ivec2 pixel = ivec2(gl_GlobalInvocationID.xy);
    if (!inside(pixel, view.at[0].size)) return;
    Surface s = load_receiver(view, pixel, params.gbuffer);
    vec3 incident = vec3(0.0);
    float confidence = 0.0;
    if (s.exists) {
        float openness = params.openness == NO_IMAGE ? 1.0 : load(params.openness, pixel).r;
        incident = fallback_in_lobe(view, s, openness);
    }
    if (params.found != NO_IMAGE) {
        confidence = MOST_CONFIDENCE * load(params.found_confidence, pixel).r;
        // Noise of the two may leave less than nothing.
        incident = non_negative(incident * (1.0 - confidence) + load(params.found, pixel).rgb);
        store(params.confidence, pixel, vec4(min(confidence, 1.0)));
    }
    vec3 radiance = incident * environment_brdf(s.fresnel, s.roughness, max(dot(s.normal, s.to_eye), 0.0));
    store(params.radiance, pixel, vec4(representable(radiance, params.greatest), 1.0));
}
