#ifndef LIB_PROBE_GLSL
#define LIB_PROBE_GLSL
#include "lib/bindless.glsl"
#include "lib/not_finite.glsl"
#include "lib/vector.glsl"
#include "shared/probe.glsl"
// Reflection probes: cubes of radiance and distance. `probe_light` gives the radiance that a surface sees in a direction over a lobe.
//
// Faces are layers, in the order +x -x +y -y +z -z. Texel centres at the border of a face lie exactly on its edge, so that two faces hold
// the same directions along the edge that they share, and filtering within each face leaves no seam.
//
// Alpha holds 1 / z with z the distance along the axis of the face: linear over a plane, as in perspective, so that filtering is exact for
// planes; 0 is the sky. On the edge of two faces both axes give the same z.

float largest_component(vec3 v) {
    vec3 a = abs(v);
    return max(a.x, max(a.y, a.z));
}

// Face of a direction of any length but 0, and its coordinates there, -1 to 1.
uint cube_face(vec3 d, out vec2 at) {
    vec3 a = abs(d);
    uint axis = a.x >= a.y && a.x >= a.z ? 0u : a.y >= a.z ? 1u : 2u;
    float along = d[axis];
    at = vec2(d[(axis + 1u) % 3u], d[(axis + 2u) % 3u]) / abs(along);
    return 2u * axis + (along < 0.0 ? 1u : 0u);
}

// Its inverse: the component along the axis of the face is 1.
vec3 cube_direction(uint face, vec2 at) {
    uint axis = face / 2u;
    vec3 d;
    d[axis] = (face & 1u) == 0u ? 1.0 : -1.0;
    d[(axis + 1u) % 3u] = at.x;
    d[(axis + 2u) % 3u] = at.y;
    return d;
}

// Coordinates on a face of the centre of a texel, of a face with `side` texels along an edge, at least 2.
vec2 cube_at(ivec2 texel, uint side) {
    return 2.0 * vec2(texel) / float(side - 1u) - 1.0;
}

// The same as texture coordinates.
vec2 cube_uv(vec2 at, float side) {
    return ((0.5 * at + 0.5) * (side - 1.0) + 0.5) / side;
}

// Solid angle of a texel in this direction, whose component along the axis of the face is 1.
float cube_solid_angle(vec2 at, float side) {
    float step = 2.0 / (side - 1.0);
    float square = 1.0 + dot(at, at);
    return step * step / (square * sqrt(square));
}

vec4 sample_layer(uint image, uint sampler_id, vec2 uv, float layer, float lod) {
    return textureLod(sampler2DArray(image_arrays[nonuniformEXT(image)], samplers[nonuniformEXT(sampler_id)]), vec3(uv, layer), lod);
}

// One mip of a cube, filtered. `side`: texels of an edge in that mip.
vec4 sample_cube_mip(uint image, uint sampler_id, uint layer, vec3 d, float side, float mip) {
    vec2 at;
    uint face = cube_face(d, at);
    return sample_layer(image, sampler_id, cube_uv(at, side), float(layer + face), mip);
}

// Between two mips: texel centres of mips do not coincide at the borders, so samplers cannot blend them.
vec4 sample_cube(uint image, uint sampler_id, uint layer, vec3 d, uint side, uint mips, float level) {
    vec2 at;
    float slice = float(layer + cube_face(d, at));
    float low = min(floor(level), float(mips));
    vec4 value = sample_layer(image, sampler_id, cube_uv(at, float(side >> uint(low))), slice, low);
    if (level <= low || low >= float(mips)) return value;
    vec4 next = sample_layer(image, sampler_id, cube_uv(at, float(side >> uint(low + 1.0))), slice, low + 1.0);
    return mix(value, next, level - low);
}

// Where a probe captures, world, metres. An offset that is not finite counts as none.
vec3 probe_centre(vec3 centre, uvec2 offsets, uint index) {
    vec3 offset = PositionBuffer(offsets).at[index];
    return is_finite(offset) ? centre + offset : centre;
}

// What a ray meets according to a probe.
struct ProbeHit {
    vec3 direction;    // from the probe's centre, any length
    float travelled;   // along the ray, metres; infinite if unknown or the sky
    float from_probe;  // from the centre, metres
    float trust;       // 0 to 1
    float hidden;      // how far the surface that reflects is hidden from the probe, 0 to 1
};

const float PROBE_FAR = 1e30;

