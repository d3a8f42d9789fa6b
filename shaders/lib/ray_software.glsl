// Backend: traversal of two levels of compressed wide BVHs in a compute shader, for devices without hardware ray tracing.
#ifndef LIB_RAY_SOFTWARE_GLSL
#define LIB_RAY_SOFTWARE_GLSL
#include "lib/alpha.glsl"
#include "lib/intersect.glsl"
#include "lib/ray_types.glsl"

// The BVH tables are 16-byte aligned, for wide loads.
layout(buffer_reference, scalar, buffer_reference_align = 16) readonly buffer NodeTable { BvhNode at[]; };
layout(buffer_reference, scalar, buffer_reference_align = 16) readonly buffer PrimitiveTable { BvhPrimitive at[]; };
layout(buffer_reference, scalar, buffer_reference_align = 16) readonly buffer PlacedTable { BvhInstance at[]; };

// For the heat map: nodes visited and primitives tested by this invocation so far, on both levels.
#ifdef RAYS_STEPS
uvec2 ray_steps = uvec2(0u);
#define COUNT_NODE ray_steps.x++
#define COUNT_PRIMITIVE ray_steps.y++
#else
#define COUNT_NODE
#define COUNT_PRIMITIVE
#endif

// Groups, as in Ylitie et al. 2017. A node group: x is the first inner child, y has the hits in bits 24 to 31, in visiting order, and the
// mask of inner children in bits 0 to 7. A primitive group: x is the first primitive, y the hits in bits 0 to 23.
//
// One iteration visits a node, tests its primitives, and enters an instance or pops a group. Pending node groups go on the stack, the
// newest in `top`: most are popped in the next iterations, and private arrays are slow memory on most devices. Pending instances need no
// stack, as only one group of them is open at a time. The depth of the BVHs was checked against the size of the stack when they were built.
bool walk_scene(SceneBuffer scene, Ray ray, bool any_hit, out Hit hit)
{
    Scene tables = scene.at[0];
    const uint NODE_HITS = 0xff000000u;
    const uvec2 ROOT = uvec2(0u, 0x80000000u);
    const uvec2 NOTHING = uvec2(0u);
    hit = Hit(ray.t_max, NO_HIT, NO_HIT, vec2(0.0), false);
    uvec2 stack[TRAVERSAL_STACK];
    uint height = 0u;     // of the stack, `top` included
    uvec2 top = NOTHING;  // replaces stack[height - 1] if it is not NOTHING
    uvec2 nodes_left = ROOT;
    uvec2 instances = NOTHING;

    // The current level: the scene, or the mesh of `instance`.
    BoxRay world_ray = box_ray(ray.origin, ray.direction);
    BoxRay level_ray = world_ray;
    NodeTable nodes = NodeTable(tables.tlas_nodes);
    uint instance = NO_HIT;
    uint mesh_height = 0u;  // height of the stack when the mesh was entered
    TriangleRay mesh_ray = TriangleRay(vec3(0.0), 0u, vec3(0.0));
    vec3 mesh_direction = vec3(0.0);
    PrimitiveTable mesh_primitives;
    uvec2 positions = uvec2(0u);  // address
    uint flags = 0u;              // of the instance

    while (true) {
        uvec2 primitives = NOTHING;
        if ((nodes_left.y & NODE_HITS) != 0u) {
            uint bit = uint(findMSB(nodes_left.y));
            nodes_left.y &= ~(1u << bit);
            if ((nodes_left.y & NODE_HITS) != 0u) {
                if (top.y != 0u) {
                    stack[height - 1u] = top;
                }
                top = nodes_left;
                height++;
            }
            uint slot = (bit - 24u) ^ level_ray.octant;
            uint before = uint(bitCount(nodes_left.y & ((1u << slot) - 1u)));
            BvhNode node = nodes.at[nodes_left.x + before];
            COUNT_NODE;
            uint hits = hit_children(node, level_ray, ray.t_min, hit.t);
            nodes_left = uvec2(node.child_base, (hits & NODE_HITS) | (node.exponents_and_mask >> 24));
            primitives = uvec2(node.primitive_base, hits & ~NODE_HITS);
            if (instance == NO_HIT) {
                instances = primitives;
                primitives = NOTHING;
            }
        }

        while (primitives.y != 0u) {
            uint bit = uint(findLSB(primitives.y));
            primitives.y &= primitives.y - 1u;
            BvhPrimitive candidate = mesh_primitives.at[primitives.x + bit];
            COUNT_PRIMITIVE;
            SurfaceHit found;
            bool met;
            if ((flags & INSTANCE_SPHERES) != 0u) {
                vec4 sphere = SphereBuffer(positions).at[candidate.primitive];
                met = hit_sphere(mesh_ray.origin, mesh_direction, sphere.xyz, sphere.w, ray.t_min, hit.t, found);
            } else {
                PositionBuffer corners = PositionBuffer(positions);
                met = hit_triangle(mesh_ray, corners.at[candidate.corners.x], corners.at[candidate.corners.y],
                    corners.at[candidate.corners.z], ray.t_min, hit.t, found);
            }
            met = met && !is_culled(ray, flags, found.front);
            if (met && (flags & INSTANCE_ALPHA_TEST) != 0u && (ray.cull & RAY_UNTESTED) == 0u) {
                bool blended = (ray.cull & RAY_BLENDED) != 0u;
                met = alpha_passes(scene, instance, candidate.corners, found.barycentric, ray.direction, cone_width_at(ray, found.t), blended);
            }
            if (met) {
                hit = Hit(found.t, instance, candidate.primitive, found.barycentric, found.front);
                if (any_hit) {
                    // Ends the traversal by leaving nothing pending, so that the loop has one exit.
                    nodes_left = NOTHING;
                    instances = NOTHING;
                    height = 0u;
                    mesh_height = 0u;
                    break;
                }
            }
        }

        bool level_done = (nodes_left.y & NODE_HITS) == 0u;
        if (level_done && instance != NO_HIT && height == mesh_height) {
            instance = NO_HIT;
            nodes = NodeTable(tables.tlas_nodes);
            level_ray = world_ray;
        }
        if (instance == NO_HIT && instances.y != 0u) {
            if (!level_done) {
                // The node's inner children wait until its instances are done.
                if (top.y != 0u) {
                    stack[height - 1u] = top;
                }
                top = nodes_left;
                height++;
                nodes_left = NOTHING;
            }
            uint bit = uint(findLSB(instances.y));
            instances.y &= instances.y - 1u;
            BvhInstance candidate = PlacedTable(tables.tlas_instances).at[instances.x + bit];
            if (meets_box(world_ray, candidate.min, candidate.max, ray.t_min, hit.t)) {
                Instance placed = InstanceBuffer(tables.instances).at[candidate.instance];
                if ((placed.mask & ray.mask) != 0u) {
                    instance = candidate.instance;
                    mesh_height = height;
                    vec4 rows[3] = placed.object_from_world;
                    vec4 from = vec4(ray.origin, 1.0);
                    vec4 along = vec4(ray.direction, 0.0);
                    vec3 mesh_origin = vec3(dot(rows[0], from), dot(rows[1], from), dot(rows[2], from));
                    mesh_direction = vec3(dot(rows[0], along), dot(rows[1], along), dot(rows[2], along));
                    level_ray = box_ray(mesh_origin, mesh_direction);
                    mesh_ray = triangle_ray(mesh_origin, mesh_direction);
                    MeshBuffer meshes = MeshBuffer(tables.meshes);
                    nodes = NodeTable(meshes.at[placed.mesh].nodes);
                    mesh_primitives = PrimitiveTable(meshes.at[placed.mesh].primitives);
                    positions = meshes.at[placed.mesh].positions;
                    flags = placed.flags;
                    nodes_left = ROOT;
                }
            }
        } else if (level_done) {
            if (height == 0u) {
                break;
            }
            height--;
            if (top.y != 0u) {
                nodes_left = top;
                top = NOTHING;
            } else {
                nodes_left = stack[height];
            }
        }
    }
    return hit.instance != NO_HIT;
}

// Whether the ray hits anything.
bool trace_any(SceneBuffer scene, Ray ray)
{
    Hit hit;
    return walk_scene(scene, ray, true, hit);
}

// The same, with the distance of the hit that was found first, which need not be the nearest; `ray.t_max` on a miss.
bool trace_any_at(SceneBuffer scene, Ray ray, out float t)
{
    Hit hit;
    bool met = walk_scene(scene, ray, true, hit);
    t = hit.t;
    return met;
}

// The nearest hit. On a miss `hit.instance` is NO_HIT and `hit.t` is `ray.t_max`.
bool trace_closest(SceneBuffer scene, Ray ray, out Hit hit)
{
    return walk_scene(scene, ray, false, hit);
}

#endif
