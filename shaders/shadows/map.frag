#version 460
#extension GL_GOOGLE_include_directive : require
#include "lib/bindless.glsl"
#include "lib/alpha.glsl"
#include "lib/intersect.glsl"
#include "shared/shadow_map.glsl"
// Depth only, which the raster writes. Alpha-tested surfaces are discarded where rays would pass them.
layout(push_constant, scalar) uniform Push { MapDrawParams params; };

// If false, nothing is discarded and the depth test can run before shading.
layout(constant_id = 0) const bool ALPHA_TEST = false;

layout(location = 0) in vec3 position;
layout(location = 1) flat in uint instance_index;

// The alpha test for the light's ray through the texel's centre, a cone as wide as the texel.
bool is_there() {
    SceneBuffer scene = SceneBuffer(params.scene);
    Instance instance = InstanceBuffer(scene.at[0].instances).at[instance_index];
    Mesh mesh = MeshBuffer(scene.at[0].meshes).at[instance.mesh];
    bool parallel = params.is_parallel != 0u;
    vec3 along = parallel ? params.light : position - params.light;
    float width = parallel ? params.texel : params.texel * length(along);
    TriangleRay ray = triangle_ray(
        transform_point(instance.object_from_world, position - along), transform_vector(instance.object_from_world, along)
    );
    uvec3 corners = TriangleBuffer(mesh.indices).at[gl_PrimitiveID];
    PositionBuffer at = PositionBuffer(mesh.positions);
    SurfaceHit hit;
    // A miss does not matter: fragments at the edges may lie just outside.
    hit_triangle(ray, at.at[corners.x], at.at[corners.y], at.at[corners.z], 0.0, 0.0, hit);
    return alpha_passes(scene, instance_index, corners, hit.barycentric, along, width);
}

void main() {
    if (ALPHA_TEST && !is_there()) discard;
}
