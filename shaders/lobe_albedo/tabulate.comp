#version 460
#extension GL_GOOGLE_include_directive : require
#include "lib/bindless.glsl"
#include "lib/bsdf.glsl"
#include "shared/lobe_albedo.glsl"
// Fills the tables of the specular lobe's directional albedo: the integrals of D V n.l (1 - c) and D V n.l c over the directions of light,
// c = (1 - v.h)^5, by sampling of visible normals (Karis 2013, "Real Shading in Unreal Engine 4", for this project's lobe).
layout(local_size_x = 8, local_size_y = 8) in;
layout(push_constant, scalar) uniform Push { TabulateParams params; };

// Entries at a cosine of 0 are computed for this one instead, where the albedo is within 1e-3 of its limit.
const float LEAST_COSINE = 1e-6;

void main() {
    uvec2 entry = gl_GlobalInvocationID.xy;
    if (any(greaterThanEqual(entry, uvec2(LOBE_ALBEDO_SIZE)))) return;
    vec2 at = vec2(entry) / float(LOBE_ALBEDO_SIZE - 1u);
    float n_v = max(at.x * at.x * at.x * at.x, LEAST_COSINE);
    float alpha = alpha_of_roughness(mix(LEAST_ROUGHNESS, 1.0, at.y));
    vec3 v = vec3(sqrt(1.0 - n_v * n_v), 0.0, n_v);
    // Sampled with the pdf of `visible_normal_pdf`, D V n.l becomes the ratio of G2 = 4 n.v V n.l to G1.
    float unmasked = 4.0 * n_v / smith_g1(n_v, alpha);
    float whole = 0.0, grazing = 0.0, densities = 0.0;
    for (uint ring = 0u; ring < LOBE_ALBEDO_RINGS; ring++) {
        // A grid, as the integrand is smooth, with the rings closest together where facets are steep: of smooth surfaces only those lose
        // light.
        float rest = 1.0 - (float(ring) + 0.5) / float(LOBE_ALBEDO_RINGS);
        float density = 4.0 * rest * rest * rest;
        densities += density;
        for (uint turn = 0u; turn < LOBE_ALBEDO_TURNS; turn++) {
            vec2 u = vec2(0.5 * (float(turn) + 0.5) / float(LOBE_ALBEDO_TURNS), 1.0 - rest * rest * rest * rest);
            vec3 h = sample_visible_normal(v, alpha, u);
            vec3 l = reflect(-v, h);
            if (l.z <= 0.0) continue;
            // Only rounding exceeds 1.
            float weight = density * min(smith_v_cosine(l.z, n_v, alpha) * unmasked, 1.0);
            whole += weight;
            grazing += weight * schlick(vec3(0.0), 1.0, dot(v, h)).x;
        }
    }
    float scale = 1.0 / (densities * float(LOBE_ALBEDO_TURNS));
    vec2 sum = vec2(min(whole * scale, 1.0) - grazing * scale, grazing * scale);
    uint index = entry.y * LOBE_ALBEDO_SIZE + entry.x;
    LobeAlbedoBufferWrite(params.table).at[index] = LobeAlbedo(sum.x, sum.y, 1.0);
    LobeAlbedoBufferWrite(params.table).at[index + LOBE_ALBEDO_SIZE * LOBE_ALBEDO_SIZE] = LobeAlbedo(sum.x, sum.y, 0.0);
}
