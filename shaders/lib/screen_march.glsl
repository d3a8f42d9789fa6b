#ifndef LIB_SCREEN_MARCH_GLSL
#define LIB_SCREEN_MARCH_GLSL
#include "lib/gbuffer.glsl"
#include "lib/guide.glsl"
#include "shared/screen_march.glsl"
// Rays through the depth image. Depth is reversed: the nearest of several depths is their maximum, and a background of 0 is behind
// everything. Reversed depth is proportional to 1 / view depth, which is linear along a straight line on the screen, so a ray is a straight
// line in pixels and reversed depth together: no division per step (McGuire and Mara 2014, "Efficient GPU Screen-Space Ray Tracing", JCGT
// 3(4), section 2, interpolate 1/w for the same reason).

// A program that counts the pixels that a march looks at defines this; it is called once for each, before the depth is read.
#ifndef SCREEN_MARCH_LOOKS_AT
#define SCREEN_MARCH_LOOKS_AT(pixel)
#endif

// A ray, clipped to what the camera sees.
struct ScreenRay {
    vec3 from;         // pixels and reversed depth
    vec3 change;       // from there to the end
    vec2 view_depths;  // of both ends, metres
    float metres;      // its length
};

// What a ray has found.
struct ScreenHit {
    bool met;        // a surface that the camera sees, from the side that it sees
    vec2 place;      // pixels
    ivec2 pixel;     // of the surface
    float depth;     // reversed, of the surface
    bool was_behind; // the ray passed behind something on its way
    uint steps;      // look-ups of depth
};

// Clips a ray to the screen and the near plane. False if nothing is left that could be marched: it starts outside, or stays in its pixel.
// `origin` world, metres; `direction` unit.
bool clip_to_screen(ViewBuffer view, vec3 origin, vec3 direction, float most, out ScreenRay ray) {
    vec4 a = view.at[0].clip_from_world * vec4(origin, 1.0);
    vec4 along = view.at[0].clip_from_world * vec4(direction, 0.0);
    // Inside of each plane is above 0: left, right, top, bottom, near.
    float inside_now[5] = float[](a.w + a.x, a.w - a.x, a.w + a.y, a.w - a.y, a.w - a.z);
    float change[5] = float[](along.w + along.x, along.w - along.x, along.w + along.y, along.w - along.y, along.w - along.z);
    ray.metres = most;
    for (int plane = 0; plane < 5; plane++) {
        if (!(inside_now[plane] > 0.0)) return false;
        if (change[plane] < 0.0) ray.metres = min(ray.metres, inside_now[plane] / -change[plane]);
    }
    vec4 b = a + ray.metres * along;
    if (!(b.w > 0.0)) return false;
    vec2 size = vec2(view.at[0].size);
    ray.from = vec3((a.xy / a.w * 0.5 + 0.5) * size, a.z / a.w);
    ray.change = vec3((b.xy / b.w * 0.5 + 0.5) * size, b.z / b.w) - ray.from;
    ray.view_depths = vec2(a.w, b.w);
    return max(abs(ray.change.x), abs(ray.change.y)) >= 1.0;
}

// Distance from the origin, metres, at a share of the way on the screen.
float distance_at(ScreenRay ray, float share) {
    return share * ray.metres * ray.view_depths.x / mix(ray.view_depths.y, ray.view_depths.x, share);
}

// The least and the greatest reversed depth of a surface in a pixel: it is taken to be as thick as the setting says, but no thinner than two
// pixels are wide there. A camera that sees things of a pixel's width cannot tell how far they go back, and a ray that steps from pixel to
// pixel would go through them. `nearest` and `farthest` of several pixels give the range of all.
vec2 occupied(ViewBuffer view, ScreenMarch march, float farthest, float nearest) {
    // Behind a background there is no more.
    if (farthest <= 0.0) return vec2(0.0, nearest);
    float depth = view_depth(view, farthest);
    float thickness = max(march.thickness, 2.0 * pixel_spread(view) * depth);
    return vec2(farthest * depth / (depth + thickness), nearest);
}

// Whether reversed depths of a part of a ray meet those that are occupied.
bool meets(vec2 depths, vec2 occupied_depths) {
    return min(depths.x, depths.y) <= occupied_depths.y && max(depths.x, depths.y) >= occupied_depths.x && occupied_depths.y > 0.0;
}

