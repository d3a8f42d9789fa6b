#version 460
#extension GL_GOOGLE_include_directive : require
#include "lib/bindless.glsl"
#include "shared/probe.glsl"
// Means of 2x2, 4x4, up to 64x64 texels of each face, all in one dispatch: a thread has 8x8 texels, a workgroup 64x64 of one face.
layout(local_size_x = 8, local_size_y = 8) in;
layout(push_constant, scalar) uniform Push { MeansParams params; };

shared vec4 means[8][8];

void put(uint mip, ivec2 at, int face, vec4 value) {
    if (mip < params.count && all(lessThan(at, ivec2(params.side >> mip)))) store_layer(params.mips[mip], at, face, value);
}

void main() {
    // Faces of fewer than 64 texels have a workgroup each too.
    int groups = max(int(params.side) / 64, 1);
    int face = int(gl_WorkGroupID.y) / groups;
    ivec2 own = ivec2(gl_LocalInvocationID.xy);
    ivec2 first = (ivec2(gl_WorkGroupID.x, int(gl_WorkGroupID.y) % groups) * 8 + own) * 8;
    vec4 of_eight = vec4(0.0);
    if (all(lessThan(first, ivec2(params.side)))) {
        for (int b = 0; b < 2; b++) {
            for (int a = 0; a < 2; a++) {
                vec4 of_four = vec4(0.0);
                for (int k = 0; k < 4; k++) {
                    ivec2 corner = first + ivec2(a, b) * 4 + ivec2(k % 2, k / 2) * 2;
                    vec4 of_two = vec4(0.0);
                    for (int j = 0; j < 4; j++) {
                        ivec2 at = corner + ivec2(j % 2, j / 2);
                        vec4 texel = load_layer(params.radiance, at, face);
                        put(0u, at, face, texel);
                        of_two += 0.25 * texel;
                    }
                    put(1u, corner / 2, face, of_two);
                    of_four += 0.25 * of_two;
                }
                put(2u, first / 4 + ivec2(a, b), face, of_four);
                of_eight += 0.25 * of_four;
            }
        }
        put(3u, first / 8, face, of_eight);
    }
    // The rest in the workgroup. Smaller faces fill a corner of it, whose means are complete.
    means[own.y][own.x] = of_eight;
    for (uint mip = 4u; mip < 7u; mip++) {
        barrier();
        int step = 1 << (mip - 3u);
        if (all(equal(own % step, ivec2(0)))) {
            int half_step = step / 2;
            vec4 sum = means[own.y][own.x] + means[own.y][own.x + half_step] + means[own.y + half_step][own.x]
                + means[own.y + half_step][own.x + half_step];
            means[own.y][own.x] = 0.25 * sum;
            put(mip, first >> mip, face, 0.25 * sum);
        }
    }
}
