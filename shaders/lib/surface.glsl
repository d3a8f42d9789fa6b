#ifndef LIB_SURFACE_GLSL
#define LIB_SURFACE_GLSL
#include "lib/alpha.glsl"
#include "lib/bindless.glsl"
#include "lib/bsdf.glsl"
#include "lib/normal_map.glsl"
#include "lib/ray_origin.glsl"
#include "lib/ray_types.glsl"
// Surface attributes at a ray's hit: position, normals and material, from the scene's tables. Equal to the G-buffer's but for texture
// filtering.

struct SurfacePoint {
    RayStart start;     // origin of rays that leave; its normal is the geometric one, on the side where the ray came from
    vec3 normal;        // shading normal, unit, on the side where the ray came from
    float coverage;     // share of light that the surface stops; below 1 on blended surfaces
    vec3 emission;      // radiance back along the ray
    bool shows_light;   // the emission only depicts a light, which lights the scene instead
    bool black;         // reflects nothing
    bool sheet;         // not the boundary of a volume, and not alpha-tested
    Bsdf bsdf;
    vec3 absorption;    // per metre, of the volume that transmitted light comes from; 0 outside of volumes
};

// Differences of world position to the neighbouring pixels, for texture filtering; zero for the finest mip.
struct Footprint {
    vec3 dx;
    vec3 dy;
};

const Footprint NO_FOOTPRINT = Footprint(vec3(0.0), vec3(0.0));

// Texture coordinates, and their differences over a footprint.
struct Coordinates {
    mat2 uv;  // one set per column
    mat2 dx;
    mat2 dy;
};

// A texture at those coordinates; `otherwise` if the slot is empty.
vec4 read_texture(TextureSlot slot, Coordinates at, vec4 otherwise) {
    if (slot.image == NO_TEXTURE) return otherwise;
    vec3 uv = vec3(at.uv[slot.uv_set & 1u], 1.0);
    vec2 place = vec2(dot(slot.row_u, uv), dot(slot.row_v, uv));
    vec2 dx = at.dx[slot.uv_set & 1u];
    vec2 dy = at.dy[slot.uv_set & 1u];
    dx = vec2(dot(slot.row_u.xy, dx), dot(slot.row_v.xy, dx));
    dy = vec2(dot(slot.row_u.xy, dy), dot(slot.row_v.xy, dy));
    return sample_gradients(slot.image, slot.sampler_id, place, dx, dy);
}

// Converts a difference of world positions on a triangle with the edges `e1` and `e2` to barycentric weights of its second and third
// corner.
vec2 weights_along(vec3 e1, vec3 e2, vec3 d) {
    vec3 n = cross(e1, e2);
    float square = dot(n, n);
    return square > 0.0 ? vec2(dot(cross(d, e2), n), dot(cross(e1, d), n)) / square : vec2(0.0);
}

// Emission of a material at some coordinates, for either side.
vec3 emission_at(Material material, Coordinates at) {
    return material.emission * read_texture(material.emission_texture, at, vec4(1.0)).rgb;
}

// Evaluates a material at some coordinates. `vertex`: vertex colour; `front`: hit on its front. `textured`: there are coordinates, which
// spheres do not have.
void read_material(SceneBuffer scene, Material material, Coordinates at, vec4 vertex, bool front, bool textured, inout SurfacePoint p) {
    vec4 base = material.base_colour * vertex * read_texture(material.base_colour_texture, at, vec4(1.0));
    vec4 metal_rough = read_texture(material.metallic_roughness_texture, at, vec4(1.0));
    float metalness = material.metalness * metal_rough.b;
    p.coverage = (material.flags & MATERIAL_BLEND) != 0u ? base.a : 1.0;
    p.black = (material.flags & MATERIAL_UNLIT) != 0u;
    p.shows_light = (material.flags & MATERIAL_SHOWS_LIGHT) != 0u;
    p.emission = p.black ? base.rgb : emission_at(material, at);
    if (!front && (material.flags & MATERIAL_DOUBLE_SIDED) == 0u) p.emission = vec3(0.0);
    p.bsdf = opaque_bsdf(base.rgb, metalness, material.roughness * metal_rough.g);
    p.absorption = vec3(0.0);
    // An alpha-tested surface is either there or not.
    p.sheet = (material.flags & (MATERIAL_ALPHA_TEST | MATERIAL_BLEND)) != MATERIAL_ALPHA_TEST;
    if (material.layers == NO_LAYERS) return;

    MaterialLayers layers = MaterialLayersBuffer(scene.at[0].layers).at[material.layers];
    float strength = layers.specular;
    vec3 tint = layers.specular_colour;
    if (textured) {
        strength *= read_texture(layers.specular_texture, at, vec4(1.0)).a;
        tint *= read_texture(layers.specular_colour_texture, at, vec4(1.0)).rgb;
    }
    Dielectric d = dielectric_of(layers.ior, strength, tint);
    p.bsdf.fresnel = fresnel_of(d, base.rgb, metalness);
    vec3 own_f0 = dielectric_of(layers.ior, 1.0, vec3(1.0)).f0;
    p.bsdf.less = Dielectric(own_f0 - d.f0, 1.0 - strength);
    p.bsdf.transmission = (1.0 - metalness) * layers.transmission * read_texture(layers.transmission_texture, at, vec4(1.0)).r;
    p.bsdf.eta = front || layers.thickness == 0.0 ? layers.ior : 1.0 / layers.ior;
    // Equal indices do not refract either, and leave refraction's half vector undefined.
    p.sheet = p.sheet && layers.thickness == 0.0;
    p.bsdf.thin = layers.thickness == 0.0 || abs(p.bsdf.eta - 1.0) < 1e-4;
    p.absorption = front && layers.thickness > 0.0 ? layers.absorption : vec3(0.0);
    if (front || layers.thickness == 0.0) {
        float coat = layers.clearcoat;
        float rough = layers.clearcoat_roughness;
        if (textured) {
            coat *= read_texture(layers.clearcoat_texture, at, vec4(1.0)).r;
            rough *= read_texture(layers.clearcoat_roughness_texture, at, vec4(1.0)).g;
        }
        p.bsdf.coat = coat;
        p.bsdf.coat_alpha = alpha_of_roughness(rough);
    }
}

