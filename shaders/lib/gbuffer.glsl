#ifndef LIB_GBUFFER_GLSL
#define LIB_GBUFFER_GLSL
#include "lib/bindless.glsl"
#include "lib/bsdf.glsl"
#include "lib/gbuffer_specular.glsl"
#include "lib/octahedral.glsl"
#include "lib/vector.glsl"
#include "shared/gbuffer.glsl"
#include "shared/view.glsl"
// The G-buffer, decoded. Layout: README.md.

struct Surface {
    // False on the background; nothing else is meaningful then.
    bool exists;
    // World, metres.
    vec3 position;
    // Unit, towards the viewer.
    vec3 to_eye;
    // Shading normal, unit, facing the viewer.
    vec3 normal;
    // Normal of the triangle, unit, facing the viewer.
    vec3 geometric_normal;
    // Linear Rec.709, 0 to 1.
    vec3 base_colour;
    // Occlusion map; 1 is open.
    float occlusion;
    float metalness;
    // Perceptual, 0 to 1.
    float roughness;
    // Of base colour, metalness and the dielectric part's reflectance.
    Fresnel fresnel;
    // Strength of the clear coat, 0 to 1, and its roughness, perceptual.
    float coat;
    float coat_roughness;
    // Albedo of the specular lobes of base and coat towards the eye.
    SplitSum lobe;
    SplitSum coat_lobe;
};

// Direction of the ray through a pixel's centre, not normalised: the point at reversed depth d is eye + ray / (d w) with w =
// world_from_clip[2].w. With an infinite reversed projection only the inverse's depth column has a w, and that column is the eye. Taking
// the matrix apart this way avoids adding coordinates as large as the eye's before the division.
vec3 pixel_ray(ViewBuffer view, ivec2 pixel) {
    precise vec2 ndc = (vec2(pixel) + 0.5) / vec2(view.at[0].size) * 2.0 - 1.0;
    mat4 m = view.at[0].world_from_clip;
    precise vec3 ray = m[0].xyz * ndc.x + m[1].xyz * ndc.y + m[3].xyz;
    return ray;
}

// Width of a pixel's cone per view depth: the height of a pixel at one metre. Times the `t` of a ray along `pixel_ray` it is the cone's
// width there, metres.
float pixel_spread(ViewBuffer view) {
    return 2.0 * length(view.at[0].world_from_clip[1].xyz) / float(view.at[0].size.y);
}

// World position of a pixel's centre at reversed depth `depth`, above 0.
vec3 world_position(ViewBuffer view, ivec2 pixel, float depth) {
    precise vec3 position = view.at[0].eye + pixel_ray(view, pixel) / (depth * view.at[0].world_from_clip[2].w);
    return position;
}

// The surface of a background pixel.
Surface no_surface() {
    Surface s;
    s.exists = false;
    s.position = vec3(0.0);
    s.to_eye = vec3(0.0);
    s.normal = vec3(0.0);
    s.geometric_normal = vec3(0.0);
    s.base_colour = vec3(0.0);
    s.occlusion = 1.0;
    s.metalness = 0.0;
    s.roughness = 1.0;
    s.fresnel = Fresnel(vec3(0.0), 0.0, vec3(0.0), 1.0);
    s.coat = 0.0;
    s.coat_roughness = 0.0;
    s.lobe = NO_SPLIT_SUM;
    s.coat_lobe = NO_SPLIT_SUM;
    return s;
}

// Position and normals. A pass that uses one normal only need not declare the other.
Surface load_geometry(ViewBuffer view, ivec2 pixel, GBufferImages gbuffer) {
    Surface s = no_surface();
    float depth = load(gbuffer.depth, pixel).r;
    s.exists = depth > 0.0;
    if (!s.exists) return s;
    s.position = world_position(view, pixel, depth);
    s.to_eye = -normalize(pixel_ray(view, pixel));
    s.normal = octahedral_decode(load(gbuffer.normal, pixel).xy);
    s.geometric_normal = octahedral_decode(load(gbuffer.geometric_normal, pixel).xy);
    return s;
}

// Cosine of the angle at which the eye sees a surface. One on or below the horizon is treated as grazing.
float eye_cosine(Surface s) {
    return max(dot(s.normal, s.to_eye), 1e-4);
}

// The material; normals and the direction to the eye are there already.
void load_material(ViewBuffer view, inout Surface s, ivec2 pixel, GBufferImages gbuffer) {
    vec4 base_colour = load(gbuffer.base_colour, pixel);
    vec4 material = load(gbuffer.material, pixel);
    s.base_colour = base_colour.rgb;
    s.occlusion = base_colour.a;
    s.metalness = material.r;
    s.roughness = material.g;
    s.fresnel = fresnel_of(decode_dielectric(material.ba), s.base_colour, s.metalness);
    s.lobe = split_sum(view.at[0].lobe_albedo, s.roughness, eye_cosine(s));
    // In scenes without clear coats the image is the black placeholder.
    if (gbuffer.coat == 0u) return;
    vec2 coat = load(gbuffer.coat, pixel).rg;
    s.coat = coat.r;
    s.coat_roughness = coat.g;
    s.coat_lobe = split_sum(view.at[0].lobe_albedo, s.coat_roughness, eye_cosine(s));
}

// Whether the surface reflects anything specularly.
bool reflects(Surface s) {
    return s.coat > 0.0 || has_reflection(s.fresnel);
}

// Whether the surface scatters anything diffusely.
bool scatters(Surface s) {
    return s.exists && s.metalness < 1.0 && s.base_colour != vec3(0.0);
}

// Position, normals and material.
Surface load_surface(ViewBuffer view, ivec2 pixel, GBufferImages gbuffer) {
    Surface s = load_geometry(view, pixel, gbuffer);
    if (s.exists) load_material(view, s, pixel, gbuffer);
    return s;
}

// Normals and material without position and depth, for indirect light from far away. `exists` is false where no indirect light is seen: on
// the background, and where the occlusion map is 0.
Surface load_receiver(ViewBuffer view, ivec2 pixel, GBufferImages gbuffer) {
    Surface s = no_surface();
    s.to_eye = -normalize(pixel_ray(view, pixel));
    s.normal = octahedral_decode(load(gbuffer.normal, pixel).xy);
    s.geometric_normal = octahedral_decode(load(gbuffer.geometric_normal, pixel).xy);
    load_material(view, s, pixel, gbuffer);
    s.exists = s.occlusion > 0.0;
    return s;
}

// How the surface scatters light towards the eye.
Bsdf bsdf_of(Surface s) {
    Bsdf b = opaque_bsdf(s.base_colour, s.metalness, s.roughness, s.fresnel);
    b.lobe = s.lobe;
    b.coat = s.coat;
    b.coat_alpha = alpha_of_roughness(s.coat_roughness);
    b.coat_lobe = s.coat_lobe;
    return b;
}

// Albedo of the diffuse lobe towards the eye.
vec3 diffuse_albedo(Surface s) {
    return diffuse_albedo(bsdf_of(s), eye_cosine(s));
}

#endif
