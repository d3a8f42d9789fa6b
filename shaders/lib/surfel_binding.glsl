#ifndef LIB_SURFEL_BINDING_GLSL
#define LIB_SURFEL_BINDING_GLSL
#include "lib/octahedral.glsl"
#include "lib/ray_origin.glsl"
#include "lib/surfels.glsl"
// Surfels are bound to a point of a triangle or sphere, and go where it goes.

// What the eye sees along a ray. `ids` and `position` as in `seen_start`.
SurfelBinding seen_binding(SceneBuffer scene, uvec2 ids, vec3 eye, vec3 along, vec3 position) {
    SurfelBinding s;
    s.instance = ids.x;
    s.primitive = ids.y;
    Instance instance = InstanceBuffer(scene.at[0].instances).at[ids.x - 1u];
    Mesh mesh = MeshBuffer(scene.at[0].meshes).at[instance.mesh];
    vec3 normal;
    if ((instance.flags & INSTANCE_SPHERES) != 0u) {
        vec3 from_centre = transform_point(instance.object_from_world, position) - SphereBuffer(mesh.positions).at[ids.y].xyz;
        s.weights = octahedral_encode(from_centre);
        normal = transform_normal(instance.object_from_world, from_centre);
    } else {
        PositionBuffer corners = PositionBuffer(mesh.positions);
        uvec3 at = TriangleBuffer(mesh.indices).at[ids.y];
        vec3 a = corners.at[at.x], b = corners.at[at.y], c = corners.at[at.z];
        vec3 from = transform_point(instance.object_from_world, eye);
        s.weights = met_weights(a - from, b - from, c - from, transform_vector(instance.object_from_world, along));
        normal = transform_normal(instance.object_from_world, cross(b - a, c - a));
    }
    s.side = dot(normal, along) > 0.0 ? SURFEL_BACK : 0u;
    return s;
}

// What a ray has hit.
SurfelBinding hit_binding(SceneBuffer scene, Ray ray, Hit hit) {
    SurfelBinding s = SurfelBinding(hit.instance + 1u, hit.primitive, hit.barycentric, SURFEL_OF_RAYS | (hit.front ? 0u : SURFEL_BACK));
    Instance instance = InstanceBuffer(scene.at[0].instances).at[hit.instance];
    if ((instance.flags & INSTANCE_SPHERES) != 0u) {
        vec4 sphere = SphereBuffer(MeshBuffer(scene.at[0].meshes).at[instance.mesh].positions).at[hit.primitive];
        s.weights = octahedral_encode(transform_point(instance.object_from_world, ray.origin + hit.t * ray.direction) - sphere.xyz);
    }
    return s;
}

// Where a surfel is. Its normal is 0 where its triangle or instance has no area.
RayStart surfel_start(SceneBuffer scene, SurfelBinding s) {
    Instance instance = InstanceBuffer(scene.at[0].instances).at[s.instance - 1u];
    Mesh mesh = MeshBuffer(scene.at[0].meshes).at[instance.mesh];
    RayStart start;
    if ((instance.flags & INSTANCE_SPHERES) != 0u) {
        vec4 sphere = SphereBuffer(mesh.positions).at[s.primitive];
        start = sphere_start(instance, sphere, sphere.xyz + octahedral_decode(s.weights));
    } else {
        PositionBuffer corners = PositionBuffer(mesh.positions);
        uvec3 at = TriangleBuffer((s.side & SURFEL_OF_RAYS) != 0u ? mesh.ray_indices : mesh.indices).at[s.primitive];
        start = triangle_start(instance, corners.at[at.x], corners.at[at.y], corners.at[at.z], s.weights);
    }
    if ((s.side & SURFEL_BACK) != 0u) start.normal = -start.normal;
    return start;
}

#endif
