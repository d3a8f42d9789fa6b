#ifndef LIB_LIGHT_SAMPLING_GLSL
#define LIB_LIGHT_SAMPLING_GLSL
#include "lib/light_tree.glsl"
#include "lib/lights.glsl"
#include "lib/random.glsl"
#include "lib/sampling.glsl"
#include "lib/sky.glsl"
#include "lib/surface.glsl"
#include "shared/light_sampling.glsl"
// Incident light at a point: samples of every kind of light, and their pdf, per steradian.

// Light from one direction.
struct Incident {
    vec3 direction;  // unit, towards the light
    float distance;  // metres; INFINITELY_FAR for directional lights and the sky
    vec3 radiance;   // divided by the pdf; for lights without a size, irradiance at normal incidence over the probability
    float pdf;       // per steradian; 0 for lights without a size, which no ray can hit
};

// Draws an entry of an alias table of `count` entries.
uint choose(LightChoiceBuffer table, uint count, uint word, float u) {
    uint index, low;
    umulExtended(word, count, index, low);
    LightChoice entry = table.at[index];
    return u < entry.threshold ? index : entry.alias;
}

// Probability of an entry of a table of `count` entries; 0 if the table is empty.
float probability_of(LightChoiceBuffer table, uint count, uint entry) {
    return entry < count ? table.at[entry].probability : 0.0;
}

// A surface that light is chosen for.
LitPoint lit_surface(SurfacePoint s) {
    return lit_point(s.start.position, s.normal, s.bsdf.transmission > 0.0);
}

// Whether the kernel knows light trees. Those that do take many registers more.
layout(constant_id = 0) const bool LIGHT_TREE = true;

bool has_tree(LightTables lights) {
    return LIGHT_TREE && lights.tree != uvec2(0u);
}

// Chooses an entry of `LightTables::near` for a point: by the light tree, or by power where there is none. False if no light shines.
bool choose_near(SceneBuffer scene, LightTables lights, LitPoint at, uint word, vec2 u, out uint entry, out float probability) {
    if (has_tree(lights)) {
        return choose_by_tree(scene, LightTreeBuffer(lights.tree).at[0], at.position, at.normal, at.both_sides, u, entry, probability);
    }
    LightChoiceBuffer table = LightChoiceBuffer(lights.near);
    entry = choose(table, lights.near_count, word, u.y);
    probability = table.at[entry].probability;
    return true;
}

// The probability of that choice.
float near_probability(SceneBuffer scene, LightTables lights, LitPoint at, uint entry) {
    if (!has_tree(lights)) return probability_of(LightChoiceBuffer(lights.near), lights.near_count, entry);
    return tree_probability(scene, LightTreeBuffer(lights.tree).at[0], lights, entry, at.position, at.normal, at.both_sides);
}

bool has_size(Light light) {
    return light.kind == LIGHT_RECTANGLE || light.kind == LIGHT_DISC || light.kind == LIGHT_SPHERE
        || (light.kind == LIGHT_DIRECTIONAL && light.radius > 0.0);
}

// Radiance of the disc of a directional light.
vec3 disc_radiance(Light light) {
    // Illuminance at normal incidence is radiance times pi sin² of the disc's half angle.
    float s = sin(light.radius);
    return light.intensity / (PI * s * s);
}

