#ifndef LIB_RESAMPLING_GLSL
#define LIB_RESAMPLING_GLSL
#include "lib/gbuffer.glsl"
#include "lib/hit_shading.glsl"
#include "lib/not_finite.glsl"
#include "shared/resampling.glsl"
// Resampled importance sampling of lights (Talbot et al. 2005, "Importance Resampling for Global Illumination") with reservoirs (Bitterli et
// al. 2020, "Spatiotemporal reservoir resampling for real-time ray tracing with dynamic direct lighting").
//
// A sample is a light and two numbers that the light's own sampling turns into a point. The space of samples is the same at every
// surface, so a sample goes from one to another without a Jacobian, and lights of every kind are alike: no density per area or per solid
// angle occurs here.

// Words that make the random numbers of each pass others.
const uint SALT_CANDIDATES = 0x51ed270bu;
const uint SALT_TEMPORAL = 0x7b1c3a95u;
const uint SALT_SPATIAL = 0x2f9be6ccu;

// Counters: closest-hit and any-hit rays.
uvec2 resampling_traced = uvec2(0u);

uint pixel_index(ViewBuffer view, ivec2 pixel) {
    return uint(pixel.y) * view.at[0].size.x + uint(pixel.x);
}

// A surface that receives light. Local directions as in lib/bsdf.glsl.
struct SampledPoint {
    RayStart start;
    mat3 around;
    vec3 v;
    Bsdf bsdf;
};

// Distances, metres, in 8 bits: steps of a tenth of a metre near by, of 4 % farther off, and one code for all beyond 6.5 km. 0 is for none.
const float FINEST_STEPS = 0.1;
const float OCTAVES = 16.0;

uint pack_distance(float distance) {
    return clamp(uint(round(255.0 / OCTAVES * log2(1.0 + distance / FINEST_STEPS))), 1u, 255u);
}

// `code`: above 0.
float unpack_distance(uint code) {
    return code == 255u ? INFINITELY_FAR : FINEST_STEPS * (exp2(OCTAVES / 255.0 * float(code)) - 1.0);
}

LitSurface lit_surface_of(Surface s, RayStart start, vec3 eye, vec2 dielectric) {
    // A colour above 0 stays so: nothing that reflects light must be taken for black.
    vec3 colour = ceil(255.0 * sqrt(s.base_colour)) / 255.0;
    vec3 at = abs(start.position);
    LitSurface r;
    r.from_eye = start.position - eye;
    // The difference is rounded, and so is the sum that undoes it.
    r.rounding = start.rounding + 2.4e-7 * max(at.x, max(at.y, at.z));
    r.geometric_normal = packSnorm2x16(octahedral_encode(start.normal));
    r.normal = packSnorm2x16(octahedral_encode(s.normal));
    r.colour = packUnorm4x8(vec4(colour, s.metalness));
    r.gloss = packUnorm4x8(vec4(s.roughness, s.coat, s.coat_roughness, 0.0));
    r.dielectric = packSnorm2x16(dielectric);
    return r;
}

bool is_lit(LitSurface r) {
    return r.rounding > 0.0;
}

vec3 lit_normal(LitSurface r) {
    return octahedral_decode(unpackSnorm2x16(r.normal));
}

// `eye`: of the frame that the receiver belongs to.
SampledPoint sampled_point(LitSurface r, vec3 eye) {
    vec4 colour = unpackUnorm4x8(r.colour);
    vec4 gloss = unpackUnorm4x8(r.gloss);
    vec3 base_colour = colour.rgb * colour.rgb;
    vec3 normal = lit_normal(r);
    Fresnel fresnel = fresnel_of(decode_dielectric(unpackSnorm2x16(r.dielectric)), base_colour, colour.a);
    SampledPoint p;
    p.start = RayStart(eye + r.from_eye, octahedral_decode(unpackSnorm2x16(r.geometric_normal)), r.rounding);
    p.around = frame_of(normal);
    p.v = safe_normalize(-r.from_eye, normal) * p.around;
    p.v.z = max(p.v.z, 1e-4);
    p.bsdf = opaque_bsdf(base_colour, colour.a, gloss.x, fresnel);
    p.bsdf.coat = gloss.y;
    p.bsdf.coat_alpha = alpha_of_roughness(gloss.z);
    return p;
}

