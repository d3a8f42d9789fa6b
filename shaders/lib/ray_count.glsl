// Ray counters, for the statistics of each pass.
#ifndef LIB_RAY_COUNT_GLSL
#define LIB_RAY_COUNT_GLSL
#ifndef RAYS_PIPELINE
#extension GL_KHR_shader_subgroup_basic : require
#extension GL_KHR_shader_subgroup_arithmetic : require
#endif

layout(buffer_reference, scalar, buffer_reference_align = 4) buffer RayCounter { uint closest; uint any; };

#ifndef RAYS_PIPELINE
// Beside the counter of values that are not finite.
layout(buffer_reference, scalar, buffer_reference_align = 4) buffer ScreenRayCounter { uint not_finite; uint screen; };

// Adds the rays of this invocation through the depth image. All invocations of a subgroup call it. `not_finite`: `Record::not_finite`.
void count_screen_rays(uvec2 not_finite, uint rays) {
    rays = subgroupAdd(rays);
    if (subgroupElect() && rays != 0u) atomicAdd(ScreenRayCounter(not_finite).screen, rays);
}
#endif

// Adds the rays of this invocation; in compute shaders with one atomic per subgroup and kind of ray. Devices need not have subgroup
// operations in ray-generation shaders.
void count_rays(uvec2 counter, uint closest, uint any) {
#ifndef RAYS_PIPELINE
    closest = subgroupAdd(closest);
    any = subgroupAdd(any);
    if (!subgroupElect()) return;
#endif
    if (closest != 0u) atomicAdd(RayCounter(counter).closest, closest);
    if (any != 0u) atomicAdd(RayCounter(counter).any, any);
}

#endif
