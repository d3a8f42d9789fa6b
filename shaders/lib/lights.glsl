#ifndef LIB_LIGHTS_GLSL
#define LIB_LIGHTS_GLSL
#include "shared/scene.glsl"
#include "lib/vector.glsl"
// Light sources as seen from a surface point. Units and falloff: KHR_lights_punctual.

// Distance of directional lights, metres.
const float INFINITELY_FAR = 1e30;

// Least distance to a light, metres; closer points are lit as from there.
const float MIN_LIGHT_DISTANCE = 1e-4;

struct LightSample {
    // Unit, from the point towards the light.
    vec3 direction;
    // Metres.
    float distance;
    // On a surface that faces the light, unoccluded. 0 outside a cone, a range or on the dark side of a rectangle or disc.
    vec3 irradiance;
};

// (1 - (d / range)^4) in 0..1, the window of KHR_lights_punctual; range 0 never ends.
float range_window(float distance, float range) {
    if (range <= 0.0) return 1.0;
    float q = distance / range;
    float q2 = q * q;
    return clamp(1.0 - q2 * q2, 0.0, 1.0);
}

// Area of a lamp as seen from where it looks largest, square metres; 1 for what has none.
float lamp_area(Light light) {
    if (light.kind == LIGHT_RECTANGLE) return 4.0 * length(cross(light.half_u, light.half_v));
    return light.kind == LIGHT_DISC || light.kind == LIGHT_SPHERE ? PI * light.radius * light.radius : 1.0;
}

LightSample sample_light(Light light, vec3 position) {
    LightSample result;
    if (light.kind == LIGHT_DIRECTIONAL) {
        result.direction = -light.direction;
        result.distance = INFINITELY_FAR;
        result.irradiance = light.intensity;
        return result;
    }
    vec3 to_light = light.position - position;
    result.distance = length(to_light);
    result.direction = safe_normalize(to_light, -light.direction);
    float square = max(dot(to_light, to_light), MIN_LIGHT_DISTANCE * MIN_LIGHT_DISTANCE);

    if (light.kind == LIGHT_RECTANGLE) {
        // All flux is taken from the centre: radiance * area * cos / d². Accurate from a few edge lengths on. Nearer it would exceed the
        // greatest irradiance from any emitter of this radiance, pi * radiance, so d² is at least area / pi.
        float area = 4.0 * length(cross(light.half_u, light.half_v));
        float cosine = max(dot(light.direction, -result.direction), 0.0);
        result.irradiance = light.intensity * (area * cosine / max(square, area / PI));
        return result;
    }
    if (light.kind == LIGHT_DISC) {
        float area = PI * light.radius * light.radius;
        float cosine = max(dot(light.direction, -result.direction), 0.0);
        result.irradiance = light.intensity * (area * cosine / max(square, area / PI));
        return result;
    }
    if (light.kind == LIGHT_SPHERE) {
        // pi * radiance * sin² of the half angle that it subtends: exact if it is fully above the horizon.
        float radius_square = light.radius * light.radius;
        result.irradiance = light.intensity * (PI * radius_square / max(square, radius_square));
        return result;
    }
    float factor = range_window(result.distance, light.range) / square;
    if (light.kind == LIGHT_SPOT) {
        float cone = clamp(dot(light.direction, -result.direction) * light.cone_scale + light.cone_offset, 0.0, 1.0);
        factor *= cone * cone;
    }
    result.irradiance = light.intensity * factor;
    return result;
}

#endif
