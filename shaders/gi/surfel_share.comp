#version 460
#extension GL_GOOGLE_include_directive : require
#include "lib/bindless.glsl"
#include "lib/gbuffer.glsl"
#include "lib/surfel_change.glsl"
#include "lib/surfel_guide.glsl"
#include "lib/surfel_plane.glsl"
#include "shared/denoise.glsl"
// Brings the light of surfels to where the picture looks it up. The youngest take the mean over the samples of others around them; surfel_widen.comp then asks
// farther away. Later they take what those share as a guess that counts as so many samples more; as the others do the same, light of ever more surfels is
// averaged from frame to frame, until their own samples are enough. What surfels keep for themselves is their own, but for light that they found by chance.
layout(local_size_x = SURFEL_GROUP) in;
layout(push_constant, scalar) uniform Push { SurfelShareParams params; };

layout(buffer_reference, scalar, buffer_reference_align = 4) buffer Placed { PlacedSurfel at[]; };

// Samples with which a surfel stands alone.
const float ALONE = 256.0;
// Samples that the guess counts for, ever less towards those with which a surfel stands alone. Where light has changed others may still share what it was: there
// the guess counts for no more than so many times a surfel's own.
const float GUESS = 128.0;
const float GUESS_OF_OWN = 4.0;
// A surfel with so many paths more than samples has thrown samples away because its light changed. With so many samples others have done so as well.
const float FORGOTTEN = 8.0;
const float RECOVERED = 32.0;
// Radii within which others are asked. The youngest ask within so many that others have ENOUGH samples, at most REACH.
const float ENOUGH = 64.0;
const float ASKED = 2.0;
// Samples with which a surfel is no longer one of the youngest: before, light has not spread everywhere, and what is shared would be what it was before.
const float YOUNGEST = 12.0;
// More samples than this do not make a surfel count more; for the youngest, more than so many times their own: who has not noticed a change has most.
const float SETTLED = 64.0;
const float MOST_OF_OWN = 2.0;
// Samples of the surfels of a cell, each twice, of which the youngest ask no more.
const float ENOUGH_OF_CELL = 256.0;
// Binary logarithm of the frames after which a surfel asks at the latest.
const float LONGEST_PERIOD = 3.0;
// One path that finds rare light makes its surfel a bright disc. What a surfel's own mean has beyond so many times what others share is excess, as far as it is
// unsure: by the standard error of the mean, over the mean. Excess does not light the surfel but its surroundings, to which it spreads from ask to ask.
const float LIKELY = 1.5;
const vec2 UNSURE = vec2(0.15, 0.3);
// Share of a surfel's own excess in what it passes on: the less, the wider and the later excess spreads.
const float OWN_EXCESS = 0.15;
// Excess beyond so many times the light around is left out until others have found such light.
const float MOST_EXCESS = 6.0;
// Share that a surfel keeps of its own mean at most where the means of others differ by no more than chance: there the guess knows more, however many samples
// are its own. They differ by more where their variance is above that of chance by so many standard errors.
const float OWN_IN_EVEN_LIGHT = 0.15;
const float SURE = 1.0;
// Frames after which a surfel that stands alone asks, for its excess.
const uint SELDOM = 16u;
// Share of the newest frame in the mean of openness.
const float NEWEST_OPENNESS = 0.125;
// Distance of a surfel to what the picture shows in its place, over its radius, up to which it is seen.
const float SEEN = 0.1;

// Means over what others share.
struct Others {
    vec3 mean;
    vec3 excess;
    float weights;
    float squared_weights;
    // Of the luminance of what each has found itself: its mean, the mean of its square, and its variance by chance.
    float own;
    float own_square;
    float chance;
};

const Others NO_OTHERS = Others(vec3(0.0), vec3(0.0), 0.0, 0.0, 0.0, 0.0, 0.0);

void add_other(inout Others sum, SharedLight light, Estimator found, float weight) {
    float own = luminance(found.mean);
    sum.mean += weight * light.mean;
    sum.excess += weight * light.excess;
    sum.weights += weight;
    sum.squared_weights += weight * weight;
    sum.own += weight * own;
    sum.own_square += weight * own * own;
    sum.chance += weight * variance_of_mean(found);
}

Others mean_of_others(Others sum) {
    if (sum.weights == 0.0) return sum;
    float scale = 1.0 / sum.weights;
    return Others(scale * sum.mean, scale * sum.excess, sum.weights, scale * scale * sum.squared_weights, scale * sum.own, scale * sum.own_square, scale * sum.chance);
}