// Roughness to look up with: of the cone that the surface reflects by, `travelled` long, the probe sees the end from `from_probe` away
// (digest of Paananen 2016, "Physically-based shading and real-time reflections", equation 6.3).
float probe_roughness(uint narrowing, float roughness, ProbeHit hit) {
    if (narrowing == PROBE_NARROWING_OFF || !(hit.travelled < PROBE_FAR)) return roughness;
    float ratio = hit.travelled / max(hit.from_probe, 1e-6);
    return clamp(roughness * (narrowing == PROBE_NARROWING_ALPHA ? sqrt(ratio) : ratio), 0.0, 1.0);
}

// Where a ray leaves a box around the origin.
float leaves_box(vec3 origin, vec3 direction, vec3 half_size) {
    float t = PROBE_FAR;
    for (int axis = 0; axis < 3; axis++) {
        // Along an axis that the ray does not move it never leaves.
        if (direction[axis] == 0.0) continue;
        t = min(t, (sign(direction[axis]) * half_size[axis] - origin[axis]) / direction[axis]);
    }
    return max(t, 0.0);
}

// How far a point is behind what the probe captured: below 0 in front, in shares of the distance. `w`: weight of a homogeneous point.
float behind_captured(ProbeImages p, ProbeTable t, uint layer, vec3 point, float w, float mip) {
    float nearness = sample_cube_mip(p.chain, p.sampler_id, layer, point, float(t.side >> uint(mip)), mip).a;
    return largest_component(point) * nearness - w;
}

// Gap between a ray and the captured surface, in shares of the distance, up to which the ray meets it; beyond, it passes behind an edge.
const float PROBE_GAP = 0.08;

// Follows a ray over the captured distances (Szirmay-Kalos, Aszodi, Lazanyi and Premecz 2005, "Approximate Ray-Tracing on the GPU with
// Distance Impostors"): steps find where it comes to lie behind them, secants where exactly. `o`: its origin from the probe's centre.
//
// Points are (1 - s) o + s |o| r over 1 - s: steps of s are nearly equal angles seen from the centre, and s = 1 is infinitely far.
ProbeHit march_probe(ProbeImages p, ProbeTable t, uint layer, vec3 o, vec3 r, float mip) {
    float scale = max(length(o), 1e-3);
    vec3 end = scale * r;
    // The surface that reflects is itself captured, a little before or behind where it is: by so much everything near it is shifted.
    float shift = max(behind_captured(p, t, layer, o, 1.0, mip), 0.0);
    float hidden = smoothstep(PROBE_GAP, 3.0 * PROBE_GAP, shift);
    ProbeHit hit = ProbeHit(r, PROBE_FAR, PROBE_FAR, 1.0, hidden);
    if (hidden >= 1.0) return hit;
    float before = -1e-4;
    float s_before = 0.0;
    float edge = -1.0;
    float found = -1.0;
    for (uint i = 1u; i <= t.steps && found < 0.0; i++) {
        float s = float(i) / float(t.steps);
        float now = behind_captured(p, t, layer, mix(o, end, s), 1.0 - s, mip) - shift * (1.0 - s);
        // At the end of the ray the sky is neither before nor behind.
        if (before < 0.0 && (now > 0.0 || (now == 0.0 && i < t.steps))) {
            float a = s_before, b = s, f_a = before, f_b = now;
            for (int k = 0; k < 4; k++) {
                float at = mix(a, b, clamp(f_a / (f_a - f_b), 0.05, 0.95));
                float f = behind_captured(p, t, layer, mix(o, end, at), 1.0 - at, mip) - shift * (1.0 - at);
                if (f < 0.0) {
                    a = at;
                    f_a = f;
                } else {
                    b = at;
                    f_b = f;
                }
            }
            // An edge stays a jump however near the ends are.
            if (f_b - f_a < PROBE_GAP) found = mix(a, b, f_a / (f_a - f_b));
            else if (edge < 0.0) edge = a;
        }
        before = now;
        s_before = s;
    }
    if (found < 0.0) {
        if (before <= 0.0) return hit;
        // Hidden to the end: what the ray passed behind, or what lies in its direction.
        hit.trust = 0.3;
        if (edge < 0.0) return hit;
        found = edge;
    }
    float left = max(1.0 - found, 1e-6);
    hit.direction = mix(o, end, found);
    hit.travelled = scale * found / left;
    hit.from_probe = length(hit.direction) / left;
    return hit;
}

