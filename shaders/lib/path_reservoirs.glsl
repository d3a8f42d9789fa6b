#ifndef LIB_PATH_RESERVOIRS_GLSL
#define LIB_PATH_RESERVOIRS_GLSL
#include "lib/colour.glsl"
#include "lib/octahedral.glsl"
#include "lib/random.glsl"
#include "lib/ray_origin.glsl"
#include "lib/sampling.glsl"
#include "shared/path_reservoirs.glsl"
#include "shared/view.glsl"
// Samples of the light that reaches diffuse surfaces, in reservoirs (Ouyang et al. 2021, "ReSTIR GI: Path Resampling for Real-Time Path
// Tracing").
//
// A sample is what a path met first: a point that sends radiance to whoever sees it, or the sky in a direction. The target, by which
// samples are chosen, is the luminance of that times the cosine at the surface that receives it, without its colour.

// Words that make the random numbers of each pass others.
const uint SALT_PATH = 0x3c79ac49u;
const uint SALT_PATH_TEMPORAL = 0x1b56c4e9u;
const uint SALT_PATH_SPATIAL = 0x9e1f2d57u;

// A surface that receives light.
struct Receiver {
    RayStart start;
    vec3 normal;    // shading normal
};

struct PathSample {
    vec3 place;      // world, metres; of the sky the direction, unit
    vec3 normal;     // geometric, unit, to the side that was seen
    vec3 radiance;
    bool is_sky;
    bool is_glossy;
};

#define RESERVOIR PathReservoir
const PathReservoir NO_PATH = PathReservoir(vec3(0.0), 0u, 0.0, 0u, 0.0, 0u, 0u);

// Pixels are worked on in a grid, all or one of four.
ivec2 grid_step(uint modes) {
    return ivec2((modes & PATH_HALF) != 0u ? 2 : 1);
}

uvec2 grid_size(ViewBuffer view, uint modes) {
    uvec2 step = uvec2(grid_step(modes));
    return (view.at[0].size + step - 1u) / step;
}

uint grid_index(ViewBuffer view, uint modes, ivec2 cell) {
    return uint(cell.y) * grid_size(view, modes).x + uint(cell.x);
}

// Tiles of cells.
uvec2 tiles_of(ViewBuffer view, uint modes) {
    return (grid_size(view, modes) + CHANGES_TILE - 1u) / CHANGES_TILE;
}

uint tile_index(ViewBuffer view, uint modes, ivec2 cell) {
    uvec2 tile = uvec2(cell) / CHANGES_TILE;
    return tile.y * tiles_of(view, modes).x + tile.x;
}

// `eye`: of the frame that it belongs to.
Receiver unpack_receiver(PathReceiver r, vec3 eye) {
    RayStart start = RayStart(eye + r.from_eye, octahedral_decode(unpackSnorm2x16(r.geometric_normal)), r.rounding);
    return Receiver(start, octahedral_decode(unpackSnorm2x16(r.normal)));
}

PathReceiver pack_receiver(RayStart start, vec3 normal, vec3 eye) {
    vec3 at = abs(start.position);
    PathReceiver r;
    r.from_eye = start.position - eye;
    // The difference is rounded, and so is the sum that undoes it.
    r.rounding = start.rounding + 2.4e-7 * max(at.x, max(at.y, at.z));
    r.geometric_normal = packSnorm2x16(octahedral_encode(start.normal));
    r.normal = packSnorm2x16(octahedral_encode(normal));
    return r;
}

const PathReceiver NO_RECEIVER = PathReceiver(vec3(0.0), 0.0, 0u, 0u);

bool receives(PathReceiver r) {
    return r.rounding > 0.0;
}

PathSample sample_of(PathReservoir r, vec3 eye) {
    vec3 roots = vec3(r.colour & 1023u, (r.colour >> 10u) & 1023u, (r.colour >> 20u) & 1023u) / 1023.0;
    PathSample s;
    s.is_sky = (r.colour & SKY_SAMPLE) != 0u;
    s.is_glossy = (r.colour & GLOSSY_SAMPLE) != 0u;
    s.place = s.is_sky ? r.place : eye + r.place;
    s.normal = octahedral_decode(unpackSnorm2x16(r.normal));
    s.radiance = r.peak * roots * roots;
    return s;
}

void put_sample(inout PathReservoir r, PathSample s, vec3 eye) {
    r.place = s.is_sky ? s.place : s.place - eye;
    r.normal = packSnorm2x16(octahedral_encode(s.normal));
    r.peak = max(s.radiance.r, max(s.radiance.g, s.radiance.b));
    uvec3 roots = r.peak > 0.0 ? uvec3(round(1023.0 * sqrt(s.radiance / r.peak))) : uvec3(0u);
    r.colour = roots.r | (roots.g << 10u) | (roots.b << 20u) | (s.is_sky ? SKY_SAMPLE : 0u) | (s.is_glossy ? GLOSSY_SAMPLE : 0u);
}

uint confidence_of(PathReservoir r) {
    return r.confidence & 65535u;
}

uint age_of(PathReservoir r) {
    return r.confidence >> 16u;
}

uint pack_confidence(uint confidence, uint age) {
    return min(confidence, GREATEST_CONFIDENCE) | (min(age, 65535u) << 16u);
}

uint frames_since_traced(PathReservoir r) {
    return r.path & 255u;
}

vec3 direction_to(Receiver r, PathSample s) {
    return s.is_sky ? s.place : safe_normalize(s.place - r.start.position, r.start.normal);
}

// Cosine of a sample's direction at a surface; 0 where none of its light can arrive, whatever is in between.
float cosine_of(Receiver r, PathSample s) {
    vec3 direction = direction_to(r, s);
    if (dot(direction, r.start.normal) <= 0.0) return 0.0;
    if (!s.is_sky && dot(direction, s.normal) >= 0.0) return 0.0;
    return max(dot(direction, r.normal), 0.0);
}

// The target.
float target_of(Receiver r, PathSample s) {
    return luminance(s.radiance) * cosine_of(r, s);
}

// The solid angle that a sample's surroundings take at one surface, over that at another: what its weight becomes at `to` that it had at
// `from` (Ouyang et al. 2021, section 4.3). The sky is as far from both.
float jacobian(Receiver from, Receiver to, PathSample s) {
    if (s.is_sky) return 1.0;
    vec3 a = from.start.position - s.place;
    vec3 b = to.start.position - s.place;
    float closer = sqrt(dot(a, a) / dot(b, b));
    return dot(b, s.normal) / dot(a, s.normal) * (closer * closer * closer);
}

#endif
