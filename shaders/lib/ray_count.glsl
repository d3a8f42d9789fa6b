// Ray counters, for the statistics of each pass.
#ifndef LIB_RAY_COUNT_GLSL
#define LIB_RAY_COUNT_GLSL
#ifndef RAYS_PIPELINE
#extension GL_KHR_shader_subgroup_basic : require
#extension GL_KHR_shader_subgroup_arithmetic : require
#endif

layout(buffer_reference, scalar, buffer_reference_align = 4) buffer RayCounter { uint closest; uint any; };

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
