#ifndef LIB_SAMPLED_LIGHT_GLSL
#define LIB_SAMPLED_LIGHT_GLSL
#include "lib/lobes.glsl"
#include "lib/resampling.glsl"
// Visibility and light of reservoirs' samples.

void test_visibility(VisibilityParams params) {
    ViewBuffer view = ViewBuffer(params.view);
    ivec2 pixel = ivec2(RAY_INVOCATION.xy);
    if (!inside(pixel, view.at[0].size)) return;
    uint index = pixel_index(view, pixel);
    Reservoir r = ReservoirBuffer(params.reservoirs).at[index];
    if (r.weight > 0.0) {
        SceneBuffer scene = SceneBuffer(params.scene);
        LightTables lights = LightTablesBuffer(params.lights).at[0];
        SampledPoint p = sampled_point(LitSurfaceBuffer(params.surfaces).at[index], view.at[0].eye);
        Incident from;
        reflected_sample(scene, lights, p, r.light, r.point, false, from);
        if (!is_visible(scene, p.start, from)) ReservoirBufferWrite(params.reservoirs).at[index].weight = 0.0;
    }
    count_rays(params.rays, resampling_traced.x, resampling_traced.y);
}

// Distance to what the specular lobes reflect, metres: of the light where it is that, else of what a ray along the lobe has met.
float reflected_distance(LitSurface lit, Incident from, Lobes light) {
    uint met = lit.gloss >> 24u;
    bool shows_light = luminance(light.specular) > luminance(light.diffuse);
    if (shows_light || (met == 0u && from.distance > 0.0)) return from.distance;
    return met == 0u ? INFINITELY_FAR : unpack_distance(met);
}

void shade_sample(SampledLightParams params) {
    ViewBuffer view = ViewBuffer(params.view);
    ivec2 pixel = ivec2(RAY_INVOCATION.xy);
    if (!inside(pixel, view.at[0].size)) return;
    uint index = pixel_index(view, pixel);
    Reservoir r = ReservoirBuffer(params.reservoirs).at[index];
    Lobes light = DARK;
    Reflecting seen = Reflecting(bsdf_of(no_surface()), 1.0, 0.0, 0.0);
    float hit_distance = INFINITELY_FAR;
    if (r.weight > 0.0 || is_split(params.lobes)) {
        SceneBuffer scene = SceneBuffer(params.scene);
        LitSurface lit = LitSurfaceBuffer(params.surfaces).at[index];
        SampledPoint p = sampled_point(lit, view.at[0].eye);
        // In place of the rounded material the one of the G-buffer.
        Surface s = load_surface(view, pixel, params.gbuffer);
        p.around = frame_of(s.normal);
        p.v = s.to_eye * p.around;
        p.v.z = eye_cosine(s);
        p.bsdf = bsdf_of(s);
        if (s.exists) seen = Reflecting(p.bsdf, p.v.z, distance(s.position, view.at[0].eye), share_apart(params.lobes, s));
        Incident from = Incident(vec3(0.0), 0.0, vec3(0.0), 0.0);
        vec3 l;
        if (r.weight > 0.0 && sample_arriving(scene, LightTablesBuffer(params.lights).at[0], p, r.light, r.point, false, from, l)) {
            light = lobes_cosine(seen.apart, p.bsdf, p.v, l);
            light.diffuse *= from.radiance * r.weight;
            light.specular *= from.radiance * r.weight;
            if (light != DARK) {
                vec3 share = visible_share(scene, p.start, from);
                light.diffuse *= share;
                light.specular *= share;
            }
        }
        hit_distance = reflected_distance(lit, from, light);
    }
    store_lobes(view, params.lobes, pixel, seen, light, hit_distance);
    count_rays(params.rays, resampling_traced.x, resampling_traced.y);
}

#endif
