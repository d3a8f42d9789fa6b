#ifndef LIB_LAMP_CLUSTERS_GLSL
#define LIB_LAMP_CLUSTERS_GLSL
#include "lib/bindless.glsl"
#include "lib/bsdf.glsl"
#include "lib/colour.glsl"
#include "shared/clusters.glsl"
#include "shared/view.glsl"
// Cells of the view frustum (Olsson, Billeter and Assarsson 2012, "Clustered Deferred and Forward Shading"): equal parts of the picture, and slices
// of depth of equal ratio between the nearest and the farthest surface. Light of each lamp is cut in two by a window around it: within, it is
// evaluated at every pixel; what the window takes away is smooth, and interpolated between the corners of cells.

layout(buffer_reference, scalar, buffer_reference_align = 4) readonly buffer LampReaches { vec4 at[]; };
layout(buffer_reference, scalar, buffer_reference_align = 4) writeonly buffer LampReachesWrite { vec4 at[]; };

// View depth of a plane between slices, metres; 0 is the nearest.
float slice_depth(LampGrid grid, float slice) {
    return grid.nearest * exp2(grid.octaves * slice / float(grid.tables.cells.z));
}

// Where a pixel is, in cells from the first corner. `along`: view depth, metres.
vec3 cell_position(LampGrid grid, uvec2 size, ivec2 pixel, float along) {
    vec2 across = (vec2(pixel) + 0.5) / vec2(size) * vec2(grid.tables.cells.xy);
    float slice = log2(along / grid.nearest) / grid.octaves * float(grid.tables.cells.z);
    return clamp(vec3(across, slice), vec3(0.0), vec3(grid.tables.cells));
}

uint cell_index(LampGrid grid, uvec3 cell) {
    return (cell.z * grid.tables.cells.y + cell.y) * grid.tables.cells.x + cell.x;
}

uint corner_index(LampGrid grid, uvec3 corner) {
    return (corner.z * (grid.tables.cells.y + 1u) + corner.y) * (grid.tables.cells.x + 1u) + corner.x;
}

// From the eye to a corner, metres.
vec3 to_corner(ViewBuffer view, LampGrid grid, uvec3 corner) {
    vec2 ndc = 2.0 * vec2(corner.xy) / vec2(grid.tables.cells.xy) - 1.0;
    mat4 m = view.at[0].world_from_clip;
    return (m[0].xyz * ndc.x + m[1].xyz * ndc.y + m[3].xyz) * slice_depth(grid, float(corner.z));
}

// Share of a lamp's light that counts as near, at a distance from it. It and its slope fall to 0 at the reach times the scale.
float near_share(float distance, float reach, float scale) {
    if (isinf(reach)) return 1.0;
    reach *= scale;
    if (distance >= reach) return 0.0;
    float q = distance / reach;
    float window = 1.0 - q * q * q * q;
    return window * window;
}

// Light of far lamps at a place.
struct FarLight {
    float scale;      // what reaches are multiplied with there
    vec3 irradiance;  // on the surface
    vec3 fluence;     // sum of the irradiances at normal incidence
    mat3 flow;        // the same times the direction towards each lamp; a column for each colour
};

// Order-2 spherical harmonics of a direction, in the order of `Sky::irradiance_sh`.
float[9] harmonics(vec3 d) {
    return float[9](
        0.282095, 0.488603 * d.y, 0.488603 * d.z, 0.488603 * d.x, 1.092548 * d.x * d.y, 1.092548 * d.y * d.z,
        0.315392 * (3.0 * d.z * d.z - 1.0), 1.092548 * d.x * d.z, 0.546274 * (d.x * d.x - d.y * d.y)
    );
}

// What the corners around a place have, blended, on a surface with this normal. Irradiance: Ramamoorthi and Hanrahan 2001, "An Efficient
// Representation for Irradiance Environment Maps"; it rings a little, and negative sums become 0.
FarLight light_between_corners(LampGrid grid, vec3 position, vec3 normal) {
    CornerLightBuffer corners = CornerLightBuffer(grid.tables.corners);
    uvec3 first = min(uvec3(position), grid.tables.cells - 1u);
    vec3 t = position - vec3(first);
    float basis[9] = harmonics(normal);
    for (int k = 0; k < 9; k++) basis[k] *= k == 0 ? PI : k < 4 ? 2.0 * PI / 3.0 : PI / 4.0;
    FarLight far = FarLight(0.0, vec3(0.0), vec3(0.0), mat3(0.0));
    mat3 by_axis = mat3(0.0);
    for (uint k = 0u; k < 8u; k++) {
        uvec3 at = uvec3(k, k >> 1u, k >> 2u) & 1u;
        vec3 shares = mix(1.0 - t, t, equal(at, uvec3(1u)));
        float share = shares.x * shares.y * shares.z;
        uint corner = corner_index(grid, first + at);
        far.scale += share * corners.at[corner].scale;
        vec3 terms[4];
        for (int j = 0; j < 9; j++) {
            vec3 term = share * corners.at[corner].harmonics[j];
            far.irradiance += basis[j] * term;
            if (j < 4) terms[j] = term;
        }
        far.fluence += terms[0] / 0.282095;
        by_axis += mat3(terms[3], terms[1], terms[2]) / 0.488603;
    }
    far.irradiance = non_negative(far.irradiance);
    far.flow = transpose(by_axis);
    return far;
}

// Radiance that a surface reflects of it. `v`: to the eye, in the frame of the columns of `around`, whose third is the shading normal. `lobe`: share
// of the specular part.
vec3 reflected_of_far(FarLight light, Bsdf b, mat3 around, vec3 v, float lobe) {
    float fluence = luminance(light.fluence);
    if (!(fluence > 0.0)) return vec3(0.0);
    vec3 flow = light.flow * LUMINANCE;
    float agree = min(length(flow) / fluence, 1.0);
    vec3 l = safe_normalize(flow, around[2]) * around;
    // Of even light the mean cosine on a surface is a half.
    float cosine = clamp(mix(0.5, l.z, agree), 0.05, 1.0);
    vec3 sum = below_coat(b, v) * diffuse_cosine(b.fresnel, (1.0 - b.metalness) * b.base_colour, v.z, cosine) / cosine * light.irradiance;
    if (lobe <= 0.0) return sum;

    // Specular: light that agrees comes from one direction, spread over 2 (1 - agree) squared radians, of which half vectors see a quarter; the
    // rest from everywhere.
    vec3 flows = vec3(length(light.flow[0]), length(light.flow[1]), length(light.flow[2]));
    vec3 shares = min(flows / max(light.fluence, vec3(1e-30)), vec3(1.0));
    float spread = 0.5 * (1.0 - agree);
    Bsdf wide = b;
    wide.alpha = min(sqrt(b.alpha * b.alpha + spread), 1.0);
    wide.coat_alpha = min(sqrt(b.coat_alpha * b.coat_alpha + spread), 1.0);
    vec3 specular = specular_albedo(b, v.z) * light.fluence * (1.0 - shares) / (4.0 * PI);
    if (l.z > 0.0) specular += bsdf_cosine(wide, v, l, LOBE_SPECULAR) * light.fluence * shares;
    return sum + lobe * specular;
}

#endif
