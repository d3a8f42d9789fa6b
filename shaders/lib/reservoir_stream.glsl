#ifndef LIB_RESERVOIR_STREAM_GLSL
#define LIB_RESERVOIR_STREAM_GLSL
// A reservoir of any kind while samples stream into it (Chao 1982, "A General Purpose Unequal Probability Sampling Plan"). Whoever includes this
// file has defined its type, RESERVOIR.

struct Stream {
    RESERVOIR chosen;   // as it was offered
    float target;       // of the chosen sample
    float sum;          // of all weights
    uint source;        // whose sample was chosen; 0 is the pixel itself
};

Stream stream_from(RESERVOIR none) {
    return Stream(none, 0.0, 0.0, 0u);
}

// Offers a sample with its resampling weight. `u` in [0, 1). A weight of 0 is never chosen, the first above 0 always.
void offer(inout Stream s, RESERVOIR r, float target, float weight, uint source, float u) {
    if (!(weight > 0.0)) return;
    s.sum += weight;
    if (u * s.sum >= weight) return;
    s.chosen = r;
    s.target = target;
    s.source = source;
}

// The weight of the chosen sample. `normalization`: what the sum of the weights is divided by.
float weight_of(Stream s, float normalization) {
    return s.target > 0.0 && normalization > 0.0 ? s.sum / (normalization * s.target) : 0.0;
}

#endif
