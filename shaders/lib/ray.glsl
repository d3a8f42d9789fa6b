// Ray tracing against the scene, the same interface for every backend: `trace_closest(scene, ray, hit)`, `trace_any(scene, ray)` and
// `trace_any_at(scene, ray, t)`.
//
// A ray pass is a file `*.ray`. It is compiled three times: as a compute shader that traverses Magpie's own BVH (RAYS_SOFTWARE), as a
// compute shader with ray queries (RAYS_QUERY), and as the ray-generation shader of a pipeline (RAYS_PIPELINE).
#ifndef LIB_RAY_GLSL
#define LIB_RAY_GLSL
#if defined(RAYS_QUERY)
#extension GL_EXT_ray_query : require
#elif defined(RAYS_PIPELINE)
#extension GL_EXT_ray_tracing : require
#endif
#include "lib/bindless.glsl"
#include "lib/ray_count.glsl"
#include "lib/ray_origin.glsl"
#include "lib/ray_types.glsl"
#if defined(RAYS_QUERY)
#include "lib/ray_query.glsl"
#elif defined(RAYS_PIPELINE)
#include "lib/ray_pipeline.glsl"
#else
#include "lib/ray_software.glsl"
#endif

// The pixel, or other index, of this invocation.
#if defined(RAYS_PIPELINE)
#define RAY_INVOCATION gl_LaunchIDEXT
#else
#define RAY_INVOCATION gl_GlobalInvocationID
layout(local_size_x = 8, local_size_y = 8) in;
#endif

#endif
