#ifndef LIB_ALIKE_SAMPLES_GLSL
#define LIB_ALIKE_SAMPLES_GLSL
// Noise of samples that are kept from frame to frame: of a chain that keeps its sample with some probability, of which `alike` frames are worth one
// independent sample, 1 or more.

// Factor from the variance of such samples around their mean, over `n` frames, to the expected squared error of that mean. With independent samples
// 1 / (n - 1). Two samples of a chain that are k frames apart have the correlation keeps^k.
float variance_of_mean(float n, float alike) {
    float keeps = (alike - 1.0) / (alike + 1.0);
    float kept = 1.0, apart = 0.0;
    // Summed up as differences from 1, which are small where nearly all is kept.
    for (float k = 1.0; k < n; k++) {
        kept *= keeps;
        apart += (n - k) * (1.0 - kept);
    }
    float differ = 2.0 * apart / (n * (n - 1.0));
    return n > 1.0 ? (1.0 / n + (1.0 - 1.0 / n) * (1.0 - differ)) / ((1.0 - 1.0 / n) * differ) : 0.0;
}

#endif
