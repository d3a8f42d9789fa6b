#ifndef LIB_SHADE_LIGHTS_GLSL
#define LIB_SHADE_LIGHTS_GLSL
#include "lib/bindless.glsl"
#include "lib/area_light.glsl"
#include "lib/gbuffer.glsl"
#include "lib/lobes.glsl"
#include "lib/precision.glsl"
#include "shared/direct.glsl"
// What the kernels of `direct.shade` have in common: the light of one light source at a pixel, and what comes as an image.

// A pixel that is lit.
struct Receiver {
    ivec2 pixel;
    Surface s;
    Bsdf b;
    mat3 around;  // its third column is the shading normal
    vec3 v;       // to the eye, in that frame
};

Receiver receiver_at(ViewBuffer view, ivec2 pixel, GBufferImages gbuffer) {
    Receiver r;
    r.pixel = pixel;
    r.s = load_surface(view, pixel, gbuffer);
    if (!r.s.exists) return r;
    r.b = bsdf_of(r.s);
    r.around = frame_of(r.s.normal);
    r.v = r.s.to_eye * r.around;
    r.v.z = eye_cosine(r.s);
    return r;
}

// Emission, and light that comes as an image.
vec3 emitted_and_sampled(ShadeParams params, Receiver r) {
    vec3 radiance = load(params.gbuffer.emission, r.pixel).rgb;
    if (params.sampled == NO_SAMPLED_LIGHT) return radiance;
    float apart = params.specular == NO_LOBE ? 0.0 : share_apart(r.s, params.limit);
    radiance += load(params.sampled, r.pixel).rgb * reflectance_together(r.b, r.v.z, apart);
    if (apart > 0.0) radiance += load(params.specular, r.pixel).rgb * apart * specular_reflectance(r.b, r.v.z);
    return radiance;
}

// Visibility of a light.
struct Seen {
    vec3 share;  // share of the light's points that is visible, per colour channel
    bool raw;    // unfiltered, see ShadowGroup::raw
};

// Visibility of a light in the shadow images; 1 for lights that cast no shadow.
Seen visibility(ShadeParams params, ViewBuffer view, uint light, ivec2 pixel) {
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

// Reflected radiance of one light.
vec3 reflected(ShadeParams params, ViewBuffer view, Receiver r, uint index, Light light, LightSample centre, Seen visible) {
    Surface s = r.s;
    vec3 seen = visible.share;
    vec3 l = centre.direction * r.around;
    uint points = params.flags >> AREA_SHIFT;
    float angle = points > 0u && has_size(light) ? half_angle(light, centre.distance) : 0.0;
    vec3 half_vector = safe_normalize(s.to_eye + centre.direction, s.normal);
    // Seen from the side a specular lobe is flattened, and so narrower.
    bool is_small = angle <= SMALL_LAMP;
    bool is_small_in_lobe = angle <= SMALL_IN_LOBE * narrowest_alpha(r.b) * dot(s.to_eye, half_vector);
    if (is_small && is_small_in_lobe) {
        return l.z > 0.0 ? bsdf_cosine(r.b, r.v, l, LOBE_DIFFUSE | LOBE_SPECULAR) * centre.irradiance * seen : vec3(0.0);
    }
    float above = share_above(light, centre, s.position, s.normal);
    if (above <= 0.0) return vec3(0.0);
    seen = share_of_those_above(visible, above);
    vec3 sum = vec3(0.0);
    if (!is_small) sum += diffuse_of_lamp(light, centre, s.position, r.b, r.around, r.v);
    else if (l.z > 0.0) sum += bsdf_cosine(r.b, r.v, l, LOBE_DIFFUSE) * centre.irradiance;
    if (!is_small_in_lobe) {
        uint first = view.at[0].frame * points;
        uint stream = SEQUENCE_DIRECT + 2u * index;
        sum += specular_of_lamp(light, s.position, r.b, r.around, r.v, r.pixel, first, points, stream, view.at[0].seed);
    } else if (l.z > 0.0) {
        sum += bsdf_cosine(r.b, r.v, l, LOBE_SPECULAR) * centre.irradiance;
    }
    return sum * seen;
}

// Of an unshadowed light, by the specular lobes alone.
vec3 reflected_by_lobe(ShadeParams params, ViewBuffer view, Receiver r, uint index, Light light, LightSample centre) {
    uint points = params.flags >> AREA_SHIFT;
    float angle = points > 0u && has_size(light) ? half_angle(light, centre.distance) : 0.0;
    vec3 half_vector = safe_normalize(r.s.to_eye + centre.direction, r.s.normal);
    if (angle > SMALL_IN_LOBE * narrowest_alpha(r.b) * dot(r.s.to_eye, half_vector)) {
        uint first = view.at[0].frame * points;
        uint stream = SEQUENCE_DIRECT + 2u * index;
        return specular_of_lamp(light, r.s.position, r.b, r.around, r.v, r.pixel, first, points, stream, view.at[0].seed);
    }
    vec3 l = centre.direction * r.around;
    return l.z > 0.0 ? bsdf_cosine(r.b, r.v, l, LOBE_SPECULAR) * centre.irradiance : vec3(0.0);
}

// Of a light times its visibility, by all lobes.
vec3 seen_light(ShadeParams params, ViewBuffer view, Receiver r, uint index, Light light) {
    LightSample centre = sample_light(light, r.s.position);
    // Out of range; in a scene with many lights, that is most of them.
    if (centre.irradiance == vec3(0.0)) return vec3(0.0);
    Seen seen = visibility(params, view, index, r.pixel);
    return seen.share != vec3(0.0) ? reflected(params, view, r, index, light, centre, seen) : vec3(0.0);
}

// Writes the radiance of a pixel.
void store_radiance(ShadeParams params, ivec2 pixel, vec3 radiance) {
    float greatest = (params.flags & RADIANCE_HALF) != 0u ? 65504.0 : 1.0 / 0.0;
    store(params.radiance, pixel, vec4(representable(radiance, greatest), 1.0));
}

#endif
