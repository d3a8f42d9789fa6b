#ifndef LIB_BSDF_GLSL
#define LIB_BSDF_GLSL
#include "lib/brdf.glsl"
#include "lib/sampling.glsl"
// The whole surface model, evaluated and sampled lobe by lobe. Directions are unit and local: the shading normal is +z, `v` goes
// towards the viewer (v.z > 0), `l` towards the light. Opaque surfaces are those of lib/brdf.glsl; on top come transmission
// (KHR_materials_transmission, _volume, _ior) and a clear coat (KHR_materials_clearcoat). Light that scatters more than once between
// microfacets is given back by the opaque lobe and by the coat, not by glass: a rough interface of glass loses it.

const uint LOBE_DIFFUSE = 1u;
const uint LOBE_SPECULAR = 2u;  // includes the clear coat
const uint LOBE_TRANSMISSION = 4u;
const uint LOBE_ALL = 7u;

struct Bsdf {
    vec3 base_colour;
    float metalness;
    Fresnel fresnel;     // of the opaque part
    float alpha;         // roughness², above 0
    float transmission;  // share of the dielectric part that is glass instead of diffuse, 0 to 1
    float eta;           // relative index of refraction: beyond the surface over this side
    bool thin;           // a thin sheet: transmitted light is not refracted
    float coat;          // strength of the coat, 0 to 1
    float coat_alpha;
    Dielectric less;     // what KHR_materials_specular takes off the Fresnel reflectance of glass, negative where it adds
    SplitSum lobe;       // albedo of the specular lobe towards the viewer
    SplitSum coat_lobe;  // the same of the coat's
};

// For glass whose reflectance follows from its index of refraction alone.
const Dielectric NO_LESS = Dielectric(vec3(0.0), 0.0);

// An opaque material.
Bsdf opaque_bsdf(vec3 base_colour, float metalness, float roughness, Fresnel f) {
    return Bsdf(base_colour, metalness, f, alpha_of_roughness(roughness), 0.0, 1.5, false, 0.0, 1.0, NO_LESS, NO_SPLIT_SUM, NO_SPLIT_SUM);
}

// An opaque material of index 1.5.
Bsdf opaque_bsdf(vec3 base_colour, float metalness, float roughness) {
    return opaque_bsdf(base_colour, metalness, roughness, fresnel_of(PLAIN_DIELECTRIC, base_colour, metalness));
}

// The same surface with the albedos of its lobes towards a viewer at the cosine `n_v`, from the table at this address (`split_sum`). Without
// them its facets scatter light once.
Bsdf towards_viewer(uvec2 table, Bsdf b, float n_v) {
    b.lobe = split_sum(table, sqrt(b.alpha), n_v);
    if (b.coat > 0.0) b.coat_lobe = split_sum(table, sqrt(b.coat_alpha), n_v);
    return b;
}

// Unpolarised Fresnel reflectance of a dielectric, by the cosine on this side and the relative index `eta`; 1 for total internal
// reflection.
float dielectric_f(float cosine, float eta) {
    float g2 = eta * eta - 1.0 + cosine * cosine;
    if (g2 <= 0.0) return 1.0;
    float g = sqrt(g2);
    // Cook and Torrance 1982, "A Reflectance Model for Computer Graphics", section "Fresnel term".
    float a = (g - cosine) / (g + cosine);
    float b = (cosine * (g + cosine) - 1.0) / (cosine * (g - cosine) + 1.0);
    // Equal indices give 0 / 0 at grazing incidence only.
    return 0.5 * a * a * (1.0 + b * b);
}

// Fresnel reflectance of a microfacet of glass. KHR_materials_specular changes it at normal and grazing incidence, with the exact Fresnel
// curve in between. Total internal reflection stays total.
vec3 glass_f(Bsdf b, float cosine) {
    float f = dielectric_f(cosine, b.eta);
    if (f >= 1.0) return vec3(1.0);
    float normal_f = (b.eta - 1.0) / (b.eta + 1.0);
    float f0 = normal_f * normal_f;
    float t = max(f - f0, 0.0) / (1.0 - f0);
    return vec3(f) - (1.0 - t) * b.less.f0 - vec3(t * b.less.f90);
}

// Share of light that a microfacet of glass does not transmit: the strongest channel of its reflectance, for all channels.
float stopped_by_glass(Bsdf b, float cosine) {
    vec3 f = glass_f(b, cosine);
    return max(f.r, max(f.g, f.b));
}