// Whether a part of a ray is behind all that the camera sees there.
bool is_behind_all(vec2 depths, vec2 occupied_depths) {
    return max(depths.x, depths.y) < occupied_depths.x;
}

float depth_seen(GBufferImages gbuffer, ivec2 pixel) {
    SCREEN_MARCH_LOOKS_AT(pixel);
    return load(gbuffer.depth, pixel).r;
}

// Steps of equal length on the screen, each to the middle of another pixel along the longer axis, so that none is looked at twice (McGuire
// and Mara 2014). `stride`: pixels, 1 or more. `jitter`, 0 to 1, moves the first step within the stride. A hit between two steps is found by
// bisection, to less than a pixel.
ScreenHit march_linear(ViewBuffer view, ScreenMarch march, GBufferImages gbuffer, ScreenRay ray, float stride, float jitter) {
    ScreenHit hit = ScreenHit(false, vec2(0.0), ivec2(0), 0.0, false, 0u);
    bool is_wide = abs(ray.change.x) >= abs(ray.change.y);
    float start = is_wide ? ray.from.x : ray.from.y;
    float reach = is_wide ? ray.change.x : ray.change.y;
    float side = reach < 0.0 ? -1.0 : 1.0;
    float first = floor(start) + 0.5 + side * (1.0 + floor(jitter * stride));
    ivec2 last_pixel = ivec2(view.at[0].size) - 1;
    float before = 0.0;
    for (uint i = 0u; i < march.steps; i++) {
        float share = (first + side * float(i) * stride - start) / reach;
        if (share > 1.0) break;
        vec3 at = ray.from + share * ray.change;
        ivec2 pixel = clamp(ivec2(floor(at.xy)), ivec2(0), last_pixel);
        float depth = depth_seen(gbuffer, pixel);
        hit.steps++;
        vec2 depths = vec2(ray.from.z + before * ray.change.z, at.z);
        vec2 taken = occupied(view, march, depth, depth);
        hit.was_behind = hit.was_behind || is_behind_all(depths, taken);
        if (meets(depths, taken)) {
            // Lower end in front of what is seen, upper end behind.
            float low = before;
            float high = share;
            for (float width = stride; width > 0.5; width *= 0.5) {
                float middle = 0.5 * (low + high);
                vec3 there = ray.from + middle * ray.change;
                ivec2 p = clamp(ivec2(floor(there.xy)), ivec2(0), last_pixel);
                float found = load(gbuffer.depth, p).r;
                hit.steps++;
                bool is_behind = there.z <= found;
                high = is_behind ? middle : high;
                low = is_behind ? low : middle;
            }
            vec3 end = ray.from + high * ray.change;
            pixel = clamp(ivec2(floor(end.xy)), ivec2(0), last_pixel);
            depth = load(gbuffer.depth, pixel).r;
            if (meets(vec2(ray.from.z + low * ray.change.z, end.z), occupied(view, march, depth, depth))) {
                hit.met = true;
                hit.place = end.xy;
                hit.pixel = pixel;
                hit.depth = depth;
                return hit;
            }
        }
        before = share;
    }
    return hit;
}

