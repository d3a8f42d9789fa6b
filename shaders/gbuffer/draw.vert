#version 460
#extension GL_GOOGLE_include_directive : require
#include "lib/bindless.glsl"
#include "lib/vector.glsl"
#include "shared/gbuffer.glsl"
#include "shared/scene.glsl"
#include "shared/view.glsl"
// Fetches the vertices of one instance by address. gl_VertexIndex comes from the bound index buffer; the draw's first instance is the
// instance's index in the scene.
layout(push_constant, scalar) uniform Push { DrawParams params; };

layout(location = 0) out vec3 from_eye;     // world position relative to the eye, metres
layout(location = 1) out vec3 normal;       // world, unit
layout(location = 2) out vec4 tangent;      // world, unit; w is the sign of the bitangent
layout(location = 3) out vec2 uv0;
layout(location = 4) out vec2 uv1;
layout(location = 5) out vec4 colour;       // linear
layout(location = 6) flat out uint instance_index;

invariant gl_Position;

void main() {
    ViewBuffer view = ViewBuffer(params.view);
    SceneBuffer scene = SceneBuffer(params.scene);
    instance_index = uint(gl_InstanceIndex);
    Instance instance = InstanceBuffer(scene.at[0].instances).at[instance_index];
    MeshBuffer mesh = MeshBuffer(scene.at[0].meshes);
    vec3 position = PositionBuffer(mesh.at[instance.mesh].positions).at[gl_VertexIndex];
    VertexAttributes attributes = VertexAttributesBuffer(mesh.at[instance.mesh].attributes).at[gl_VertexIndex];

    precise vec3 world = transform_point(instance.world_from_object, position);
    precise vec4 clip = view.at[0].clip_from_world * vec4(world, 1.0);
    gl_Position = clip;
    from_eye = world - view.at[0].eye;

    vec3 world_normal = transform_normal(instance.object_from_world, attributes.normal);
    normal = safe_normalize(world_normal, vec3(0.0, 1.0, 0.0));
    vec3 world_tangent = transform_vector(instance.world_from_object, attributes.tangent.xyz);
    tangent.xyz = safe_normalize(world_tangent, vec3(0.0));
    tangent.w = attributes.tangent.w * handedness(instance.world_from_object);
    uv0 = attributes.uv0;
    uv1 = attributes.uv1;
    colour = attributes.colour;
}
