#ifndef LIB_LOBES_GLSL
#define LIB_LOBES_GLSL
#include "lib/found_ray.glsl"
#include "lib/gbuffer.glsl"
#include "lib/precision.glsl"
#include "shared/denoise.glsl"
#include "shared/direct.glsl"
// Light that a surface reflects once, written for denoisers: of all lobes together, or of the specular ones apart.

struct Lobes {
    vec3 diffuse;   // of all lobes where they are not apart
    vec3 specular;
};

const Lobes DARK = Lobes(vec3(0.0), vec3(0.0));

Lobes scaled(Lobes light, vec3 factor) {
    return Lobes(light.diffuse * factor, light.specular * factor);
}

Lobes plus(Lobes a, Lobes b) {
    return Lobes(a.diffuse + b.diffuse, a.specular + b.specular);
}

bool is_split(LobeImages images) {
    return images.specular != NO_LOBE;
}

// BSDF times |n·l| of the lobes.
Lobes lobes_cosine(LobeImages images, Bsdf b, vec3 v, vec3 l) {
    if (!is_split(images)) return Lobes(bsdf_cosine(b, v, l, LOBE_DIFFUSE | LOBE_SPECULAR), vec3(0.0));
    return Lobes(bsdf_cosine(b, v, l, LOBE_DIFFUSE), bsdf_cosine(b, v, l, LOBE_SPECULAR));
}

// Writes light of a surface over its albedo; all of it 0 where there is no surface. `distance`: to what the specular lobes reflect, metres.
void store_lobes(ViewBuffer view, LobeImages images, ivec2 pixel, Surface s, Bsdf b, Lobes light, float distance) {
    float n_v = s.exists ? eye_cosine(s) : 1.0;
    if (!is_split(images)) {
        if (light.diffuse != vec3(0.0)) light.diffuse /= reflectance(b, n_v);
        store(images.radiance, pixel, vec4(representable(light.diffuse, images.greatest), 1.0));
        return;
    }
    if (light.diffuse != vec3(0.0)) light.diffuse /= diffuse_reflectance(b, n_v);
    if (light.specular != vec3(0.0)) light.specular /= specular_reflectance(b, n_v);
    float width = 0.0;
    if (s.exists && reflects(s)) width = lobe_width(view, s, strongest_alpha(b, vec3(0.0, 0.0, n_v)), distance);
    store(images.radiance, pixel, vec4(representable(light.diffuse, images.greatest), 1.0));
    store(images.specular, pixel, vec4(representable(light.specular, images.greatest), 1.0));
    store(images.hit_distance, pixel, vec4(min(distance, SKY_DISTANCE)));
    store(images.width, pixel, vec4(min(width / WIDEST_NOISE, 1.0)));
}

#endif
