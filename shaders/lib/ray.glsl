// Rays against the scene: a walk through two levels of compressed wide BVHs.
#ifndef LIB_RAY_GLSL
#define LIB_RAY_GLSL
#include "lib/bindless.glsl"
#include "lib/intersect.glsl"
#include "shared/scene.glsl"

// Hits count for t_min < t < t_max, in lengths of `direction`, which need not be a unit vector.
struct Ray {
    vec3 origin;
    float t_min;
    vec3 direction;
    float t_max;
};

// `instance` and `triangle` index the scene's instances and the triangles of its mesh.
struct Hit {
    float t;
    uint instance;
    uint triangle;
    vec2 barycentric;  // weights of the second and third corner
    bool front;        // the side from which the corners run counter-clockwise in object space
};

// `Hit.instance` of a miss.
const uint NO_HIT = 4294967295u;

layout(buffer_reference, scalar, buffer_reference_align = 4) readonly buffer RayInstanceOrder { uint at[]; };
layout(buffer_reference, scalar, buffer_reference_align = 4) readonly buffer RayTriangleIndices { uvec3 at[]; };

// Moves a point off a surface, to the side of the unit normal `n`, by just more than the rounding error of its coordinates
// (Waechter and Binder 2019, "A Fast and Robust Method for Avoiding Self-Intersection", Ray Tracing Gems, chapter 6).
// The step is a number of representable floats, so it grows with the coordinate; near the origin it is a fixed length.
vec3 offset_origin(vec3 p, vec3 n)
{
    const float STEPS = 256.0;
    const float NEAR_ZERO = 1.0 / 32.0;
    const float SHORT_STEP = 1.0 / 65536.0;
    ivec3 steps = ivec3(STEPS * n);
    // Integers count away from zero on both sides of it.
    ivec3 moved = floatBitsToInt(p) + mix(steps, -steps, lessThan(p, vec3(0.0)));
    return mix(intBitsToFloat(moved), p + SHORT_STEP * n, lessThan(abs(p), vec3(NEAR_ZERO)));
}

