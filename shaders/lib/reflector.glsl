#ifndef LIB_REFLECTOR_GLSL
#define LIB_REFLECTOR_GLSL
#include "lib/gbuffer.glsl"
#include "lib/sequence.glsl"
#include "lib/specular_albedo.glsl"
#include "shared/denoise.glsl"
// Surfaces that reflect, and directions along their specular lobe: visible normals of GGX (Heitz 2018, "Sampling the GGX Distribution of
// Visible Normals").

struct Reflector {
    bool exists;   // false where nothing is reflected; the rest is undefined then
    Surface surface;
    Bsdf bsdf;
    mat3 around;   // axes of the shading normal in the columns
    vec3 v;        // towards the viewer, in these axes
};

Reflector reflector_at(ViewBuffer view, GBufferImages gbuffer, ivec2 pixel) {
    Reflector r;
    r.surface = load_surface(view, pixel, gbuffer);
    r.exists = r.surface.exists && reflects(r.surface);
    if (!r.exists) return r;
    r.bsdf = bsdf_of(r.surface);
    r.around = frame_of(r.surface.normal);
    r.v = r.surface.to_eye * r.around;
    r.v.z = eye_cosine(r.surface);
    return r;
}

// A sampled direction.
struct LobeSample {
    bool exists;   // false where the lobe has no light in the direction
    vec3 l;        // in the axes of the shading normal
    float pdf;     // per steradian
};

// Sample `index` of a pixel's sequence.
LobeSample sample_lobe(ViewBuffer view, Reflector r, ivec2 pixel, uint index) {
    LobeSample s = LobeSample(false, vec3(0.0), 0.0);
    if (!sample_specular(r.bsdf, r.v, sequence2(pixel, index, SEQUENCE_REFLECTIONS, view.at[0].seed), s.l)) return s;
    s.pdf = bsdf_pdf(r.bsdf, r.v, s.l, LOBE_SPECULAR);
    s.exists = s.pdf > 0.0;
    return s;
}

// Greatest number of directions that are drawn for one ray, and how far apart they are in the pixel's sequence.
const uint MOST_DRAWS = 4u;
const uint DRAW_STRIDE = 1u << 24u;

// As sample_lobe, for reconstruct.comp, which does not ask how often a direction had no light: those are drawn again. `index`: returned as
// that of the direction.
LobeSample draw_lobe(ViewBuffer view, Reflector r, ivec2 pixel, inout uint index) {
    LobeSample s = LobeSample(false, vec3(0.0), 0.0);
    for (uint draw = 0u; draw < MOST_DRAWS; draw++) {
        if (draw > 0u) index += DRAW_STRIDE;
        s = sample_lobe(view, r, pixel, index);
        if (s.exists) break;
    }
    return s;
}

#endif
