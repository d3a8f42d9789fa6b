#ifndef LIB_PATH_HISTORY_GLSL
#define LIB_PATH_HISTORY_GLSL
#include "lib/bindless.glsl"
#include "lib/not_finite.glsl"
#include "lib/path_reuse.glsl"
// Reuse of the reservoir that the previous frame had where it showed the surface. No shadow rays: the surface is the same, but for less than a
// pixel, and samples are traced again before long.

Lender previous_lender;

bool lender_at(uint k, out Lender lender) {
    lender = previous_lender;
    return true;
}

bool is_clear(Receiver r, PathSample s) {
    return true;
}

// The reservoir of the previous frame at an index, a frame older, and the surface that it belongs to. False if there is none.
bool carried_over(ViewBuffer view, uvec2 receivers, uvec2 reservoirs, uvec2 not_finite, uint index, out Lender lender) {
    PathReceiver receiver = PathReceiverBuffer(receivers).at[index];
    PathReservoir r = PathReservoirBuffer(reservoirs).at[index];
    if (!receives(receiver) || !is_taken(not_finite, vec4(r.place, r.weight * r.peak))) return false;
    vec3 eye = view.at[0].previous_eye;
    lender.receiver = unpack_receiver(receiver, eye);
    if ((r.colour & SKY_SAMPLE) == 0u) r.place = eye + r.place - view.at[0].eye;
    r.confidence = pack_confidence(confidence_of(r), age_of(r) + 1u);
    r.path = (r.path & ~255u) | min(frames_since_traced(r) + 1u, 255u);
    lender.reservoir = r;
    return true;
}

// Moves what a pixel had to the surface that it shows now. Without weight where that is too different.
void move_to(Receiver here, uint modes, float stretch, vec3 eye, inout Lender lender) {
    PathSample s = sample_of(lender.reservoir, eye);
    float j = (modes & PATH_JACOBIAN) != 0u ? jacobian(lender.receiver, here, s) : 1.0;
    bool stays = cosine_of(here, s) > 0.0 && j <= stretch && j * stretch >= 1.0;
    lender.reservoir.weight = stays ? lender.reservoir.weight * j : 0.0;
    lender.receiver = here;
}

// Merges a pixel's sample with what it had. Where neither is any light it keeps the old sample, whose turn to be traced again comes first.
// `most`: greatest confidence of that.
PathReservoir merged_with(Borrower b, Lender lender, uint most, uvec2 not_finite, inout Random random) {
    lender.reservoir.confidence = pack_confidence(min(confidence_of(lender.reservoir), most), age_of(lender.reservoir));
    previous_lender = lender;
    PathReservoir all = merged(b, 1u, random);
    if (!is_taken(not_finite, vec3(all.weight))) return b.own;
    if (target_of(b.receiver, sample_of(all, b.eye)) > 0.0 || lender.reservoir.weight == 0.0) return all;
    PathReservoir kept = lender.reservoir;
    kept.confidence = pack_confidence(confidence_of(all), age_of(kept));
    return kept;
}

#endif