// Intersects a ray of unit direction from `position` with a light that has a size: distance, radiance, and the pdf of sampling that
// direction from there. False on a miss, or from behind.
bool meet_light(Light light, vec3 position, vec3 direction, out float distance, out vec3 radiance, out float pdf) {
    distance = INFINITELY_FAR;
    radiance = light.intensity;
    pdf = 0.0;
    if (light.kind == LIGHT_DIRECTIONAL) {
        // sin² of the angle between the directions, precise for small angles.
        vec3 c = cross(direction, light.direction);
        float s = sin(light.radius);
        if (light.radius <= 0.0 || dot(direction, light.direction) >= 0.0 || dot(c, c) > s * s) return false;
        radiance = disc_radiance(light);
        pdf = cone_pdf(one_minus_cos(light.radius));
        return true;
    }
    vec3 to_light = light.position - position;
    if (light.kind == LIGHT_SPHERE) {
        float outside = dot(to_light, to_light) - light.radius * light.radius;
        float along = dot(to_light, direction);
        vec3 beside = to_light - along * direction;
        float half_chord = light.radius * light.radius - dot(beside, beside);
        if (outside <= 0.0 || along <= 0.0 || half_chord < 0.0) return false;
        distance = outside / (along + sqrt(half_chord));
        pdf = cone_pdf(one_minus_cos_of(light.radius * light.radius / dot(to_light, to_light)));
        return true;
    }
    if (light.kind != LIGHT_RECTANGLE && light.kind != LIGHT_DISC) return false;
    float cosine = -dot(light.direction, direction);
    if (cosine <= 0.0) return false;
    distance = -dot(light.direction, to_light) / cosine;
    if (distance <= 0.0) return false;
    vec3 from_centre = distance * direction - to_light;
    float area;
    if (light.kind == LIGHT_DISC) {
        if (dot(from_centre, from_centre) > light.radius * light.radius) return false;
        area = PI * light.radius * light.radius;
    } else {
        vec2 at = weights_along(light.half_u, light.half_v, from_centre);
        if (abs(at.x) > 1.0 || abs(at.y) > 1.0) return false;
        area = 4.0 * length(cross(light.half_u, light.half_v));
    }
    pdf = distance * distance / (area * cosine);
    return true;
}

// Samples one light. False if it sends no light from there.
bool sample_sized_light(Light light, vec3 position, vec2 u, out Incident found) {
    if (!has_size(light)) {
        LightSample towards = sample_light(light, position);
        found = Incident(towards.direction, towards.distance, towards.irradiance, 0.0);
        return towards.irradiance != vec3(0.0);
    }
    found = Incident(vec3(0.0), INFINITELY_FAR, vec3(0.0), 0.0);
    if (light.kind == LIGHT_DIRECTIONAL) {
        float width = one_minus_cos(light.radius);
        found.direction = frame_of(-light.direction) * sample_cone(u, width);
        found.pdf = cone_pdf(width);
        found.radiance = disc_radiance(light) / found.pdf;
        return true;
    }
    vec3 to_light = light.position - position;
    float square = dot(to_light, to_light);
    if (light.kind == LIGHT_SPHERE) {
        float radius_square = light.radius * light.radius;
        if (square <= radius_square) return false;
        float width = one_minus_cos_of(radius_square / square);
        vec3 local = sample_cone(u, width);
        found.direction = frame_of(to_light / sqrt(square)) * local;
        float along = local.z * sqrt(square);
        float half_chord = radius_square - square * dot(local.xy, local.xy);
        found.distance = (square - radius_square) / (along + sqrt(max(half_chord, 0.0)));
        found.pdf = cone_pdf(width);
        found.radiance = light.intensity / found.pdf;
        return true;
    }
    float area;
    if (light.kind == LIGHT_DISC) {
        vec2 on = light.radius * sample_disc(u);
        to_light += frame_of(light.direction) * vec3(on, 0.0);
        area = PI * light.radius * light.radius;
    } else {
        vec2 on = 2.0 * u - 1.0;
        to_light += on.x * light.half_u + on.y * light.half_v;
        area = 4.0 * length(cross(light.half_u, light.half_v));
    }
    found.distance = length(to_light);
    found.direction = safe_normalize(to_light, -light.direction);
    float cosine = -dot(light.direction, found.direction);
    if (cosine <= 0.0 || found.distance <= 0.0) return false;
    found.pdf = found.distance * found.distance / (area * cosine);
    found.radiance = light.intensity / found.pdf;
    return true;
}

// A direction around the axis of a cone of this width as the numbers of `sample_cone`.
vec2 numbers_of_cone(vec3 local, float width) {
    float around = atan(local.y, local.x) / (2.0 * PI);
    return vec2(around < 0.0 ? around + 1.0 : around, one_minus_cos_of(min(dot(local.xy, local.xy), 1.0)) / width);
}

