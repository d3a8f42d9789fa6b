// Shared by the two hardware backends, ray queries and ray-tracing pipelines.
#ifndef LIB_RAY_DRIVER_GLSL
#define LIB_RAY_DRIVER_GLSL
#include "lib/ray_types.glsl"

// The ray's flags as the driver's. Culling of spheres is left to the shader that intersects them.
uint driver_flags(Ray ray)
{
    return ((ray.cull & RAY_CULL_BACK) != 0u ? gl_RayFlagsCullBackFacingTrianglesEXT : 0u)
        | ((ray.cull & RAY_CULL_FRONT) != 0u ? gl_RayFlagsCullFrontFacingTrianglesEXT : 0u)
        | ((ray.cull & RAY_UNTESTED) != 0u ? gl_RayFlagsOpaqueEXT : 0u);
}

// Centre and radius of a sphere in object space.
vec4 driver_sphere(SceneBuffer scene, uint instance, uint primitive)
{
    uint mesh = InstanceBuffer(scene.at[0].instances).at[instance].mesh;
    return SphereBuffer(MeshBuffer(scene.at[0].meshes).at[mesh].positions).at[primitive];
}

// Vertex indices of a triangle.
uvec3 driver_corners(SceneBuffer scene, uint instance, uint primitive)
{
    uint mesh = InstanceBuffer(scene.at[0].instances).at[instance].mesh;
    return TriangleBuffer(MeshBuffer(scene.at[0].meshes).at[mesh].ray_indices).at[primitive];
}

#endif
