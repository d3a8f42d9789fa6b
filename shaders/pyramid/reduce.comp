#version 460
#extension GL_GOOGLE_include_directive : require
#include "lib/bindless.glsl"
#include "shared/pyramid.glsl"
// Up to four levels of an image pyramid: a workgroup reduces a square of 32 by 32 pixels.
layout(local_size_x = PYRAMID_GROUP, local_size_y = PYRAMID_GROUP) in;
layout(push_constant, scalar) uniform Push { PyramidParams params; };

shared vec4 values[PYRAMID_GROUP * PYRAMID_GROUP];

vec4 reduced(vec4 a, vec4 b, vec4 c, vec4 d) {
    if (params.content == PYRAMID_MEAN) return 0.25 * ((a + b) + (c + d));
    return vec4(min(min(a.x, b.x), min(c.x, d.x)), max(max(a.y, b.y), max(c.y, d.y)), 0.0, 0.0);
}

vec4 source(ivec2 p) {
    vec4 value = load_mip(params.source, min(p, ivec2(params.source_size) - 1), int(params.source_mip));
    return params.content == PYRAMID_FIRST_MIN_MAX ? value.xxxx : value;
}

void main() {
    ivec2 local = ivec2(gl_LocalInvocationID.xy);
    ivec2 pixel = ivec2(gl_GlobalInvocationID.xy);
    ivec2 p = 2 * pixel;
    vec4 value = reduced(source(p), source(p + ivec2(1, 0)), source(p + ivec2(0, 1)), source(p + ivec2(1, 1)));
    if (inside(pixel, params.size)) store(params.levels[0], pixel, value);
    uvec2 size = params.size;
    int side = int(PYRAMID_GROUP);
    for (uint level = 1u; level < params.count; level++) {
        // A square of `side` by `side` values becomes one of half that size.
        if (all(lessThan(local, ivec2(side)))) values[local.y * int(PYRAMID_GROUP) + local.x] = value;
        barrier();
        side /= 2;
        size = max(size / 2u, uvec2(1u));
        bool is_used = all(lessThan(local, ivec2(side)));
        if (is_used) {
            int first = 2 * (local.y * int(PYRAMID_GROUP) + local.x);
            value = reduced(values[first], values[first + 1], values[first + int(PYRAMID_GROUP)], values[first + int(PYRAMID_GROUP) + 1]);
            ivec2 target = side * ivec2(gl_WorkGroupID.xy) + local;
            if (inside(target, size)) store(params.levels[level], target, value);
        }
        barrier();
    }
}