// The numbers for which `sample_sized_light` returns this unit direction, which meets the light (`meet_light`) at this distance.
vec2 numbers_of_light(Light light, vec3 position, vec3 direction, float distance) {
    if (light.kind == LIGHT_DIRECTIONAL) return numbers_of_cone(direction * frame_of(-light.direction), one_minus_cos(light.radius));
    vec3 to_light = light.position - position;
    float square = dot(to_light, to_light);
    if (light.kind == LIGHT_SPHERE) {
        return numbers_of_cone(direction * frame_of(to_light / sqrt(square)), one_minus_cos_of(light.radius * light.radius / square));
    }
    vec3 from_centre = distance * direction - to_light;
    if (light.kind == LIGHT_RECTANGLE) return 0.5 + 0.5 * weights_along(light.half_u, light.half_v, from_centre);
    vec3 local = from_centre * frame_of(light.direction) / light.radius;
    float around = atan(local.y, local.x) / (2.0 * PI);
    return vec2(around < 0.0 ? around + 1.0 : around, dot(local.xy, local.xy));
}

// Pdf over area, per square metre, of points on an emissive primitive, uniform over a triangle or over a sphere in object space.
// `outwards`: direction to the point of a sphere. `normal`: of the triangle or sphere there, unit, outwards.
float emitter_density(Instance instance, Mesh mesh, uint primitive, vec3 outwards, out vec3 normal) {
    if ((instance.flags & INSTANCE_SPHERES) != 0u) {
        float radius = SphereBuffer(mesh.positions).at[primitive].w;
        vec3 stretched = transform_normal(instance.object_from_world, outwards);
        vec4 rows[3] = instance.world_from_object;
        float volume = abs(dot(cross(rows[0].xyz, rows[1].xyz), rows[2].xyz));
        normal = safe_normalize(stretched, outwards);
        return 1.0 / (4.0 * PI * radius * radius * volume * length(stretched));
    }
    uvec3 corners = TriangleBuffer(mesh.ray_indices).at[primitive];
    PositionBuffer positions = PositionBuffer(mesh.positions);
    vec3 corner = positions.at[corners.x];
    vec3 e1 = positions.at[corners.y] - corner;
    vec3 e2 = positions.at[corners.z] - corner;
    normal = safe_normalize(transform_normal(instance.object_from_world, cross(e1, e2)), vec3(0.0));
    vec3 across = cross(transform_vector(instance.world_from_object, e1), transform_vector(instance.world_from_object, e2));
    return 2.0 / length(across);
}

// The numbers for which `sample_emitter` returns a point of an emissive primitive: where a ray has hit it, at this world position.
vec2 numbers_of_emitter(SceneBuffer scene, Hit hit, vec3 position) {
    Instance instance = InstanceBuffer(scene.at[0].instances).at[hit.instance];
    if ((instance.flags & INSTANCE_SPHERES) != 0u) {
        vec4 sphere = SphereBuffer(MeshBuffer(scene.at[0].meshes).at[instance.mesh].positions).at[hit.primitive];
        vec3 outwards = safe_normalize(transform_point(instance.object_from_world, position) - sphere.xyz, vec3(0.0, 1.0, 0.0));
        float around = atan(outwards.y, outwards.x) / (2.0 * PI);
        return vec2(around < 0.0 ? around + 1.0 : around, 0.5 - 0.5 * outwards.z);
    }
    float root = hit.barycentric.x + hit.barycentric.y;
    return vec2(root * root, root > 0.0 ? hit.barycentric.y / root : 0.0);
}

