#ifndef LIB_SURFEL_RAYS_GLSL
#define LIB_SURFEL_RAYS_GLSL
#define SURFELS
#include "lib/pixel_list.glsl"
#include "lib/follow_path.glsl"
#include "lib/not_finite.glsl"
#include "lib/sequence.glsl"
#include "lib/surfel_binding.glsl"
#include "lib/surfel_cache.glsl"
#include "lib/surfel_change.glsl"
#include "lib/surfel_guide.glsl"
// One path of a surfel, and short rays along its surface that find what stands on it.

// Rise of these rays. They are REACH radii long.
const float RISE = 0.15;
// Of two surfels where one counts more than this at the other, the one with fewer samples is recycled. It is far above the coverage below which
// new ones are spawned, so that none is spawned in its place.
const float NEEDLESS = 0.77;

// Looks along the surface into a sector. `u`: two uniform numbers.
void look_along(SceneBuffer scene, RayStart start, float radius, uint sector, vec2 u, uint before, inout Surfel s) {
    float angle = (float(sector) + u.x + u.y - 1.0) * (2.0 * PI / float(SECTORS));
    vec3 along = frame_of(start.normal) * vec3(cos(angle), sin(angle), 0.0);
    float nearness = 0.0;
    Hit hit;
    paths_traced.x++;
    if (trace_closest(scene, surface_ray(start, along + RISE * start.normal, REACH * radius), hit)) nearness = 1.0 / max(hit.t, 1e-3 * radius);
    vec2 known = unpack_upper(s.nearness[sector]);
    float blend = max(1.0 / float(before + 1u), 0.1);
    float apart = nearness - known.x;
    known.x += blend * apart;
    known.y = sqrt((1.0 - blend) * (known.y * known.y + blend * apart * apart));
    s.nearness[sector] = pack_upper(known);
}

// Whether another surfel makes this one needless.
bool is_needless(SurfelGrid grid, vec3 eye, uint surfel, PlacedSurfel own) {
    uvec2 list = cell_list(grid, eye, own.position);
    for (uint i = 0u; i < list.y; i++) {
        uint other = SurfelWords(grid.references).at[list.x + i];
        if (other == surfel) continue;
        float samples = PlacedSurfelBuffer(grid.placed).at[other].samples;
        if (samples < own.samples || (samples == own.samples && other > surfel)) continue;
        if (surfel_weight(grid, other, own.position, own.normal, 1.0).y > NEEDLESS) return true;
    }
    return false;
}

void trace_surfel(SurfelTraceParams params, uvec2 invocation) {
    ViewBuffer view = ViewBuffer(params.view);
    SceneBuffer scene = SceneBuffer(params.scene);
    SurfelGrid grid = SurfelGridBuffer(params.grid).at[0];
    ivec2 pixel;
    if (listed_pixel(params.list, invocation, pixel)) {
        uint surfel = key_surfel(pixel);
        PlacedSurfel placed = PlacedSurfelBuffer(grid.placed).at[surfel];
        SurfelPool pool = SurfelPool(params.pool);
        Surfel s = pool.at[surfel];
        RayStart start = surfel_start(scene, s.bound);
        uint seed = view.at[0].seed;
        ivec2 key = ivec2(surfel, s.born);

        // All sectors first, then one after another.
        uint first = s.paths == 0u ? 0u : s.paths % SECTORS;
        uint end = s.paths == 0u ? SECTORS : first + 1u;
        for (uint sector = first; sector < end; sector++) {
            look_along(scene, start, placed.radius, sector, sequence2(key, s.paths, SEQUENCE_SURFELS + 1u + sector, seed), s.paths / SECTORS, s);
        }

        mat3 around = frame_of(start.normal);
        uint block = block_start(s.paths);
        ivec2 block_key = key + ivec2(0, int(0x10001u * (block / FIRST_BLOCK)));
        Guided drawn = guided(s.chances, sequence2(block_key, s.paths - block, SEQUENCE_SURFELS, seed));
        vec3 l = sample_cosine(drawn.u);
        vec3 direction = around * l;
        Random random = random_of(surfel, s.paths, seed ^ s.born ^ SEQUENCE_SURFELS);
        Path path = Path(params.hits, params.bounces, regularization_after(s.light.samples, params.regularization), params.pool, params.emitters != 0u);
        float distance;
        vec3 radiance = follow(view, scene, path, surface_ray(start, direction, UNBOUNDED), drawn.density * l.z / PI, random, distance);
        if (is_taken(word_at(params.rays, 2u), radiance)) {
            uint place = change_places(grid, placed.position - view.at[0].eye).y;
            float nearby = uintBitsToFloat(SurfelChanges(params.changes).at[place].brightest);
            learn(s.guide, drawn.cell, radiance);
            add_sample(s.light, Sample(radiance, drawn.density, direction - l.z * start.normal, nearby), params.estimator);
        }
        s.paths++;
        if (is_needless(grid, view.at[0].eye, surfel, placed)) pool.at[surfel].bound.instance = 0u;
        if (surfel_wish.instance != 0u) {
            wished_bindings(grid, params.wishes).at[surfel] = surfel_wish;
            atomicMax(SurfelWords(params.wishes).at[cell_at(grid, view.at[0].eye, surfel_wish_position)], surfel + 1u);
        }
        pool.at[surfel].paths = s.paths;
        pool.at[surfel].light = s.light;
        pool.at[surfel].nearness = s.nearness;
        pool.at[surfel].guide = s.guide;
    }
    count_rays(params.rays, paths_traced.x, paths_traced.y);
    uint traced = paths_traced.x + paths_traced.y;
    if (traced != 0u) atomicAdd(SurfelCounters(params.counts).counts.rays, traced);
}

#endif
