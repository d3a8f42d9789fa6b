#ifndef LIB_SURFELS_GLSL
#define LIB_SURFELS_GLSL
#include "lib/bindless.glsl"
#include "lib/octahedral.glsl"
#include "lib/random.glsl"
#include "lib/sampling.glsl"
#include "shared/surfels.glsl"
#include "shared/view.glsl"
// Surfels in a hashed grid around the camera: where they are, how much they count at a point, and the light that they give it.

layout(buffer_reference, scalar, buffer_reference_align = 4) buffer SurfelPool { Surfel at[]; };
layout(buffer_reference, scalar, buffer_reference_align = 4) buffer SurfelWords { uint at[]; };
layout(buffer_reference, scalar, buffer_reference_align = 4) buffer SurfelCells { uvec2 at[]; };
layout(buffer_reference, scalar, buffer_reference_align = 4) buffer SurfelCounters { SurfelCounts counts; };

layout(buffer_reference, scalar, buffer_reference_align = 4) buffer SurfelBindings { SurfelBinding at[]; };

// Address of a word of a buffer.
uvec2 word_at(uvec2 buffer_address, uint word) {
    uint carry;
    uint low = uaddCarry(buffer_address.x, 4u * word, carry);
    return uvec2(low, buffer_address.y + carry);
}

// Free places of a pool begin behind so many words.
uint free_head(uint capacity) {
    return (capacity + SURFEL_GROUP - 1u) / SURFEL_GROUP + 1u;
}

// Workgroups of cells that paths may ask in.
uint cell_groups(SurfelGrid grid) {
    return grid.cell_mask / SURFEL_GROUP + 1u;
}

// What the path of a surfel asks for.
SurfelBindings wished_bindings(SurfelGrid grid, uvec2 wishes) {
    return SurfelBindings(word_at(wishes, grid.cell_mask + 1u));
}

// Surfels are listed as pixels of an image of keys.
ivec2 key_pixel(uint surfel) {
    return ivec2(surfel % KEYS_WIDTH, surfel / KEYS_WIDTH);
}

uint key_surfel(ivec2 pixel) {
    return uint(pixel.y) * KEYS_WIDTH + uint(pixel.x);
}

// Radius of surfels at a distance from the eye, metres.
float surfel_radius(SurfelGrid grid, float distance) {
    return grid.size * max(distance, 1e-6);
}

// Cells double in size where the distance does. They are wider than the surfels in them and on the border to the next level, so a surfel touches
// at most eight of a level.
int cell_level(float distance) {
    return int(floor(log2(max(distance, 1e-6))));
}

float cell_width(SurfelGrid grid, int level) {
    return 5.0 * grid.size * exp2(float(level));
}

// Index of a cell in the table. Cells that share an index share a list: what is not near is left out when the list is read.
uint cell_index(SurfelGrid grid, ivec3 cell, int level) {
    return hash4(uvec4(uvec3(cell), uint(level))).x & grid.cell_mask;
}

ivec3 cell_of(SurfelGrid grid, vec3 from_eye, int level) {
    return ivec3(floor(from_eye / cell_width(grid, level)));
}

// Cells of a level that may hold what is near a surfel and near its plane. What stands off that plane has no weight, or hardly any.
struct SurfelCellsAround {
    ivec3 low;
    ivec3 high;
    int level;
    float width;
    float reach;      // metres from the surfel
    float off_plane;  // metres from its plane to the centre of a cell
    vec3 from_eye;
    vec3 normal;
};

SurfelCellsAround cells_around(SurfelGrid grid, vec3 from_eye, vec3 normal, float reach, float off_plane) {
    int level = cell_level(length(from_eye));
    float width = cell_width(grid, level);
    float half_cell = 0.5 * width * (abs(normal.x) + abs(normal.y) + abs(normal.z));
    return SurfelCellsAround(
        cell_of(grid, from_eye - reach, level), cell_of(grid, from_eye + reach, level), level, width, reach, off_plane + half_cell, from_eye, normal
    );
}

bool holds(SurfelCellsAround around, ivec3 cell) {
    vec3 centre = (vec3(cell) + 0.5) * around.width - around.from_eye;
    vec3 nearest = max(abs(centre) - 0.5 * around.width, 0.0);
    return abs(dot(centre, around.normal)) <= around.off_plane && dot(nearest, nearest) <= around.reach * around.reach;
}

// The cell at a point.
uint cell_at(SurfelGrid grid, vec3 eye, vec3 position) {
    vec3 from_eye = position - eye;
    int level = cell_level(length(from_eye));
    return cell_index(grid, cell_of(grid, from_eye, level), level);
}

// First reference and number of references of the cell at a point.
uvec2 cell_list(SurfelGrid grid, vec3 eye, vec3 position) {
    return SurfelCells(grid.cells).at[cell_at(grid, eye, position)];
}

