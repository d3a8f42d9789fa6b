#ifndef LIB_SHADOW_GRADIENT_GLSL
#define LIB_SHADOW_GRADIENT_GLSL
#include "lib/gradient.glsl"
#include "lib/shadow_rays.glsl"
// Surfaces that the previous frame stored, as receivers of shadow rays.

Receiver receiver_of(Remembered was) {
    Receiver at = Receiver(no_surface(), was.start, was.width);
    at.surface.exists = true;
    at.surface.position = was.position;
    at.surface.to_eye = was.to_eye;
    at.surface.normal = was.normal;
    at.surface.geometric_normal = was.start.normal;
    return at;
}

#endif
