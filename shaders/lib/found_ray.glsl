#ifndef LIB_FOUND_RAY_GLSL
#define LIB_FOUND_RAY_GLSL
#include "lib/gbuffer.glsl"
#include "lib/octahedral.glsl"
// What rays along a specular lobe found, packed for the pass that reconstructs the reflection from them, and how wide that lobe is.

// Distance of what is infinitely far, metres: the greatest number of 16-bit floats.
const float SKY_DISTANCE = 65504.0;

// A ray in four 16-bit floats. The pdf of a direction, per steradian, is above 0; its logarithm fits where it does not.
vec4 pack_ray(vec3 direction, float distance, float pdf) {
    return vec4(octahedral_encode(direction), distance, log2(pdf));
}

struct FoundRay {
    vec3 direction;   // unit
    float distance;   // metres
    float pdf;        // per steradian
};

FoundRay unpack_ray(vec4 packed) {
    return FoundRay(octahedral_decode(packed.xy), packed.z, exp2(packed.w));
}

// Width on the screen of what a lobe reflects at some distance, pixels: seen from the eye, the lobe's cone behind the surface is as wide
// as this.
float lobe_width(ViewBuffer view, float eye_distance, float alpha, float hit_distance) {
    float share = hit_distance / (hit_distance + eye_distance);
    return 2.0 * alpha * share / pixel_spread(view);
}

float lobe_width(ViewBuffer view, Surface s, float alpha, float hit_distance) {
    return lobe_width(view, distance(s.position, view.at[0].eye), alpha, hit_distance);
}

#endif
