#ifndef LIB_REFLECTION_BLUR_GLSL
#define LIB_REFLECTION_BLUR_GLSL
// The pyramid of blurred reflections: how its levels are made, and which of them a lobe asks for.

// Taps of a level along one axis, at 0.5, 1.5, ... source pixels to both sides of the middle between two pixels.
const int BLUR_TAPS = 8;
// Standard deviation of a level's Gaussian, pixels of the level below.
const float BLUR_SIGMA = 1.2;

// The tap's pixel, from twice the target's on.
int blur_offset(int k) {
    return k - BLUR_TAPS / 2 + 1;
}

float blur_weight(int k) {
    float x = (float(blur_offset(k)) - 0.5) / BLUR_SIGMA;
    return exp(-0.5 * x * x);
}

// The level at which all Gaussians so far make one of `sigma` pixels: variances add, and those of level k count 4^k times, so that
// sigma² = BLUR_SIGMA² (4^level - 1) / 3.
float blur_level(float sigma) {
    float ratio = sigma / BLUR_SIGMA;
    return 0.5 * log2(1.0 + 3.0 * ratio * ratio);
}

// Pixel of the whole image that a pixel stands for whose axes were halved this often.
ivec2 stands_for(ivec2 pixel, ivec2 halved, ivec2 size) {
    return min((pixel << halved) + ((ivec2(1) << halved) >> 1), size - 1);
}

// Radius of a cone of reflected light at a distance, metres: distance · tan(angle / 2), with the angle from which a share `xi` of the
// normals of GGX lie nearer to the surface's normal, cos² = (1 - xi) / (1 + (alpha² - 1) xi). Written so that an angle of 0 gives 0, not
// 0 / 0: tan(angle / 2) = sin / (1 + cos).
float cone_radius(float alpha, float xi, float distance) {
    float below = 1.0 + (alpha * alpha - 1.0) * xi;
    float cosine = sqrt((1.0 - xi) / below);
    float sine = alpha * sqrt(xi / below);
    return distance * sine / (1.0 + cosine);
}

#endif
