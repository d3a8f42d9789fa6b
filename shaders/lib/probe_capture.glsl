#ifndef LIB_PROBE_CAPTURE_GLSL
#define LIB_PROBE_CAPTURE_GLSL
#include "lib/hit_shading.glsl"
#include "lib/path.glsl"
#include "lib/precision.glsl"
#include "lib/probe.glsl"
#include "lib/tinted.glsl"
// What a reflection probe captures in a direction: the light of what a ray meets, and how far away it is. With TINTED, surfaces may let
// light through, as in lib/tinted.glsl.
//
// Lamps, the sun's disc, and surfaces that emit do not show: the slot `direct` has their highlights (Paananen 2016, section 6.3: light in
// both would count twice). Unlit surfaces do, for nothing else shows their light.

layout(set = 0, binding = 1) uniform uimage2DArray storage_image_arrays_uint[];

// Counters: closest-hit and any-hit rays.
uvec2 probe_traced = uvec2(0u);

// Surfaces that a hit's indirect light may be taken from the probe for: rough ones look the same from everywhere.
const float LEAST_SHARED_ALPHA = 0.25;

// Traces until a surface stops the ray. `throughput`: of what it passed. Lights with a size that it meets on the way are added to
// `radiance` if `pdf`, with which its direction was sampled at `vertex`, is above 0.
bool meet_surface(
    SceneBuffer scene, LightTables lights, inout Ray ray, LitPoint vertex, float pdf, inout Random random, inout vec3 throughput, inout vec3 radiance,
    out Hit hit, out SurfacePoint s, out uint lobes
) {
    vec3 direction = normalize(ray.direction);
    lobes = LOBE_ALL;
    for (uint turn = 0u; turn < MOST_SHEETS; turn++) {
        probe_traced.x++;
#ifdef TINTED
        ray.cull |= RAY_BLENDED;
#endif
        bool met = trace_closest(scene, ray, hit);
        float t_max = hit.t * length(ray.direction);
        if (pdf > 0.0) add_lights_met(radiance, throughput, scene, lights, ray, vertex, pdf, 0.0, vec3(0.0), t_max, met, 0u);
        if (!met) return false;
        float width = cone_width_at(ray, hit.t);
        s = surface_at(scene, ray, hit, cone_footprint(ray.direction, hit_start(scene, ray, hit).normal, width));
#ifdef TINTED
        lobes = LOBE_ALL;
        if (goes_straight_on(s, direction, random, throughput, lobes)) {
            ray = with_cone(surface_ray(s.start, direction, UNBOUNDED), width, ray.cone_spread);
            continue;
        }
#endif
        return true;
    }
    return false;
}

// Indirect light of a hit by one ray. If `shared_light`, what the probe has captured where that ray ends stands for all further bounces.
vec3 indirect_light(
    ViewBuffer view, SceneBuffer scene, LightTables lights, CaptureParams p, vec3 centre, SurfacePoint s, vec3 to_viewer, uint lobes,
    inout Random random
) {
    mat3 frame = frame_of(s.normal);
    vec3 v = to_viewer * frame;
    vec4 u = random4(random);
    vec3 l;
    if (!bsdf_sample(s.bsdf, v, lobes, u.x, u.yz, l)) return vec3(0.0);
    vec3 next = frame * l;
    if ((dot(s.start.normal, next) < 0.0) != (l.z < 0.0)) return vec3(0.0);
    float pdf = bsdf_pdf(s.bsdf, v, l, lobes);
    if (!(pdf > 0.0)) return vec3(0.0);
    vec3 throughput = bsdf_cosine(s.bsdf, v, l, lobes) / pdf;
    vec3 radiance = vec3(0.0);
    Ray ray = surface_ray(s.start, next, UNBOUNDED);
    LitPoint vertex = lit_surface(s);
    Hit hit;
    SurfacePoint there;
    uint lobes_there;
    if (!meet_surface(scene, lights, ray, vertex, pdf, random, throughput, radiance, hit, there, lobes_there)) {
        if (view.at[0].has_sky != 0u) add_sky_met(radiance, throughput, view, lights, normalize(ray.direction), pdf, 0.0, 0u);
        return radiance;
    }
    add_emission_met(radiance, throughput, scene, lights, there, hit, vertex, pdf, 0.0, 0u);
    if (there.black) return radiance;
    if (p.indirect > 1u && there.bsdf.alpha >= LEAST_SHARED_ALPHA) {
        vec3 o = there.start.position - centre;
        vec4 seen = sample_cube_mip(p.filtered, p.sampler_id, 0u, o, float(p.side >> 1u), 0.0);
        if (abs(largest_component(o) * seen.a - 1.0) < PROBE_GAP && is_taken(p.not_finite, seen)) return radiance + throughput * seen.rgb;
    }
    return radiance + throughput * direct_light_at(view, scene, lights, there, -normalize(ray.direction), lobes_there, 0u, 0.0, random, probe_traced);
}