// Samples an emissive triangle or sphere of a mesh at some place; its radiance is the emission times its coverage. False if there is none.
bool sample_placed_emitter(SceneBuffer scene, Instance instance, Mesh mesh, LightChoice choice, vec3 position, vec2 u, out Incident found) {
    found = Incident(vec3(0.0), 0.0, vec3(0.0), 0.0);
    Material material = MaterialBuffer(scene.at[0].materials).at[instance.material];
    Coordinates at = Coordinates(mat2(0.0), mat2(0.0), mat2(0.0));
    vec3 outwards = vec3(0.0);
    vec3 point;
    // Coverage that a ray without a cone finds at that point, from the finest mip.
    float coverage = 1.0;
    if ((instance.flags & INSTANCE_SPHERES) != 0u) {
        outwards = sample_sphere(u);
        vec4 sphere = SphereBuffer(mesh.positions).at[choice.primitive];
        point = sphere.xyz + sphere.w * outwards;
        material.emission_texture.image = NO_TEXTURE;
        // Spheres are not alpha-tested.
        if ((material.flags & MATERIAL_BLEND) != 0u) coverage = coverage_of(material, material.base_colour.a);
    } else {
        vec2 weights = sample_triangle(u);
        vec3 w = vec3(1.0 - weights.x - weights.y, weights);
        uvec3 corners = TriangleBuffer(mesh.ray_indices).at[choice.primitive];
        PositionBuffer positions = PositionBuffer(mesh.positions);
        VertexAttributesBuffer attributes = VertexAttributesBuffer(mesh.attributes);
        point = w.x * positions.at[corners.x] + w.y * positions.at[corners.y] + w.z * positions.at[corners.z];
        at.uv = mat2(
            w.x * attributes.at[corners.x].uv0 + w.y * attributes.at[corners.y].uv0 + w.z * attributes.at[corners.z].uv0,
            w.x * attributes.at[corners.x].uv1 + w.y * attributes.at[corners.y].uv1 + w.z * attributes.at[corners.z].uv1
        );
        if ((material.flags & (MATERIAL_ALPHA_TEST | MATERIAL_BLEND)) != 0u) {
            coverage = coverage_of(material, alpha_at(scene, choice.instance, corners, weights, vec3(0.0), 0.0));
        }
    }
    vec3 normal;
    float density = emitter_density(instance, mesh, choice.primitive, outwards, normal);
    vec3 to_light = transform_point(instance.world_from_object, point) - position;
    found.distance = length(to_light);
    found.direction = safe_normalize(to_light, -normal);
    float cosine = -dot(normal, found.direction);
    if ((material.flags & MATERIAL_DOUBLE_SIDED) != 0u) cosine = abs(cosine);
    if (!(cosine > 0.0) || found.distance <= 0.0) return false;
    found.pdf = density * found.distance * found.distance / cosine;
    found.radiance = coverage * emission_at(material, at) / found.pdf;
    return found.radiance != vec3(0.0);
}

// The same where it is.
bool sample_emitter(SceneBuffer scene, LightChoice choice, vec3 position, vec2 u, out Incident found) {
    Instance instance = InstanceBuffer(scene.at[0].instances).at[choice.instance];
    return sample_placed_emitter(scene, instance, MeshBuffer(scene.at[0].meshes).at[instance.mesh], choice, position, u, found);
}

// The same where it was one frame ago.
bool sample_previous_emitter(SceneBuffer scene, LightChoice choice, vec3 position, vec2 u, out Incident found) {
    Instance instance = InstanceBuffer(scene.at[0].instances).at[choice.instance];
    Mesh mesh = MeshBuffer(scene.at[0].meshes).at[instance.mesh];
    mesh.positions = mesh.previous_positions;
    vec4 rows[3] = instance.previous_world_from_object;
    // Only normals are taken from the inverse, so its translation does not matter.
    mat3 inverse_rows = inverse(mat3(rows[0].xyz, rows[1].xyz, rows[2].xyz));
    for (int k = 0; k < 3; k++) instance.object_from_world[k] = vec4(inverse_rows[k], 0.0);
    instance.world_from_object = rows;
    return sample_placed_emitter(scene, instance, mesh, choice, position, u, found);
}

// Pdf, per steradian, of sampling the emissive primitive that a ray from `position` hits at `point`, once it is chosen.
float hit_emitter_pdf(SceneBuffer scene, Hit hit, vec3 position, vec3 point) {
    Instance instance = InstanceBuffer(scene.at[0].instances).at[hit.instance];
    Mesh mesh = MeshBuffer(scene.at[0].meshes).at[instance.mesh];
    vec3 outwards = vec3(0.0);
    if ((instance.flags & INSTANCE_SPHERES) != 0u) {
        vec3 centre = SphereBuffer(mesh.positions).at[hit.primitive].xyz;
        outwards = safe_normalize(transform_point(instance.object_from_world, point) - centre, vec3(0.0, 1.0, 0.0));
    }
    vec3 normal;
    float density = emitter_density(instance, mesh, hit.primitive, outwards, normal);
    vec3 to_light = point - position;
    float cosine = abs(dot(normal, safe_normalize(to_light, normal)));
    return cosine > 0.0 ? density * dot(to_light, to_light) / cosine : 0.0;
}

