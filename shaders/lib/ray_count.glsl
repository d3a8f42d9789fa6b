// Counting rays, for the figures of each pass.
#ifndef LIB_RAY_COUNT_GLSL
#define LIB_RAY_COUNT_GLSL
#extension GL_KHR_shader_subgroup_basic : require
#extension GL_KHR_shader_subgroup_arithmetic : require

layout(buffer_reference, scalar, buffer_reference_align = 4) buffer RayCounter { uint closest; uint any; };

// Adds what this invocation traced; one atomic per subgroup and kind of ray.
void count_rays(uvec2 counter, uint closest, uint any) {
    uint all_closest = subgroupAdd(closest);
    uint all_any = subgroupAdd(any);
    if (!subgroupElect()) return;
    if (all_closest != 0u) atomicAdd(RayCounter(counter).closest, all_closest);
    if (all_any != 0u) atomicAdd(RayCounter(counter).any, all_any);
}

#endif