// What a probe shows along a ray, blurred to a roughness. False if the value is not finite.
bool probe_radiance(ProbeImages p, ProbeTable t, uvec2 not_finite, Probe probe, vec3 centre, vec3 position, vec3 r, float roughness,
    out vec3 radiance, out float trust
) {
    vec3 o = position - centre;
    ProbeHit hit = ProbeHit(r, PROBE_FAR, PROBE_FAR, 1.0, 0.0);
    if (t.correction == PROBE_CORRECTION_BOX && probe.half_size.x > 0.0) {
        float travelled = leaves_box(transform_point(probe.box_from_world, position), transform_vector(probe.box_from_world, r), probe.half_size);
        vec3 met = o + travelled * r;
        hit = ProbeHit(met == vec3(0.0) ? r : met, travelled, length(met), 1.0, 0.0);
    } else if (t.correction == PROBE_CORRECTION_DISTANCE) {
        // Rough lobes are wide: the distances are those of the lobe's mip below.
        float mip = max(floor(roughness * float(t.mips)) - 1.0, 0.0);
        hit = march_probe(p, t, probe.layer, o, r, mip);
    }
    float narrowed = probe_roughness(t.narrowing, roughness, hit);
    vec4 value = sample_cube(p.chain, p.sampler_id, probe.layer, hit.direction, t.side, t.mips, narrowed * float(t.mips));
    // The probe does not see what is near a surface that it does not see.
    if (hit.hidden > 0.0 && hit.travelled < PROBE_FAR) {
        value = mix(value, sample_cube(p.chain, p.sampler_id, probe.layer, r, t.side, t.mips, roughness * float(t.mips)), hit.hidden);
    }
    radiance = value.rgb;
    trust = hit.trust * (1.0 - 0.7 * hit.hidden);
    return is_taken(not_finite, value);
}

// Weight of a probe at a position: of its box, smooth at the border, or of the camera's probe.
float probe_weight(ProbeTable t, Probe probe, vec3 centre, vec3 position) {
    if (probe.half_size.x > 0.0 && probe.fade >= 0.0) {
        vec3 inside = probe.half_size - abs(transform_point(probe.box_from_world, position));
        float depth = min(inside.x, min(inside.y, inside.z));
        return depth <= 0.0 ? 0.0 : smoothstep(0.0, 1.0, probe.fade > 0.0 ? depth / probe.fade : 1.0);
    }
    return probe.weight * (1.0 - smoothstep(0.5 * t.reach, t.reach, distance(centre, position)));
}

// What the probes show.
struct ProbeLight {
    vec3 radiance;     // times `weight`
    float weight;      // 0 to 1; the rest is the sky's
    float confidence;  // 0 to 1
};

// Mean radiance over the lobe of this roughness around the unit direction `r`, from a position in the world.
//
// Weights of boxes that overlap are divided by their sum where it is above 1; where it is below, the camera's probe has the rest, and what it
// leaves is the sky's.
ProbeLight probe_light(ProbeImages p, uvec2 not_finite, vec3 position, vec3 r, float roughness) {
    ProbeTable t = ProbeTableBuffer(p.table).at[0];
    ProbeBuffer probes = ProbeBuffer(p.probes);
    ProbeLight light = ProbeLight(vec3(0.0), 0.0, 0.0);
    float boxes = 0.0;
    for (uint i = 0u; i < t.count; i++) {
        Probe probe = probes.at[i];
        if (probe.fade < 0.0) continue;
        boxes += probe_weight(t, probe, vec3(0.0), position);
    }
    float of_boxes = boxes > 1.0 ? 1.0 / boxes : 1.0;
    float rest = 1.0 - min(boxes, 1.0);
    for (uint i = 0u; i < t.count; i++) {
        Probe probe = probes.at[i];
        vec3 centre = probe_centre(probe.centre, p.offsets, probe.offset);
        float weight = probe_weight(t, probe, centre, position) * (probe.fade < 0.0 ? rest : of_boxes);
        if (weight <= 0.0) continue;
        vec3 radiance;
        float trust;
        if (!probe_radiance(p, t, not_finite, probe, centre, position, r, roughness, radiance, trust)) continue;
        light.radiance += weight * radiance;
        light.weight += weight;
        light.confidence += weight * trust;
    }
    return light;
}

#endif