// GGX of a local half vector (Walter et al. 2007, "Microfacet Models for Refraction through Rough Surfaces", equation 33), per steradian:
//   D = a² / (pi ((n·h)² (a² - 1) + 1)²)
// With 1 - (n·h)² = |n × h|² the bracket becomes |n × h|² + a² (n·h)², which has no cancellation near the peak. `n·h < 0` gives 0.
float local_d(vec3 h, float alpha) {
    if (h.z <= 0.0) return 0.0;
    float scaled = alpha * h.z;
    float ratio = alpha / (dot(h.xy, h.xy) + scaled * scaled);
    return ratio * ratio / PI;
}

// Smith masking G1 of one direction, by its cosine (Walter et al. 2007, equation 34); 0 on the horizon.
float smith_g1(float cosine, float alpha) {
    float c2 = cosine * cosine;
    return 2.0 * cosine / (cosine + sqrt(alpha * alpha * (1.0 - c2) + c2));
}

// Pdf of sample_visible_normal, per steradian of the half vector.
float visible_normal_pdf(vec3 v, vec3 h, float alpha) {
    return smith_g1(v.z, alpha) * local_d(h, alpha) * max(dot(v, h), 0.0) / v.z;
}

// The half vector of refraction, on the side of the viewer (Walter et al. 2007, equation 16).
vec3 refraction_half(Bsdf b, vec3 v, vec3 l) {
    vec3 h = safe_normalize(-(v + b.eta * l), vec3(0.0, 0.0, 1.0));
    return h.z < 0.0 ? -h : h;
}

vec3 mirrored(vec3 l) {
    return vec3(l.xy, -l.z);
}

// Share of light that the facets of the clear coat reflect, by the view direction alone.
float coat_share(Bsdf b, vec3 v) {
    return b.coat * schlick(vec3(DIELECTRIC_F0), 1.0, v.z).x;
}

// What the coat's lobe is multiplied with beside its share.
float coat_scattered_again(Bsdf b) {
    return scattered_again(vec3(DIELECTRIC_F0), b.coat_lobe).x;
}

// Albedo of the coat's lobe: its share times E, and what scatters again.
float coat_albedo(Bsdf b, vec3 v) {
    return coat_share(b, v) * (b.coat_lobe.a + b.coat_lobe.b) * coat_scattered_again(b);
}

// Share of light that reaches what is below the coat, and comes back from there: all that the coat does not reflect. With the
// single-scattering model the coat's share is missing there whatever its lobe returns.
float below_coat(Bsdf b, vec3 v) {
    return 1.0 - coat_share(b, v) * coat_scattered_again(b) / (1.0 + b.coat_lobe.again);
}

// Alpha of the narrower of the specular lobes of base and coat.
float narrowest_alpha(Bsdf b) {
    return b.coat > 0.0 ? min(b.alpha, b.coat_alpha) : b.alpha;
}

// Transmission times |n·l|. Radiance scales with the square of the index across an interface; a path that goes in and out again gets it
// back.
vec3 transmission_cosine(Bsdf b, vec3 v, vec3 l) {
    if (b.thin) {
        vec3 m = mirrored(l);
        vec3 h = safe_normalize(v + m, vec3(0.0, 0.0, 1.0));
        float f = stopped_by_glass(b, max(dot(v, h), 0.0));
        return b.base_colour * ((1.0 - f) * local_d(h, b.alpha) * smith_v_cosine(m.z, v.z, b.alpha));
    }
    vec3 h = refraction_half(b, v, l);
    float v_h = dot(v, h);
    float l_h = dot(l, h);
    if (v_h <= 0.0 || l_h >= 0.0) return vec3(0.0);
    // Walter et al. 2007, equation 21, over the squared index behind; masking and shadowing by height-correlated Smith, as above.
    float bend = v_h + b.eta * l_h;
    float visible = 4.0 * smith_v_cosine(-l.z, v.z, b.alpha);
    return b.base_colour * ((1.0 - stopped_by_glass(b, v_h)) * local_d(h, b.alpha) * visible * v_h * -l_h / (bend * bend));
}

// Share of light, per channel, that passes straight through a thin sheet that is as smooth as alpha can be; 0 for all others. It is the
// limit of the transmission lobe as its width goes to 0. `cosine`: of either direction with the normal.
vec3 straight_transmission(Bsdf b, float cosine) {
    if (!b.thin || b.transmission <= 0.0 || b.alpha > MIN_ALPHA) return vec3(0.0);
    float facing = min(cosine, 1.0);
    return b.base_colour * (below_coat(b, vec3(0.0, 0.0, facing)) * b.transmission * (1.0 - stopped_by_glass(b, facing)));
}