// Through the pyramid: as large a step as the cell of a level allows through which the ray passes in front of everything or behind
// everything. From cell to cell the place is kept as a whole pixel, so that rounding can neither skip one nor stay in one.
ScreenHit march_pyramid(ViewBuffer view, ScreenMarch march, GBufferImages gbuffer, ScreenRay ray) {
    ScreenHit hit = ScreenHit(false, vec2(0.0), ivec2(0), 0.0, false, 0u);
    ivec2 size = ivec2(view.at[0].size);
    // An axis along which the ray does not move is never left.
    vec2 inverse = vec2(ray.change.x == 0.0 ? 1e30 : 1.0 / ray.change.x, ray.change.y == 0.0 ? 1e30 : 1.0 / ray.change.y);
    ivec2 forward = ivec2(greaterThanEqual(ray.change.xy, vec2(0.0)));
    ivec2 pixel = clamp(ivec2(floor(ray.from.xy)), ivec2(0), size - 1);
    float share = 0.0;
    int level = 0;
    // The first turn leaves the pixel of the origin.
    for (uint turn = 0u; turn <= march.steps; turn++) {
        ivec2 cell = pixel >> level;
        vec2 borders = vec2((cell + forward) << level);
        vec2 ends = (borders - ray.from.xy) * inverse;
        bool leaves_by_x = ends.x < ends.y;
        float end = max(leaves_by_x ? ends.x : ends.y, share);
        bool is_last = end >= 1.0;
        end = min(end, 1.0);
        if (turn > 0u) {
            vec2 depths = ray.from.z + vec2(share, end) * ray.change.z;
            vec2 seen = level == 0 ? vec2(depth_seen(gbuffer, pixel)) : load_mip(march.pyramid, cell, level - 1).rg;
            hit.steps++;
            vec2 taken = occupied(view, march, seen.x, seen.y);
            hit.was_behind = hit.was_behind || is_behind_all(depths, taken);
            if (meets(depths, taken)) {
                if (depths.x > seen.y && ray.change.z != 0.0) {
                    // In front of all of the cell until it is as deep as the nearest of it.
                    share = clamp((seen.y - ray.from.z) / ray.change.z, share, end);
                    ivec2 low = cell << level;
                    pixel = clamp(ivec2(floor(ray.from.xy + share * ray.change.xy)), low, min(low + (1 << level), size) - 1);
                }
                if (level == 0) {
                    hit.met = true;
                    hit.place = ray.from.xy + share * ray.change.xy;
                    hit.pixel = pixel;
                    hit.depth = seen.y;
                    return hit;
                }
                level--;
                continue;
            }
        }
        if (is_last) return hit;
        // Into the next cell: beyond the border along one axis, still within this cell along the other.
        ivec2 low = cell << level;
        ivec2 next = clamp(ivec2(floor(ray.from.xy + end * ray.change.xy)), low, low + (1 << level) - 1);
        if (leaves_by_x) next.x = forward.x == 1 ? low.x + (1 << level) : low.x - 1;
        else next.y = forward.y == 1 ? low.y + (1 << level) : low.y - 1;
        if (any(lessThan(next, ivec2(0))) || any(greaterThanEqual(next, size))) return hit;
        pixel = next;
        share = end;
        level = min(level + 1, int(march.levels));
    }
    return hit;
}

// Marches a ray in the world. What the camera sees from its other side is no hit, and ends the ray: something is there, and nobody knows
// what it looks like from there. `stride` and `jitter` are for steps of equal length.
ScreenHit march_screen(ViewBuffer view, ScreenMarch march, GBufferImages gbuffer, vec3 origin, vec3 direction, float stride, float jitter) {
    ScreenHit hit = ScreenHit(false, vec2(0.0), ivec2(0), 0.0, false, 0u);
    ScreenRay ray;
    if (!clip_to_screen(view, origin, direction, march.distance, ray)) return hit;
    if (march.pyramid == NO_IMAGE) hit = march_linear(view, march, gbuffer, ray, stride, jitter);
    else hit = march_pyramid(view, march, gbuffer, ray);
    if (hit.met) hit.met = dot(octahedral_decode(load(gbuffer.geometric_normal, hit.pixel).xy), direction) < 0.0;
    return hit;
}

// Where a ray leaves a surface so that it does not meet that surface itself. A pixel holds one depth for all of its area, so a plane may be
// off by what it rises over half a pixel's diagonal: at most 0.71 pixel widths along its normal.
vec3 march_origin(ViewBuffer view, Surface s) {
    float depth = (view.at[0].clip_from_world * vec4(s.position, 1.0)).w;
    return s.position + s.geometric_normal * (0.75 * pixel_spread(view) * depth);
}

// World position of a hit: on the way of the camera's ray, as deep as the pixel's surface.
vec3 hit_position(ViewBuffer view, ScreenHit hit) {
    precise vec2 ndc = hit.place / vec2(view.at[0].size) * 2.0 - 1.0;
    mat4 m = view.at[0].world_from_clip;
    precise vec3 position = view.at[0].eye + (m[0].xyz * ndc.x + m[1].xyz * ndc.y + m[3].xyz) / (hit.depth * m[2].w);
    return position;
}

#endif
