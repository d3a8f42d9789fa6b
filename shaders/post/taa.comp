#version 460
#extension GL_GOOGLE_include_directive : require
#include "lib/bindless.glsl"
#include "lib/colour.glsl"
#include "lib/gbuffer.glsl"
#include "lib/not_finite.glsl"
#include "lib/picture_change.glsl"
#include "lib/reprojection.glsl"
#include "lib/resample.glsl"
#include "lib/surface_history.glsl"
#include "shared/denoise.glsl"
#include "shared/post.glsl"
// Temporal anti-aliasing (Karis 2014, "High Quality Temporal Supersampling"; Yang, Liu and Salvi 2020, "A Survey of Temporal Antialiasing
// Techniques"), and upsampling where the frame is smaller than the picture. Static pixels converge to the plain mean of their samples:
// their history is kept unless the samples show a change. The history of moving pixels is clipped to the colours around. Details:
// docs/passes/post.md.
layout(local_size_x = 8, local_size_y = 8) in;
layout(push_constant, scalar) uniform Push { TaaParams params; };

// Greatest weight of the history, in samples: of static and of moving pixels.
const float MOST_STILL = 128.0;
const float MOST_MOVING = 8.0;
// Motion, pixels per frame: up to the first it counts as static (the precision of motion vectors), from the second on as moving.
const vec2 STILL_PIXELS = vec2(0.001, 0.1);
// Half size of the box of colours that a moving history is clipped to, in standard deviations.
const float CLIP_DEVIATIONS = 1.0;
// Weight of the history after a change, in samples such as this frame's.
const float LEFT_AFTER_CHANGE = 1.0;
// Light mostly changes over several frames. From one in which it did, later samples count more than earlier ones: a new sample adds only this much to the weight
// of the history, until that is SETTLED.
const float ADDED_WHILE_CHANGING = 1.0 / 3.0;
const float SETTLED = 8.0;
// While the history is shorter than BRIEF samples, the blend of an even 3x3 counts as a sample of the pixel's own, so that all pixels take
// in new light alike; else a change of light would show the pattern of the samples. Deviation over mean: up to the first it is even, from
// the second on it is not.
const vec2 EVEN = vec2(0.03, 0.2);
const float BRIEF = 16.0;
// Pixels of the 3x3 that show the centre's instance, at most, where that is thinner than a pixel: a line has three.
const uint THIN = 3u;

// This frame's neighbourhood of an output pixel.
struct Around {
    ivec2 centre;     // the frame's pixel whose sample is nearest to the centre
    ivec2 closest;    // the pixel of the 3x3 whose surface is closest to the camera
    vec3 mean;        // tone-compressed YCoCg
    vec3 deviation;
    vec3 smooth_mean; // the same weighted by the distance from the centre
    uint depth_least; // as depth_code
    uint depth_most;
    uint instances;   // as instance_bit
    uint instance;    // of the centre, + 1
    float depth;      // of the centre
    uint mover;       // an instance that can move, + 1, if one is there
    bool stays;       // the one that the history shows is still there
    uint alike;       // pixels that show the same instance
    ivec2 beside;     // a pixel of the instance that most of the others show, if one does
    bool seen;        // at least one of the colours is finite
};