// Radiance and reciprocal distance along the axis of the face. `surface`: 24 bits that change with the triangle or sphere; 0 for the sky.
vec4 captured_light(ViewBuffer view, SceneBuffer scene, CaptureParams p, vec3 centre, vec3 along, Random random, out uint surface) {
    surface = 0u;
    LightTables lights = LightTablesBuffer(p.lights).at[0];
    vec3 direction = normalize(along);
    Ray ray = with_cone(make_ray(centre, 0.0, direction, UNBOUNDED), 0.0, 2.0 / float(p.side - 1u));
    vec3 throughput = vec3(1.0);
    vec3 radiance = vec3(0.0);
    Hit hit;
    SurfacePoint s;
    uint lobes;
    if (!meet_surface(scene, lights, ray, lit_point(centre, vec3(0.0), false), 0.0, random, throughput, radiance, hit, s, lobes)) {
        return vec4(view.at[0].has_sky != 0u ? throughput * sky_radiance(view.at[0].sky, direction) : vec3(0.0), 0.0);
    }
    // What moves is another surface in every frame.
    Instance instance = InstanceBuffer(scene.at[0].instances).at[hit.instance];
    bool moves = instance.world_from_object != instance.previous_world_from_object;
    surface = hash4(uvec4(hit.instance, hit.primitive, moves ? p.key : 0u, 0u)).x >> 8u;
    if (s.black) {
        radiance = s.emission;
    } else {
        radiance = direct_light_at(view, scene, lights, s, -direction, lobes, p.indirect > 0u ? lobes : 0u, 0.0, random, probe_traced);
        if (p.indirect > 0u) radiance += indirect_light(view, scene, lights, p, centre, s, -direction, lobes, random);
    }
    // A surface at the centre itself is as near as the format can say.
    float z = largest_component(s.start.position - centre);
    return vec4(throughput * radiance, z > 0.0 ? 1.0 / z : 65504.0);
}

// Captures a texel, and averages it with earlier captures. `slot` counts the faces that are captured.
void capture_texel(ViewBuffer view, CaptureParams p, uint slot, ivec2 texel) {
    uint face = 0u;
    for (uint seen = 0u; face < PROBE_FACES; face++) {
        if ((p.faces & (1u << face)) == 0u) continue;
        if (seen == slot) break;
        seen++;
    }
    if (face == PROBE_FACES) return;
    ivec3 at = ivec3(texel, face);
    vec4 was = imageLoad(storage_image_arrays[p.radiance], at);
    uint word = imageLoad(storage_image_arrays_uint[p.counts], at).r;
    uint count = word & 255u;
    vec3 centre = probe_centre(p.centre, p.offset, 0u);
    uint index = (uint(texel.y) * p.side + uint(texel.x)) * PROBE_FACES + face;
    uint surface;
    vec3 along = cube_direction(face, cube_at(texel, p.side));
    vec4 now = captured_light(view, SceneBuffer(p.scene), p, centre, along, random_of(index, p.key, view.at[0].seed), surface);
    bool is_fresh = (p.fresh & (1u << face)) != 0u || count == 0u || !is_taken(p.not_finite, was);
    if (is_fresh) count = 0u;
    if (!is_taken(p.not_finite, now)) {
        // Nothing was captured: what there was stays, or there is nothing.
        if (is_fresh) {
            imageStore(storage_image_arrays[p.radiance], at, vec4(0.0));
            imageStore(storage_image_arrays_uint[p.counts], at, uvec4(0u));
        }
        return;
    }
    // Another surface than before: what was captured is no part of a mean with it. Where light passes through surfaces by chance, that says
    // nothing.
#ifndef TINTED
    if (surface != word >> 8u || abs(now.a - was.a) > PROBE_GAP * max(now.a, was.a)) count = 0u;
#endif
    count = min(count, p.most - 1u);
    // Later captures count more than the first ones, in which indirect light had not come far.
    vec4 mean = count == 0u ? now : was + (now - was) / (0.5 * float(count) + 1.0);
    imageStore(storage_image_arrays[p.radiance], at, vec4(representable(mean.rgb, 65504.0), representable(mean.aaa, 65504.0).x));
    imageStore(storage_image_arrays_uint[p.counts], at, uvec4((count + 1u) | (surface << 8u), uvec3(0u)));
}

#endif
