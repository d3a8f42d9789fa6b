#version 460
#extension GL_GOOGLE_include_directive : require
#include "lib/bindless.glsl"
#include "lib/vector.glsl"
#include "shared/gbuffer.glsl"
#include "shared/scene.glsl"
#include "shared/view.glsl"
// A box around each sphere of one instance: eight corners per sphere, in the order of gl_VertexIndex. The index buffer's winding draws the
// back faces, which are visible even when the eye is in the box.
layout(push_constant, scalar) uniform Push { DrawParams params; };

layout(location = 0) flat out uint instance_index;
layout(location = 1) flat out uint sphere_index;

// The box is a little larger than the sphere, as its corners are snapped to the raster's subpixel grid.
const float MARGIN = 1.0 / 256.0;

void main() {
    ViewBuffer view = ViewBuffer(params.view);
    SceneBuffer scene = SceneBuffer(params.scene);
    instance_index = uint(gl_InstanceIndex);
    sphere_index = uint(gl_VertexIndex) / 8u;
    Instance instance = InstanceBuffer(scene.at[0].instances).at[instance_index];
    vec4 sphere = SphereBuffer(MeshBuffer(scene.at[0].meshes).at[instance.mesh].positions).at[sphere_index];
    uvec3 far_sides = (uvec3(gl_VertexIndex) >> uvec3(0u, 1u, 2u)) & 1u;
    vec3 corner = sphere.xyz + (2.0 * vec3(far_sides) - 1.0) * (sphere.w * (1.0 + MARGIN));
    gl_Position = view.at[0].clip_from_world * vec4(transform_point(instance.world_from_object, corner), 1.0);
}
