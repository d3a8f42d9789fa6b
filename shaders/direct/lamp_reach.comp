#version 460
#extension GL_GOOGLE_include_directive : require
#include "lib/bindless.glsl"
#include "lib/lamp_clusters.glsl"
#include "lib/lights.glsl"
#include "shared/scene.glsl"
// How far each lamp reaches: where its irradiance falls to a limit that is the same for all. The limit is such that at a place among the lamps
// `near` of them reach, in the mean. One workgroup.
layout(local_size_x = REACH_GROUP) in;
layout(push_constant, scalar) uniform Push { LampReachParams params; };

layout(buffer_reference, scalar, buffer_reference_align = 4) readonly buffer Blocks { uvec2 at[]; };

// Intensities in steps of a factor of sqrt(2) from 2^-64.
const uint BINS = 256u;
const float FIRST = -64.0;
// Lamps closer together than this part of the farthest depth count as that far apart.
const float LEAST_EXTENT = 0.0625;

shared uint least_depth, greatest_depth;
shared vec3 lows[REACH_GROUP];
shared vec3 highs[REACH_GROUP];
shared uint bins[BINS];
shared uint best[2];

// Greatest radiant intensity of a lamp.
float intensity_of(Light light) {
    return lamp_area(light) * luminance(light.intensity);
}

// log2 of a factor: lamps of an intensity of 1 reach so many metres.
float candidate(float first, float step, uint k) {
    return first + step * float(k);
}

// Lamps that reach a place, in the mean, if each is a cube around a place anywhere within the box of all, widened by it.
float mean_near(float factor, vec3 extent) {
    float sum = 0.0;
    for (uint b = 0u; b < BINS; b++) {
        if (bins[b] == 0u) continue;
        float width = 2.0 * exp2(factor + 0.5 * (FIRST + 0.5 * (float(b) + 0.5)));
        vec3 shares = width / (extent + width);
        sum += float(bins[b]) * shares.x * shares.y * shares.z;
    }
    return sum;
}

// The greatest candidate at which no more lamps are near than there shall be; the count if that holds for all.
uint search(uint round, float first, float step, vec3 extent) {
    uint thread = gl_LocalInvocationIndex;
    if (mean_near(candidate(first, step, thread), extent) <= params.near) atomicMax(best[round], thread + 1u);
    barrier();
    return best[round];
}

void main() {
    uint thread = gl_LocalInvocationIndex;
    SceneBuffer scene = SceneBuffer(params.scene);
    LightBuffer lights = LightBuffer(scene.at[0].lights);
    uint count = scene.at[0].light_count;
    if (thread < BINS) bins[thread] = 0u;
    if (thread < 2u) best[thread] = 0u;
    if (thread == 0u) {
        least_depth = floatBitsToUint(1.0 / 0.0);
        greatest_depth = 0u;
    }
    barrier();

    for (uint k = thread; k < params.block_count; k += REACH_GROUP) {
        uvec2 block = Blocks(params.blocks).at[k];
        atomicMin(least_depth, block.x);
        atomicMax(greatest_depth, block.y);
    }
    vec3 low = vec3(1.0 / 0.0), high = vec3(-1.0 / 0.0);
    for (uint i = thread; i < count; i += REACH_GROUP) {
        float intensity = intensity_of(lights.at[i]);
        if (lights.at[i].kind == LIGHT_DIRECTIONAL || !(intensity > 0.0)) continue;
        low = min(low, lights.at[i].position);
        high = max(high, lights.at[i].position);
        atomicAdd(bins[uint(clamp(2.0 * (log2(intensity) - FIRST), 0.0, float(BINS - 1u)))], 1u);
    }
    lows[thread] = low;
    highs[thread] = high;
    barrier();
    for (uint half_count = REACH_GROUP / 2u; half_count > 0u; half_count /= 2u) {
        if (thread < half_count) {
            lows[thread] = min(lows[thread], lows[thread + half_count]);
            highs[thread] = max(highs[thread], highs[thread + half_count]);
        }
        barrier();
    }

    ViewBuffer view = ViewBuffer(params.view);
    float per_depth = 1.0 / view.at[0].world_from_clip[2].w;
    bool any = greatest_depth > 0u;
    float nearest = any ? per_depth / uintBitsToFloat(greatest_depth) : 1.0;
    float farthest = any ? per_depth / uintBitsToFloat(least_depth) : 1.0;
    vec3 extent = max(highs[0] - lows[0], vec3(LEAST_EXTENT * farthest));
    const float STEP = 0.5;
    uint coarse = search(0u, FIRST, STEP, extent);
    float from = candidate(FIRST, STEP, max(coarse, 1u) - 1u);
    uint fine = search(1u, from, STEP / float(REACH_GROUP), extent);
    float factor = coarse == REACH_GROUP ? 1.0 / 0.0 : exp2(candidate(from, STEP / float(REACH_GROUP), max(fine, 1u) - 1u));

    for (uint i = thread; i < count; i += REACH_GROUP) {
        float intensity = intensity_of(lights.at[i]);
        bool everywhere = lights.at[i].kind == LIGHT_DIRECTIONAL;
        for (uint k = 0u; k < view.at[0].shadow_light_count; k++) everywhere = everywhere || view.at[0].shadow_lights[k] == i;
        float reach = intensity > 0.0 ? (everywhere ? 1.0 / 0.0 : sqrt(intensity) * factor) : 0.0;
        LampReachesWrite(params.tables.reaches).at[i] = vec4(lights.at[i].position, reach);
    }
    if (thread == 0u) {
        LampGrid grid;
        grid.tables = params.tables;
        // Powers of two, so that slices stay where they are while something passes the camera.
        grid.nearest = exp2(floor(log2(nearest)));
        grid.reach = factor;
        vec3 last = vec3(1.0 / 0.0);
        for (uint k = 0u; k < MAX_SHADOW_LIGHTS; k++) {
            uint light = k < view.at[0].shadow_light_count ? view.at[0].shadow_lights[k] : NO_LIGHT;
            if (light < count && lights.at[light].kind != LIGHT_DIRECTIONAL) last = lights.at[light].position;
            grid.everywhere[k] = last;
        }
        grid.octaves = max(ceil(log2(farthest / grid.nearest)), 1.0);
        LampGridBufferWrite(params.grid).at[0] = grid;
    }
}