// Openness that the picture shows at a surfel's centre; below 0 if it does not show it.
float seen_openness(ViewBuffer view, PlacedSurfel s) {
    vec4 clip = view.at[0].clip_from_world * vec4(s.position, 1.0);
    if (params.openness == NO_IMAGE || !(clip.w > 0.0)) return -1.0;
    vec2 uv = 0.5 + 0.5 * clip.xy / clip.w;
    ivec2 pixel = ivec2(floor(uv * vec2(view.at[0].size)));
    if (!inside(pixel, view.at[0].size)) return -1.0;
    float depth = load(params.depth, pixel).r;
    if (depth == 0.0) return -1.0;
    vec3 apart = world_position(view, pixel, depth) - s.position;
    // The pixel's centre is not the surfel's: what is across the surface counts.
    return abs(dot(apart, s.normal)) < SEEN * s.radius && dot(apart, apart) < s.radius * s.radius ? load(params.openness, pixel).r : -1.0;
}

// What surfels around one share.
struct Around {
    SharedLight sum;
    float weights;
    float seen;
    float samples;
    Others others;
    Plane plane;  // not where light is fresh
};

void add_cell(inout Around around, ivec3 cell, int level, vec3 position, vec3 normal, float reach, uint surfel, float most) {
    SurfelPool pool = SurfelPool(params.pool);
    uvec2 list = SurfelCells(params.grid.cells).at[cell_index(params.grid, cell, level)];
    vec3 eye = ViewBuffer(params.view).at[0].eye;
    mat3 along = frame_of(normal);
    bool fresh = most < SETTLED;
    uint step = most < MOST_OF_OWN * YOUNGEST ? max(uint(float(list.y) * most / ENOUGH_OF_CELL), 1u) : 1u;
    for (uint i = surfel % step; i < list.y; i += step) {
        uint other = SurfelWords(params.grid.references).at[list.x + i];
        vec3 centre = PlacedSurfelBuffer(params.grid.placed).at[other].position;
        vec3 offset = position - centre;
        float square = dot(offset, offset) / (reach * reach);
        if (!(square < 1.0)) continue;
        // A surfel is in the lists of all cells that it touches. It counts in the one where its centre is.
        if (cell_of(params.grid, centre - eye, level) != cell) continue;
        vec3 own = PlacedSurfelBuffer(params.grid.placed).at[other].normal;
        float weight = disc_weight(square, reach, own, offset, normal).y;
        if (weight > 0.0) weight *= reached(params.grid, other, own, offset - dot(offset, own) * own);
        if (weight == 0.0) continue;
        weight *= float(step);
        around.samples += weight * min(pool.at[other].light.samples, SETTLED);
        weight *= min(pool.at[other].light.samples, most);
        SharedLight light = pool.at[other].light_shared;
        if (fresh || light.is_known == 0u) {
            light.mean = pool.at[other].light.mean;
            light.tilt = pool.at[other].light.tilt;
            light.excess = vec3(0.0);
        }
        if (!fresh) add_to_plane(around.plane, -vec2(dot(offset, along[0]), dot(offset, along[1])) / reach, luminance(light.mean), weight);
        if (other != surfel) add_other(around.others, light, pool.at[other].light, weight);
        add_shared(around.sum, light, weight, around.weights, around.seen);
    }
}

// What surfels around one share, itself among them; means in `sum` and `others`.
Around found_around(vec3 eye, uint surfel, PlacedSurfel s, float samples, bool fresh) {
    Around around = Around(no_shared_light(), 0.0, 0.0, 0.0, NO_OTHERS, NO_PLANE);
    float most = fresh ? MOST_OF_OWN * max(samples, 1.0) : SETTLED;
    float reach = s.radius * (samples < YOUNGEST ? clamp(sqrt(ENOUGH / max(samples, 1.0)), 1.0, REACH) : ASKED);
    SurfelCellsAround cells = cells_around(params.grid, s.position - eye, s.normal, reach, 0.5 * reach);
    for (int z = cells.low.z; z <= cells.high.z; z++) {
        for (int y = cells.low.y; y <= cells.high.y; y++) {
            for (int x = cells.low.x; x <= cells.high.x; x++) {
                ivec3 cell = ivec3(x, y, z);
                if (holds(cells, cell)) add_cell(around, cell, cells.level, s.position, s.normal, reach, surfel, most);
            }
        }
    }
    around.sum = mean_shared(around.sum, around.weights, around.seen);
    around.others = mean_of_others(around.others);
    return around;
}

// Share of a surfel's own mean that is likely.
float likely_share(Estimator e, Others others) {
    float mean = luminance(e.mean);
    float likely = LIKELY * luminance(others.mean);
    if (others.weights == 0.0 || !(mean > likely)) return 1.0;
    float error = sqrt(variance_of_mean(e));
    return mix(1.0, likely / mean, smoothstep(UNSURE.x, UNSURE.y, error / mean));
}

