#ifndef LIB_BINDLESS_GLSL
#define LIB_BINDLESS_GLSL
// Every extension that Magpie's shaders need, the one bindless set, and helpers to read and write it.
// Include it first: GLSL wants extensions before anything else.
#extension GL_EXT_scalar_block_layout : require
#extension GL_EXT_buffer_reference : require
#extension GL_EXT_buffer_reference2 : require
#extension GL_EXT_buffer_reference_uvec2 : require
#extension GL_EXT_nonuniform_qualifier : require
#extension GL_EXT_shader_image_load_formatted : require
#extension GL_EXT_samplerless_texture_functions : require
#include "shared/filter.glsl"

// Views of one table. An index must be used through the view that fits its image's format and whether it has layers. An image view with
// several layers is an array.
layout(set = 0, binding = 2) uniform texture2D images[];
layout(set = 0, binding = 2) uniform utexture2D images_uint[];
layout(set = 0, binding = 2) uniform texture2DArray image_arrays[];
layout(set = 0, binding = 1) uniform image2D storage_images[];
layout(set = 0, binding = 1) uniform uimage2D storage_images_uint[];
layout(set = 0, binding = 1) uniform image2DArray storage_image_arrays[];
layout(set = 0, binding = 0) uniform sampler samplers[];

// Three floats each: the positions of a mesh.
layout(buffer_reference, scalar, buffer_reference_align = 4) readonly buffer PositionBuffer { vec3 at[]; };
// The positions of a mesh of spheres: centre and radius.
layout(buffer_reference, scalar, buffer_reference_align = 4) readonly buffer SphereBuffer { vec4 at[]; };
// Vertex indices of a mesh's triangles.
layout(buffer_reference, scalar, buffer_reference_align = 4) readonly buffer TriangleBuffer { uvec3 at[]; };
// Plain 32-bit words, such as indices.
layout(buffer_reference, scalar, buffer_reference_align = 4) readonly buffer WordBuffer { uint at[]; };

// False outside the image, which the last workgroups exceed.
bool inside(ivec2 pixel, uvec2 size) {
    return all(lessThan(uvec2(pixel), size));
}

// Texel `p` of mip 0, unfiltered. `image` must be uniform over the draw or dispatch.
vec4 load(uint image, ivec2 p) {
    return texelFetch(images[image], p, 0);
}

// The same of another mip.
vec4 load_mip(uint image, ivec2 p, int mip) {
    return texelFetch(images[image], p, mip);
}

// As load(), for an unsigned integer format.
uvec4 load_uint(uint image, ivec2 p) {
    return texelFetch(images_uint[image], p, 0);
}

// The same for one layer of an image with several.
vec4 load_layer(uint image, ivec2 p, int layer) {
    return texelFetch(image_arrays[image], ivec3(p, layer), 0);
}

// Filtered at mip level `lod`. Image and sampler may differ between invocations.
vec4 sample_lod(uint image, uint sampler_id, vec2 uv, float lod) {
    return textureLod(sampler2D(images[nonuniformEXT(image)], samplers[nonuniformEXT(sampler_id)]), uv, lod);
}

// Beyond the last mip of any image: the level is clamped.
const float COARSEST_MIP = 1000.0;

// Mip level for gradients that are too small or too large to be of use to a filter, for which some drivers return NaN; below 0 for all
// others. Below LEAST a pixel spans less than a 600th of a texel of the largest image (16384): the finest mip. Above MOST it spans so many
// images that even an eighth of it, the limit of anisotropy, is the coarsest mip. NaN counts as that too.
float lod_without_gradients(vec2 dx, vec2 dy) {
    const float LEAST = 1e-7;
    const float MOST = 1e4;
    if (all(lessThan(abs(dx), vec2(LEAST))) && all(lessThan(abs(dy), vec2(LEAST)))) return 0.0;
    return all(lessThan(abs(dx), vec2(MOST))) && all(lessThan(abs(dy), vec2(MOST))) ? -1.0 : COARSEST_MIP;
}

// Filtered with the gradients `dx` and `dy` of the coordinates over a pixel. Image and sampler may differ between invocations.
vec4 sample_gradients(uint image, uint sampler_id, vec2 uv, vec2 dx, vec2 dy) {
    float lod = lod_without_gradients(dx, dy);
    if (lod >= 0.0) return sample_lod(image, sampler_id, uv, lod);
    return textureGrad(sampler2D(images[nonuniformEXT(image)], samplers[nonuniformEXT(sampler_id)]), uv, dx, dy);
}

// Index of texel `at` in a row of `count`, repeated or clamped.
int wrapped(int at, int count, bool repeats) {
    return repeats ? ((at % count) + count) % count : clamp(at, 0, count - 1);
}

// Emulates a bilinear sampler (Vulkan, 16.9.3) by four fetches, for formats that the device cannot filter.
vec4 fetch_bilinear(uint image, uint edges, vec2 uv) {
    ivec2 size = textureSize(images[nonuniformEXT(image)], 0);
    vec2 at = uv * vec2(size) - 0.5;
    ivec2 low = ivec2(floor(at));
    vec2 f = at - vec2(low);
    bool by_u = (edges & REPEATS_U) != 0u, by_v = (edges & REPEATS_V) != 0u;
    int x0 = wrapped(low.x, size.x, by_u), x1 = wrapped(low.x + 1, size.x, by_u);
    int y0 = wrapped(low.y, size.y, by_v), y1 = wrapped(low.y + 1, size.y, by_v);
    vec4 above = mix(texelFetch(images[nonuniformEXT(image)], ivec2(x0, y0), 0), texelFetch(images[nonuniformEXT(image)], ivec2(x1, y0), 0), f.x);
    vec4 below = mix(texelFetch(images[nonuniformEXT(image)], ivec2(x0, y1), 0), texelFetch(images[nonuniformEXT(image)], ivec2(x1, y1), 0), f.x);
    return mix(above, below, f.y);
}

// Bilinear at mip 0 by a sampler or by four fetches, as `Gpu::bilinear` chose for the image's format. Image and sampler may differ between
// invocations.
vec4 sample_bilinear(uint image, uint sampler_id, vec2 uv) {
    return sampler_id >= FETCHED ? fetch_bilinear(image, sampler_id - FETCHED, uv) : sample_lod(image, sampler_id, uv, 0.0);
}

// Writes pixel `p`. `image` must be uniform over the draw or dispatch.
void store(uint image, ivec2 p, vec4 value) {
    imageStore(storage_images[image], p, value);
}

// The same for one layer of an image with several.
void store_layer(uint image, ivec2 p, int layer, vec4 value) {
    imageStore(storage_image_arrays[image], ivec3(p, layer), value);
}

// The same for an unsigned integer format.
void store_uint(uint image, ivec2 p, uvec4 value) {
    imageStore(storage_images_uint[image], p, value);
}

#endif
