#version 460
#extension GL_GOOGLE_include_directive : require
#include "lib/bindless.glsl"
#include "lib/gbuffer.glsl"
#include "lib/lights.glsl"
#include "lib/shadow_map.glsl"
#include "shared/scene.glsl"
#include "shared/shadow_map.glsl"
// Screen-space contact shadows: a short ray march from each surface towards each light, for occluders smaller than a texel of a shadow map.
// What the depth buffer does not show casts none. What it shows is taken to be as thick as the march is long, so that an object far in
// front of the march does not occlude.
layout(local_size_x = 8, local_size_y = 8) in;
layout(push_constant, scalar) uniform Push { ContactParams params; };

// A step counts as occluded if it is at least this many pixel widths behind the depth buffer, so that the surface's own facets do not
// occlude.
const float TOLERANCE = 1.0;

bool meets(ViewBuffer view, vec3 from, vec3 direction, float reach, float start) {
    float near = 1.0 / view.at[0].world_from_clip[2].w;
    for (uint i = 0u; i < params.steps; i++) {
        vec3 at = from + direction * (reach * (float(i) + start) / float(params.steps));
        vec4 clip = view.at[0].clip_from_world * vec4(at, 1.0);
        if (clip.w <= near) return false;
        ivec2 pixel = ivec2(floor((clip.xy / clip.w * 0.5 + 0.5) * vec2(view.at[0].size)));
        if (!inside(pixel, view.at[0].size)) return false;
        float depth = load(params.gbuffer.depth, pixel).r;
        if (depth <= 0.0) continue;
        float behind = clip.w - near / depth;
        if (behind > TOLERANCE * pixel_spread(view) * clip.w && behind < params.reach) return true;
    }
    return false;
}

void main() {
    ViewBuffer view = ViewBuffer(params.view);
    ivec2 pixel = ivec2(gl_GlobalInvocationID.xy);
    if (!inside(pixel, view.at[0].size)) return;
    Surface surface = load_geometry(view, pixel, params.gbuffer);
    if (!surface.exists) return;
    vec4 visibility = imageLoad(storage_images[params.visibility], pixel);
    LightBuffer lights = LightBuffer(SceneBuffer(params.scene).at[0].lights);
    // Starts above the facets that the depth buffer makes of the surface.
    float pixel_width = pixel_spread(view) * distance(surface.position, view.at[0].eye);
    vec3 from = surface.position + pixel_width * surface.geometric_normal;
    for (uint i = 0u; i < params.light_count; i++) {
        if (visibility[i] <= 0.0) continue;
        LightSample towards = sample_light(lights.at[MapLightBuffer(params.lights).at[i].light], surface.position);
        float reach = min(params.reach, towards.distance);
        float start = pixel_turn(pixel) / 6.28318531;
        if (meets(view, from, towards.direction, reach, start)) visibility[i] = 0.0;
    }
    store(params.visibility, pixel, visibility);
}