// Pdf, per steradian, of sampling for `at` the emissive surface that a ray from there hits at `point`; 0 if it is never sampled.
float emitter_pdf(SceneBuffer scene, LightTables lights, Hit hit, LitPoint at, vec3 point) {
    uint first = WordBuffer(lights.emitters).at[hit.instance];
    if (first == NO_EMITTER) return 0.0;
    float probability = near_probability(scene, lights, at, first + hit.primitive);
    return probability == 0.0 ? 0.0 : probability * hit_emitter_pdf(scene, hit, at.position, point);
}

// A direction of the sky. Rows of cells have equal steps of height, so that all cells have the same solid angle.
vec3 sky_direction(vec2 at) {
    float angle = 2.0 * PI * at.x;
    float y = 1.0 - 2.0 * at.y;
    float flat_length = 2.0 * sqrt(at.y * (1.0 - at.y));
    return vec3(flat_length * cos(angle), y, flat_length * sin(angle));
}

uint sky_cell(LightTables lights, vec3 direction) {
    float around = atan(direction.z, direction.x) / (2.0 * PI);
    vec2 at = vec2(around < 0.0 ? around + 1.0 : around, 0.5 - 0.5 * direction.y);
    uvec2 cell = min(uvec2(at * vec2(lights.sky_cells)), lights.sky_cells - 1u);
    return cell.y * lights.sky_cells.x + cell.x;
}

// Pdf of sampling a direction in a cell of the sky, per steradian.
float sky_cell_pdf(LightTables lights, uint cell) {
    return probability_of(LightChoiceBuffer(lights.sky), lights.sky_count, cell) * float(lights.sky_count) / (4.0 * PI);
}

// Pdf of sampling a direction of the sky, per steradian; 0 if the sky is black.
float sky_pdf(LightTables lights, vec3 direction) {
    return sky_cell_pdf(lights, sky_cell(lights, direction));
}

// Samples a sky that has at least one cell to choose.
Incident sample_sky(Sky sky, LightTables lights, uint word, vec3 u) {
    uint cell = choose(LightChoiceBuffer(lights.sky), lights.sky_count, word, u.z);
    uvec2 at = uvec2(cell % lights.sky_cells.x, cell / lights.sky_cells.x);
    vec3 direction = sky_direction((vec2(at) + u.xy) / vec2(lights.sky_cells));
    float pdf = sky_cell_pdf(lights, cell);
    return Incident(direction, INFINITELY_FAR, sky_radiance(sky, direction) / pdf, pdf);
}

// Groups of lights. Each has a table of its own.
const uint GROUP_NEAR = 0u;  // local lights, emissive triangles and spheres
const uint GROUP_FAR = 1u;   // directional lights
const uint GROUP_SKY = 2u;
const uint LIGHT_GROUPS = 3u;

// Entries of a group's table; 0 if the group gives no light.
uint lights_in(LightTables lights, uint group) {
    return group == GROUP_NEAR ? lights.near_count : group == GROUP_FAR ? lights.far_count : lights.sky_count;
}

// Samples a group that has lights: one of them, and a point or direction of it. `probability`: of choosing that light; the sky is one light.
// False if it sends no light to `at`.
bool sample_group(
    uint group, ViewBuffer view, SceneBuffer scene, LightTables lights, LitPoint at, uvec4 words, out Incident found, out float probability
) {
    vec4 u = unit_floats(words);
    if (group == GROUP_SKY) {
        probability = 1.0;
        found = sample_sky(view.at[0].sky, lights, words.x, u.yzw);
        return found.radiance != vec3(0.0);
    }
    LightChoice choice;
    if (group == GROUP_NEAR) {
        uint entry;
        if (!choose_near(scene, lights, at, words.x, u.xy, entry, probability)) return false;
        choice = LightChoiceBuffer(lights.near).at[entry];
    } else {
        LightChoiceBuffer table = LightChoiceBuffer(lights.far);
        choice = table.at[choose(table, lights.far_count, words.x, u.y)];
        probability = choice.probability;
    }
    if (choice.light == CHOICE_EMITTER) return sample_emitter(scene, choice, at.position, u.zw, found);
    return sample_sized_light(LightBuffer(scene.at[0].lights).at[choice.light], at.position, u.zw, found);
}

#endif
