#version 460
#extension GL_GOOGLE_include_directive : require
#include "lib/bindless.glsl"
#include "lib/light_tree_fit.glsl"
// Refits the tree over local lights and emissive instances to where they are in this frame, and to how lights are dimmed.
layout(local_size_x = LIGHT_REFIT_GROUP) in;
layout(push_constant, scalar) uniform Push { LightRefitParams params; };

void main() {
    uint group = gl_WorkGroupID.y * gl_NumWorkGroups.x + gl_WorkGroupID.x;
    if (group >= params.groups) return;
    LightTree tree = LightTreeBuffer(params.tree).at[0];
    LightTreePart part = LightTreePartBuffer(tree.parts).at[0];
    uint index = group * LIGHT_REFIT_GROUP + gl_LocalInvocationID.x;
    if (index >= part.leaf_count) return;
    LightTreeLeaf leaf = LightTreeLeafBuffer(part.leaves).at[index];
    LightNodeBuffer nodes = LightNodeBuffer(tree.nodes);
    uint child = nodes.at[part.first_node + leaf.node].child;

    SceneBuffer scene = SceneBuffer(params.scene);
    LightNode value;
    if ((child & LIGHT_NODE_KIND) == LIGHT_NODE_INSTANCE) {
        uint instance = child & LIGHT_NODE_INDEX;
        LightNode root = nodes.at[LightTreeInstanceBuffer(tree.instances).at[instance].root];
        value = instance_leaf(root, InstanceBuffer(scene.at[0].instances).at[instance], child);
    } else {
        value = lamp_leaf(LightBuffer(scene.at[0].lights).at[leaf.light], child);
    }
    refit_above(tree, part, leaf.node, value);
}
