#ifndef LIB_BRDF_GLSL
#define LIB_BRDF_GLSL
#include "lib/bindless.glsl"
#include "lib/vector.glsl"
#include "shared/lobe_albedo.glsl"
// The surface model: GGX over coupled Lambert. Materials and specular part are those of glTF 2.0, appendix B:
//   f = D V F (1 + F0 (1 - E) / E) + diffuse,   F0 = mix(dielectric F0, base_colour, metalness)
// where the bracket gives back what scatters more than once between the microfacets (`scattered_again`).
// glTF's diffuse part, (1 - F(v·h)) base_colour / pi, is not used: at grazing angles the sum reflects up to 1.7 times the incident light.

// Reflectance of a dielectric at normal incidence: index of refraction 1.5.
const float DIELECTRIC_F0 = 0.04;

// Reflectance of the dielectric part of a material (KHR_materials_ior, KHR_materials_specular).
struct Dielectric {
    vec3 f0;    // at normal incidence
    float f90;  // at grazing incidence
};

const Dielectric PLAIN_DIELECTRIC = Dielectric(vec3(DIELECTRIC_F0), 1.0);

// Parameters of Schlick's approximation (Schlick 1994, "An Inexpensive BRDF Model for Physically-Based Rendering", equation 15).
struct Fresnel {
    vec3 f0;              // at normal incidence
    float f90;            // at grazing incidence
    vec3 over_base;       // f0 for the diffuse part below: of a dielectric, its strongest channel in all three
    float diffuse_share;  // factor of the diffuse part
};

// Factor that conserves energy: rough lobes reflect more than F(n·v), by 0.26 % of what is not reflected at most, which is at roughness 0.38
// and an f0 of 0. It rises to 1 as the reflection gets weaker, where the surface is exactly Lambertian.
const float DIFFUSE_SHARE = 0.9974;

// Lower limit of alpha. Point lights are infinitely small, and a perfect mirror would show them infinitely bright. At 0.002 (perceptual
// roughness 0.045) the highlight is some 0.3 degrees wide, narrower than the disc of the sun.
const float MIN_ALPHA = 0.002;

// alpha = roughness² (Burley 2012, "Physically-Based Shading at Disney"), at least MIN_ALPHA.
float alpha_of_roughness(float roughness) {
    return max(roughness * roughness, MIN_ALPHA);
}

// Height-correlated Smith visibility V = G2 / (4 n·l n·v) (Heitz 2014, "Understanding the Masking-Shadowing Function",
// JCGT 3(2), equation 99), times n·l:
//   V n·l = n·l / (2 (n·l sqrt(a² + (1 - a²) (n·v)²) + n·v sqrt(a² + (1 - a²) (n·l)²)))
// V alone grows without bound when both cosines go to 0; the product stays below 1 / (2 a). Dividing both cosines by the larger one
// keeps the quotient defined down to the smallest floats. Cosines in 0..1; `n·l = 0` gives 0.
float smith_v_cosine(float n_l, float n_v, float alpha) {
    float largest = max(n_l, n_v);
    if (n_l <= 0.0 || largest <= 0.0) return 0.0;
    float a2 = alpha * alpha;
    float view_root = sqrt(a2 + (1.0 - a2) * n_v * n_v);
    float light_root = sqrt(a2 + (1.0 - a2) * n_l * n_l);
    float l = n_l / largest;
    float v = n_v / largest;
    return 0.5 * l / (l * view_root + v * light_root);
}

// Reflectance at grazing incidence: 1, falling to 0 below the 2 % that no real material undercuts, so that black is black
// (Lagarde and de Rousiers 2014, "Moving Frostbite to Physically Based Rendering", section 3.1.1).
float specular_f90(vec3 f0) {
    return min(50.0 * max(max(f0.r, f0.g), f0.b), 1.0);
}

// The dielectric part of a material. `strength` 0 to 1, `colour` at least 0: `specular` and `specularColor` of KHR_materials_specular,
// which has f90 = strength. As above, an index of refraction near 1 takes it down.
Dielectric dielectric_of(float ior, float strength, vec3 colour) {
    float normal_f = (ior - 1.0) / (ior + 1.0);
    float f0 = normal_f * normal_f;
    return Dielectric(min(f0 * colour, vec3(1.0)) * strength, specular_f90(vec3(f0)) * strength);
}

// For a coloured dielectric reflection the diffuse part uses the strongest channel in all three, so that it does not take on the
// complementary colour (KHR_materials_specular, `max_value` of `fresnel_mix`).
Fresnel fresnel_of(Dielectric d, vec3 base_colour, float metalness) {
    float strongest = max(d.f0.r, max(d.f0.g, d.f0.b));
    float grazing = specular_f90(mix(vec3(DIELECTRIC_F0), base_colour, metalness));
    // Written so that a dielectric with an f90 of 1 gets exactly 1.
    float kept = 1.0 - (1.0 - metalness) * (1.0 - d.f90);
    vec3 over_base = mix(vec3(strongest), base_colour, metalness);
    return Fresnel(mix(d.f0, base_colour, metalness), grazing * kept, over_base, mix(1.0, DIFFUSE_SHARE, kept));
}

// Fresnel reflectance from f0 and f90, equation 15.
vec3 schlick(vec3 f0, float f90, float v_h) {
    float m = clamp(1.0 - v_h, 0.0, 1.0);
    float m2 = m * m;
    return f0 + (vec3(f90) - f0) * (m2 * m2 * m);
}

