#ifndef LIB_BENCH_GLSL
#define LIB_BENCH_GLSL
#include "shared/bench.glsl"

// What pass `number` writes in `lane`, from what the two passes before wrote there; wraps. A wrong order or a lost write changes every
// later value.
uint bench_value(uint first, uint second, uint number, uint lane) {
    return first * FIRST_FACTOR + second * SECOND_FACTOR + number * NUMBER_FACTOR + lane;
}
#endif
