// Intersection of a ray with boxes of a compressed node and with triangles. No scene, no bindings.
#ifndef LIB_INTERSECT_GLSL
#define LIB_INTERSECT_GLSL
#include "shared/scene.glsl"

// A ray prepared for the box test.
struct BoxRay {
    vec3 origin;
    vec3 inverse;  // 1 / direction, always finite
    uint octant;   // bit 2, 1, 0: x, y, z of the direction is not negative
};

// A ray prepared for the triangle test (Woop et al. 2013).
struct TriangleRay {
    vec3 origin;
    uint axis;     // axis along which the direction is longest, permuted to be z
    vec3 shear;    // x/z, y/z and 1/z of the permuted direction
};

// A hit on a triangle or a sphere. Undefined if there is no hit.
struct SurfaceHit {
    float t;
    vec2 barycentric;  // weights of the second and third corner; zero on a sphere
    bool front;        // hit on the front: corners counter-clockwise, or the outside of a sphere
};

// Smaller components of a direction are raised to this. Over any distance that f32 resolves in a scene the ray then moves by less than a
// rounding error, and 1 / component times coordinates up to 1e18 stays finite, so that 0 * infinity does not occur.
const float SMALLEST_COMPONENT = 1e-20;

// Relative rounding error of a plane's distance, 16 unit roundoffs: the division is good to 5 (Vulkan allows 2.5 ulp), the
// difference, the two products and the sum to 4, on either side. In the spirit of Ize 2013, "Robust BVH Ray Traversal".
const float BOX_ROUNDING = 9.5367431640625e-7;

const float SMALLEST_NORMAL = 1.17549435e-38;

BoxRay box_ray(vec3 origin, vec3 direction)
{
    vec3 tiny = mix(vec3(SMALLEST_COMPONENT), vec3(-SMALLEST_COMPONENT), lessThan(direction, vec3(0.0)));
    vec3 safe = mix(direction, tiny, lessThan(abs(direction), vec3(SMALLEST_COMPONENT)));
    uint octant = (safe.x < 0.0 ? 0u : 4u) | (safe.y < 0.0 ? 0u : 2u) | (safe.z < 0.0 ? 0u : 1u);
    return BoxRay(origin, 1.0 / safe, octant);
}

// Permutes `axis` to z and keeps the handedness.
vec3 axis_to_z(vec3 v, uint axis)
{
    return axis == 0u ? v.yzx : axis == 1u ? v.zxy : v;
}

TriangleRay triangle_ray(vec3 origin, vec3 direction)
{
    vec3 size = abs(direction);
    uint axis = size.x > size.y ? (size.x > size.z ? 0u : 2u) : (size.y > size.z ? 1u : 2u);
    vec3 d = axis_to_z(direction, axis);
    return TriangleRay(origin, axis, vec3(d.x / d.z, d.y / d.z, 1.0 / d.z));
}

// Hits of the eight children as one mask (Ylitie et al. 2017, section 3): bits 24 to 31 for inner children, the first to visit highest;
// bits 0 to 23 for primitives, counted from the node's first.
uint hit_children(BvhNode node, BoxRay ray, float t_min, float t_max)
{
    uint e = node.exponents_and_mask;
    vec3 cell = uintBitsToFloat(uvec3((e & 255u) << 23, ((e >> 8) & 255u) << 23, ((e >> 16) & 255u) << 23));
    // Distance to plane q is q * scale + base. Near planes are moved closer and far ones further by the rounding error.
    vec3 scale = cell * ray.inverse;
    vec3 base = (node.origin - ray.origin) * ray.inverse;
    vec3 slack = BOX_ROUNDING * (abs(base) + 255.0 * abs(scale));
    vec3 near_base = base - slack;
    vec3 far_base = base + slack;
    bvec3 backwards = lessThan(ray.inverse, vec3(0.0));
    uint hits = 0u;
    for (int half_node = 0; half_node < 2; ++half_node) {
        uint metas = node.meta[half_node];
        if (metas == 0u) {
            continue;
        }
        uvec3 lower = uvec3(node.min_x[half_node], node.min_y[half_node], node.min_z[half_node]);
        uvec3 upper = uvec3(node.max_x[half_node], node.max_y[half_node], node.max_z[half_node]);
        uvec3 near_planes = mix(lower, upper, backwards);
        uvec3 far_planes = mix(upper, lower, backwards);
        for (int shift = 0; shift < 32; shift += 8) {
            vec3 near = vec3((near_planes >> shift) & 255u) * scale + near_base;
            vec3 far = vec3((far_planes >> shift) & 255u) * scale + far_base;
            float enter = max(max(near.x, near.y), max(near.z, t_min));
            float leave = min(min(far.x, far.y), min(far.z, t_max));
            // An empty slot has meta 0 and adds no bit. Inner slots count from 24 to 31 and are reordered by the ray's octant.
            uint meta = (metas >> shift) & 255u;
            uint at = meta & 31u;
            hits |= (enter <= leave ? meta >> 5 : 0u) << (at >= 24u ? at ^ ray.octant : at);
        }
    }
    return hits;
}

