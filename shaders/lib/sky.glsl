#ifndef LIB_SKY_GLSL
#define LIB_SKY_GLSL
#include "shared/view.glsl"
#include "lib/colour.glsl"
#include "lib/vector.glsl"
// Analytic daylight: Preetham, Shirley and Smits 1999, "A Practical Analytic Model for Daylight". Directions are unit, y up.

// Perez et al. 1993: F(theta, gamma) = (1 + A exp(B / cos theta)) (1 + C exp(D gamma) + E cos² gamma), coefficients A to E.
// theta: angle from the zenith; gamma: angle from the sun.
float perez(float k[5], float cos_theta, float gamma, float cos_gamma) {
    return (1.0 + k[0] * exp(k[1] / cos_theta)) * (1.0 + k[2] * exp(k[3] * gamma) + k[4] * cos_gamma * cos_gamma);
}

// Radiance from `direction` without the sun's disc: the ground below the horizon, the sky above.
vec3 sky_radiance(Sky sky, vec3 direction) {
    if (direction.y < 0.0) return sky.ground;
    // The formula has a pole at the horizon; its last half degree is that of 0.6 degrees.
    float cos_theta = max(direction.y, 0.01);
    float cos_gamma = clamp(dot(direction, sky.to_sun), -1.0, 1.0);
    float gamma = acos(cos_gamma);
    vec3 yxy = sky.zenith * vec3(
        perez(sky.perez_y_luminance, cos_theta, gamma, cos_gamma),
        perez(sky.perez_x, cos_theta, gamma, cos_gamma),
        perez(sky.perez_y, cos_theta, gamma, cos_gamma)
    );
    // Deep blue daylight lies outside Rec.709: the negative component goes to 0.
    return non_negative(rec709_of_yxy(yxy));
}

// The same with the sun's disc.
vec3 sky_radiance_with_sun(Sky sky, vec3 direction) {
    vec3 radiance = sky_radiance(sky, direction);
    if (direction.y >= 0.0 && dot(direction, sky.to_sun) >= sky.sun_cos_radius) radiance += sky.sun_radiance;
    return radiance;
}

// Irradiance of sky and ground on a surface with normal `n`: E(n) = sum c_i Y_i(n) over the real spherical harmonics in the
// order (l, m) = 00, 1-1, 10, 11, 2-2, 2-1, 20, 21, 22; the coefficients hold the cosine lobe.
// Ramamoorthi and Hanrahan 2001, "An Efficient Representation for Irradiance Environment Maps", equations 3 and 10.
// Nine terms ring a little: below 0 there is no light.
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
