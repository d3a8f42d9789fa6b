#ifndef LIB_SPATIAL_REUSE_GLSL
#define LIB_SPATIAL_REUSE_GLSL
#include "lib/reuse.glsl"
// Reuse of the reservoirs of pixels around, from one buffer into another.

// Least cosine between the shading normals of a pixel and a neighbour: 25 degrees.
const float LEAST_ALIKE = 0.9;
// Greatest distance of a neighbour from the pixel's plane, over the distance from the eye.
const float GREATEST_STEP = 0.02;

ViewBuffer reuse_view;
ResampleParams reuse_params;
ivec2 asked[MAX_NEIGHBOURS];

bool lender_at(uint k, out Lender lender) {
    if (asked[k].x < 0) return false;
    uint index = pixel_index(reuse_view, asked[k]);
    lender.reservoir = ReservoirBuffer(reuse_params.reservoirs).at[index];
    lender.surface = LitSurfaceBuffer(reuse_params.surfaces).at[index];
    lender.eye = reuse_view.at[0].eye;
    lender.before = false;
    lender.start = RayStart(
        lender.eye + lender.surface.from_eye, octahedral_decode(unpackSnorm2x16(lender.surface.geometric_normal)), lender.surface.rounding
    );
    return true;
}

// Whether a pixel's reservoir is of use for a surface.
bool is_alike(LitSurface here, LitSurface there) {
    if (!is_lit(there)) return false;
    vec3 normal = lit_normal(here);
    return dot(normal, lit_normal(there)) >= LEAST_ALIKE
        && abs(dot(normal, there.from_eye - here.from_eye)) <= GREATEST_STEP * length(here.from_eye);
}

// Chooses the neighbours. Returns how many are alike.
uint choose_neighbours(ivec2 pixel, LitSurface here, inout Random random) {
    uint found = 0u;
    for (uint k = 0u; k < reuse_params.neighbours; k++) {
        vec2 u = random4(random).xy;
        float angle = 2.0 * PI * u.x;
        ivec2 at = pixel + ivec2(round(reuse_params.radius * sqrt(u.y) * vec2(cos(angle), sin(angle))));
        asked[k] = ivec2(-1);
        if (at == pixel || !inside(at, reuse_view.at[0].size)) continue;
        if (!is_alike(here, LitSurfaceBuffer(reuse_params.surfaces).at[pixel_index(reuse_view, at)])) continue;
        asked[k] = at;
        found++;
    }
    return found;
}

void reuse_neighbours(ResampleParams params) {
    reuse_params = params;
    reuse_view = ViewBuffer(params.view);
    ivec2 pixel = ivec2(RAY_INVOCATION.xy);
    if (!inside(pixel, reuse_view.at[0].size)) return;
    uint index = pixel_index(reuse_view, pixel);
    LitSurface surface = LitSurfaceBuffer(params.surfaces).at[index];
    Reservoir r = ReservoirBuffer(params.reservoirs).at[index];
    if (is_lit(surface)) {
        uint seed = reuse_view.at[0].seed ^ (SALT_SPATIAL + params.round);
        Random random = random_of(index, reuse_view.at[0].frame, seed);
        if (choose_neighbours(pixel, surface, random) > 0u) {
            Borrower b;
            b.scene = SceneBuffer(params.scene);
            b.lights = LightTablesBuffer(params.lights).at[0];
            b.point = sampled_point(surface, reuse_view.at[0].eye);
            b.own = r;
            b.tests_all = params.tests_all != 0u;
            b.weights = params.weights;
            Incident from;
            b.own_target = target_of(b.scene, b.lights, b.point, r.light, r.point, from);
            Reservoir all = merged(b, params.neighbours, random);
            if (is_taken(params.not_finite, vec3(all.weight))) r = all;
        }
    }
    ReservoirBufferWrite(params.resampled).at[index] = r;
    count_rays(params.rays, resampling_traced.x, resampling_traced.y);
}

#endif
