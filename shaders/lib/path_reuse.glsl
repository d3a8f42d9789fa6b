#ifndef LIB_PATH_REUSE_GLSL
#define LIB_PATH_REUSE_GLSL
#include "lib/path_reservoirs.glsl"
// Merging the reservoirs of paths, lib/merging.glsl. A pixel cannot have drawn what it could not lend or borrow: the same tests decide about
// both.

// A pixel that lends its reservoir, whose place is relative to the eye of this frame.
struct Lender {
    PathReservoir reservoir;
    Receiver receiver;
};

// Defined by the kernel: whether nothing is between a surface and a sample.
bool is_clear(Receiver r, PathSample s);

struct Borrower {
    Receiver receiver;
    PathReservoir own;
    float own_target;     // set by `merged`
    vec3 eye;
    uint modes;
    float stretch;        // greatest Jacobian, and one over the least
    uint cap;             // of the confidence
    bool borrows_glossy;  // samples that send much more light to some than to others
};

#include "lib/merging.glsl"

// Jacobians that were asked for, and those that were refused.
uvec2 jacobians = uvec2(0u);

// Target of a sample at `to` that was drawn at `from`, and the Jacobian of its weight; 0 if it does not go there.
float shifted_target(Borrower b, Receiver from, Receiver to, PathSample s, out float j) {
    j = 1.0;
    if (s.is_glossy && !b.borrows_glossy) return 0.0;
    float target = target_of(to, s);
    if (target == 0.0 || (b.modes & PATH_JACOBIAN) == 0u) return target;
    j = jacobian(from, to, s);
    jacobians.x++;
    // NaN counts too.
    if (j <= b.stretch && j * b.stretch >= 1.0) return target;
    jacobians.y++;
    return 0.0;
}

float target_here(Borrower b, Lender lender, out float j) {
    return shifted_target(b, lender.receiver, b.receiver, sample_of(lender.reservoir, b.eye), j);
}

float target_there(Borrower b, Lender lender) {
    return target_of(lender.receiver, sample_of(lender.reservoir, b.eye));
}

float target_at_lender(Borrower b, Lender lender, PathReservoir r) {
    PathSample s = sample_of(r, b.eye);
    float j;
    float target = shifted_target(b, b.receiver, lender.receiver, s, j) * j;
    return target > 0.0 && is_clear(lender.receiver, s) ? target : 0.0;
}

bool sees_chosen(Borrower b, Stream s) {
    return s.source == 0u || is_clear(b.receiver, sample_of(s.chosen, b.eye));
}

PathReservoir finished(Borrower b, Stream s, float normalization, uint confidence) {
    // Where no light was found the pixel keeps a sample of no light, so that one that is traced again may find some.
    PathReservoir r = s.chosen;
    if (s.sum > 0.0) r.weight = weight_of(s, normalization);
    r.confidence = pack_confidence(min(confidence, b.cap), age_of(r));
    return r;
}

// Merges the pixel's reservoir with those of `others` lenders at most.
PathReservoir merged(Borrower b, uint others, inout Random random) {
    b.own_target = target_of(b.receiver, sample_of(b.own, b.eye));
    return merged(b, stream_from(b.own), others, b.modes & PATH_WEIGHTS, random);
}

#endif