// Two numbers in the upper halves of two floats: the range of floats, with 8 significant bits.
uint pack_upper(vec2 v) {
    uvec2 bits = floatBitsToUint(v) + 0x8000u;
    return (bits.x >> 16u) | (bits.y & 0xffff0000u);
}

vec2 unpack_upper(uint packed) {
    return uintBitsToFloat(uvec2(packed << 16u, packed & 0xffff0000u));
}

// Where around its normal a surfel sees a direction: sectors are 1 apart.
float sector_of(vec3 normal, vec3 along) {
    vec2 local = (along * frame_of(normal)).xy;
    return (atan(local.y, local.x) / (2.0 * PI) + 1.0) * float(SECTORS);
}

// Share of a surfel's light that counts at a point near it: all as far as nothing stands on the surface in between, less behind that. By
// Chebyshev's inequality (Donnelly and Lauritzen 2006, "Variance Shadow Maps"), cubed as probes have it (Majercik et al. 2019). In place of
// distances it has their inverses: of a wall, those are the cosine of the angle over the least distance, which is nearly linear between
// sectors. `along`: from the surfel to the point, in its plane.
float reached(SurfelGrid grid, uint surfel, vec3 normal, vec3 along) {
    PlacedSurfelBuffer placed = PlacedSurfelBuffer(grid.placed);
    float far = length(along);
    if (!(far > 0.0)) return 1.0;
    float turn = sector_of(normal, along);
    uint sector = uint(turn);
    float part = turn - float(sector);
    vec2 here = unpack_upper(placed.at[surfel].nearness[sector % SECTORS]);
    vec2 next = unpack_upper(placed.at[surfel].nearness[(sector + 1u) % SECTORS]);
    float nearest = mix(here.x, next.x, part);
    float behind = nearest - 1.0 / far;
    if (behind <= 0.0) return 1.0;
    float deviation = max(mix(here.y, next.y, part), 0.05 * nearest);
    float share = 1.0 / (1.0 + behind * behind / (deviation * deviation));
    return share * share * share;
}

// How much a disc counts at a point that is `offset` away from its centre, of a surface with a geometric normal: `x` where nothing else is known,
// `y` of light that may not leak but behind what stands on the disc. `square`: of the distance over the radius, below 1.
vec2 disc_weight(float square, float radius, vec3 disc_normal, vec3 offset, vec3 normal) {
    float kernel = (1.0 - square) * (1.0 - square);
    float facing = dot(normal, disc_normal);
    float likeness = max(facing, 0.0);
    float plane = max(1.0 - 2.0 * abs(dot(offset, disc_normal)) / radius, 0.0);
    return kernel * vec2(0.5 + 0.5 * facing, likeness * likeness * plane);
}

// The same of a surfel as if it were `reach` times as large, `y` without what does not reach the point. Most surfels of a list do not: no more is
// loaded of those than it takes to know that.
vec2 surfel_weight(SurfelGrid grid, uint surfel, vec3 position, vec3 normal, float reach) {
    PlacedSurfelBuffer placed = PlacedSurfelBuffer(grid.placed);
    vec3 offset = position - placed.at[surfel].position;
    float radius = reach * placed.at[surfel].radius;
    float square = dot(offset, offset) / (radius * radius);
    // Written so that free places, which have no radius, do not count.
    if (!(square < 1.0)) return vec2(0.0);
    vec3 own = placed.at[surfel].normal;
    vec2 weight = disc_weight(square, radius, own, offset, normal);
    if (weight.y > 0.0) weight.y *= reached(grid, surfel, own, offset - dot(offset, own) * own);
    return weight;
}

SharedLight no_shared_light() {
    SharedLight none;
    none.mean = vec3(0.0);
    for (int channel = 0; channel < 3; channel++) none.tilt[channel] = vec3(0.0);
    none.openness = -1.0;
    none.is_known = 0u;
    none.excess = vec3(0.0);
    return none;
}

// Adds to sums of what surfels share, whose weights are `weights`, and `seen` for openness.
void add_shared(inout SharedLight sum, SharedLight light, float weight, inout float weights, inout float seen) {
    sum.mean += weight * light.mean;
    sum.excess += weight * light.excess;
    for (int channel = 0; channel < 3; channel++) sum.tilt[channel] += weight * light.tilt[channel];
    sum.is_known = 1u;
    weights += weight;
    if (light.openness < 0.0) return;
    sum.openness = max(sum.openness, 0.0) + weight * light.openness;
    seen += weight;
}

SharedLight mean_shared(SharedLight sum, float weights, float seen) {
    if (weights > 0.0) {
        sum.mean /= weights;
        sum.excess /= weights;
        for (int channel = 0; channel < 3; channel++) sum.tilt[channel] /= weights;
    }
    if (seen > 0.0) sum.openness /= seen;
    return sum;
}

