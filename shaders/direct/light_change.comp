#version 460
#extension GL_GOOGLE_include_directive : require
#include "lib/bindless.glsl"
#include "lib/gradient_squares.glsl"
#include "lib/light_sampling.glsl"
#include "lib/light_tree.glsl"
#include "lib/not_finite.glsl"
#include "lib/reprojection.glsl"
#include "shared/direct.glsl"
// How much the light of lamps has changed since the previous frame, in one pixel of nine, without shadow rays: by a lamp that the light tree chooses now, and by the
// one that it chose in the previous frame, each as it is and as it was. A lamp that has been switched on is found by the first, one that has been switched off by the
// second, one that has moved by both. Of lamps that are as they were the difference is exactly 0, whatever the noise.
layout(local_size_x = 8, local_size_y = 8) in;
layout(push_constant, scalar) uniform Push { LightChangeParams params; };

// Of the random numbers.
const uint SALT = 0x6c616d70u;

// Light that a point of a lamp sends to a surface.
float arriving(Light light, vec3 position, vec3 normal, vec2 u) {
    Incident from;
    if (!sample_sized_light(light, position, u, from)) return 0.0;
    return luminance(from.radiance) * max(dot(from.direction, normal), 0.0);
}

// A lamp and a point of it.
struct Drawn {
    uint light;  // + 1; 0 for none
    uint point;  // two numbers of 16 bits
};

// Change of a lamp's light over the sum of what it is and was, 0 to 1.
float change_of(SceneBuffer scene, Drawn drawn, vec3 position, vec3 before, vec3 normal) {
    if (drawn.light == 0u || drawn.light > scene.at[0].light_count) return 0.0;
    vec2 u = unpackUnorm2x16(drawn.point);
    float is = arriving(LightBuffer(scene.at[0].lights).at[drawn.light - 1u], position, normal, u);
    float was = arriving(LightBuffer(scene.at[0].previous_lights).at[drawn.light - 1u], before, normal, u);
    float sum = is + was;
    return sum > 0.0 && is_finite(vec3(sum)) ? abs(is - was) / sum : 0.0;
}

// The lamp that the tree chooses; none if it is an emissive surface.
Drawn drawn_here(SceneBuffer scene, vec3 position, vec3 normal, vec4 u) {
    uint entry;
    float probability;
    LightTables lights = LightTablesBuffer(params.lights).at[0];
    if (!choose_by_tree(scene, LightTreeBuffer(params.tree).at[0], position, normal, false, u.xy, entry, probability)) return Drawn(0u, 0u);
    uint light = LightChoiceBuffer(lights.near).at[entry].light;
    return Drawn(light == CHOICE_EMITTER ? 0u : light + 1u, packUnorm2x16(u.zw));
}

void main() {
    ViewBuffer view = ViewBuffer(params.view);
    ivec2 square = ivec2(gl_GlobalInvocationID.xy);
    if (!inside(square * int(GRADIENT_STRATUM), view.at[0].size)) return;
    uint frame = view.at[0].frame;
    ivec2 pixel = min(gradient_pixel(view, square, frame), ivec2(view.at[0].size) - 1);
    float depth = load(params.gbuffer.depth, pixel).r;
    Drawn drawn = Drawn(0u, 0u);
    float change = 0.0;
    if (depth > 0.0) {
        SceneBuffer scene = SceneBuffer(params.scene);
        vec3 position = world_position(view, pixel, depth);
        vec3 normal = octahedral_decode(load(params.gbuffer.normal, pixel).xy);
        vec3 before = position_before(InstanceBuffer(scene.at[0].instances).at[load_uint(params.gbuffer.ids, pixel).x - 1u], position);
        drawn = drawn_here(scene, position, normal, unit_floats(hash4(uvec4(square, frame, view.at[0].seed ^ SALT))));
        ivec2 was = square_before(view, square, params.gbuffer.motion);
        ivec2 squares = (ivec2(view.at[0].size) + int(GRADIENT_STRATUM) - 1) / int(GRADIENT_STRATUM);
        if (params.valid != 0u && inside(was, uvec2(squares))) {
            uvec2 kept = load_uint(params.previous, was).xy;
            change = change_of(scene, drawn, position, before, normal) + change_of(scene, Drawn(kept.x, kept.y), position, before, normal);
        }
    }
    store(params.change, square, vec4(min(change, 1.0)));
    store_uint(params.drawn, square, uvec4(drawn.light, drawn.point, 0u, 0u));
}
