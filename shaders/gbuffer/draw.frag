#version 460
#extension GL_GOOGLE_include_directive : require
#define WRITES_GBUFFER
#include "lib/bindless.glsl"
#include "lib/alpha.glsl"
#include "lib/gbuffer.glsl"
#include "lib/gbuffer_write.glsl"
#include "lib/intersect.glsl"
#include "shared/gbuffer.glsl"
// Writes the G-buffer; its layout is in lib/README.md. Back faces of single-sided materials are culled before. The side is derived from the
// triangle itself, so that both normals face the viewer on double-sided and mirrored instances too.
layout(push_constant, scalar) uniform Push { DrawParams params; };

// If false, nothing is discarded and the depth test can run before shading.
layout(constant_id = 0) const bool ALPHA_TEST = false;

layout(location = 0) in vec3 from_eye;
layout(location = 1) in vec3 normal;
layout(location = 2) in vec4 tangent;
layout(location = 3) in vec2 uv0;
layout(location = 4) in vec2 uv1;
layout(location = 5) in vec4 colour;
layout(location = 6) flat in uint instance_index;

vec4 read(ViewBuffer view, TextureSlot slot, vec4 otherwise) {
    if (slot.image == NO_TEXTURE) return otherwise;
    vec3 uv = vec3(slot.uv_set == 0u ? uv0 : uv1, 1.0);
    vec2 at = vec2(dot(slot.row_u, uv), dot(slot.row_v, uv));
    // As sample_gradients, with screen-space derivatives, which must be taken before any branch as they need the whole quad.
    vec4 value = texture(
        sampler2D(images[nonuniformEXT(slot.image)], samplers[nonuniformEXT(slot.sampler_id)]), at, view.at[0].mip_bias
    );
    float lod = lod_without_gradients(dFdx(at), dFdy(at));
    return lod < 0.0 ? value : sample_lod(slot.image, slot.sampler_id, at, lod);
}

// World-space normal of the triangle by its winding (counter-clockwise from the front), not normalised; zero if degenerate.
vec3 triangle_normal(Instance instance, Mesh mesh, out vec3 corner) {
    WordBuffer indices = WordBuffer(mesh.indices);
    PositionBuffer positions = PositionBuffer(mesh.positions);
    uint first = 3u * uint(gl_PrimitiveID);
    corner = positions.at[indices.at[first]];
    vec3 e1 = safe_normalize(positions.at[indices.at[first + 1u]] - corner, vec3(0.0));
    vec3 e2 = safe_normalize(positions.at[indices.at[first + 2u]] - corner, vec3(0.0));
    return transform_normal(instance.object_from_world, cross(e1, e2));
}

// Where the ray through the pixel meets the triangle's plane. Interpolated attributes are those of snapped vertex positions, which is too
// coarse for triangles seen edge on.
SurfaceHit meet(ViewBuffer view, Instance instance, Mesh mesh, uvec3 corners, vec3 ray) {
    vec3 origin = transform_point(instance.object_from_world, view.at[0].eye);
    TriangleRay object_ray = triangle_ray(origin, transform_vector(instance.object_from_world, ray));
    PositionBuffer at = PositionBuffer(mesh.positions);
    SurfaceHit hit;
    // A miss does not matter: fragments at the edges may lie just outside.
    hit_triangle(object_ray, at.at[corners.x], at.at[corners.y], at.at[corners.z], 0.0, 0.0, hit);
    return hit;
}

// A point of the triangle by the weights of its second and third corner.
vec3 point_of(PositionBuffer positions, uvec3 corners, vec2 weights) {
    vec3 first = positions.at[corners.x];
    precise vec3 second = weights.x * (positions.at[corners.y] - first);
    precise vec3 third = weights.y * (positions.at[corners.z] - first);
    precise vec3 point = first + second + third;
    return point;
}

// Motion vector of the point that the ray meets. Both frames take the same steps, so that static points get exactly 0.
vec2 motion_at(ViewBuffer view, Instance instance, Mesh mesh, uvec3 corners, vec2 weights) {
    // There is no such point on a degenerate triangle, or one seen edge on.
    if (!all(lessThan(abs(weights), vec2(4.0)))) weights = vec2(1.0 / 3.0);
    precise vec3 now = transform_point(instance.world_from_object, point_of(PositionBuffer(mesh.positions), corners, weights));
    precise vec3 before =
        transform_point(instance.previous_world_from_object, point_of(PositionBuffer(mesh.previous_positions), corners, weights));
    precise vec4 clip_now = view.at[0].steady_clip_from_world * vec4(now, 1.0);
    precise vec4 clip_before = view.at[0].previous_clip_from_world * vec4(before, 1.0);
    return motion_between(clip_now.xyw, clip_before.xyw);
}

