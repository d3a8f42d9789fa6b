#ifndef LIB_SKY_GLSL
#define LIB_SKY_GLSL
#include "lib/bindless.glsl"
#include "shared/scene.glsl"
#include "shared/view.glsl"
#include "lib/colour.glsl"
#include "lib/vector.glsl"
// Distant light: an environment map if there is one, else analytic daylight after Preetham, Shirley and Smits 1999, "A Practical Analytic
// Model for Daylight". Directions are unit, y up.

bool has_environment(Sky sky) {
    return sky.environment != NO_TEXTURE;
}

// Texture coordinates, 0 to 1 from the top left, of a direction in the world. Before the turn about +y it is
// (sin p sin t, cos t, -cos p sin t) with p = 2 pi (u - 1/2) and t = pi v: the middle of the image is -z. At the poles u is 1/2.
vec2 environment_uv(Sky sky, vec3 direction) {
    float s = sky.environment_turn.x, c = sky.environment_turn.y;
    vec2 flat_part = vec2(c * direction.x - s * direction.z, s * direction.x + c * direction.z);
    float around = flat_part == vec2(0.0) ? 0.0 : atan(flat_part.x, -flat_part.y);
    return vec2(around / (2.0 * PI) + 0.5, atan(length(flat_part), direction.y) / PI);
}

// Its inverse: the unit direction in the world of texture coordinates. A patch of the image covers 2 pi^2 sin(pi v) du dv steradians.
vec3 environment_direction(Sky sky, vec2 uv) {
    float p = 2.0 * PI * (uv.x - 0.5), t = PI * uv.y;
    vec3 d = vec3(sin(p) * sin(t), cos(t), -cos(p) * sin(t));
    float s = sky.environment_turn.x, c = sky.environment_turn.y;
    return vec3(c * d.x + s * d.z, d.y, c * d.z - s * d.x);
}

// Radiance of the environment map, bilinear between texels.
vec3 environment_radiance(Sky sky, vec3 direction) {
    vec2 uv = environment_uv(sky, direction);
    return sky.environment_scale * sample_bilinear(sky.environment, sky.environment_sampler, uv).rgb;
}

// Perez et al. 1993: F(theta, gamma) = (1 + A exp(B / cos theta)) (1 + C exp(D gamma) + E cos² gamma), coefficients A to E.
// theta: angle from the zenith; gamma: angle from the sun.
float perez(float k[5], float cos_theta, float gamma, float cos_gamma) {
    return (1.0 + k[0] * exp(k[1] / cos_theta)) * (1.0 + k[2] * exp(k[3] * gamma) + k[4] * cos_gamma * cos_gamma);
}

// Radiance from `direction` without the sun's disc: the environment map, or the ground below the horizon, the sky above.
vec3 sky_radiance(Sky sky, vec3 direction) {
    if (has_environment(sky)) return environment_radiance(sky, direction);
    if (direction.y < 0.0) return sky.ground;
    // The formula has a pole at the horizon: the last half degree is extended from 0.6 degrees.
    float cos_theta = max(direction.y, 0.01);
    float cos_gamma = clamp(dot(direction, sky.to_sun), -1.0, 1.0);
    float gamma = acos(cos_gamma);
    vec3 yxy = sky.zenith * vec3(
        perez(sky.perez_y_luminance, cos_theta, gamma, cos_gamma),
        perez(sky.perez_x, cos_theta, gamma, cos_gamma),
        perez(sky.perez_y, cos_theta, gamma, cos_gamma)
    );
    // Deep blue daylight lies outside Rec.709: negative components become 0.
    return non_negative(rec709_of_yxy(yxy));
}

// The same with the sun's disc. Environment maps contain their own sun.
vec3 sky_radiance_with_sun(Sky sky, vec3 direction) {
    vec3 radiance = sky_radiance(sky, direction);
    if (direction.y >= 0.0 && dot(direction, sky.to_sun) >= sky.sun_cos_radius) radiance += sky.sun_radiance;
    return radiance;
}

// Irradiance of sky and ground on a surface with normal `n`: E(n) = sum c_i Y_i(n) over the real spherical harmonics in the
// order (l, m) = 00, 1-1, 10, 11, 2-2, 2-1, 20, 21, 22; the coefficients hold the cosine lobe.
// Ramamoorthi and Hanrahan 2001, "An Efficient Representation for Irradiance Environment Maps", equations 3 and 10.
// Nine terms ring a little: negative results become 0.
vec3 sky_irradiance(Sky sky, vec3 n) {
    vec3 e = sky.irradiance_sh[0] * 0.282095;
    e += sky.irradiance_sh[1] * (0.488603 * n.y);
    e += sky.irradiance_sh[2] * (0.488603 * n.z);
    e += sky.irradiance_sh[3] * (0.488603 * n.x);
    e += sky.irradiance_sh[4] * (1.092548 * n.x * n.y);
    e += sky.irradiance_sh[5] * (1.092548 * n.y * n.z);
    e += sky.irradiance_sh[6] * (0.315392 * (3.0 * n.z * n.z - 1.0));
    e += sky.irradiance_sh[7] * (1.092548 * n.x * n.z);
    e += sky.irradiance_sh[8] * (0.546274 * (n.x * n.x - n.y * n.y));
    return non_negative(e);
}

#endif
