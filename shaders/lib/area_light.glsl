#ifndef LIB_AREA_LIGHT_GLSL
#define LIB_AREA_LIGHT_GLSL
#include "lib/bsdf.glsl"
#include "lib/light_sampling.glsl"
#include "lib/sequence.glsl"
// What a surface reflects of a lamp that has a size, nothing between them. The diffuse part in closed form, the specular one by points of
// the lamp and directions of the lobe. Directions are local, as in lib/bsdf.glsl.

// Up to this half angle, radians, a lamp lights a matte surface as its centre does: what is left out is some half_angle², 4e-4.
const float SMALL_LAMP = 0.02;
// Up to this half angle over the width of a lobe a lamp is a point in it. The lobe is 1 / (1 + t² / alpha²)² around its peak, with t half
// the angle; its mean over the lamp is half_angle² / (4 alpha²) less than the peak: 1e-3.
const float SMALL_IN_LOBE = 0.0632;

// Sides of the polygon that stands for a disc; of the same area.
const uint DISC_SIDES = 8u;
const float DISC_CORNER = 1.053907;  // radius of its corners over that of the disc: sqrt(2 pi / (8 sin(pi / 4)))

// Irradiance on a surface of light of radiance 1, and the mean cosine with which it arrives.
struct Arriving {
    float irradiance;
    float cosine;
};

// Half the angle that a lamp fills, radians, small ones at least.
float half_angle(Light light, float distance) {
    if (light.kind == LIGHT_DIRECTIONAL) return light.radius;
    float extent = light.kind == LIGHT_RECTANGLE
        ? sqrt(dot(light.half_u, light.half_u) + dot(light.half_v, light.half_v)) : light.radius;
    return extent / max(distance, MIN_LIGHT_DISTANCE);
}

// A ball around a direction with the cosine `c` to the normal; `s`: sine of its half angle. Where the horizon cuts it: Snyder 1996, "Area
// Light Sources for Real-Time Graphics", section 3.
Arriving arriving_from_ball(float c, float s) {
    float whole = PI * s * s;
    if (c >= s) return Arriving(whole * c, c);
    if (c <= -s) return Arriving(0.0, 0.0);
    float sine = sqrt(1.0 - c * c);
    float x = sqrt(max(1.0 - s * s, 0.0)) / s;
    // Rounding alone takes it beyond 1.
    float y = clamp(-x * c / sine, -1.0, 1.0);
    float chord = sine * sqrt(1.0 - y * y);
    float irradiance = s * s * (c * acos(y) - x * chord) + atan(chord, x);
    if (irradiance <= 0.0) return Arriving(0.0, 0.0);
    // The vector irradiance along the surface: half the integral of u × du around what is seen, as above.
    float along = s * s * (sine * acos(y) + x * sqrt(1.0 - y * y) * c);
    return Arriving(irradiance, irradiance / length(vec2(irradiance, along)));
}

// Share of one edge in the vector irradiance (Lambert 1760; Arvo 1994, "The Irradiance Jacobian for Partially Occluded Polyhedral Sources").
vec3 edge_share(vec3 a, vec3 b) {
    vec3 across = cross(a, b);
    float size = length(across);
    return size > 0.0 ? across * (atan(size, dot(a, b)) / size) : vec3(0.0);
}

// A corner of the lamp's polygon, clockwise as its front is seen.
vec3 lamp_corner(Light light, uint corner) {
    if (light.kind == LIGHT_RECTANGLE) {
        return (corner < 2u ? -1.0 : 1.0) * light.half_u + (corner == 1u || corner == 2u ? 1.0 : -1.0) * light.half_v;
    }
    float angle = 2.0 * PI * float(corner) / float(DISC_SIDES);
    return frame_of(light.direction) * (light.radius * DISC_CORNER * vec3(cos(angle), -sin(angle), 0.0));
}

// A rectangle or disc, cut by the horizon. The point is in front of it.
Arriving arriving_from_polygon(Light light, vec3 to_light, mat3 around) {
    uint sides = light.kind == LIGHT_RECTANGLE ? 4u : DISC_SIDES;
    vec3 sum = vec3(0.0), left = vec3(0.0), entered = vec3(0.0);
    vec3 a = safe_normalize((to_light + lamp_corner(light, sides - 1u)) * around, vec3(0.0));
    for (uint i = 0u; i < sides; i++) {
        vec3 b = safe_normalize((to_light + lamp_corner(light, i)) * around, vec3(0.0));
        vec3 from = a, to = b;
        bool enters = a.z <= 0.0 && b.z > 0.0;
        bool leaves = a.z > 0.0 && b.z <= 0.0;
        if (enters || leaves) {
            vec3 between = a + (a.z / (a.z - b.z)) * (b - a);
            if (enters) entered = from = between;
            else left = to = between;
        }
        if (a.z > 0.0 || b.z > 0.0) sum += edge_share(from, to);
        a = b;
    }
    // Along the horizon; nothing where it cuts nothing.
    sum += edge_share(left, entered);
    float size = length(sum);
    return sum.z > 0.0 ? Arriving(0.5 * sum.z, sum.z / size) : Arriving(0.0, 0.0);
}