// BSDF times |n·l|, per steradian, of the selected lobes.
vec3 bsdf_cosine(Bsdf b, vec3 v, vec3 l, uint lobes) {
    float below = below_coat(b, v);
    if (l.z <= 0.0) {
        if ((lobes & LOBE_TRANSMISSION) == 0u || b.transmission <= 0.0 || l.z == 0.0) return vec3(0.0);
        return below * b.transmission * transmission_cosine(b, v, l);
    }
    vec3 sum = vec3(0.0);
    vec3 h = safe_normalize(v + l, vec3(0.0, 0.0, 1.0));
    if ((lobes & LOBE_DIFFUSE) != 0u && b.metalness < 1.0) {
        vec3 albedo = (1.0 - b.metalness) * b.base_colour;
        sum += below * (1.0 - b.transmission) * diffuse_cosine(b.fresnel, albedo, v.z, l.z);
    }
    if ((lobes & LOBE_SPECULAR) != 0u) {
        float v_h = max(dot(v, h), 0.0);
        vec3 f = (1.0 - b.transmission) * schlick_f(b.fresnel, v_h) * scattered_again(b.fresnel.f0, b.lobe);
        if (b.transmission > 0.0) f += b.transmission * glass_f(b, v_h);
        sum += below * f * (local_d(h, b.alpha) * smith_v_cosine(l.z, v.z, b.alpha));
        if (b.coat > 0.0) {
            float coat = coat_share(b, v) * coat_scattered_again(b);
            sum += coat * local_d(h, b.coat_alpha) * smith_v_cosine(l.z, v.z, b.coat_alpha);
        }
    }
    return sum;
}

// Probability of sampling each lobe: diffuse, specular, glass, coat. Roughly what they reflect, and above 0 wherever a lobe contributes.
// All 0 if none of the selected lobes does. Glass is one lobe whose facets reflect or transmit by Fresnel.
vec4 lobe_probabilities(Bsdf b, vec3 v, uint lobes) {
    const float LEAST = 0.05;
    float coat = coat_share(b, v);
    vec3 f = schlick_f(b.fresnel, v.z);
    float base = max(b.base_colour.r, max(b.base_colour.g, b.base_colour.b));
    float reflected = max(f.r, max(f.g, f.b));
    float opaque = 1.0 - b.transmission;
    vec4 probabilities = vec4(0.0);
    if ((lobes & LOBE_DIFFUSE) != 0u) probabilities.x = opaque * (1.0 - b.metalness) * base * max(1.0 - reflected, LEAST);
    if ((lobes & LOBE_SPECULAR) != 0u) {
        probabilities.y = opaque > 0.0 && has_reflection(b.fresnel) ? max(opaque * reflected, LEAST) : 0.0;
        probabilities.w = coat > 0.0 ? max(coat, LEAST) : 0.0;
    }
    if ((lobes & (LOBE_SPECULAR | LOBE_TRANSMISSION)) != 0u) probabilities.z = b.transmission;
    probabilities.xyz *= 1.0 - coat;
    float sum = probabilities.x + probabilities.y + probabilities.z + probabilities.w;
    return sum > 0.0 ? probabilities / sum : vec4(0.0);
}

// Probability with which a microfacet of glass reflects instead of transmitting.
float reflection_probability(Bsdf b, float v_h, uint lobes) {
    if ((lobes & LOBE_TRANSMISSION) == 0u) return 1.0;
    return (lobes & LOBE_SPECULAR) == 0u ? 0.0 : stopped_by_glass(b, v_h);
}

// Pdf of transmitted directions, per steradian.
float transmission_pdf(Bsdf b, vec3 v, vec3 l, uint lobes) {
    if (b.thin) {
        vec3 h = safe_normalize(v + mirrored(l), vec3(0.0, 0.0, 1.0));
        float v_h = dot(v, h);
        if (v_h <= 0.0) return 0.0;
        return (1.0 - reflection_probability(b, v_h, lobes)) * visible_normal_pdf(v, h, b.alpha) / (4.0 * v_h);
    }
    vec3 h = refraction_half(b, v, l);
    float v_h = dot(v, h);
    float l_h = dot(l, h);
    if (v_h <= 0.0 || l_h >= 0.0) return 0.0;
    float bend = v_h + b.eta * l_h;
    return (1.0 - reflection_probability(b, v_h, lobes)) * visible_normal_pdf(v, h, b.alpha) * b.eta * b.eta * -l_h / (bend * bend);
}

