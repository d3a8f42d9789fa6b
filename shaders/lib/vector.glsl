#ifndef LIB_VECTOR_GLSL
#define LIB_VECTOR_GLSL
// Small vector helpers.

const float PI = 3.14159265358979;

// `v / |v|`, or `otherwise` when v is zero. Scaled by the largest component first, so that neither
// very short nor very long vectors lose their direction in `|v|²`.
vec3 safe_normalize(vec3 v, vec3 otherwise) {
    float largest = max(max(abs(v.x), abs(v.y)), abs(v.z));
    return largest == 0.0 ? otherwise : normalize(v / largest);
}

// An affine transform as its three upper rows, applied to a point.
vec3 transform_point(vec4 rows[3], vec3 p) {
    return vec3(dot(rows[0], vec4(p, 1.0)), dot(rows[1], vec4(p, 1.0)), dot(rows[2], vec4(p, 1.0)));
}

// The same, applied to a direction.
vec3 transform_vector(vec4 rows[3], vec3 v) {
    return vec3(dot(rows[0].xyz, v), dot(rows[1].xyz, v), dot(rows[2].xyz, v));
}

// Normals are transformed by the inverse transpose: `rows` are those of the inverse, so `object_from_world` for world-space normals. Holds
// for mirrored and stretched instances too: the front stays the front. Not normalised.
vec3 transform_normal(vec4 rows[3], vec3 n) {
    return rows[0].xyz * n.x + rows[1].xyz * n.y + rows[2].xyz * n.z;
}

// -1 when the transform mirrors, else 1.
float handedness(vec4 rows[3]) {
    return dot(cross(rows[0].xyz, rows[1].xyz), rows[2].xyz) < 0.0 ? -1.0 : 1.0;
}

// Negative components become 0. Unlike max, it keeps NaN, for `--check` to find.
vec3 non_negative(vec3 v) {
    return mix(v, vec3(0.0), lessThan(v, vec3(0.0)));
}

#endif
