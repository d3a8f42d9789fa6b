// Encodes a fragment for the G-buffer; its layout is in README.md. A fragment shader defines WRITES_GBUFFER first.
#ifndef LIB_GBUFFER_WRITE_GLSL
#define LIB_GBUFFER_WRITE_GLSL
#include "lib/gbuffer_specular.glsl"
#include "lib/normal_map.glsl"
#include "lib/octahedral.glsl"
#include "shared/scene.glsl"

// Greatest number in the formats of emission and motion, so that finite values stay finite. Clamped by comparison, which keeps NaN for
// `--check` to find; min and clamp may not.
layout(constant_id = 1) const float GREATEST = 65504.0;

// Whether materials have clear coats, which are then in the attachment before emission.
layout(constant_id = 2) const bool COATED = false;

struct Fragment {
    vec3 to_eye;               // world, unit
    vec3 normal;               // shading normal on the visible side, unit; turned towards the viewer here if it points away
    vec3 geometric_normal;     // unit, on the visible side
    vec3 base_colour;
    float occlusion;           // 1 is open
    vec2 metalness_roughness;
    vec2 specular;             // see encode_dielectric
    vec2 coat;                 // strength and roughness of the clear coat
    vec3 emission;
    vec2 motion;
    uvec2 ids;                 // instance + 1, primitive
};

// uv now minus uv one frame ago, from clip x, y, w; 0 for what was behind the camera then.
vec2 motion_between(vec3 clip_now, vec3 clip_before) {
    if (clip_before.z <= 0.0) return vec2(0.0);
    vec2 moved = 0.5 * (clip_now.xy / clip_now.z - clip_before.xy / clip_before.z);
    return mix(moved, sign(moved) * GREATEST, greaterThan(abs(moved), vec2(GREATEST)));
}

#ifdef WRITES_GBUFFER
layout(location = 0) out vec4 out_base_colour;
layout(location = 1) out vec2 out_normal;
layout(location = 2) out vec2 out_geometric_normal;
layout(location = 3) out vec4 out_material;
layout(location = 4) out vec2 out_motion;
layout(location = 5) out uvec2 out_ids;
// Last, so that scenes can leave them out: coat and emission, or emission alone.
layout(location = 6) out vec4 out_coat_or_emission;
layout(location = 7) out vec4 out_emission;

void write_gbuffer(Fragment f, uint material_flags) {
    if ((material_flags & MATERIAL_UNLIT) != 0u) {
        // A black metal, the one material that reflects nothing (specular_f90 of lib/brdf.glsl).
        f.emission = f.base_colour;
        f.base_colour = vec3(0.0);
        f.metalness_roughness = vec2(1.0);
        f.coat = vec2(0.0);
    }
    out_base_colour = vec4(f.base_colour, f.occlusion);
    out_normal = octahedral_encode(turn_to_viewer(f.normal, f.to_eye));
    out_geometric_normal = octahedral_encode(f.geometric_normal);
    out_material = vec4(f.metalness_roughness, f.specular);
    out_emission = vec4(mix(f.emission, vec3(GREATEST), greaterThan(f.emission, vec3(GREATEST))), 1.0);
    if (COATED) out_coat_or_emission = vec4(f.coat, 0.0, 0.0);
    else out_coat_or_emission = out_emission;
    out_motion = f.motion;
    out_ids = f.ids;
}
#endif

#endif
