#ifndef LIB_NORMAL_MAP_GLSL
#define LIB_NORMAL_MAP_GLSL
#include "lib/vector.glsl"
// Shading normals.

// Least cosine between the shading normal and the direction to the viewer.
const float MIN_NORMAL_COSINE = 0.01;

// A tangent-space normal in the world (Mikkelsen 2008): the frame is not normalised after interpolation, only the result is.
// `n` normal, `t` tangent with the sign of the bitangent in w, `texel` 0..1, `scale` of x and y. `n` when the result is zero.
vec3 apply_normal_map(vec3 n, vec4 t, vec3 texel, float scale) {
    vec3 m = (texel * 2.0 - 1.0) * vec3(scale, scale, 1.0);
    vec3 bitangent = t.w * cross(n, t.xyz);
    return safe_normalize(m.x * t.xyz + m.y * bitangent + m.z * n, n);
}

// Interpolated and mapped normals may point away from the viewer on a visible surface, where microfacet models are undefined. Such a normal
// is mirrored at the plane perpendicular to the view direction, with a cosine of at least MIN_NORMAL_COSINE. A normal exactly in that plane
// would be dark, as all light is reflected there. Both unit; so is the result.
vec3 turn_to_viewer(vec3 n, vec3 to_eye) {
    float cosine = dot(n, to_eye);
    return cosine >= MIN_NORMAL_COSINE ? n : normalize(n + to_eye * (max(-cosine, MIN_NORMAL_COSINE) - cosine));
}

#endif
