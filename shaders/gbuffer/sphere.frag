#version 460
#extension GL_GOOGLE_include_directive : require
#define WRITES_GBUFFER
#include "lib/bindless.glsl"
#include "lib/gbuffer.glsl"
#include "lib/gbuffer_write.glsl"
#include "lib/intersect.glsl"
#include "shared/gbuffer.glsl"
// Writes the G-buffer where the ray through the pixel's centre meets a sphere, with the intersection test of rays: in object space, where
// it is round even if the instance is stretched. Spheres have no texture coordinates, so their materials are read without textures.
layout(push_constant, scalar) uniform Push { DrawParams params; };

layout(location = 0) flat in uint instance_index;
layout(location = 1) flat in uint sphere_index;

// No far limit.
const float NO_END = 1e30;

void main() {
    ViewBuffer view = ViewBuffer(params.view);
    SceneBuffer scene = SceneBuffer(params.scene);
    Instance instance = InstanceBuffer(scene.at[0].instances).at[instance_index];
    Material material = MaterialBuffer(scene.at[0].materials).at[instance.material];
    vec4 sphere = SphereBuffer(MeshBuffer(scene.at[0].meshes).at[instance.mesh].positions).at[sphere_index];

    // `ray` has unit view depth: t is view depth, and the near plane lies at 1 / world_from_clip[2].w.
    vec3 ray = pixel_ray(view, ivec2(gl_FragCoord.xy));
    vec3 origin = transform_point(instance.object_from_world, view.at[0].eye);
    vec3 direction = transform_vector(instance.object_from_world, ray);
    float inverse_near = view.at[0].world_from_clip[2].w;
    SurfaceHit hit;
    if (!hit_sphere(origin, direction, sphere.xyz, sphere.w, 1.0 / inverse_near, NO_END, hit)) discard;
    if (!hit.front && (instance.flags & INSTANCE_DOUBLE_SIDED) == 0u) discard;
    gl_FragDepth = 1.0 / (hit.t * inverse_near);

    vec3 to_eye = -normalize(ray);
    vec3 outwards = safe_normalize(origin - sphere.xyz + hit.t * direction, -direction);
    vec3 normal = safe_normalize(transform_normal(instance.object_from_world, outwards), to_eye);

    // The point moves with its instance.
    vec3 point = sphere.xyz + sphere.w * outwards;
    vec4 now = view.at[0].steady_clip_from_world * vec4(transform_point(instance.world_from_object, point), 1.0);
    vec3 world_before = transform_point(instance.previous_world_from_object, point);
    vec4 before = view.at[0].previous_clip_from_world * vec4(world_before, 1.0);

    Fragment fragment;
    fragment.to_eye = to_eye;
    fragment.normal = hit.front ? normal : -normal;
    fragment.geometric_normal = fragment.normal;
    fragment.base_colour = material.base_colour.rgb;
    fragment.occlusion = 1.0;
    fragment.metalness_roughness = vec2(material.metalness, material.roughness);
    fragment.specular = NO_SPECULAR_CODE;
    fragment.coat = vec2(0.0);
    if (material.layers != NO_LAYERS) {
        MaterialLayers layers = MaterialLayersBuffer(scene.at[0].layers).at[material.layers];
        fragment.specular = encode_dielectric(dielectric_of(layers.ior, layers.specular, layers.specular_colour));
        if (hit.front || layers.thickness == 0.0) fragment.coat = vec2(layers.clearcoat, layers.clearcoat_roughness);
    }
    fragment.emission = material.emission;
    fragment.motion = motion_between(now.xyw, before.xyw);
    fragment.ids = uvec2(instance_index + 1u, sphere_index);
    write_gbuffer(fragment, material.flags);
}
