#version 460
#extension GL_GOOGLE_include_directive : require
#include "lib/bindless.glsl"
#include "shared/acceleration.glsl"
#include "shared/scene.glsl"
// Refits the boxes of a BVH to vertices that have moved; the topology stays. One workgroup per BVH goes from the deepest level to the root.
// Exact boxes are kept beside the quantised ones, so that boxes do not grow from level to level.
layout(local_size_x = REFIT_GROUP) in;
layout(push_constant, scalar) uniform Push { RefitParams params; };

// As `Levels` in engine/src/ray/fit.rs, which explains each: exponent of the finest cell, and factors that outweigh rounding.
const int FINEST = -60;
const float MORE_EXTENT = 1.0 + exp2(-20.0);
const float LESS = 1.0 - exp2(-21.0);
const float MORE = 1.0 + exp2(-21.0);
const float INFINITE = uintBitsToFloat(0x7f800000u);

// Exponent of the smallest power of two of which 255 cover `extent`.
int cell_exponent(float extent) {
    float wanted = extent * MORE_EXTENT / 255.0;
    int exponent;
    // frexp: the number is fraction * 2^exponent with a fraction of at least one half, so this power is not too small.
    float fraction = frexp(wanted, exponent);
    if (fraction == 0.5) exponent -= 1;
    exponent = max(exponent, FINEST);
    // The division above may have rounded down.
    return 255.0 * ldexp(1.0, exponent) < extent * MORE_EXTENT ? exponent + 1 : exponent;
}

void fit(RefitJob job, uint index) {
    BvhNode node = BvhNodeBuffer(job.nodes).at[index];
    NodeBoxBuffer boxes = NodeBoxBuffer(job.boxes);
    PositionBuffer positions = PositionBuffer(job.positions);
    BvhPrimitiveBuffer primitives = BvhPrimitiveBuffer(job.primitives);
    uint inner = node.exponents_and_mask >> 24;

    // Boxes of the children, and their union.
    vec3 lower[8];
    vec3 upper[8];
    vec3 least = vec3(INFINITE);
    vec3 greatest = vec3(-INFINITE);
    for (uint slot = 0u; slot < 8u; ++slot) {
        lower[slot] = vec3(INFINITE);
        upper[slot] = vec3(-INFINITE);
        uint meta = (node.meta[slot / 4u] >> (8u * (slot % 4u))) & 255u;
        if (meta == 0u) continue;
        if ((inner & (1u << slot)) != 0u) {
            NodeBox child = boxes.at[node.child_base + uint(bitCount(inner & ((1u << slot) - 1u)))];
            lower[slot] = child.lower;
            upper[slot] = child.upper;
        } else {
            uint first = node.primitive_base + (meta & 31u);
            for (uint i = 0u; i < uint(bitCount(meta >> 5)); ++i) {
                uvec3 corners = primitives.at[first + i].corners;
                vec3 a = positions.at[corners.x];
                vec3 b = positions.at[corners.y];
                vec3 c = positions.at[corners.z];
                lower[slot] = min(lower[slot], min(a, min(b, c)));
                upper[slot] = max(upper[slot], max(a, max(b, c)));
            }
        }
        least = min(least, lower[slot]);
        greatest = max(greatest, upper[slot]);
    }
    NodeBoxBufferWrite(job.boxes).at[index] = NodeBox(least, greatest);

    // Quantised, rounded outwards.
    ivec3 exponents = ivec3(cell_exponent(greatest.x - least.x), cell_exponent(greatest.y - least.y), cell_exponent(greatest.z - least.z));
    vec3 cells = ldexp(vec3(1.0), exponents);
    uvec2 planes_min[3] = uvec2[3](uvec2(0u), uvec2(0u), uvec2(0u));
    uvec2 planes_max[3] = uvec2[3](uvec2(0u), uvec2(0u), uvec2(0u));
    for (uint slot = 0u; slot < 8u; ++slot) {
        if (!(lower[slot].x <= upper[slot].x)) continue;
        uvec3 from = uvec3(floor((lower[slot] - least) / cells * LESS));
        uvec3 to = min(uvec3(ceil((upper[slot] - least) / cells * MORE)), uvec3(255u));
        uint word = slot / 4u;
        uint shift = 8u * (slot % 4u);
        for (int axis = 0; axis < 3; ++axis) {
            planes_min[axis][word] |= from[axis] << shift;
            planes_max[axis][word] |= to[axis] << shift;
        }
    }
    uvec3 biased = uvec3(exponents + 127);
    node.origin = least;
    node.exponents_and_mask = (node.exponents_and_mask & 0xff000000u) | biased.x | biased.y << 8 | biased.z << 16;
    node.min_x = planes_min[0];
    node.max_x = planes_max[0];
    node.min_y = planes_min[1];
    node.max_y = planes_max[1];
    node.min_z = planes_min[2];
    node.max_z = planes_max[2];
    BvhNodeBufferWrite(job.nodes).at[index] = node;
}

void main() {
    RefitJob job = RefitJobBuffer(params.jobs).at[gl_WorkGroupID.x];
    WordBuffer order = WordBuffer(job.order);
    WordBuffer levels = WordBuffer(job.levels);
    for (uint level = 0u; level < job.level_count; ++level) {
        for (uint at = levels.at[level] + gl_LocalInvocationID.x; at < levels.at[level + 1u]; at += REFIT_GROUP) {
            fit(job, order.at[at]);
        }
        memoryBarrierBuffer();
        barrier();
    }
}