// How much what others have found differs from surfel to surfel: from 0, by no more than chance, to 1, by far more than this one's mean by chance.
float structure_share(Estimator e, Others others) {
    float differences = max(others.own_square - others.own * others.own, 0.0);
    float chance = others.chance * (1.0 + SURE * sqrt(2.0 * others.squared_weights));
    float structure = max(differences - chance, 0.0);
    return structure > 0.0 ? structure / (structure + variance_of_mean(e)) : 0.0;
}

// What a surfel passes on of its own excess before others have their part.
vec3 limited_excess(vec3 excess, Others others) {
    float bright = luminance(excess);
    float most = MOST_EXCESS * luminance(others.mean + others.excess);
    return bright > most ? excess * (most / bright) : excess;
}

// Frames from path to path of those that are not settled: more than one where the budget is too small for all.
uint frames_per_path() {
    float frames = float(SurfelCounters(params.counts).counts.live) / float(params.paths);
    return 1u << uint(clamp(round(log2(frames)), 0.0, LONGEST_PERIOD));
}

void main() {
    uint i = gl_GlobalInvocationID.x;
    SurfelPool pool = SurfelPool(params.pool);
    if (i >= params.capacity) return;
    Placed placed = Placed(params.grid.placed);
    if (pool.at[i].bound.instance == 0u) {
        pool.at[i].samples_around = 0.0;
        return;
    }
    ViewBuffer view = ViewBuffer(params.view);
    PlacedSurfel s = placed.at[i];
    float samples = pool.at[i].light.samples;
    float seen = seen_openness(view, s);
    float openness = pool.at[i].openness;
    if (seen >= 0.0) openness = openness < 0.0 ? seen : mix(openness, seen, NEWEST_OPENNESS);
    SharedLight light = pool.at[i].light_shared;
    // Each asks as often as it has new samples, and in each frame after a change; those of a workgroup together, as one that asks takes as long as all.
    bool is_new = pool.at[i].born == view.at[0].frame;
    bool is_changing = change_elsewhere(SurfelCounters(params.counts).counts) > 0.0;
    uint period = is_new ? 1u : samples < YOUNGEST ? frames_per_path() : is_changing ? 1u : samples < SETTLED ? 2u : samples < ALONE ? 4u : SELDOM;
    float around = WELL_KNOWN;
    bool asks = (gl_WorkGroupID.x + view.at[0].frame) % period == 0u;
    if (asks) {
        bool has_forgotten = samples < RECOVERED && float(pool.at[i].paths) > samples + FORGOTTEN;
        // After a change, what others share is still what it was: their own means are asked until light has spread.
        bool fresh = samples < YOUNGEST || (has_forgotten && samples < SPREADING);
        Around found = found_around(view.at[0].eye, i, s, samples, fresh);
        Others others = found.others;
        light = found.sum;
        if (samples < YOUNGEST && !has_forgotten) around = min(found.samples, WELL_KNOWN);
        float guess = (has_forgotten ? min(GUESS_OF_OWN * samples, GUESS) : GUESS) * max(1.0 - samples / ALONE, 0.0);
        float own = samples < YOUNGEST ? 0.0 : samples / (samples + guess);
        if (!has_forgotten) own = mix(min(own, OWN_IN_EVEN_LIGHT), own, structure_share(pool.at[i].light, others));
        vec3 mean = pool.at[i].light.mean;
        float likely = fresh ? 1.0 : likely_share(pool.at[i].light, others);
        pool.at[i].excess = others.excess;
        pool.at[i].excess_passed = mix(others.excess, limited_excess((1.0 - likely) * mean, others), OWN_EXCESS);
        if (samples >= YOUNGEST && !has_forgotten) {
            float here = at_surfel(found.plane);
            light.mean *= here;
            for (int channel = 0; channel < 3; channel++) light.tilt[channel] *= here;
        }
        light.mean = mix(light.mean, likely * mean, own);
        for (int channel = 0; channel < 3; channel++) light.tilt[channel] = mix(light.tilt[channel], likely * pool.at[i].light.tilt[channel], own);
        if (openness >= 0.0) light.openness = light.openness < 0.0 ? openness : mix(light.openness, openness, own);
    }
    uint paths = pool.at[i].paths;
    if (params.guided != 0u && paths != 0u && block_start(paths) == paths) pool.at[i].chances = chances_around(params.grid, pool, view.at[0].eye, s, i, ASKED);
    pool.at[i].openness = openness;
    pool.at[i].samples_around = around;
    placed.at[i].mean = light.mean;
    placed.at[i].excess = pool.at[i].excess;
    placed.at[i].tilt = light.tilt;
    placed.at[i].openness = light.openness;
    placed.at[i].samples = samples;
}
