#ifndef LIB_OCTAHEDRAL_GLSL
#define LIB_OCTAHEDRAL_GLSL
// Unit vectors as two numbers in -1..1: the octahedral map.
// Cigolle et al. 2014, "A Survey of Efficient Representations for Independent Unit Vectors", JCGT 3(2), section 3.

vec2 octahedral_fold(vec2 p) {
    return (1.0 - abs(p.yx)) * mix(vec2(-1.0), vec2(1.0), greaterThanEqual(p, vec2(0.0)));
}

// A direction of any length; the zero vector counts as +z.
vec2 octahedral_encode(vec3 v) {
    float sum = abs(v.x) + abs(v.y) + abs(v.z);
    if (sum == 0.0) return vec2(0.0);
    vec2 p = v.xy / sum;
    return v.z < 0.0 ? octahedral_fold(p) : p;
}

// A unit vector. The folded vector has an L1 norm of 1, so its length is never 0.
vec3 octahedral_decode(vec2 p) {
    vec3 v = vec3(p, 1.0 - abs(p.x) - abs(p.y));
    if (v.z < 0.0) v.xy = octahedral_fold(p);
    return normalize(v);
}

#endif
