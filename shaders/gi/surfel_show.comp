#version 460
#extension GL_GOOGLE_include_directive : require
#include "lib/bindless.glsl"
#include "lib/colour.glsl"
#include "lib/gbuffer.glsl"
#include "lib/surfels.glsl"
#include "shared/denoise.glsl"
// Pictures of the surfels for people: at each pixel, the one that counts most there.
layout(local_size_x = 8, local_size_y = 8) in;
layout(push_constant, scalar) uniform Push { SurfelShowParams params; };

// Counters of the frame, one to a pixel.
void show_counts(int at) {
    SurfelCounts counts = SurfelCounters(params.counts).counts;
    uint numbers[SURFEL_COUNTERS] = uint[](
        counts.live, counts.wanted, counts.spawned, counts.recycled, counts.dropped, counts.uncovered, counts.visible, counts.rays
    );
    store(params.counters, ivec2(at, 0), vec4(float(numbers[at])));
}

// Where surfels are, and what they are bound to.
void show_table() {
    uint stride = gl_NumWorkGroups.x * gl_NumWorkGroups.y * 64u;
    uint first = (gl_WorkGroupID.y * gl_NumWorkGroups.x + gl_WorkGroupID.x) * 64u + gl_LocalInvocationIndex;
    for (uint i = first; i < params.capacity; i += stride) {
        SurfelBinding at = SurfelPool(params.pool).at[i].bound;
        bool lives = at.instance != 0u;
        vec4 placed = vec4(0.0);
        if (lives) placed = vec4(PlacedSurfelBuffer(params.grid.placed).at[i].position, PlacedSurfelBuffer(params.grid.placed).at[i].radius);
        ivec2 pixel = ivec2(i % KEYS_WIDTH, 2u * (i / KEYS_WIDTH));
        store(params.table, pixel, placed);
        store(params.table, pixel + ivec2(0, 1), lives ? vec4(at.instance, at.primitive, at.weights) : vec4(0.0));
    }
}

void main() {
    ViewBuffer view = ViewBuffer(params.view);
    ivec2 pixel = ivec2(gl_GlobalInvocationID.xy);
    if (gl_WorkGroupID.xy == uvec2(0u) && gl_LocalInvocationIndex < SURFEL_COUNTERS) show_counts(int(gl_LocalInvocationIndex));
    if (params.table != NO_IMAGE) show_table();
    if (!inside(pixel, view.at[0].size)) return;
    vec4 disc = vec4(0.0), state = vec4(0.0), place = vec4(0.0);
    Surface s = load_geometry(view, pixel, params.gbuffer);
    if (s.exists) {
        SurfelLight light = surfel_lookup(params.grid, view.at[0].eye, s.position, s.geometric_normal, s.geometric_normal);
        place = vec4(0.0, float(cell_list(params.grid, view.at[0].eye, s.position).y), light.coverage, 1.0);
        if (light.coverage > 0.0) {
            Surfel found = SurfelPool(params.pool).at[light.most];
            PlacedSurfel placed = PlacedSurfelBuffer(params.grid.placed).at[light.most];
            uvec4 word = hash4(uvec4(light.most, found.born, 0u, 0u));
            float weight = surfel_weight(params.grid, light.most, s.position, s.geometric_normal, 1.0).y;
            disc = vec4(vec3(word.xyz >> 8u) / 16777216.0 * sqrt(weight), light.coverage);
            float mean = luminance(found.light.mean);
            float deviation = mean > 0.0 ? luminance(sqrt(max(vec3(found.light.variance), 0.0))) / mean : 0.0;
            state = vec4(float(view.at[0].frame - found.born), found.light.samples, float(found.paths), deviation);
            vec3 offset = s.position - placed.position;
            place.x = placed.radius;
            place.w = reached(params.grid, light.most, placed.normal, offset - dot(offset, placed.normal) * placed.normal);
        }
    }
    store(params.discs, pixel, disc);
    store(params.state, pixel, state);
    store(params.place, pixel, place);
}