// The surface at a hit.
SurfacePoint surface_at(SceneBuffer scene, Ray ray, Hit hit, Footprint footprint) {
    Instance instance = InstanceBuffer(scene.at[0].instances).at[hit.instance];
    Mesh mesh = MeshBuffer(scene.at[0].meshes).at[instance.mesh];
    Material material = MaterialBuffer(scene.at[0].materials).at[instance.material];
    vec3 towards = -normalize(ray.direction);
    float side = hit.front ? 1.0 : -1.0;

    SurfacePoint p;
    p.start = hit_start(scene, ray, hit);
    Coordinates at = Coordinates(mat2(0.0), mat2(0.0), mat2(0.0));
    if ((instance.flags & INSTANCE_SPHERES) != 0u) {
        material.base_colour_texture.image = NO_TEXTURE;
        material.metallic_roughness_texture.image = NO_TEXTURE;
        material.emission_texture.image = NO_TEXTURE;
        read_material(scene, material, at, vec4(1.0), hit.front, false, p);
        p.normal = turn_to_viewer(p.start.normal, towards);
        p.bsdf = towards_viewer(scene.at[0].lobe_albedo, p.bsdf, dot(p.normal, towards));
        return p;
    }

    uvec3 corners = TriangleBuffer(mesh.ray_indices).at[hit.primitive];
    VertexAttributesBuffer attributes = VertexAttributesBuffer(mesh.attributes);
    VertexAttributes a = attributes.at[corners.x];
    VertexAttributes b = attributes.at[corners.y];
    VertexAttributes c = attributes.at[corners.z];
    vec3 w = vec3(1.0 - hit.barycentric.x - hit.barycentric.y, hit.barycentric);
    at.uv = mat2(w.x * a.uv0 + w.y * b.uv0 + w.z * c.uv0, w.x * a.uv1 + w.y * b.uv1 + w.z * c.uv1);
    if (footprint.dx != vec3(0.0)) {
        PositionBuffer positions = PositionBuffer(mesh.positions);
        vec3 corner = positions.at[corners.x];
        vec3 e1 = transform_vector(instance.world_from_object, positions.at[corners.y] - corner);
        vec3 e2 = transform_vector(instance.world_from_object, positions.at[corners.z] - corner);
        mat2 along0 = mat2(b.uv0 - a.uv0, c.uv0 - a.uv0);
        mat2 along1 = mat2(b.uv1 - a.uv1, c.uv1 - a.uv1);
        vec2 dx = weights_along(e1, e2, footprint.dx);
        vec2 dy = weights_along(e1, e2, footprint.dy);
        at.dx = mat2(along0 * dx, along1 * dx);
        at.dy = mat2(along0 * dy, along1 * dy);
    }
    read_material(scene, material, at, w.x * a.colour + w.y * b.colour + w.z * c.colour, hit.front, true, p);

    mat3 normals = mat3(
        safe_normalize(transform_normal(instance.object_from_world, a.normal), vec3(0.0, 1.0, 0.0)),
        safe_normalize(transform_normal(instance.object_from_world, b.normal), vec3(0.0, 1.0, 0.0)),
        safe_normalize(transform_normal(instance.object_from_world, c.normal), vec3(0.0, 1.0, 0.0))
    );
    vec3 normal = normals * w;
    vec3 shading = safe_normalize(normal, side * p.start.normal);
    if (material.normal_texture.image != NO_TEXTURE) {
        mat3 tangents = mat3(
            safe_normalize(transform_vector(instance.world_from_object, a.tangent.xyz), vec3(0.0)),
            safe_normalize(transform_vector(instance.world_from_object, b.tangent.xyz), vec3(0.0)),
            safe_normalize(transform_vector(instance.world_from_object, c.tangent.xyz), vec3(0.0))
        );
        float turn = dot(w, vec3(a.tangent.w, b.tangent.w, c.tangent.w)) * handedness(instance.world_from_object);
        vec3 texel = read_texture(material.normal_texture, at, vec4(0.5, 0.5, 1.0, 1.0)).xyz;
        shading = apply_normal_map(normal, vec4(tangents * w, turn), texel, material.normal_scale);
    }
    p.normal = turn_to_viewer(side * shading, towards);
    p.bsdf = towards_viewer(scene.at[0].lobe_albedo, p.bsdf, dot(p.normal, towards));
    return p;
}

#endif
