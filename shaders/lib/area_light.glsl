#ifndef LIB_AREA_LIGHT_GLSL
#define LIB_AREA_LIGHT_GLSL
#include "lib/bsdf.glsl"
#include "lib/light_sampling.glsl"
#include "lib/sequence.glsl"
// Reflected radiance of lights with an area, without shadows. The diffuse part is in closed form; the specular part is sampled on the light
// and on the lobe. Directions are local, as in lib/bsdf.glsl.

// Up to this half angle, radians, the diffuse part treats a light as a point at its centre: the relative error is about half_angle², 4e-4.
const float SMALL_LAMP = 0.02;
// Up to this half angle over the lobe's width the specular part does so too. The lobe is 1 / (1 + t² / alpha²)² around its peak, with t
// half the angle; its mean over the light is half_angle² / (4 alpha²) less than the peak: 1e-3.
const float SMALL_IN_LOBE = 0.0632;

// Sides of the polygon of equal area that replaces a disc.
const uint DISC_SIDES = 8u;
const float DISC_CORNER = 1.053907;  // its circumradius over the radius of the disc: sqrt(2 pi / (8 sin(pi / 4)))

// Irradiance on a surface from a light of radiance 1, and the mean cosine of its directions.
struct Arriving {
    float irradiance;
    float cosine;
};

// Half the angle that a light subtends, radians; an overestimate for large ones.
float half_angle(Light light, float distance) {
    if (light.kind == LIGHT_DIRECTIONAL) return light.radius;
    float extent = light.kind == LIGHT_RECTANGLE
        ? sqrt(dot(light.half_u, light.half_u) + dot(light.half_v, light.half_v)) : light.radius;
    return extent / max(distance, MIN_LIGHT_DISTANCE);
}

// Irradiance of a sphere centred on a direction with the cosine `c` to the normal; `s` is the sine of its half angle. Where the horizon
// cuts it: Snyder 1996, "Area Light Sources for Real-Time Graphics", section 3.
Arriving arriving_from_ball(float c, float s) {
    float whole = PI * s * s;
    if (c >= s) return Arriving(whole * c, c);
    if (c <= -s) return Arriving(0.0, 0.0);
    float sine = sqrt(1.0 - c * c);
    float x = sqrt(max(1.0 - s * s, 0.0)) / s;
    // Only rounding exceeds 1.
    float y = clamp(-x * c / sine, -1.0, 1.0);
    float chord = sine * sqrt(1.0 - y * y);
    float irradiance = s * s * (c * acos(y) - x * chord) + atan(chord, x);
    if (irradiance <= 0.0) return Arriving(0.0, 0.0);
    // The part of the vector irradiance along the surface: half the contour integral of u × du around the visible region.
    float along = s * s * (sine * acos(y) + x * sqrt(1.0 - y * y) * c);
    return Arriving(irradiance, irradiance / length(vec2(irradiance, along)));
}

// Contribution of one edge to the vector irradiance (Lambert 1760; Arvo 1994, "The Irradiance Jacobian for Partially Occluded Polyhedral
// Sources").
vec3 edge_share(vec3 a, vec3 b) {
    vec3 across = cross(a, b);
    float size = length(across);
    return size > 0.0 ? across * (atan(size, dot(a, b)) / size) : vec3(0.0);
}

// A corner of the light's polygon, clockwise as seen from its front.
vec3 lamp_corner(Light light, uint corner) {
    if (light.kind == LIGHT_RECTANGLE) {
        return (corner < 2u ? -1.0 : 1.0) * light.half_u + (corner == 1u || corner == 2u ? 1.0 : -1.0) * light.half_v;
    }
    float angle = 2.0 * PI * float(corner) / float(DISC_SIDES);
    return frame_of(light.direction) * (light.radius * DISC_CORNER * vec3(cos(angle), -sin(angle), 0.0));
}

// A rectangle or disc, clipped by the horizon. The point is in front of it.
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
    // The edge along the horizon; zero if nothing was clipped.
    sum += edge_share(left, entered);
    float size = length(sum);
    return sum.z > 0.0 ? Arriving(0.5 * sum.z, sum.z / size) : Arriving(0.0, 0.0);
}

// Share of a unit disc above a line, given the height of its centre over the line.
float share_of_disc(float height) {
    float t = clamp(height, -1.0, 1.0);
    return 0.5 + (t * sqrt(1.0 - t * t) + asin(t)) / PI;
}

// Share of a light's points above the horizon of the normal `n`. Visibility counts those below as hidden, while the closed form has left
// them out already.
float share_above(Light light, LightSample centre, vec3 position, vec3 n) {
    if (light.kind == LIGHT_RECTANGLE) {
        float height = dot(light.position - position, n);
        float a = abs(dot(light.half_u, n));
        float b = abs(dot(light.half_v, n));
        if (height >= a + b) return 1.0;
        // For a light level along one side, a small slope avoids 0 / 0.
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

// Diffuse reflection of the whole light. Fresnel is evaluated for the mean direction.
vec3 diffuse_of_lamp(Light light, LightSample centre, vec3 position, Bsdf b, mat3 around, vec3 v) {
    vec3 radiance = light.intensity;
    Arriving light_in;
    if (light.kind == LIGHT_RECTANGLE || light.kind == LIGHT_DISC) {
        light_in = arriving_from_polygon(light, light.position - position, around);
    } else {
        bool far = light.kind == LIGHT_DIRECTIONAL;
        if (far) radiance = disc_radiance(light);
        // Lights do not shine inwards.
        else if (centre.distance <= light.radius) return vec3(0.0);
        light_in = arriving_from_ball(dot(around[2], centre.direction), far ? sin(light.radius) : light.radius / centre.distance);
    }
    if (light_in.irradiance <= 0.0) return vec3(0.0);
    vec3 reflected = diffuse_cosine(b.fresnel, (1.0 - b.metalness) * b.base_colour, v.z, light_in.cosine) / light_in.cosine;
    return below_coat(b, v) * reflected * light_in.irradiance * radiance;
}

// Specular reflection of the whole light by multiple importance sampling: `points` samples of the light and as many of the lobe (Veach
// 1997, section 9.2). `stream`: the first of two sequences.
vec3 specular_of_lamp(Light light, vec3 position, Bsdf b, mat3 around, vec3 v, ivec2 pixel, uint first, uint points, uint stream, uint seed) {
    vec3 sum = vec3(0.0);
    for (uint i = first; i < first + points; i++) {
        Incident from;
        if (sample_sized_light(light, position, sequence2(pixel, i, stream, seed), from)) {
            vec3 l = from.direction * around;
            float weight = l.z > 0.0 ? mis_weight(from.pdf, bsdf_pdf(b, v, l, LOBE_SPECULAR), true) : 0.0;
            if (weight > 0.0) sum += weight * bsdf_cosine(b, v, l, LOBE_SPECULAR) * from.radiance;
        }
        vec3 l;
        float distance, pdf;
        vec3 radiance;
        bool above = sample_specular(b, v, sequence2(pixel, i, stream + 1u, seed), l);
        if (above && meet_light(light, position, around * l, distance, radiance, pdf)) {
            float own = bsdf_pdf(b, v, l, LOBE_SPECULAR);
            float weight = mis_weight(own, pdf, true);
            if (weight > 0.0) sum += (weight / own) * bsdf_cosine(b, v, l, LOBE_SPECULAR) * radiance;
        }
    }
    return sum / float(points);
}

#endif
