#ifndef LIB_SPECULAR_ALBEDO_GLSL
#define LIB_SPECULAR_ALBEDO_GLSL
#include "lib/gbuffer.glsl"

// Albedo of a surface's specular lobe, above 0. Reflected radiance is divided by it before denoising and multiplied afterwards.
vec3 specular_albedo(Surface s) {
    return specular_reflectance(bsdf_of(s), eye_cosine(s));
}

#endif
