#ifndef LIB_CANDIDATES_GLSL
#define LIB_CANDIDATES_GLSL
#include "lib/lamp_walk.glsl"
#include "lib/light_tree.glsl"
#include "lib/resampling.glsl"
// The candidates of one frame, streamed into a reservoir: lights from a table, and what a ray along the specular lobe meets. Where both could
// draw the same sample each has its weight by the balance heuristic (Veach 1997, section 9.2).

// The greatest float below 1.
const float BELOW_ONE = 0.99999994;

struct Candidates {
    SceneBuffer scene;
    LightTables lights;
    LightTree tree;
    SampledPoint point;
    uint source;
    uint near;      // candidates from the table `near`
    uint far;       // from the table `far`
    bool lobe;      // one more along the specular lobe
};

uint candidates_of(Candidates c, uint light) {
    return (light & DIRECTIONAL_SAMPLE) != 0u ? c.far : c.near;
}

// Probability of a light, for one candidate.
float source_probability(Candidates c, uint light, LightChoice choice) {
    bool is_far = (light & DIRECTIONAL_SAMPLE) != 0u;
    if (c.source == SOURCE_UNIFORM) return 1.0 / float(is_far ? c.lights.far_count : c.lights.near_count);
    if (is_far || c.source == SOURCE_POWER) return choice.probability;
    return tree_probability(c.scene, c.tree, c.lights, light, c.point.start.position, c.point.around[2], false);
}

// Whether a ray along the lobe can find the light, as far as occlusion lets it: not what other things shine through.
bool lobe_can_find(Candidates c, LightChoice choice, Incident from) {
    if (from.pdf == 0.0) return false;
#ifdef TINTED
    if (choice.light == CHOICE_EMITTER) {
        return (InstanceBuffer(c.scene.at[0].instances).at[choice.instance].mask & INSTANCE_MASK_SOLID) != 0u;
    }
#endif
    return true;
}

// Offers a sample. It stands for all strategies that could have drawn it: its weight is the target over the expected number of times that they
// draw it, per unit of the space of samples. `probability`: of the light for one candidate; below 0 if it is not known yet.
void offer_candidate(inout Stream s, Candidates c, uint light, uint point, float probability, float u) {
    bool is_far = (light & DIRECTIONAL_SAMPLE) != 0u;
    LightChoice choice = LightChoiceBuffer(is_far ? c.lights.far : c.lights.near).at[light & ~DIRECTIONAL_SAMPLE];
    Incident from;
    float target = target_of(c.scene, c.lights, c.point, light, point, from);
    if (!(target > 0.0)) return;
    if (probability < 0.0) probability = source_probability(c, light, choice);
    float expected = float(candidates_of(c, light)) * probability;
    if (c.lobe && lobe_can_find(c, choice, from)) {
        expected += bsdf_pdf(c.point.bsdf, c.point.v, from.direction * c.point.around, LOBE_SPECULAR) / from.pdf;
    }
    Reservoir r = NO_RESERVOIR;
    r.light = light;
    r.point = point;
    offer(s, r, target, expected > 0.0 ? target / expected : 0.0, 0u, u);
}

// `number`: which of `count` candidates this is. The table's entries are stratified over them.
void offer_light(inout Stream s, Candidates c, bool is_far, uint number, uint count, inout Random random) {
    LightChoiceBuffer table = LightChoiceBuffer(is_far ? c.lights.far : c.lights.near);
    uint entries = is_far ? c.lights.far_count : c.lights.near_count;
    uvec4 words = random_words(random);
    vec4 u = unit_floats(words);
    uint entry;
    float probability = -1.0;
    if (c.source == SOURCE_TREE && !is_far) {
        vec3 position = c.point.start.position;
        vec2 which = vec2((float(number) + u.x) / float(count), u.y);
        if (!choose_by_tree(c.scene, c.tree, position, c.point.around[2], false, which, entry, probability)) return;
    } else if (c.source == SOURCE_UNIFORM) {
        entry = min(uint((float(number) + u.x) / float(count) * float(entries)), entries - 1u);
    } else {
        entry = choose(table, entries, words.x, u.y);
    }
    offer_candidate(s, c, is_far ? entry | DIRECTIONAL_SAMPLE : entry, pack_point(u.zw), probability, random4(random).x);
}

// Offers a lamp if a ray meets it before its end. `nearest`: the least distance of those that it meets.
void offer_met(inout Stream s, Candidates c, uint light, uint index, vec3 direction, float end, inout float nearest, inout Random random) {
    Light lamp = LightBuffer(c.scene.at[0].lights).at[index];
    float distance, pdf;
    vec3 radiance;
    if (!meet_light(lamp, c.point.start.position, direction, distance, radiance, pdf) || distance > end) return;
    nearest = min(nearest, distance);
    uint point = pack_point(min(numbers_of_light(lamp, c.point.start.position, direction, distance), vec2(BELOW_ONE)));
    offer_candidate(s, c, light, point, -1.0, random4(random).x);
}

