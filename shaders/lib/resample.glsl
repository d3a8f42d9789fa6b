#ifndef LIB_RESAMPLE_GLSL
#define LIB_RESAMPLE_GLSL
#include "lib/bindless.glsl"
#include "lib/vector.glsl"

// Samples an image with the bicubic filter of Catmull and Rom (1974, "A Class of Local Interpolating Splines"), which blurs far less than
// bilinear. 16 texels in 5 bilinear taps: the four corners, which have the least weight, are left out (Jimenez 2016, "Filmic SMAA",
// SIGGRAPH course "Advances in Real-Time Rendering"). The filter has negative lobes; results below 0 become 0.
vec3 catmull_rom(uint image, uint bilinear, vec2 uv, vec2 size) {
    vec2 at = uv * size;
    vec2 centre = floor(at - 0.5) + 0.5;
    vec2 f = at - centre;
    vec2 w0 = f * (-0.5 + f * (1.0 - 0.5 * f));
    vec2 w1 = 1.0 + f * f * (1.5 * f - 2.5);
    vec2 w2 = f * (0.5 + f * (2.0 - 1.5 * f));
    vec2 w3 = f * f * (0.5 * f - 0.5);
    // The two middle texels are one bilinear tap.
    vec2 w12 = w1 + w2;
    vec2 before = (centre - 1.0) / size, after = (centre + 2.0) / size, middle = (centre + w2 / w12) / size;
    float left = w0.x * w12.y, right = w3.x * w12.y, above = w12.x * w0.y, below = w12.x * w3.y;
    float own = w12.x * w12.y;
    vec3 sum = own * sample_bilinear(image, bilinear, middle).rgb;
    sum += left * sample_bilinear(image, bilinear, vec2(before.x, middle.y)).rgb;
    sum += right * sample_bilinear(image, bilinear, vec2(after.x, middle.y)).rgb;
    sum += above * sample_bilinear(image, bilinear, vec2(middle.x, before.y)).rgb;
    sum += below * sample_bilinear(image, bilinear, vec2(middle.x, after.y)).rgb;
    return non_negative(sum / (own + left + right + above + below));
}

// Weight of a sample far outside of its pixel. Not 0, so that pixels without samples of their own show something.
const float LEAST_WEIGHT = 0.03;

// Weight of a sample at a distance of `off` from a pixel's centre, in output pixels: 1 in the pixel's square, little beyond.
float sample_weight(vec2 off) {
    vec2 beyond = max(abs(off) - 0.5, vec2(0.0));
    return max(exp(-100.0 * dot(beyond, beyond)), LEAST_WEIGHT);
}

#endif
