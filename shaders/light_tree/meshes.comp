#version 460
#extension GL_GOOGLE_include_directive : require
#include "lib/bindless.glsl"
#include "lib/light_tree_fit.glsl"
// Refits the trees of emissive meshes that deform to their vertices in this frame.
layout(local_size_x = LIGHT_REFIT_GROUP) in;
layout(push_constant, scalar) uniform Push { LightRefitParams params; };

void main() {
    uint group = gl_WorkGroupID.y * gl_NumWorkGroups.x + gl_WorkGroupID.x;
    if (group >= params.groups) return;
    LightTree tree = LightTreeBuffer(params.tree).at[0];
    LightTreeJob job = LightTreeJobBuffer(tree.jobs).at[group];
    LightTreePart part = LightTreePartBuffer(tree.parts).at[job.part];
    uint index = job.first + gl_LocalInvocationID.x;
    if (index >= part.leaf_count) return;
    LightTreeLeaf leaf = LightTreeLeafBuffer(part.leaves).at[index];
    uint child = LightNodeBuffer(tree.nodes).at[part.first_node + leaf.node].child;

    SceneBuffer scene = SceneBuffer(params.scene);
    Mesh mesh = MeshBuffer(scene.at[0].meshes).at[InstanceBuffer(scene.at[0].instances).at[part.instance].mesh];
    uvec3 corners = TriangleBuffer(mesh.ray_indices).at[index];
    PositionBuffer positions = PositionBuffer(mesh.positions);
    LightNode value = triangle_leaf(positions.at[corners.x], positions.at[corners.y], positions.at[corners.z], leaf.emission, child);
    refit_above(tree, part, leaf.node, value);
}
