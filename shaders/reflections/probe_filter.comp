#version 460
#extension GL_GOOGLE_include_directive : require
#include "lib/bindless.glsl"
#include "lib/bsdf.glsl"
#include "lib/precision.glsl"
#include "lib/probe.glsl"
#include "lib/sampling.glsl"
#include "lib/sequence.glsl"
// Lobes of GGX over a probe, a roughness per mip: importance sampling of a signal that was blurred by the solid angle of each sample
// (Krivanek and Colbert 2008, "Real-time Shading with Filtered Importance Sampling"), with viewer and normal in the direction of the lobe
// (Karis 2013, "Real Shading in Unreal Engine 4"). A thread per texel of all mips and faces.
layout(local_size_x = 8, local_size_y = 8) in;
layout(push_constant, scalar) uniform Push { ProbeFilterParams params; };

vec4 lobe(vec3 axis, float roughness) {
    float alpha = alpha_of_roughness(roughness);
    mat3 frame = frame_of(axis);
    vec4 sum = vec4(0.0);
    float weights = 0.0;
    for (uint i = 0u; i < params.samples; i++) {
        // Hammersley points, of the middle of their intervals.
        vec2 u = vec2((float(i) + 0.5) / float(params.samples), float(bitfieldReverse(i)) * exp2(-32.0));
        // cos of the half vector's angle, distributed as D n·h (Walter et al. 2007, equation 35).
        float cosine = sqrt((1.0 - u.x) / (1.0 + (alpha * alpha - 1.0) * u.x));
        vec3 h = around_z(2.0 * PI * u.y, sqrt(max(1.0 - cosine * cosine, 0.0)), cosine);
        vec3 l = reflect(vec3(0.0, 0.0, -1.0), h);
        if (l.z <= 0.0) continue;
        // D n·h / (4 v·h) with v = n.
        float pdf = 0.25 * local_d(h, alpha);
        vec3 d = frame * l;
        vec2 at;
        uint face = cube_face(d, at);
        float ratio = 1.0 / (float(params.samples) * pdf * cube_solid_angle(at, float(params.side)));
        float level = params.filtered != 0u ? clamp(0.5 * log2(ratio), 0.0, float(params.mean_mips)) : 0.0;
        vec4 value = sample_layer(params.means, params.sampler_id, cube_uv(at, float(params.side)), float(face), level);
        if (!is_taken(params.not_finite, value)) continue;
        // Distances are blurred as reciprocals, along the direction itself.
        sum += l.z * vec4(value.rgb, value.a * largest_component(d));
        weights += l.z;
    }
    return weights > 0.0 ? sum / weights : vec4(0.0);
}

void main() {
    uint index = gl_GlobalInvocationID.y * params.width + gl_GlobalInvocationID.x;
    uint mip = 0u, face = 0u, side = 0u, at = 0u;
    bool found = false;
    for (uint f = 0u; f < PROBE_FACES && !found; f++) {
        if ((params.faces & (1u << f)) == 0u) continue;
        for (uint m = 0u; m < params.count && !found; m++) {
            uint of_mip = params.side >> (m + 1u);
            if (index < of_mip * of_mip) {
                found = true;
                mip = m;
                face = f;
                side = of_mip;
                at = index;
            } else {
                index -= of_mip * of_mip;
            }
        }
    }
    vec4 value = vec4(0.0);
    ivec2 texel = ivec2(0);
    if (found) {
        texel = ivec2(at % side, at / side);
        vec3 axis = normalize(cube_direction(face, cube_at(texel, side)));
        value = lobe(axis, float(mip + 1u) / float(params.count));
        value.a /= largest_component(axis);
        value = vec4(representable(value.rgb, 65504.0), representable(value.aaa, 65504.0).x);
    }
    for (uint m = 0u; m < params.count; m++) {
        if (found && m == mip) store_layer(params.mips[m], texel, int(face), value);
    }
}
