// The walk through two levels of compressed wide BVHs: rays on a device without ray tracing of its own.
#ifndef LIB_RAY_SOFTWARE_GLSL
#define LIB_RAY_SOFTWARE_GLSL
#include "lib/alpha.glsl"
#include "lib/intersect.glsl"
#include "lib/ray_types.glsl"

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
    vec3 mesh_ray_origin = ray.origin;
    vec3 mesh_ray_direction = ray.direction;
    TriangleRay mesh_ray = triangle_ray(ray.origin, ray.direction);
    BvhTriangleBuffer triangles;
    uint flags = 0u;  // of the instance

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
                uint candidate = WordBuffer(tables.tlas_instances).at[index];
                Instance placed = InstanceBuffer(tables.instances).at[candidate];
                if ((placed.mask & ray.mask) == 0u) {
                    continue;
                }
                // Into an instance. The rest of this node waits, its other instances on top.
                if ((nodes_left.y & NODE_HITS) != 0u) {
                    stack[height++] = nodes_left;
                }
                if (primitives.y != 0u) {
                    stack[height++] = primitives;
                }
                mesh_height = height;
                instance = candidate;
                vec4 rows[3] = placed.object_from_world;
                vec4 from = vec4(ray.origin, 1.0);
                vec4 along = vec4(ray.direction, 0.0);
                mesh_ray_origin = vec3(dot(rows[0], from), dot(rows[1], from), dot(rows[2], from));
                mesh_ray_direction = vec3(dot(rows[0], along), dot(rows[1], along), dot(rows[2], along));
                box_level_ray = box_ray(mesh_ray_origin, mesh_ray_direction);
                mesh_ray = triangle_ray(mesh_ray_origin, mesh_ray_direction);
                MeshBuffer meshes = MeshBuffer(tables.meshes);
                nodes = BvhNodeBuffer(meshes.at[placed.mesh].nodes);
                triangles = BvhTriangleBuffer(meshes.at[placed.mesh].triangles);
                flags = placed.flags;
                nodes_left = ROOT;
                break;
            }
            BvhTriangle candidate = triangles.at[index];
            SurfaceHit found;
            bool met = (flags & INSTANCE_SPHERES) != 0u
                ? hit_sphere(mesh_ray_origin, mesh_ray_direction, candidate.v0, candidate.v1.x, ray.t_min, hit.t, found)
                : hit_triangle(mesh_ray, candidate.v0, candidate.v1, candidate.v2, ray.t_min, hit.t, found);
            if (met && !is_culled(ray, flags, found.front)
                && ((flags & INSTANCE_ALPHA_TEST) == 0u || alpha_passes(scene, instance, candidate.triangle, found.barycentric))) {
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
