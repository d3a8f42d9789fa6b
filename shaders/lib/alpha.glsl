// The alpha test, shared by rays and raster so that both read the same texels.
#ifndef LIB_ALPHA_GLSL
#define LIB_ALPHA_GLSL
#include "lib/bindless.glsl"
#include "lib/vector.glsl"
#include "shared/scene.glsl"

// Mip level for a cone of this width, metres, on a world-space triangle with the edges `e1` and `e2`, whose texture coordinates differ by
// `uv1` and `uv2` along them: half the logarithm of texels per area, plus that of the cone's width over the cosine (Akenine-Moeller et al.
// 2021, "Improved Shader and Texture Level of Detail Using Ray Cones", section 2). `direction` has any length. A width of 0 gives the
// finest mip.
float cone_lod(TextureSlot slot, vec3 e1, vec3 e2, vec2 uv1, vec2 uv2, vec3 direction, float width) {
    if (!(width > 0.0)) return 0.0;
    vec2 size = vec2(textureSize(images[nonuniformEXT(slot.image)], 0));
    vec2 a = size * vec2(dot(slot.row_u.xy, uv1), dot(slot.row_v.xy, uv1));
    vec2 b = size * vec2(dot(slot.row_u.xy, uv2), dot(slot.row_v.xy, uv2));
    vec3 across = cross(e1, e2);
    float texels = abs(a.x * b.y - a.y * b.x);
    // The length of `across` is twice the area: sqrt(texels / area) * width / cosine. Edge-on it is the coarsest mip.
    float texels_per_width = sqrt(texels * length(across)) * width * length(direction);
    float cosine = abs(dot(across, direction));
    return log2(max(texels_per_width, 1e-20) / max(cosine, 1e-20));
}

// Alpha at a point of a triangle, given by its vertices, which a cone of this width meets along `direction`, both in world space.
float alpha_at(SceneBuffer scene, uint instance, uvec3 corners, vec2 barycentric, vec3 direction, float width) {
    Instance placed = InstanceBuffer(scene.at[0].instances).at[instance];
    Mesh mesh = MeshBuffer(scene.at[0].meshes).at[placed.mesh];
    MaterialBuffer materials = MaterialBuffer(scene.at[0].materials);
    VertexAttributesBuffer attributes = VertexAttributesBuffer(mesh.attributes);
    vec3 weights = vec3(1.0 - barycentric.x - barycentric.y, barycentric);

    float alpha = materials.at[placed.material].base_colour.a;
    alpha *= dot(weights, vec3(attributes.at[corners.x].colour.a, attributes.at[corners.y].colour.a, attributes.at[corners.z].colour.a));
    TextureSlot slot = materials.at[placed.material].base_colour_texture;
    if (slot.image != NO_TEXTURE) {
        mat3x2 uvs = slot.uv_set == 0u
            ? mat3x2(attributes.at[corners.x].uv0, attributes.at[corners.y].uv0, attributes.at[corners.z].uv0)
            : mat3x2(attributes.at[corners.x].uv1, attributes.at[corners.y].uv1, attributes.at[corners.z].uv1);
        float lod = 0.0;
        if (width > 0.0) {
            PositionBuffer positions = PositionBuffer(mesh.positions);
            vec3 corner = positions.at[corners.x];
            vec3 e1 = transform_vector(placed.world_from_object, positions.at[corners.y] - corner);
            vec3 e2 = transform_vector(placed.world_from_object, positions.at[corners.z] - corner);
            lod = cone_lod(slot, e1, e2, uvs[1] - uvs[0], uvs[2] - uvs[0], direction, width);
        }
        vec3 uv = vec3(uvs * weights, 1.0);
        alpha *= sample_lod(slot.image, slot.sampler_id, vec2(dot(slot.row_u, uv), dot(slot.row_v, uv)), lod).a;
    }
    return alpha;
}

// Coverage by alpha: 0 or 1 where alpha is tested, alpha itself where it is blended.
float coverage_of(Material material, float alpha) {
    if ((material.flags & MATERIAL_BLEND) != 0u) return clamp(alpha, 0.0, 1.0);
    return (material.flags & MATERIAL_ALPHA_TEST) == 0u || alpha >= material.alpha_cutoff ? 1.0 : 0.0;
}

// Half a step of an alpha of eight bits: below, a blended surface covers nothing.
const float LEAST_ALPHA = 1.0 / 512.0;

// Whether an alpha-tested surface passes its test at that point. `blended`: a surface that blends does wherever it covers anything.
bool alpha_passes(SceneBuffer scene, uint instance, uvec3 corners, vec2 barycentric, vec3 direction, float width, bool blended) {
    uint index = InstanceBuffer(scene.at[0].instances).at[instance].material;
    Material material = MaterialBuffer(scene.at[0].materials).at[index];
    float cutoff = blended && (material.flags & MATERIAL_BLEND) != 0u ? LEAST_ALPHA : material.alpha_cutoff;
    return alpha_at(scene, instance, corners, barycentric, direction, width) >= cutoff;
}

bool alpha_passes(SceneBuffer scene, uint instance, uvec3 corners, vec2 barycentric, vec3 direction, float width) {
    return alpha_passes(scene, instance, corners, barycentric, direction, width, false);
}

#endif
