#ifndef LIB_SAMPLING_GLSL
#define LIB_SAMPLING_GLSL
#include "lib/vector.glsl"
// Points and directions from uniform numbers in 0..1, with their pdf. Directions are around +z unless said otherwise.

// Orthonormal right-handed frame around a unit `n` (Duff et al. 2017, "Building an Orthonormal Basis, Revisited",
// JCGT 6(1)). Columns: tangent, bitangent, n.
mat3 frame_of(vec3 n) {
    float s = n.z < 0.0 ? -1.0 : 1.0;
    float a = -1.0 / (s + n.z);
    float b = n.x * n.y * a;
    return mat3(vec3(1.0 + s * n.x * n.x * a, s * b, -s * n.x), vec3(b, s + n.y * n.y * a, -n.y), n);
}

vec3 around_z(float angle, float sine, float cosine) {
    return vec3(sine * cos(angle), sine * sin(angle), cosine);
}

// Cosine-weighted; pdf cos / pi per steradian.
vec3 sample_cosine(vec2 u) {
    return around_z(2.0 * PI * u.x, sqrt(u.y), sqrt(1.0 - u.y));
}

// 1 - cos of an angle, precise for small ones.
float one_minus_cos(float angle) {
    float s = sin(0.5 * angle);
    return 2.0 * s * s;
}

// The same from the square of its sine; for angles up to pi/2.
float one_minus_cos_of(float sine_square) {
    return sine_square / (1.0 + sqrt(max(1.0 - sine_square, 0.0)));
}

// Uniform over a cone whose half angle has this 1 - cos; pdf 1 / (2 pi (1 - cos)).
vec3 sample_cone(vec2 u, float width) {
    float below = u.y * width;
    return around_z(2.0 * PI * u.x, sqrt(below * (2.0 - below)), 1.0 - below);
}

float cone_pdf(float width) {
    return 1.0 / (2.0 * PI * width);
}

// Uniform over the unit sphere.
vec3 sample_sphere(vec2 u) {
    float z = 1.0 - 2.0 * u.y;
    return around_z(2.0 * PI * u.x, 2.0 * sqrt(u.y * (1.0 - u.y)), z);
}

// Uniform over the unit disc; pdf 1 / pi.
vec2 sample_disc(vec2 u) {
    float angle = 2.0 * PI * u.x;
    return sqrt(u.y) * vec2(cos(angle), sin(angle));
}

// Barycentric weights of the second and third corner of a triangle, uniform over it (Turk 1990, "Generating Random Points in Triangles",
// Graphics Gems, method 2).
vec2 sample_triangle(vec2 u) {
    float root = sqrt(u.x);
    return vec2(root * (1.0 - u.y), root * u.y);
}

// Half vector from the distribution of visible GGX normals, for a unit `v` with v.z >= 0 (Dupuy and Benyoub 2023, "Sampling Visible GGX
// Normals with Spherical Caps").
vec3 sample_visible_normal(vec3 v, float alpha, vec2 u) {
    vec3 stretched = normalize(vec3(alpha * v.xy, v.z));
    float z = (1.0 - u.y) * (1.0 + stretched.z) - stretched.z;
    vec3 h = around_z(2.0 * PI * u.x, sqrt(clamp(1.0 - z * z, 0.0, 1.0)), z) + stretched;
    return normalize(vec3(alpha * h.xy, h.z));
}

// Weight by multiple importance sampling of a sample with pdf `own`, which the other strategy has with pdf `other`: Veach 1997, "Robust
// Monte Carlo Methods for Light Transport Simulation", section 9.2. If both are 0 the weight does not matter.
float mis_weight(float own, float other, bool power) {
    // Computed from the quotient, as squared pdfs of sharp lobes overflow.
    float q = own > 0.0 ? other / own : 0.0;
    return own > 0.0 ? 1.0 / (1.0 + (power ? q * q : q)) : 0.0;
}

#endif
