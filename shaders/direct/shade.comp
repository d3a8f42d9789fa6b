#version 460
#extension GL_GOOGLE_include_directive : require
#include "lib/bindless.glsl"
#include "lib/area_light.glsl"
#include "lib/gbuffer.glsl"
#include "lib/lobes.glsl"
#include "lib/precision.glsl"
#include "shared/direct.glsl"
// Radiance towards the viewer: light of every light source times its visibility, reflected once, plus that of emissive surfaces, plus
// emission.
layout(local_size_x = 8, local_size_y = 8) in;
layout(push_constant, scalar) uniform Push { ShadeParams params; };

// Visibility of a light.
struct Seen {
    vec3 share;  // share of the light's points that is visible, per colour channel
    bool raw;    // unfiltered, see ShadowGroup::raw
};

// Visibility of a light in the shadow images; 1 for lights that cast no shadow.
Seen visibility(ViewBuffer view, uint light, ivec2 pixel) {
    for (uint group = 0u; group < MAX_SHADOW_LIGHTS && params.visibility[group] != 0u; group++) {
        uint lights = params.shadow_lights[group >> 1u] >> (16u * (group & 1u));
        for (uint channel = 0u; channel < 4u; channel++) {
            uint index = (lights >> (4u * channel)) & 15u;
            if (index == NO_SHADOW_LIGHT || view.at[0].shadow_lights[index] != light) continue;
            vec4 seen = load(params.visibility[group], pixel);
            vec3 share = (params.flags & (1u << group)) != 0u ? seen.rgb : vec3(seen[channel]);
            return Seen(share, (params.flags & (256u << group)) != 0u);
        }
    }
    return Seen(vec3(1.0), false);
}

// The visible share of the points above the horizon, from that of all points. Filters may blur in more visibility than there is, hence the
// minimum. Single rays are not clamped: they average out over frames, and clamping would darken their mean.
vec3 share_of_those_above(Seen seen, float above) {
    vec3 share = seen.share / above;
    return seen.raw ? share : min(share, vec3(1.0));
}

// Reflected radiance of one light. Columns of `around`: the frame whose third axis is the shading normal; `v`: to the eye, in that frame.
vec3 reflected(
    ViewBuffer view, ivec2 pixel, uint index, Light light, LightSample centre, Surface s, Bsdf b, mat3 around, vec3 v, Seen visible
) {
    vec3 seen = visible.share;
    vec3 l = centre.direction * around;
    float angle = params.area > 0u && has_size(light) ? half_angle(light, centre.distance) : 0.0;
    vec3 half_vector = safe_normalize(s.to_eye + centre.direction, s.normal);
    // Seen from the side a specular lobe is flattened, and so narrower.
    bool is_small = angle <= SMALL_LAMP;
    bool is_small_in_lobe = angle <= SMALL_IN_LOBE * narrowest_alpha(b) * dot(s.to_eye, half_vector);
    if (is_small && is_small_in_lobe) {
        return l.z > 0.0 ? bsdf_cosine(b, v, l, LOBE_DIFFUSE | LOBE_SPECULAR) * centre.irradiance * seen : vec3(0.0);
    }
    float above = share_above(light, centre, s.position, s.normal);
    if (above <= 0.0) return vec3(0.0);
    seen = share_of_those_above(visible, above);
    vec3 sum = vec3(0.0);
    if (!is_small) sum += diffuse_of_lamp(light, centre, s.position, b, around, v);
    else if (l.z > 0.0) sum += bsdf_cosine(b, v, l, LOBE_DIFFUSE) * centre.irradiance;
    if (!is_small_in_lobe) {
        uint first = view.at[0].frame * params.area;
        uint stream = SEQUENCE_DIRECT + 2u * index;
        sum += specular_of_lamp(light, s.position, b, around, v, pixel, first, params.area, stream, view.at[0].seed);
    } else if (l.z > 0.0) {
        sum += bsdf_cosine(b, v, l, LOBE_SPECULAR) * centre.irradiance;
    }
    return sum * seen;
}

vec3 shade(ViewBuffer view, ivec2 pixel) {
    Surface s = load_surface(view, pixel, params.gbuffer);
    if (!s.exists) return vec3(0.0);
    SceneBuffer scene = SceneBuffer(params.scene);
    LightBuffer lights = LightBuffer(scene.at[0].lights);

    Bsdf b = bsdf_of(s);
    mat3 around = frame_of(s.normal);
    vec3 v = s.to_eye * around;
    v.z = eye_cosine(s);
    vec3 radiance = load(params.gbuffer.emission, pixel).rgb;
    if (params.sampled != NO_SAMPLED_LIGHT) {
        float apart = params.specular == NO_LOBE ? 0.0 : share_apart(s, params.limit);
        radiance += load(params.sampled, pixel).rgb * reflectance_together(b, v.z, apart);
        if (apart > 0.0) radiance += load(params.specular, pixel).rgb * apart * specular_reflectance(b, v.z);
    }
    uint lit = params.flags & LIGHTS_MASK;
    uint count = lit == LIGHTS_NONE ? 0u : scene.at[0].light_count;
    for (uint i = 0u; i < count; i++) {
        if (lit == LIGHTS_DIRECTIONAL && lights.at[i].kind != LIGHT_DIRECTIONAL) continue;
        Light light = lights.at[i];
        LightSample centre = sample_light(light, s.position);
        // Out of range; in a scene with many lights, that is most of them.
        if (centre.irradiance == vec3(0.0)) continue;
        Seen seen = visibility(view, i, pixel);
        if (seen.share != vec3(0.0)) radiance += reflected(view, pixel, i, light, centre, s, b, around, v, seen);
    }
    return radiance;
}

void main() {
    ViewBuffer view = ViewBuffer(params.view);
    ivec2 pixel = ivec2(gl_GlobalInvocationID.xy);
    if (!inside(pixel, view.at[0].size)) return;
    store(params.radiance, pixel, vec4(representable(shade(view, pixel), params.greatest), 1.0));
}
