#version 460
#extension GL_GOOGLE_include_directive : require
#include "lib/bindless.glsl"
#include "lib/reprojection.glsl"
#include "lib/same_surface.glsl"
#include "lib/taps.glsl"
#include "shared/reproject.glsl"
// Backward reprojection: the four pixels of the previous frame around a surface's position in it, without those that showed another
// surface, by depth, normal or instance. All denoisers share the result.
layout(local_size_x = 8, local_size_y = 8) in;
layout(push_constant, scalar) uniform Push { ReprojectParams params; };

// View depth of a point in the previous frame. It moves rigidly with its instance; deformation is ignored.
float view_depth_before(ViewBuffer view, uint instance, vec3 position) {
    Instance placed = InstanceBuffer(SceneBuffer(params.scene).at[0].instances).at[instance];
    bool moved = placed.world_from_object != placed.previous_world_from_object;
    vec3 before = moved ? position_before(placed, position) : position;
    return (view.at[0].previous_clip_from_world * vec4(before, 1.0)).w;
}

void main() {
    ViewBuffer view = ViewBuffer(params.view);
    ivec2 pixel = ivec2(gl_GlobalInvocationID.xy);
    if (!inside(pixel, view.at[0].size)) return;
    Surface surface = load_geometry(view, pixel, params.gbuffer);
    uint instance = load_uint(params.gbuffer.ids, pixel).x;
    Guide here = Guide(0.0, vec3(0.0, 0.0, 1.0), vec3(0.0, 0.0, 1.0), instance & 0xffu);
    if (surface.exists) {
        here.depth = view_depth(view, load(params.gbuffer.depth, pixel).r);
        here.plane = surface.geometric_normal;
    }
    store_uint(params.guide, pixel, uvec4(pack_guide(here), 0u, 0u));

    uint taps = 0u;
    if (params.valid != 0u && surface.exists) {
        // Motion vectors contain no jitter, so that static points stay at their pixel. The two frames' samples are offset by their own
        // jitter: a point of a silhouette may have been sampled by the neighbouring pixel, where this pixel showed what is behind.
        vec2 was = vec2(pixel) - load(params.gbuffer.motion, pixel).xy * vec2(view.at[0].size);
        vec2 sampled = was + view.at[0].jitter - view.at[0].previous_jitter;
        Before before = Before(view_depth_before(view, instance - 1u, surface.position), depth_gradient(view, pixel, here), sampled);
        vec4 shares = shares_of(view, params.previous_guide, before, here, was);
        ivec2 offset = ivec2(0);
        if (shares == vec4(0.0) && view.at[0].jitter != view.at[0].previous_jitter) {
            shares = shares_of(view, params.previous_guide, before, here, sampled);
            offset = ivec2(floor(sampled)) - ivec2(floor(was));
        }
        if (shares != vec4(0.0)) taps = pack_taps(shares, offset);
    }
    store_uint(params.taps, pixel, uvec4(taps));
}