// `mover` is the instance that can move, + 1, of the history.
Around look_around(ViewBuffer view, vec2 at, uint mover) {
    SceneBuffer scene = SceneBuffer(params.scene);
    Around around;
    ivec2 last = ivec2(view.at[0].size) - 1;
    around.centre = clamp(ivec2(floor(at)), ivec2(0), last);
    // All nine lie in the picture: of an edge along its border, too, each shift by a pixel shows no more than a third.
    ivec2 middle = max(min(around.centre, last - 1), min(ivec2(1), last));
    vec3 sum = vec3(0.0), squares = vec3(0.0), smooth_sum = vec3(0.0);
    float smooth_weights = 0.0, count = 0.0, closest_depth = -1.0, farthest_depth = 2.0;
    around.instances = 0u;
    around.closest = around.centre;
    around.beside = around.centre;
    around.alike = 0u;
    around.instance = load_uint(params.gbuffer.ids, around.centre).r;
    around.depth = load(params.gbuffer.depth, around.centre).r;
    around.mover = params.movers != NO_IMAGE && can_move(scene, around.instance) ? around.instance : 0u;
    around.stays = false;
    uint most = 0u, votes = 0u;
    for (int y = -1; y <= 1; y++) {
        for (int x = -1; x <= 1; x++) {
            ivec2 pixel = clamp(middle + ivec2(x, y), ivec2(0), last);
            vec3 colour = load(params.colour, pixel).rgb;
            if (is_finite(colour)) {
                colour = tone_compress(ycocg_of(colour), params.exposure);
                sum += colour;
                squares += colour * colour;
                count += 1.0;
                // A Gaussian approximation of the Blackman-Harris window, two pixels wide.
                vec2 off = vec2(pixel) + 0.5 - at;
                float weight = exp(-2.29 * dot(off, off));
                smooth_sum += weight * colour;
                smooth_weights += weight;
            }
            float depth = load(params.gbuffer.depth, pixel).r;
            uint instance = load_uint(params.gbuffer.ids, pixel).r;
            if (depth > closest_depth) {
                closest_depth = depth;
                around.closest = pixel;
            }
            farthest_depth = min(farthest_depth, depth);
            around.instances |= instance_bit(instance);
            if (instance == mover) around.stays = true;
            if (instance == around.instance) {
                around.alike++;
            } else {
                if (params.movers != NO_IMAGE && can_move(scene, instance)) around.mover = instance;
                // Majority vote (Boyer and Moore 1991).
                if (votes == 0u) most = instance;
                if (instance == most) around.beside = pixel, votes++;
                else votes--;
            }
        }
    }
    around.seen = count > 0.0;
    count = max(count, 1.0);
    around.mean = sum / count;
    around.deviation = sqrt(non_negative(squares / count - around.mean * around.mean));
    around.smooth_mean = around.seen ? smooth_sum / smooth_weights : vec3(0.0);
    around.depth_least = depth_code(farthest_depth);
    around.depth_most = depth_code(closest_depth);
    return around;
}

// Whether the history shows the surface of the centre, or what is behind and beside it, where that is thinner than a pixel: samples of earlier
// frames may have missed it.
bool was_seen(ViewBuffer view, Around around, uvec2 surfaces) {
    SceneBuffer scene = SceneBuffer(params.scene);
    if (showed(view, scene, surfaces, around.centre, around.depth, around.instance)) return true;
    if (around.alike > THIN || around.beside == around.centre) return false;
    float depth = load(params.gbuffer.depth, around.beside).r;
    return showed(view, scene, surfaces, around.beside, depth, load_uint(params.gbuffer.ids, around.beside).r);
}

// A colour clipped towards the mean of the neighbourhood until it is inside the variance box (Salvi 2016, "An Excursion in Temporal
// Supersampling"), which preserves its hue (Karis 2014). Unchanged if it is inside.
vec3 clip_to(Around around, vec3 colour) {
    vec3 compressed = tone_compress(ycocg_of(colour), params.exposure);
    vec3 off = compressed - around.mean;
    vec3 outside = abs(off) / (CLIP_DEVIATIONS * around.deviation + 1e-5);
    float farthest = max(outside.x, max(outside.y, outside.z));
    if (farthest <= 1.0) return colour;
    return non_negative(rgb_of_ycocg(tone_expand(around.mean + off / farthest, params.exposure)));
}

