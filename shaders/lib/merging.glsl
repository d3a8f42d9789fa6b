#ifndef LIB_MERGING_GLSL
#define LIB_MERGING_GLSL
#include "lib/random.glsl"
#include "lib/reservoir_stream.glsl"
#include "shared/resampling.glsl"
// Merging the reservoir of a pixel with those of others, of neighbours or of the previous frame, whatever their samples are.
//
// Each sample gets a weight for having several pixels that could have drawn it; over those pixels these must sum to 1 (multiple importance
// sampling: Lin et al. 2022, "Generalized Resampled Importance Sampling: Foundations of ReSTIR", section 4). Three kinds:
// - WEIGHTS_BIASED: confidence over the sum of all. Counts pixels that do not see the sample, and so darkens.
// - WEIGHTS_COUNTED: confidence over that of the pixels that see the chosen sample (Bitterli et al. 2020, algorithm 6; Ouyang et al. 2021,
//   algorithm 4).
// - WEIGHTS_PAIRWISE: the balance heuristic of the pixel with each other one by itself, and a fixed share for the pixel's own (Bitterli 2022,
//   "Correlations and Reuse for Fast and Accurate Physically Based Light Transport", section 9.1.3).
//
// Whoever includes this file has defined RESERVOIR, with weight and confidence, `confidence_of`, `Lender` with its `reservoir`, and `Borrower`
// with its `own` and `own_target`.

// Lender `k`; false if there is none.
bool lender_at(uint k, out Lender lender);
// Target of a lender's sample at the pixel, 0 if it does not go there, and the factor by which its weight changes on the way.
float target_here(Borrower b, Lender lender, out float j);
// Target of a lender's own sample at the lender, which sees it.
float target_there(Borrower b, Lender lender);
// Target of the pixel's own or chosen sample at a lender, in the measure of the pixel; 0 where the lender could not have it or does not see it.
float target_at_lender(Borrower b, Lender lender, RESERVOIR r);
// Whether the pixel sees the sample that it has chosen.
bool sees_chosen(Borrower b, Stream s);
// What is left of a stream.
RESERVOIR finished(Borrower b, Stream s, float normalization, uint confidence);

// Merges by confidence. `others`: lenders at most.
RESERVOIR merged_by_confidence(Borrower b, Stream s, uint others, bool counted, inout Random random) {
    uint confidence = confidence_of(b.own);
    offer(s, b.own, b.own_target, b.own_target * b.own.weight * float(confidence), 0u, random4(random).x);
    for (uint k = 0u; k < others; k++) {
        Lender lender;
        if (!lender_at(k, lender)) continue;
        uint lent = confidence_of(lender.reservoir);
        confidence += lent;
        if (lender.reservoir.weight == 0.0) continue;
        float j;
        float target = target_here(b, lender, j);
        offer(s, lender.reservoir, target, target * lender.reservoir.weight * j * float(lent), k + 1u, random4(random).x);
    }
    float normalization = float(confidence);
    if (s.target > 0.0 && !sees_chosen(b, s)) s.target = 0.0;
    if (counted && s.target > 0.0) {
        normalization = float(confidence_of(b.own));
        for (uint k = 0u; k < others; k++) {
            Lender lender;
            if (!lender_at(k, lender)) continue;
            // Who drew it can draw it.
            bool could = s.source == k + 1u || target_at_lender(b, lender, s.chosen) > 0.0;
            if (could) normalization += float(confidence_of(lender.reservoir));
        }
    }
    return finished(b, s, normalization, confidence);
}

// Merges with pairwise weights.
RESERVOIR merged_pairwise(Borrower b, Stream s, uint others, inout Random random) {
    float own = float(confidence_of(b.own));
    float lent = 0.0;
    for (uint k = 0u; k < others; k++) {
        Lender lender;
        if (lender_at(k, lender)) lent += float(confidence_of(lender.reservoir));
    }
    float all = own + lent;
    float own_weight = own;
    for (uint k = 0u; k < others; k++) {
        Lender lender;
        if (!lender_at(k, lender)) continue;
        RESERVOIR r = lender.reservoir;
        float confidence = float(confidence_of(r));
        if (r.weight > 0.0) {
            float j;
            float here = target_here(b, lender, j);
            // Both in the measure of the pixel.
            float theirs = lent * target_there(b, lender) / j;
            float both = theirs + own * here;
            // Rounding may take a lender's target to 0 that was above it when the sample was drawn.
            float share = both > 0.0 ? theirs / both : 0.0;
            offer(s, r, here, confidence / all * share * here * r.weight * j, k + 1u, random4(random).x);
        }
        if (b.own.weight > 0.0 && b.own_target > 0.0) {
            float both = lent * target_at_lender(b, lender, b.own) + own * b.own_target;
            own_weight += confidence * (both > 0.0 ? own * b.own_target / both : 1.0);
        }
    }
    offer(s, b.own, b.own_target, own_weight / all * b.own_target * b.own.weight, 0u, random4(random).x);
    if (s.target > 0.0 && !sees_chosen(b, s)) s.target = 0.0;
    return finished(b, s, 1.0, uint(all));
}

// Merges into a stream that is empty yet.
RESERVOIR merged(Borrower b, Stream s, uint others, uint weights, inout Random random) {
    if (weights == WEIGHTS_PAIRWISE) return merged_pairwise(b, s, others, random);
    return merged_by_confidence(b, s, others, weights == WEIGHTS_COUNTED, random);
}

#endif
