#version 460
#extension GL_GOOGLE_include_directive : require
#include "lib/bindless.glsl"
#include "lib/brdf.glsl"
#include "lib/gbuffer.glsl"
#include "lib/occlusion.glsl"
#include "lib/precision.glsl"
#include "lib/sky.glsl"
#include "shared/sky_light.glsl"
// Specular light of sky and ground without the sun's disc, which is a light source of its own.
layout(local_size_x = 8, local_size_y = 8) in;
layout(push_constant, scalar) uniform Push { SkyLightParams params; };

vec3 shade(ViewBuffer view, ivec2 pixel) {
    if (view.at[0].has_sky == 0u) return vec3(0.0);
    Surface s = load_receiver(view, pixel, params.gbuffer);
    if (!s.exists) return vec3(0.0);

    // A mirror reflects the sky itself, a fully rough lobe the cosine-weighted mean around its axis. In between the two are blended by
    // roughness, instead of a prefiltered sky: both ends are exact, the middle is partly too sharp and partly too smooth.
    vec3 axis = reflect(-s.to_eye, s.normal);
    Sky sky = view.at[0].sky;
    vec3 incident = mix(sky_radiance(sky, axis), sky_irradiance(sky, axis) / PI, s.roughness);

    // A normal map can turn the axis below the surface, which occludes it itself (Russell 2015, "Horizon Occlusion for Normal Mapped
    // Reflections").
    float horizon = clamp(1.0 + dot(axis, s.geometric_normal), 0.0, 1.0);

    float n_v = max(dot(s.normal, s.to_eye), 0.0);
    float reaches = s.occlusion;
    if (params.openness != NO_IMAGE) {
        reaches = min(reaches, specular_openness(load(params.openness, pixel).r, n_v, s.roughness * s.roughness));
    }
    return environment_brdf(s.fresnel, s.roughness, n_v) * incident * (horizon * horizon * reaches);
}

void main() {
    ViewBuffer view = ViewBuffer(params.view);
    ivec2 pixel = ivec2(gl_GlobalInvocationID.xy);
    if (!inside(pixel, view.at[0].size)) return;
    store(params.radiance, pixel, vec4(representable(shade(view, pixel), params.greatest), 1.0));
}
