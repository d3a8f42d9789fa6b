#ifndef LIB_REGULARIZATION_GLSL
#define LIB_REGULARIZATION_GLSL
#include "lib/bsdf.glsl"
// Path-space regularization (Kaplanyan and Dachsbacher 2013, "Path Space Regularization for Holistic and Robust Light Transport"). Behind rough
// surfaces the highlight of a small light in a smooth surface is so small and bright that nearly all pixels miss it, and some are filled with
// it. There lobes are widened to an alpha of at least a share of what the path was spread by before, `least_alpha`, for small lights alone. 0: off.

// Alpha of the lobe whose greatest pdf, by visible normals at normal incidence, is `pdf`, per steradian; at most 1.
float alpha_of_pdf(float pdf) {
    return min(inversesqrt(4.0 * PI * max(pdf, 1e-12)), 1.0);
}

// The share for the next path of a mean that has taken in so many. It falls with the square root of their number, the fastest at which the variance of the mean
// does not grow: wide lobes while a mean of few would be bright specks, and nearly none of their error later (Kaplanyan and Dachsbacher 2013).
float regularization_after(float paths, float share) {
    return share * inversesqrt(max(paths, 1.0));
}

// Whether a light that is sampled with a pdf, per steradian, is smaller than a lobe of that alpha. Rays along lobes do not count it then.
bool is_small(float light_pdf, float least_alpha) {
    return light_pdf * (4.0 * PI * least_alpha * least_alpha) > 1.0;
}

// The lobes as small lights light them, with the albedos of wider ones from the table at this address.
Bsdf widened(uvec2 table, Bsdf b, float least_alpha, float n_v) {
    if (least_alpha <= narrowest_alpha(b)) return b;
    b.alpha = max(b.alpha, least_alpha);
    b.coat_alpha = max(b.coat_alpha, least_alpha);
    return towards_viewer(table, b, n_v);
}

#endif
