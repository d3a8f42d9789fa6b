#version 460
#extension GL_GOOGLE_include_directive : require
#include "lib/bindless.glsl"
#include "lib/intersect.glsl"
#include "lib/vector.glsl"
#include "shared/scene.glsl"
#include "shared/shadow_map.glsl"
// Depth at which the light's ray through the texel's centre meets a sphere, with the intersection test of rays.
layout(push_constant, scalar) uniform Push { MapDrawParams params; };

layout(location = 0) in vec3 position;
layout(location = 1) flat in uint instance_index;
layout(location = 2) flat in uint sphere_index;

const float NO_END = 1e30;

void main() {
    SceneBuffer scene = SceneBuffer(params.scene);
    Instance instance = InstanceBuffer(scene.at[0].instances).at[instance_index];
    vec4 sphere = SphereBuffer(MeshBuffer(scene.at[0].meshes).at[instance.mesh].positions).at[sphere_index];
    // Rays of directional lights have no origin, those of local lights begin at the light. `position` is on the far side of the box.
    bool parallel = params.is_parallel != 0u;
    vec3 from = parallel ? position : params.light;
    vec3 along = parallel ? params.light : position - params.light;
    vec3 origin = transform_point(instance.object_from_world, from);
    vec3 direction = transform_vector(instance.object_from_world, along);
    SurfaceHit hit;
    if (!hit_sphere(origin, direction, sphere.xyz, sphere.w, parallel ? -NO_END : 0.0, NO_END, hit)) discard;
    vec4 clip = params.clip_from_world * vec4(from + hit.t * along, 1.0);
    gl_FragDepth = clip.z / clip.w;
}