// Pdf with which `bsdf_sample` returns `l`, per steradian.
float bsdf_pdf(Bsdf b, vec3 v, vec3 l, uint lobes) {
    vec4 probabilities = lobe_probabilities(b, v, lobes);
    if (l.z < 0.0) return probabilities.z > 0.0 ? probabilities.z * transmission_pdf(b, v, l, lobes) : 0.0;
    float pdf = probabilities.x * l.z / PI;
    vec3 h = safe_normalize(v + l, vec3(0.0, 0.0, 1.0));
    float v_h = dot(v, h);
    if (v_h <= 0.0) return pdf;
    float facets = probabilities.y + probabilities.z * reflection_probability(b, v_h, lobes);
    pdf += facets * visible_normal_pdf(v, h, b.alpha) / (4.0 * v_h);
    if (probabilities.w > 0.0) pdf += probabilities.w * visible_normal_pdf(v, h, b.coat_alpha) / (4.0 * v_h);
    return pdf;
}

// Samples a direction towards light. False if the sample is lost: below the horizon, or a refraction that ends up on the wrong side.
// `choice` is uniform and independent of `u`.
bool bsdf_sample(Bsdf b, vec3 v, uint lobes, float choice, vec2 u, out vec3 l) {
    vec4 probabilities = lobe_probabilities(b, v, lobes);
    l = vec3(0.0, 0.0, 1.0);
    if (probabilities == vec4(0.0)) return false;
    if (choice < probabilities.x) {
        l = sample_cosine(u);
        return l.z > 0.0;
    }
    if (choice < probabilities.x + probabilities.z) {
        vec3 h = sample_visible_normal(v, b.alpha, u);
        // The rest of `choice` is uniform again.
        bool reflects = (choice - probabilities.x) / probabilities.z < reflection_probability(b, dot(v, h), lobes);
        if (reflects || b.thin) l = reflect(-v, h);
        else l = refract(-v, h, 1.0 / b.eta);
        if (b.thin && !reflects) l = mirrored(l);
        return reflects ? l.z > 0.0 : l.z < 0.0;
    }
    bool on_coat = choice >= probabilities.x + probabilities.z + probabilities.y && probabilities.w > 0.0;
    vec3 h = sample_visible_normal(v, on_coat ? b.coat_alpha : b.alpha, u);
    l = reflect(-v, h);
    return l.z > 0.0;
}

// Alpha of whichever specular lobe of an opaque surface reflects more, base or coat.
float strongest_alpha(Bsdf b, vec3 v) {
    vec4 probabilities = lobe_probabilities(b, v, LOBE_SPECULAR);
    return probabilities.w > probabilities.y ? b.coat_alpha : b.alpha;
}

// Samples a direction of the specular lobes of an opaque surface, base and coat, from two numbers: its pdf is that of `bsdf_sample` with
// LOBE_SPECULAR. False if the sample is lost below the horizon.
bool sample_specular(Bsdf b, vec3 v, vec2 u, out vec3 l) {
    vec4 probabilities = lobe_probabilities(b, v, LOBE_SPECULAR);
    bool on_coat = probabilities.w > 0.0 && u.x >= probabilities.y;
    // The rest of the number is uniform again.
    u.x = on_coat ? (u.x - probabilities.y) / probabilities.w : u.x / max(probabilities.y, 1e-6);
    l = reflect(-v, sample_visible_normal(v, on_coat ? b.coat_alpha : b.alpha, u));
    return l.z > 0.0;
}

// Albedo of the specular lobes of an opaque surface, base and coat, towards the viewer for whom it was made (`towards_viewer`), at the cosine
// `n_v`.
vec3 specular_albedo(Bsdf b, float n_v) {
    vec3 v = vec3(0.0, 0.0, n_v);
    return below_coat(b, v) * environment_brdf(b.fresnel, b.lobe) + coat_albedo(b, v);
}

// Albedo of its diffuse lobe.
vec3 diffuse_albedo(Bsdf b, float n_v) {
    return below_coat(b, vec3(0.0, 0.0, n_v)) * diffuse_albedo(b.fresnel, (1.0 - b.metalness) * b.base_colour, n_v);
}

// Light is divided by an albedo before denoising and multiplied with it afterwards (demodulation). Surfaces that reflect less than this have no
// visible noise.
const float LEAST_REFLECTANCE = 1e-3;

// Albedo of an opaque surface towards that viewer, above 0.
vec3 reflectance(Bsdf b, float n_v) {
    return max(diffuse_albedo(b, n_v) + specular_albedo(b, n_v), vec3(LEAST_REFLECTANCE));
}

// Of its diffuse lobe alone, above 0.
vec3 diffuse_reflectance(Bsdf b, float n_v) {
    return max(diffuse_albedo(b, n_v), vec3(LEAST_REFLECTANCE));
}

// Of its specular lobes alone, above 0.
vec3 specular_reflectance(Bsdf b, float n_v) {
    return max(specular_albedo(b, n_v), vec3(LEAST_REFLECTANCE));
}

#endif
