#version 460
#extension GL_GOOGLE_include_directive : require
#include "lib/bindless.glsl"
#include "lib/vector.glsl"
#include "shared/acceleration.glsl"
#include "shared/scene.glsl"
// Morph targets, then skin, as glTF 2.0 orders them (section 3.7.2.2). One thread per vertex.
layout(local_size_x = DEFORM_GROUP) in;
layout(push_constant, scalar) uniform Push { DeformParams params; };

layout(buffer_reference, scalar, buffer_reference_align = 4) buffer Positions { vec3 at[]; };
layout(buffer_reference, scalar, buffer_reference_align = 4) readonly buffer Weights { float at[]; };

// Linear blend skinning.
void skin(Deformer mesh, uint vertex, inout vec3 position, inout vec3 normal, inout vec3 tangent) {
    InfluenceBuffer influences = InfluenceBuffer(mesh.influences);
    vec4 rows[3] = vec4[3](vec4(0.0), vec4(0.0), vec4(0.0));
    for (uint i = 0u; i < mesh.influence_count; ++i) {
        Influence influence = influences.at[vertex * mesh.influence_count + i];
        if (influence.weight == 0.0) continue;
        JointMatrix joint = JointMatrixBuffer(params.joints).at[mesh.first_joint + influence.joint];
        for (int row = 0; row < 3; ++row) rows[row] += influence.weight * joint.rows[row];
    }
    position = transform_point(rows, position);
    tangent = transform_vector(rows, tangent);
    // A normal is transformed by the cofactor matrix, which is the inverse transpose times the determinant: it exists for singular
    // matrices, and a blend that mirrors flips the normal together with the winding.
    vec3 x = rows[0].xyz;
    vec3 y = rows[1].xyz;
    vec3 z = rows[2].xyz;
    normal = vec3(dot(cross(y, z), normal), dot(cross(z, x), normal), dot(cross(x, y), normal));
}

void main() {
    uint group = gl_WorkGroupID.x + gl_WorkGroupID.y * gl_NumWorkGroups.x;
    if (group >= params.job_count) return;
    DeformJob job = DeformJobBuffer(params.jobs).at[group];
    Deformer mesh = DeformerBuffer(params.deformers).at[job.deformer];
    uint vertex = job.first + gl_LocalInvocationID.x;
    if (vertex >= mesh.vertex_count) return;

    vec3 position = PositionBuffer(mesh.source_positions).at[vertex];
    VertexAttributes attributes = VertexAttributesBuffer(mesh.source_attributes).at[vertex];
    vec3 normal = attributes.normal;
    vec3 tangent = attributes.tangent.xyz;
    for (uint target = 0u; target < mesh.target_count; ++target) {
        float weight = Weights(params.weights).at[mesh.first_weight + target];
        if (weight == 0.0) continue;
        MorphDelta delta = MorphDeltaBuffer(mesh.targets).at[target * mesh.vertex_count + vertex];
        position += weight * delta.position;
        normal += weight * delta.normal;
        tangent += weight * delta.tangent;
    }
    if (mesh.influence_count > 0u) skin(mesh, vertex, position, normal, tangent);

    // Where the blend cancels a direction out, the one from the file is kept.
    attributes.normal = safe_normalize(normal, attributes.normal);
    tangent -= dot(tangent, attributes.normal) * attributes.normal;
    attributes.tangent.xyz = safe_normalize(tangent, attributes.tangent.xyz);
    Positions now = Positions(mesh.positions);
    Positions(mesh.previous_positions).at[vertex] = params.first != 0u ? position : now.at[vertex];
    now.at[vertex] = position;
    VertexAttributesBufferWrite(mesh.attributes).at[vertex] = attributes;
}