vec3 schlick_f(Fresnel f, float v_h) {
    return schlick(f.f0, f.f90, v_h);
}

// Whether the surface reflects anything specularly.
bool has_reflection(Fresnel f) {
    return f.f0 != vec3(0.0) || f.f90 > 0.0;
}

// Share of light that enters the surface, 1 - F, at a cosine.
vec3 passed_f(Fresnel f, float cosine) {
    return vec3(1.0) - schlick(f.over_base, f.f90, cosine);
}

// Diffuse reflection under a Fresnel interface, times n·l, per steradian: light enters with 1 - F(n·l), leaves with 1 - F(n·v), and is
// normalised so that a smooth surface over white reflects all light (Shirley, Hu, Smits and Lafortune 1997, "A Practitioners' Assessment of
// Light Reflection Models", section 3).
// `albedo`: (1 - metalness) base_colour. 0 below the horizon.
vec3 diffuse_cosine(Fresnel f, vec3 albedo, float n_v, float n_l) {
    // The cosine-weighted mean of F over the hemisphere is f0 + (f90 - f0) / 21. A perfect mirror would be 0 / 0 here: its diffuse part is
    // 0.
    vec3 held = vec3(1.0) - f.over_base - (vec3(f.f90) - f.over_base) / 21.0;
    vec3 passed = passed_f(f, n_l) * passed_f(f, n_v);
    return albedo * (max(n_l, 0.0) * f.diffuse_share / PI) * (passed / max(held, vec3(1e-6)));
}

// Its directional albedo: the integral over n·l.
vec3 diffuse_albedo(Fresnel f, vec3 albedo, float n_v) {
    return albedo * f.diffuse_share * passed_f(f, n_v);
}

// What light from a cosine-distributed direction counts in the mean, over that albedo.
vec3 diffuse_weight(Fresnel f, float n_l) {
    vec3 held = vec3(1.0) - f.over_base - (vec3(f.f90) - f.over_base) / 21.0;
    return passed_f(f, n_l) / max(held, vec3(1e-6));
}

// Directional albedo of the specular lobe: the integral of D V F n·l over the hemisphere is f0 a + f90 b, as Schlick's F is linear in both
// (Karis 2013, "Real Shading in Unreal Engine 4", the "split sum"). With F = 1 it is E = a + b: the share 1 - E of the light is scattered
// between the microfacets again.
struct SplitSum {
    float a;
    float b;
    float again;  // (1 - E) / E, or 0 with the single-scattering model
};

// For lobes that scatter once and whose albedo is not asked for.
const SplitSum NO_SPLIT_SUM = SplitSum(0.0, 0.0, 0.0);

// Roughness of the table's first row: below, alpha does not change.
const float LEAST_ROUGHNESS = sqrt(MIN_ALPHA);

// From the table at the address `table`, `lobe_albedo` of the view and of the scene's root: blended between the four nearest of its entries,
// which are evenly spaced over the fourth root of the cosine `n_v`, 0 to 1, since smooth surfaces lose light at cosines as small as their
// alpha, and over roughness from LEAST_ROUGHNESS to 1.
SplitSum split_sum(uvec2 table, float roughness, float n_v) {
    float row = (max(roughness, LEAST_ROUGHNESS) - LEAST_ROUGHNESS) / (1.0 - LEAST_ROUGHNESS);
    vec2 at = vec2(sqrt(sqrt(n_v)), row) * float(LOBE_ALBEDO_SIZE - 1u);
    uvec2 low = min(uvec2(at), uvec2(LOBE_ALBEDO_SIZE - 2u));
    vec2 part = at - vec2(low);
    LobeAlbedoBuffer entries = LobeAlbedoBuffer(table);
    uint first = low.y * LOBE_ALBEDO_SIZE + low.x;
    LobeAlbedo near_smooth = entries.at[first], far_smooth = entries.at[first + 1u];
    LobeAlbedo near_rough = entries.at[first + LOBE_ALBEDO_SIZE], far_rough = entries.at[first + LOBE_ALBEDO_SIZE + 1u];
    vec2 smooth_side = mix(vec2(near_smooth.a, near_smooth.b), vec2(far_smooth.a, far_smooth.b), part.x);
    vec2 rough_side = mix(vec2(near_rough.a, near_rough.b), vec2(far_rough.a, far_rough.b), part.x);
    vec2 both = mix(smooth_side, rough_side, part.y);
    return SplitSum(both.x, both.y, near_smooth.given_back * (1.0 / (both.x + both.y) - 1.0));
}

// Factor of the specular lobe that gives back the light of further scatterings between microfacets, each of which takes f0 (Turquin 2019,
// "Practical multiple scattering compensation for microfacet models"). It depends on the viewer's angle alone, so the lobe is
// not reciprocal. As f0 a + f90 b is at most E, the albedo stays below E + f0 (1 - E), for every f90.
vec3 scattered_again(vec3 f0, SplitSum lobe) {
    return vec3(1.0) + f0 * lobe.again;
}

// Directional albedo of the specular lobe towards a viewer.
vec3 environment_brdf(Fresnel f, SplitSum lobe) {
    return (f.f0 * lobe.a + f.f90 * lobe.b) * scattered_again(f.f0, lobe);
}

// The same from the table.
vec3 environment_brdf(uvec2 table, Fresnel f, float roughness, float n_v) {
    return environment_brdf(f, split_sum(table, roughness, n_v));
}

#endif
