#ifndef LIB_LOBES_GLSL
#define LIB_LOBES_GLSL
#include "lib/found_ray.glsl"
#include "lib/gbuffer.glsl"
#include "lib/precision.glsl"
#include "lib/roughness_limit.glsl"
#include "shared/denoise.glsl"
#include "shared/direct.glsl"
// Light that a surface reflects once, written for denoisers: of all lobes together, or that of the specular ones of smooth surfaces apart.

struct Lobes {
    vec3 diffuse;   // with that of the specular lobes which is not apart
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

// Share of a surface's specular light that is apart, 0 to 1.
float share_apart(Surface s, float limit) {
    return reflects(s) ? below_roughness(least_roughness(s), limit) : 0.0;
}

float share_apart(LobeImages images, Surface s) {
    return is_split(images) ? share_apart(s, images.limit) : 0.0;
}

// Albedo of the light that is not apart.
vec3 reflectance_together(Bsdf b, float n_v, float apart) {
    if (apart == 0.0) return reflectance(b, n_v);
    return diffuse_reflectance(b, n_v) + (1.0 - apart) * specular_reflectance(b, n_v);
}

// BSDF times |n·l| of the lobes. `apart`: share of the specular ones.
Lobes lobes_cosine(float apart, Bsdf b, vec3 v, vec3 l) {
    vec3 specular = bsdf_cosine(b, v, l, LOBE_SPECULAR);
    return Lobes(bsdf_cosine(b, v, l, LOBE_DIFFUSE) + (1.0 - apart) * specular, apart * specular);
}

// What a denoiser is told of the surface at a pixel.
struct Reflecting {
    Bsdf bsdf;
    float n_v;           // cosine between the normal and the direction to the eye
    float eye_distance;  // metres
    float apart;         // share of the specular light that is apart
};

// Writes light of a surface over its albedo; all of it 0 where there is none. `distance`: to what the specular lobes reflect, metres.
void store_lobes(ViewBuffer view, LobeImages images, ivec2 pixel, Reflecting s, Lobes light, float distance) {
    if (light.diffuse != vec3(0.0)) light.diffuse /= reflectance_together(s.bsdf, s.n_v, s.apart);
    store(images.radiance, pixel, vec4(representable(light.diffuse, images.greatest), 1.0));
    if (!is_split(images)) return;
    if (light.specular != vec3(0.0)) light.specular /= s.apart * specular_reflectance(s.bsdf, s.n_v);
    // Without width, blurs of neighbours leave the pixel out, which has no specular light to give.
    float width = 0.0;
    if (s.apart > 0.0) width = lobe_width(view, s.eye_distance, strongest_alpha(s.bsdf, vec3(0.0, 0.0, s.n_v)), distance);
    store(images.specular, pixel, vec4(representable(light.specular, images.greatest), 1.0));
    store(images.hit_distance, pixel, vec4(min(distance, SKY_DISTANCE)));
    store(images.width, pixel, vec4(min(width / WIDEST_NOISE, 1.0)));
}

#endif