// Irradiance over pi for a normal: exact for the surfel's own, and for light that is the same from everywhere. The tilt is a first-order term:
// where radiance is a + b . direction, the part of b along the surface is 4 / pi of the mean of direction times irradiance, and adds 2 pi / 3
// of itself to the irradiance.
vec3 surfel_light(SurfelGrid grid, uint surfel, vec3 normal) {
    PlacedSurfelBuffer placed = PlacedSurfelBuffer(grid.placed);
    vec3 along;
    for (int channel = 0; channel < 3; channel++) along[channel] = dot(placed.at[surfel].tilt[channel], normal);
    vec3 light = (placed.at[surfel].mean + placed.at[surfel].excess) * (0.5 + 0.5 * dot(placed.at[surfel].normal, normal)) + (8.0 / 3.0) * along;
    return mix(light, vec3(0.0), lessThan(light, vec3(0.0)));
}

// What surfels say of a point.
struct SurfelLight {
    bool exists;      // false where no surfel with samples is near
    bool known;       // surfels of the same surface are near
    bool full;        // the list of the cell has no room for more
    vec3 light;       // irradiance over pi
    float coverage;   // sum of weights, however many samples they have
    float samples;    // mean number of samples
    float openness;   // ambient occlusion at the surfels' centres; below 0 where it is not known
    uint most;        // the surfel that counts most
};

// Where no surfel of the same surface covers a point, others count this much. So little, that they make no difference where one does: they know less than half
// of its light, and what is passed on from surfel to surfel would lose a part of that each time.
const float UNLIKE = 1e-6;
// More samples than this do not make a surfel count more.
const float CONFIDENT = 64.0;
// Coverage below which surfels that do not reach a point count as if they were so many times larger: as far as they know what stands around.
const float KNOWN = 0.05;
const float REACH = 4.0;
// Samples around a surfel with which its light needs none of a wider surrounding.
const float WELL_KNOWN = 512.0;

// Sums over a list of surfels.
struct SurfelSums {
    vec3 light;
    float weights;
    float coverage;
    float samples;
    float openness;
    float seen;    // sum of the weights of `openness`
    uint most;
};

SurfelSums surfel_sums(SurfelGrid grid, uvec2 list, vec3 position, vec3 geometric, vec3 normal, float reach, float unlike) {
    SurfelSums sums = SurfelSums(vec3(0.0), 0.0, 0.0, 0.0, 0.0, 0.0, 0u);
    float greatest = 0.0;
    for (uint i = 0u; i < list.y; i++) {
        uint surfel = SurfelWords(grid.references).at[list.x + i];
        vec2 weight = surfel_weight(grid, surfel, position, geometric, reach);
        float counts = max(weight.y, unlike * weight.x);
        if (counts == 0.0) continue;
        float samples = PlacedSurfelBuffer(grid.placed).at[surfel].samples;
        counts *= min(samples, CONFIDENT);
        sums.light += counts * surfel_light(grid, surfel, normal);
        sums.weights += counts;
        float openness = PlacedSurfelBuffer(grid.placed).at[surfel].openness;
        if (openness >= 0.0) {
            sums.openness += counts * openness;
            sums.seen += counts;
        }
        sums.coverage += weight.y;
        sums.samples += weight.y * samples;
        if (weight.y > greatest) {
            greatest = weight.y;
            sums.most = surfel;
        }
    }
    return sums;
}

// The light at a point. `geometric` finds the surfels of its surface, `normal` is lit. Free places are not in the lists.
SurfelLight surfel_lookup(SurfelGrid grid, vec3 eye, vec3 position, vec3 geometric, vec3 normal) {
    uvec2 list = cell_list(grid, eye, position);
    SurfelSums sums = surfel_sums(grid, list, position, geometric, normal, 1.0, UNLIKE);
    float coverage = sums.coverage;
    if (coverage < KNOWN) {
        SurfelSums others = surfel_sums(grid, list, position, geometric, normal, REACH, 0.0);
        float share = KNOWN - coverage;
        sums.light += share * others.light;
        sums.weights += share * others.weights;
        sums.coverage += share * others.coverage;
        sums.samples += share * others.samples;
        sums.openness += share * others.openness;
        sums.seen += share * others.seen;
        if (coverage == 0.0) sums.most = others.most;
    }
    bool known = sums.coverage > 0.0;
    return SurfelLight(
        sums.weights > 0.0, known, list.y == CELL_LIMIT, sums.weights > 0.0 ? sums.light / sums.weights : vec3(0.0), coverage,
        known ? sums.samples / sums.coverage : 0.0, sums.seen > 0.0 ? sums.openness / sums.seen : -1.0, sums.most
    );
}

#endif