void main() {
    ViewBuffer view = ViewBuffer(params.view);
    ivec2 pixel = ivec2(gl_GlobalInvocationID.xy);
    vec2 size = vec2(view.at[0].output_size);
    if (!inside(pixel, view.at[0].output_size)) return;

    // This frame's sample of the pixel: the nearest to its centre, blended with the neighbourhood if it lies outside the pixel.
    vec2 scale = vec2(view.at[0].size) / size;
    vec2 at = (vec2(pixel) + 0.5) * scale - view.at[0].jitter;
    uint mover = params.valid != 0u && params.movers != NO_IMAGE ? load_uint(params.movers, pixel).r : 0u;
    Around around = look_around(view, at, mover);
    float own = sample_weight((vec2(around.centre) + 0.5 - at) / scale);
    vec3 now = load(params.colour, around.centre).rgb;
    if (!is_taken(params.not_finite, now)) {
        now = vec3(0.0);
        own = 0.0;
    }
    if (own < 1.0) {
        now = mix(rgb_of_ycocg(tone_expand(around.smooth_mean, params.exposure)), now, own);
    }

    // Reprojection. Edges move with the foreground.
    float closest_depth = load(params.gbuffer.depth, around.closest).r;
    vec2 motion = motion_of(view, around.closest, closest_depth, load(params.gbuffer.motion, around.closest).xy);
    if (!is_taken(params.not_finite, vec3(motion, 0.0))) motion = vec2(2.0);  // off the screen: no history
    vec2 before = (vec2(pixel) + 0.5) / size - motion;
    float still = 1.0 - clamp((length(motion * size) - STILL_PIXELS.x) / (STILL_PIXELS.y - STILL_PIXELS.x), 0.0, 1.0);

    // The history. Without motion nothing comes into sight but where a thing jumps away, so features thinner than a pixel keep their history even if some frames
    // miss them.
    Moments moments = Moments(vec3(0.0), 0.0, vec3(0.0), 0.0);
    vec3 history = vec3(0.0);
    float calm = 0.0;
    bool changes = false;
    ivec2 pixel_before = ivec2(before * size);
    if (params.valid != 0u && on_screen(before)) {
        uvec2 surfaces = load_uint(params.surfaces, pixel_before).xy;
        calm = still * float(surfaces.y >> STILLNESS_SHIFT) / MOST_STILLNESS;
        bool left = mover != 0u && !around.stays && has_departed(view, SceneBuffer(params.scene), surfaces, around.centre, mover);
        if (calm > 0.99 ? !left : was_seen(view, around, surfaces)) {
            vec4 slow = load(params.moments, pixel_before), fast = load(params.fast_moments, pixel_before);
            history = still > 0.99 ? load(params.picture, pixel_before).rgb
                                   : catmull_rom(params.picture, params.sampler_id, before, size);
            if (is_taken(params.not_finite, vec4(history, dot(slow + fast, vec4(1.0))))) {
                moments = Moments(slow.xyz, slow.w, fast.xyz, fast.w);
                changes = (surfaces.y & CHANGES_BIT) != 0u;
            } else {
                history = vec3(0.0);
            }
        }
    }

    if (calm > 0.99 && moments.samples > 0.0) {
        // All samples may miss a thin thing in the very frame in which it arrives.
        if (mover != 0u) around.mover = mover;
        else if (around.mover != 0u) moments.samples = min(moments.samples, LEFT_AFTER_CHANGE * own);
    }
    float changed = 0.0, fast = fast_share(changes);
    bool has_changed = false;
    if (moments.samples > 0.0 && around.seen) {
        float change = change_of(moments, around.mean, around.deviation, fast);
        if (calm > 0.0 && change > CHANGE.x * LIMITS_AMONG_CHANGED) change = change_among(change, changed_around(params.surfaces, pixel_before, scale, ivec2(size)));
        float steady = 1.0 - smoothstep(CHANGE.x, CHANGE.y, change);
        float kept = calm * steady;
        vec3 clipped = kept < 1.0 ? clip_to(around, history) : history;
        if (calm > 0.0) {
            changed = 1.0 - steady;
            has_changed = change > 1.0;
        }
        moments.samples = mix(moments.samples, min(moments.samples, LEFT_AFTER_CHANGE * own), changed);
        history = mix(clipped, history, kept);
        changes = changed > 0.5 || (changes && moments.samples < SETTLED);
        moments.samples = min(moments.samples, mix(MOST_MOVING, MOST_STILL, still));
    }
    float samples = moments.samples;
    float even = 1.0 - smoothstep(EVEN.x, EVEN.y, around.deviation.x / (around.mean.x + 1e-6));
    float weight = own > 0.0 ? max(own, even * (1.0 - min(samples / BRIEF, 1.0))) : 0.0;

    // Update of the mean. A short one is weighted by tone, against flicker of bright samples; that of static pixels is plain.
    float own_share = weight * mix(tone_weight(ycocg_of(now), params.exposure), 1.0, still);
    float old_share = samples * mix(tone_weight(ycocg_of(history), params.exposure), 1.0, still);
    float shares = own_share + old_share;
    float added = changes ? ADDED_WHILE_CHANGING * weight : weight;
    vec3 picture = shares > 0.0 ? (own_share * now + old_share * history) / shares : now;
    // Moments restart where the pixel moves, has changed, or was disoccluded.
    if (around.seen) {
        moments = moments_after(moments, around.mean, around.deviation, fast, samples > 0.0 ? still * (1.0 - changed) : 0.0);
        moments.samples += added;
    }

    store(params.next_picture, pixel, vec4(picture, 1.0));
    store(params.next_moments, pixel, vec4(moments.mean, moments.variance));
    store(params.next_fast_moments, pixel, vec4(moments.fast, moments.samples));
    uint stillness = uint(still * MOST_STILLNESS + 0.5);
    uint depths = around.depth_least | (around.depth_most << 16);
    uint light = (changes ? CHANGES_BIT : 0u) | (has_changed ? HAS_CHANGED_BIT : 0u);
    store_uint(params.next_surfaces, pixel, uvec4(depths, around.instances | light | (stillness << STILLNESS_SHIFT), 0u, 0u));
    if (params.next_movers != NO_IMAGE) store_uint(params.next_movers, pixel, uvec4(around.mover));
}
