// The alpha test, as rays and raster make it.
#ifndef LIB_ALPHA_GLSL
#define LIB_ALPHA_GLSL
#include "lib/bindless.glsl"
#include "shared/scene.glsl"

// Whether an alpha-tested surface is there at this point: the comparison that the G-buffer makes, at the finest mip.
bool alpha_passes(SceneBuffer scene, uint instance, uint triangle, vec2 barycentric)
{
    Instance placed = InstanceBuffer(scene.at[0].instances).at[instance];
    Mesh mesh = MeshBuffer(scene.at[0].meshes).at[placed.mesh];
    MaterialBuffer materials = MaterialBuffer(scene.at[0].materials);
    VertexAttributesBuffer attributes = VertexAttributesBuffer(mesh.attributes);
    uvec3 corners = TriangleBuffer(mesh.ray_indices).at[triangle];
    vec3 weights = vec3(1.0 - barycentric.x - barycentric.y, barycentric);

    float alpha = materials.at[placed.material].base_colour.a;
    alpha *= dot(weights, vec3(attributes.at[corners.x].colour.a, attributes.at[corners.y].colour.a, attributes.at[corners.z].colour.a));
    TextureSlot slot = materials.at[placed.material].base_colour_texture;
    if (slot.image != NO_TEXTURE) {
        mat3x2 uvs = slot.uv_set == 0u
            ? mat3x2(attributes.at[corners.x].uv0, attributes.at[corners.y].uv0, attributes.at[corners.z].uv0)
            : mat3x2(attributes.at[corners.x].uv1, attributes.at[corners.y].uv1, attributes.at[corners.z].uv1);
        vec3 uv = vec3(uvs * weights, 1.0);
        alpha *= sample_lod(slot.image, slot.sampler_id, vec2(dot(slot.row_u, uv), dot(slot.row_v, uv)), 0.0).a;
    }
    return alpha >= materials.at[placed.material].alpha_cutoff;
}

#endif
