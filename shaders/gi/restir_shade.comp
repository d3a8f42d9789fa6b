#version 460
#extension GL_GOOGLE_include_directive : require
#include "lib/bindless.glsl"
#include "lib/gbuffer.glsl"
#include "lib/path_reservoirs.glsl"
#include "lib/precision.glsl"
// Light of the reservoirs' samples over the albedo of the diffuse lobe.
layout(local_size_x = 8, local_size_y = 8) in;
layout(push_constant, scalar) uniform Push { PathShadeParams params; };

vec3 scattered(ViewBuffer view, ivec2 cell) {
    uint index = grid_index(view, params.modes, cell);
    PathReservoir r = PathReservoirBuffer(params.reservoirs).at[index];
    PathReceiver receiver = PathReceiverBuffer(params.receivers).at[index];
    if (!receives(receiver) || r.weight == 0.0) return vec3(0.0);
    PathSample s = sample_of(r, view.at[0].eye);
    float cosine = cosine_of(unpack_receiver(receiver, view.at[0].eye), s);
    Surface seen = load_surface(view, cell * grid_step(params.modes), params.gbuffer);
    return diffuse_weight(seen.fresnel, cosine) * s.radiance * (r.weight * cosine / PI);
}

void main() {
    ViewBuffer view = ViewBuffer(params.view);
    ivec2 cell = ivec2(gl_GlobalInvocationID.xy);
    if (!inside(cell, grid_size(view, params.modes))) return;
    store(params.radiance, cell, vec4(representable(scattered(view, cell), params.greatest), 1.0));
}