// Whether the ray meets a box, widened by the rounding error.
bool meets_box(BoxRay ray, vec3 lower, vec3 upper, float t_min, float t_max)
{
    vec3 a = (lower - ray.origin) * ray.inverse;
    vec3 b = (upper - ray.origin) * ray.inverse;
    vec3 slack = BOX_ROUNDING * max(abs(a), abs(b));
    vec3 near = min(a, b) - slack;
    vec3 far = max(a, b) + slack;
    return max(max(near.x, near.y), max(near.z, t_min)) <= min(min(far.x, far.y), min(far.z, t_max));
}

// Woop, Benthin and Wald 2013, "Watertight Ray/Triangle Intersection", both sides.
//
// The edge values of an edge that two triangles share are exact opposites, and as rounding is monotone none has the wrong sign: at worst it
// is zero, which counts as inside. So there are no cracks, and the paper's fallback to double precision, which decides between the two
// triangles, is not needed. This requires that products are not contracted, hence `precise`.
//
// No early exits: in a subgroup some lane nearly always hits, so leaving early would help none.
bool hit_triangle(TriangleRay ray, vec3 v0, vec3 v1, vec3 v2, float t_min, float t_max, out SurfaceHit hit)
{
    precise vec3 a = axis_to_z(v0 - ray.origin, ray.axis);
    precise vec3 b = axis_to_z(v1 - ray.origin, ray.axis);
    precise vec3 c = axis_to_z(v2 - ray.origin, ray.axis);
    precise vec2 p = a.xy - ray.shear.xy * a.z;
    precise vec2 q = b.xy - ray.shear.xy * b.z;
    precise vec2 r = c.xy - ray.shear.xy * c.z;
    precise float u = r.x * q.y - r.y * q.x;
    precise float v = p.x * r.y - p.y * r.x;
    precise float w = q.x * p.y - q.y * p.x;
    bool inside = !(min(u, min(v, w)) < 0.0 && max(u, max(v, w)) > 0.0);
    precise float determinant = u + v + w;
    // Edge on or degenerate. Written so that NaN is a miss too.
    bool has_area = abs(determinant) >= SMALLEST_NORMAL;
    precise float t = ray.shear.z * (u * a.z + v * b.z + w * c.z) / determinant;
    hit = SurfaceHit(t, vec2(v, w) / determinant, (determinant > 0.0) == (ray.shear.z > 0.0));
    return inside && has_area && t > t_min && t < t_max;
}

// The nearer intersection with a sphere if it is in range, else the further one. The discriminant is the squared radius minus the squared
// distance of the centre from the line, and the roots come without a difference of near numbers (Haines, Guenther and
// Akenine-Moeller 2019, "Precision Improvements for Ray/Sphere Intersection", Ray Tracing Gems, chapter 7).
bool hit_sphere(vec3 origin, vec3 direction, vec3 centre, float radius, float t_min, float t_max, out SurfaceHit hit)
{
    hit = SurfaceHit(t_max, vec2(0.0), false);
    vec3 f = origin - centre;
    float a = dot(direction, direction);
    float b = -dot(f, direction);
    vec3 beside = f + (b / a) * direction;
    float discriminant = radius * radius - dot(beside, beside);
    // Written so that NaN is a miss too.
    if (!(discriminant >= 0.0)) {
        return false;
    }
    float c = dot(f, f) - radius * radius;
    float q = b + (b < 0.0 ? -1.0 : 1.0) * sqrt(a * discriminant);
    float first = c / q;
    float second = q / a;
    float near = min(first, second);
    float far = max(first, second);
    bool outside = near > t_min && near < t_max;
    float t = outside ? near : far;
    if (!(t > t_min && t < t_max)) {
        return false;
    }
    hit = SurfaceHit(t, vec2(0.0), outside);
    return true;
}

#endif
