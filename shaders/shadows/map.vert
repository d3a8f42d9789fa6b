#version 460
#extension GL_GOOGLE_include_directive : require
#include "lib/bindless.glsl"
#include "lib/vector.glsl"
#include "shared/scene.glsl"
#include "shared/shadow_map.glsl"
// Projects the vertices of one instance into a layer of a shadow map.
layout(push_constant, scalar) uniform Push { MapDrawParams params; };

layout(location = 0) out vec3 position;  // world, metres
layout(location = 1) flat out uint instance_index;

void main() {
    SceneBuffer scene = SceneBuffer(params.scene);
    instance_index = uint(gl_InstanceIndex);
    Instance instance = InstanceBuffer(scene.at[0].instances).at[instance_index];
    vec3 vertex = PositionBuffer(MeshBuffer(scene.at[0].meshes).at[instance.mesh].positions).at[gl_VertexIndex];
    precise vec3 world = transform_point(instance.world_from_object, vertex);
    precise vec4 clip = params.clip_from_world * vec4(world, 1.0);
    gl_Position = clip;
    position = world;
}