// Whether an alpha-tested surface is there at this point: the comparison that the G-buffer makes, at the finest mip.
bool alpha_passes(SceneBuffer scene, uint instance, uint triangle, vec2 barycentric)
{
    Instance placed = InstanceBuffer(scene.at[0].instances).at[instance];
    Mesh mesh = MeshBuffer(scene.at[0].meshes).at[placed.mesh];
    MaterialBuffer materials = MaterialBuffer(scene.at[0].materials);
    VertexAttributesBuffer attributes = VertexAttributesBuffer(mesh.attributes);
    uvec3 corners = RayTriangleIndices(mesh.indices).at[triangle];
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

// Groups, as in Ylitie et al. 2017. A node group: x is the first inner child, y has the hits in bits 24 to 31, in the order of
// the visit, and the mask of inner children in bits 0 to 7. A primitive group: x is the first primitive, y the hits in
// bits 0 to 23. Triangles are tested at once; instances and nodes that must wait go on the stack, whose size the tree was
// checked against when it was built.
bool walk_scene(SceneBuffer scene, Ray ray, bool any_hit, out Hit hit)
{
    Scene tables = scene.at[0];
    const uint NODE_HITS = 0xff000000u;
    const uvec2 ROOT = uvec2(0u, 0x80000000u);
    hit = Hit(ray.t_max, NO_HIT, NO_HIT, vec2(0.0), false);
    uvec2 stack[TRAVERSAL_STACK];
    uint height = 0u;
    uvec2 nodes_left = ROOT;

    // The level that is being walked: the scene, or the mesh of `instance`.
    BoxRay world_ray = box_ray(ray.origin, ray.direction);
    BoxRay box_level_ray = world_ray;
    BvhNodeBuffer nodes = BvhNodeBuffer(tables.tlas_nodes);
    uint instance = NO_HIT;
    uint mesh_height = 0u;  // height of the stack when the mesh was entered
    TriangleRay mesh_ray = triangle_ray(ray.origin, ray.direction);
    BvhTriangleBuffer triangles;
    bool alpha_test = false;

    while (true) {
        uvec2 primitives = uvec2(0u);
        if ((nodes_left.y & NODE_HITS) != 0u) {
            uint bit = uint(findMSB(nodes_left.y));
            nodes_left.y &= ~(1u << bit);
            if ((nodes_left.y & NODE_HITS) != 0u) {
                stack[height++] = nodes_left;
            }
            uint slot = (bit - 24u) ^ box_level_ray.octant;
            uint before = uint(bitCount(nodes_left.y & ((1u << slot) - 1u)));
            BvhNode node = nodes.at[nodes_left.x + before];
            uint hits = hit_children(node, box_level_ray, ray.t_min, hit.t);
            nodes_left = uvec2(node.child_base, (hits & NODE_HITS) | (node.exponents_and_mask >> 24));
            primitives = uvec2(node.primitive_base, hits & ~NODE_HITS);
        } else {
            // Instances that waited on the stack.
            primitives = nodes_left;
            nodes_left.y = 0u;
        }

        while (primitives.y != 0u) {
            uint bit = uint(findLSB(primitives.y));
            primitives.y &= primitives.y - 1u;
            uint index = primitives.x + bit;
            if (instance == NO_HIT) {
                // Into an instance. The rest of this node waits, its other instances on top.
                if ((nodes_left.y & NODE_HITS) != 0u) {
                    stack[height++] = nodes_left;
                }
                if (primitives.y != 0u) {
                    stack[height++] = primitives;
                }
                mesh_height = height;
                instance = RayInstanceOrder(tables.tlas_instances).at[index];
                Instance placed = InstanceBuffer(tables.instances).at[instance];
                vec4 rows[3] = placed.object_from_world;
                vec4 from = vec4(ray.origin, 1.0);
                vec4 along = vec4(ray.direction, 0.0);
                vec3 origin = vec3(dot(rows[0], from), dot(rows[1], from), dot(rows[2], from));
                vec3 direction = vec3(dot(rows[0], along), dot(rows[1], along), dot(rows[2], along));
                box_level_ray = box_ray(origin, direction);
                mesh_ray = triangle_ray(origin, direction);
                MeshBuffer meshes = MeshBuffer(tables.meshes);
                nodes = BvhNodeBuffer(meshes.at[placed.mesh].nodes);
                triangles = BvhTriangleBuffer(meshes.at[placed.mesh].triangles);
                alpha_test = (MaterialBuffer(tables.materials).at[placed.material].flags & MATERIAL_ALPHA_TEST) != 0u;
                nodes_left = ROOT;
                break;
            }
            BvhTriangle candidate = triangles.at[index];
            TriangleHit found;
            if (hit_triangle(mesh_ray, candidate.v0, candidate.v1, candidate.v2, ray.t_min, hit.t, found)
                && (!alpha_test || alpha_passes(scene, instance, candidate.triangle, found.barycentric))) {
                hit = Hit(found.t, instance, candidate.triangle, found.barycentric, found.front);
                if (any_hit) {
                    return true;
                }
            }
        }

        if ((nodes_left.y & NODE_HITS) == 0u) {
            if (instance != NO_HIT && height == mesh_height) {
                instance = NO_HIT;
                nodes = BvhNodeBuffer(tables.tlas_nodes);
                box_level_ray = world_ray;
            }
            if (height == 0u) {
                break;
            }
            nodes_left = stack[--height];
        }
    }
    return hit.instance != NO_HIT;
}

// Whether anything lies on the ray.
bool trace_any(SceneBuffer scene, Ray ray)
{
    Hit hit;
    return walk_scene(scene, ray, true, hit);
}

// The nearest hit; `hit.instance` is NO_HIT and `hit.t` is `ray.t_max` when there is none.
bool trace_closest(SceneBuffer scene, Ray ray, out Hit hit)
{
    return walk_scene(scene, ray, false, hit);
}

#endif