// Share of a disc of radius 1 that lies above a line, from its centre's height over the line.
float share_of_disc(float height) {
    float t = clamp(height, -1.0, 1.0);
    return 0.5 + (t * sqrt(1.0 - t * t) + asin(t)) / PI;
}

// Share of a lamp's points that are above the horizon of the normal `n`. Those below count as hidden where visibility is found, and what is
// reflected of the whole lamp lacks them already.
float share_above(Light light, LightSample centre, vec3 position, vec3 n) {
    if (light.kind == LIGHT_RECTANGLE) {
        float height = dot(light.position - position, n);
        float a = abs(dot(light.half_u, n));
        float b = abs(dot(light.half_v, n));
        if (height >= a + b) return 1.0;
        // Where it is level along one side, a little slope takes the place of 0 / 0.
        float least = 1e-3 * (a + b);
        a = max(a, least);
        b = max(b, least);
        vec4 corners = max(vec4(height) + vec4(a + b, a - b, b - a, -a - b), 0.0);
        corners *= corners;
        return clamp((corners.x - corners.y - corners.z + corners.w) / (8.0 * a * b), 0.0, 1.0);
    }
    if (light.kind == LIGHT_DISC) {
        float height = dot(light.position - position, n);
        float slope = light.radius * length(cross(light.direction, n));
        return height >= slope ? 1.0 : share_of_disc(height / slope);
    }
    float c = dot(centre.direction, n);
    float s = light.kind == LIGHT_DIRECTIONAL ? sin(light.radius) : light.radius / centre.distance;
    if (c >= s) return 1.0;
    return share_of_disc(c * sqrt(max(1.0 - s * s, 0.0)) / (s * sqrt(1.0 - c * c)));
}

// What the diffuse part reflects of the whole lamp. Fresnel's share is that of the mean direction.
vec3 diffuse_of_lamp(Light light, LightSample centre, vec3 position, Bsdf b, mat3 around, vec3 v) {
    vec3 radiance = light.intensity;
    Arriving light_in;
    if (light.kind == LIGHT_RECTANGLE || light.kind == LIGHT_DISC) {
        light_in = arriving_from_polygon(light, light.position - position, around);
    } else {
        bool far = light.kind == LIGHT_DIRECTIONAL;
        if (far) radiance = disc_radiance(light);
        // Nothing shines inwards.
        else if (centre.distance <= light.radius) return vec3(0.0);
        light_in = arriving_from_ball(dot(around[2], centre.direction), far ? sin(light.radius) : light.radius / centre.distance);
    }
    if (light_in.irradiance <= 0.0) return vec3(0.0);
    vec3 reflected = diffuse_cosine(b.fresnel, (1.0 - b.metalness) * b.base_colour, v.z, light_in.cosine) / light_in.cosine;
    return reflected * light_in.irradiance * radiance;
}

// What the specular part reflects of the whole lamp: `points` of the lamp and as many directions of the lobe, each weighed by how likely the
// other strategy was to find the same (Veach 1997, section 9.2). `stream`: of two sequences.
vec3 specular_of_lamp(Light light, vec3 position, Bsdf b, mat3 around, vec3 v, ivec2 pixel, uint first, uint points, uint stream, uint seed) {
    vec3 sum = vec3(0.0);
    for (uint i = first; i < first + points; i++) {
        Incident from;
        if (sample_sized_light(light, position, sequence2(pixel, i, stream, seed), from)) {
            vec3 l = from.direction * around;
            float weight = l.z > 0.0 ? mis_weight(from.pdf, bsdf_pdf(b, v, l, LOBE_SPECULAR), true) : 0.0;
            if (weight > 0.0) sum += weight * bsdf_cosine(b, v, l, LOBE_SPECULAR) * from.radiance;
        }
        vec3 l = reflect(-v, sample_visible_normal(v, b.alpha, sequence2(pixel, i, stream + 1u, seed)));
        float distance, pdf;
        vec3 radiance;
        if (l.z > 0.0 && meet_light(light, position, around * l, distance, radiance, pdf)) {
            float own = bsdf_pdf(b, v, l, LOBE_SPECULAR);
            float weight = mis_weight(own, pdf, true);
            if (weight > 0.0) sum += (weight / own) * bsdf_cosine(b, v, l, LOBE_SPECULAR) * radiance;
        }
    }
    return sum / float(points);
}

#endif