// What a ray along the specular lobe meets: an emissive surface at its end, and lamps before it, which do not occlude. Returns the distance of the
// first, packed; 0 if there is no ray.
uint offer_by_lobe(inout Stream s, Candidates c, inout Random random) {
    vec3 l;
    bool above = sample_specular(c.point.bsdf, c.point.v, random4(random).xy, l);
    vec3 direction = c.point.around * l;
    if (!above || dot(c.point.start.normal, direction) <= 0.0) return 0u;
    Ray ray = surface_ray(c.point.start, direction, UNBOUNDED);
#ifdef TINTED
    ray.mask = INSTANCE_MASK_SOLID;
#endif
    Hit hit;
    resampling_traced.x++;
    bool met = trace_closest(c.scene, ray, hit);
    vec3 position = c.point.start.position;
    float end = met ? hit.t + dot(ray.origin - position, direction) : INFINITELY_FAR;
    float nearest = end;
    if (c.source == SOURCE_TREE) {
        LampWalk walk = lamp_walk(c.tree, position, direction, end);
        uint entry;
        while (next_lamp(c.tree, walk, entry)) {
            offer_met(s, c, entry, LightChoiceBuffer(c.lights.near).at[entry].light, direction, end, nearest, random);
        }
    }
    // Directional lights come last.
    for (uint i = c.lights.area_count; i > 0u; i--) {
        AreaLight area = AreaLightBuffer(c.lights.areas).at[i - 1u];
        bool is_far = LightBuffer(c.scene.at[0].lights).at[area.light].kind == LIGHT_DIRECTIONAL;
        if (!is_far && c.source == SOURCE_TREE) break;
        if (is_far && (c.far == 0u || met)) continue;
        offer_met(s, c, is_far ? area.entry | DIRECTIONAL_SAMPLE : area.entry, area.light, direction, end, nearest, random);
    }
    uint first = met ? WordBuffer(c.lights.emitters).at[hit.instance] : NO_EMITTER;
    if (first != NO_EMITTER) {
        uint point = pack_point(min(numbers_of_emitter(c.scene, hit, ray.origin + hit.t * ray.direction), vec2(BELOW_ONE)));
        offer_candidate(s, c, first + hit.primitive, point, -1.0, random4(random).x);
    }
    return pack_distance(nearest);
}

// Leaves with the surface how far away is what its lobe reflects.
Reservoir candidate_reservoir(ViewBuffer view, CandidateParams params, ivec2 pixel, inout LitSurface surface) {
    Candidates c;
    c.scene = SceneBuffer(params.scene);
    c.lights = LightTablesBuffer(params.lights).at[0];
    if (params.source == SOURCE_TREE) c.tree = LightTreeBuffer(params.tree).at[0];
    c.point = sampled_point(surface, view.at[0].eye);
    c.source = params.source;
    c.near = c.lights.near_count > 0u ? params.near_candidates : 0u;
    c.far = c.lights.far_count > 0u ? params.far_candidates : 0u;
    float alpha = narrowest_alpha(c.point.bsdf);
    bool reflective = c.point.bsdf.coat > 0.0 || has_reflection(c.point.bsdf.fresnel);
    c.lobe = reflective && alpha <= params.widest_alpha && params.widest_alpha > 0.0;
    Random random = random_of(pixel_index(view, pixel), view.at[0].frame, view.at[0].seed ^ SALT_CANDIDATES);
    Stream s = stream_from(NO_RESERVOIR);
    for (uint i = 0u; i < c.near; i++) offer_light(s, c, false, i, c.near, random);
    for (uint i = 0u; i < c.far; i++) offer_light(s, c, true, i, c.far, random);
    if (c.lobe) surface.gloss |= offer_by_lobe(s, c, random) << 24u;
    if (!is_taken(params.not_finite, vec3(s.sum, s.target, 0.0))) return Reservoir(NO_SAMPLE, 0u, 0.0, pack_confidence(1u, 0u));
    return finished(s, 1.0, 1u);
}

void draw_candidates(CandidateParams params) {
    ViewBuffer view = ViewBuffer(params.view);
    ivec2 pixel = ivec2(RAY_INVOCATION.xy);
    if (!inside(pixel, view.at[0].size)) return;
    uint index = pixel_index(view, pixel);
    LitSurface lit = LitSurface(vec3(0.0), 0.0, 0u, 0u, 0u, 0u, 0u);
    Reservoir r = NO_RESERVOIR;
    Surface s = load_surface(view, pixel, params.gbuffer);
    if (s.exists) {
        vec3 eye = view.at[0].eye;
        uvec2 ids = load_uint(params.gbuffer.ids, pixel).xy;
        RayStart start = seen_start(SceneBuffer(params.scene), ids, eye, pixel_ray(view, pixel), s.position);
        lit = lit_surface_of(s, start, eye, load(params.gbuffer.material, pixel).ba);
        r = candidate_reservoir(view, params, pixel, lit);
    }
    LitSurfaceBufferWrite(params.surfaces).at[index] = lit;
    ReservoirBufferWrite(params.reservoirs).at[index] = r;
    count_rays(params.rays, resampling_traced.x, resampling_traced.y);
}

#endif