void main() {
    ViewBuffer view = ViewBuffer(params.view);
    SceneBuffer scene = SceneBuffer(params.scene);
    Instance instance = InstanceBuffer(scene.at[0].instances).at[instance_index];
    Material material = MaterialBuffer(scene.at[0].materials).at[instance.material];

    // The side is decided by a corner of the triangle, not the fragment: one answer for the whole triangle.
    vec3 corner;
    Mesh mesh = MeshBuffer(scene.at[0].meshes).at[instance.mesh];
    vec3 geometric = triangle_normal(instance, mesh, corner);
    vec3 to_eye = safe_normalize(-from_eye, vec3(0.0, 0.0, 1.0));
    vec3 corner_to_eye = view.at[0].eye - transform_point(instance.world_from_object, corner);
    geometric = safe_normalize(geometric, vec3(0.0));
    bool degenerate = geometric == vec3(0.0);
    vec3 vertex_normal = safe_normalize(normal, degenerate ? to_eye : geometric);
    bool front = degenerate ? dot(vertex_normal, to_eye) >= 0.0 : dot(geometric, corner_to_eye) >= 0.0;
    if (degenerate) geometric = vertex_normal;
    float side = front ? 1.0 : -1.0;

    // Textures are read before the alpha test, as their derivatives need the neighbouring fragments.
    vec4 base = material.base_colour * colour * read(view, material.base_colour_texture, vec4(1.0));
    vec4 metal_rough = read(view, material.metallic_roughness_texture, vec4(1.0));
    float occlusion = 1.0 + material.occlusion_strength * (read(view, material.occlusion_texture, vec4(1.0)).r - 1.0);
    vec3 emission = material.emission * read(view, material.emission_texture, vec4(1.0)).rgb;
    vec3 shading = vertex_normal;
    if (material.normal_texture.image != NO_TEXTURE) {
        vec3 texel = read(view, material.normal_texture, vec4(0.5, 0.5, 1.0, 1.0)).xyz;
        shading = apply_normal_map(normal, tangent, texel, material.normal_scale);
    }
    uvec3 corners = TriangleBuffer(mesh.indices).at[gl_PrimitiveID];
    vec3 ray = pixel_ray(view, ivec2(gl_FragCoord.xy));
    SurfaceHit hit = meet(view, instance, mesh, corners, ray);
    // The same alpha test as for a ray through the pixel: at the same point of the triangle, with the same cone.
    float cone = pixel_spread(view) * hit.t;
    if (ALPHA_TEST && !alpha_passes(scene, instance_index, corners, hit.barycentric, ray, cone)) discard;

    Fragment fragment;
    fragment.to_eye = to_eye;
    fragment.normal = side * shading;
    fragment.geometric_normal = side * geometric;
    fragment.base_colour = base.rgb;
    fragment.occlusion = occlusion;
    fragment.metalness_roughness = vec2(material.metalness * metal_rough.b, material.roughness * metal_rough.g);
    fragment.specular = NO_SPECULAR_CODE;
    fragment.coat = vec2(0.0);
    if (material.layers != NO_LAYERS) {
        MaterialLayers layers = MaterialLayersBuffer(scene.at[0].layers).at[material.layers];
        float strength = layers.specular * read(view, layers.specular_texture, vec4(1.0)).a;
        vec3 tint = layers.specular_colour * read(view, layers.specular_colour_texture, vec4(1.0)).rgb;
        fragment.specular = encode_dielectric(dielectric_of(layers.ior, strength, tint));
        if (COATED && (front || layers.thickness == 0.0)) {
            fragment.coat = vec2(
                layers.clearcoat * read(view, layers.clearcoat_texture, vec4(1.0)).r,
                layers.clearcoat_roughness * read(view, layers.clearcoat_roughness_texture, vec4(1.0)).g
            );
        }
    }
    fragment.emission = emission;
    fragment.motion = motion_at(view, instance, mesh, corners, hit.barycentric);
    fragment.ids = uvec2(instance_index + 1u, uint(gl_PrimitiveID));
    write_gbuffer(fragment, material.flags);
}
