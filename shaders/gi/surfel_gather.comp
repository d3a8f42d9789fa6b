#version 460
#extension GL_GOOGLE_include_directive : require
#include "lib/bindless.glsl"
#include "lib/gbuffer.glsl"
#include "lib/occlusion.glsl"
#include "lib/precision.glsl"
#include "lib/sky.glsl"
#include "lib/surfels.glsl"
#include "shared/denoise.glsl"
// Light of the surfels around each pixel.
layout(local_size_x = 8, local_size_y = 8) in;
layout(push_constant, scalar) uniform Push { SurfelGatherParams params; };

// Added to both sides of the ratio of openness, whose noise would count too much where nearly all is hidden.
const float LEAST_OPENNESS = 0.05;

// What the workgroup's pixels have found, for those among them that no surfel covers yet.
shared vec4 found_light[64];    // irradiance over pi; 1 in alpha where surfels cover the pixel
shared vec3 found_normal[64];
shared vec3 found_position[64];

// The mean over pixels of the workgroup that lie on the same surface. Where there are none, the light of the sky.
vec3 filled(ViewBuffer view, ivec2 pixel, Surface s) {
    vec4 sum = vec4(0.0);
    float scale = length(s.position - view.at[0].eye) * params.grid.size;
    for (uint i = 0u; i < 64u; i++) {
        if (found_light[i].a == 0.0) continue;
        float plane = abs(dot(s.geometric_normal, found_position[i] - s.position));
        float weight = max(dot(found_normal[i], s.geometric_normal), 0.0) / (1.0 + plane * plane / (scale * scale));
        sum += weight * found_light[i];
    }
    if (sum.a > 0.05) return sum.rgb / sum.a;
    if (view.at[0].has_sky == 0u) return vec3(0.0);
    float openness = params.openness == NO_IMAGE ? 1.0 : load(params.openness, pixel).r;
    return sky_irradiance(view.at[0].sky, s.normal) * (openness / PI);
}

// What ambient occlusion adds to the light of surfels. They know what hides light from their centres, ambient occlusion what hides it from pixels in between. So
// its ratio to what it is at those centres counts, which is 1 in the mean: nothing darkens twice. Both are as light that is reflected between near surfaces
// makes them. Surfels with few samples have light of a wider surrounding; there it counts less.
vec3 between_centres(float at_pixel, SurfelLight surfels, vec3 diffuse) {
    if (surfels.openness < 0.0) return vec3(1.0);
    vec3 ratio = (multi_bounce(at_pixel, diffuse) + LEAST_OPENNESS) / (multi_bounce(surfels.openness, diffuse) + LEAST_OPENNESS);
    return mix(vec3(1.0), ratio, min(surfels.samples / CONFIDENT, 1.0));
}

void main() {
    ViewBuffer view = ViewBuffer(params.view);
    ivec2 at = ivec2(gl_GlobalInvocationID.xy);
    ivec2 pixel = int(params.step) * at;
    uint place = gl_LocalInvocationIndex;
    Surface s = no_surface();
    if (inside(pixel, view.at[0].size)) s = load_surface(view, pixel, params.gbuffer);
    bool scatters = s.exists && s.metalness < 1.0 && s.base_colour != vec3(0.0);
    SurfelLight found = SurfelLight(false, false, false, vec3(0.0), 0.0, 0.0, -1.0, 0u);
    if (scatters) found = surfel_lookup(params.grid, view.at[0].eye, s.position, s.geometric_normal, s.normal);
    if (found.exists && params.openness != NO_IMAGE) {
        found.light *= between_centres(load(params.openness, pixel).r, found, (1.0 - s.metalness) * s.base_colour);
    }
    found_light[place] = vec4(found.light, found.exists ? 1.0 : 0.0);
    found_normal[place] = s.geometric_normal;
    found_position[place] = s.position;
    barrier();
    if (!inside(pixel, view.at[0].size)) return;
    vec3 radiance = vec3(0.0);
    if (scatters) radiance = found.exists ? found.light : filled(view, pixel, s);
    if (scatters && params.step == 1u) radiance *= diffuse_albedo(s);
    store(params.radiance, at, vec4(representable(radiance, params.greatest), 1.0));
}