uint pack_point(vec2 u) {
    uvec2 words = uvec2(u * 65536.0);
    return words.x | (words.y << 16u);
}

vec2 unpack_point(uint point) {
    return (vec2(point & 65535u, point >> 16u) + 0.5) / 65536.0;
}

// The light of a sample at a place, over the density of its point, and whether there is any. `before`: one frame ago.
bool sample_incident(SceneBuffer scene, LightChoice choice, vec3 position, vec2 u, bool before, out Incident from) {
    if (choice.light == CHOICE_EMITTER) {
        return before ? sample_previous_emitter(scene, choice, position, u, from) : sample_emitter(scene, choice, position, u, from);
    }
    return sample_sized_light(LightBuffer(before ? scene.at[0].previous_lights : scene.at[0].lights).at[choice.light], position, u, from);
}

// The light of a sample that reaches `p`, unshadowed, over the density of its point, and its local direction. False if none can be reflected.
// `before`: of the light one frame ago.
bool sample_arriving(
    SceneBuffer scene, LightTables lights, SampledPoint p, uint light, uint point, bool before, out Incident from, out vec3 l
) {
    from = Incident(vec3(0.0), 0.0, vec3(0.0), 0.0);
    l = vec3(0.0);
    if (light == NO_SAMPLE) return false;
    bool is_far = (light & DIRECTIONAL_SAMPLE) != 0u;
    uint entry = light & ~DIRECTIONAL_SAMPLE;
    // The light may be gone.
    if (entry >= (is_far ? lights.far_count : lights.near_count)) return false;
    LightChoice choice = LightChoiceBuffer(is_far ? lights.far : lights.near).at[entry];
    bool found = sample_incident(scene, choice, p.start.position, unpack_point(point), before, from);
    if (!found || dot(p.start.normal, from.direction) <= 0.0) return false;
    l = from.direction * p.around;
    return l.z > 0.0;
}

// What `p` reflects of it.
vec3 reflected_sample(SceneBuffer scene, LightTables lights, SampledPoint p, uint light, uint point, bool before, out Incident from) {
    vec3 l;
    if (!sample_arriving(scene, lights, p, light, point, before, from, l)) return vec3(0.0);
    return bsdf_cosine(p.bsdf, p.v, l, LOBE_DIFFUSE | LOBE_SPECULAR) * from.radiance;
}

// The target: luminance of that, in this frame.
float target_of(SceneBuffer scene, LightTables lights, SampledPoint p, uint light, uint point, out Incident from) {
    return luminance(reflected_sample(scene, lights, p, light, point, false, from));
}

// Share of a sample that arrives, per colour channel.
vec3 visible_share(SceneBuffer scene, RayStart start, Incident from) {
    Ray ray = from.distance >= INFINITELY_FAR ? surface_ray(start, from.direction, UNBOUNDED)
        : surface_ray_to(start, start.position + from.distance * from.direction);
    return seen_along(scene, ray, resampling_traced);
}

bool is_visible(SceneBuffer scene, RayStart start, Incident from) {
    return visible_share(scene, start, from) != vec3(0.0);
}

const Reservoir NO_RESERVOIR = Reservoir(NO_SAMPLE, 0u, 0.0, 0u);

uint confidence_of(Reservoir r) {
    return r.confidence & 65535u;
}

uint age_of(Reservoir r) {
    return r.confidence >> 16u;
}

// Both are limited to what 16 bits hold.
uint pack_confidence(uint confidence, uint age) {
    return min(confidence, 65535u) | (min(age, 65535u) << 16u);
}

#define RESERVOIR Reservoir
#include "lib/reservoir_stream.glsl"

// Finishes a stream. `normalization`: what the sum of the weights is divided by.
Reservoir finished(Stream s, float normalization, uint confidence) {
    Reservoir r = s.chosen;
    r.weight = weight_of(s, normalization);
    r.confidence = pack_confidence(confidence, age_of(r));
    return r;
}

#endif
