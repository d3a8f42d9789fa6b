#version 460
#extension GL_GOOGLE_include_directive : require
#include "lib/bindless.glsl"
#include "lib/colour.glsl"
#include "lib/gbuffer.glsl"
#include "lib/not_finite.glsl"
#include "lib/reprojection.glsl"
#include "lib/resample.glsl"
#include "lib/surface_codes.glsl"
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
// A change is detected from the mean luma of the 3x3, which varies less with jitter than single samples. STEP limits how far it may be from
// its mean over time, DRIFT how far its fast mean may be: in standard deviations over time, plus a part of the luma itself and a constant.
const vec3 STEP = vec3(7.0, 0.02, 0.01);
const vec3 DRIFT = vec3(1.0, 0.01, 0.005);
// Parts of these limits from which on the history counts less, and from which on it has changed: an edge between them would show.
const vec2 CHANGE = vec2(0.8, 1.2);
// Temporal variance of that luma over its spatial variance: before it is known, and at least, for edges that few samples hit.
const float PRIOR = 0.06;
const float LEAST_VARIANCE = 0.01;
// Weight of a new sample in the fast mean: of steady light, and of light that changes.
const vec2 FAST = vec2(0.125, 0.3);
// Weight of the history after a change, in samples.
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
    uint alike;       // pixels that show the same instance
    ivec2 beside;     // a pixel of the instance that most of the others show, if one does
    bool seen;        // at least one of the colours is finite
};

Around look_around(ViewBuffer view, vec2 at) {
    Around around;
    ivec2 last = ivec2(view.at[0].size) - 1;
    around.centre = clamp(ivec2(floor(at)), ivec2(0), last);
    vec3 sum = vec3(0.0), squares = vec3(0.0), smooth_sum = vec3(0.0);
    float smooth_weights = 0.0, count = 0.0, closest_depth = -1.0, farthest_depth = 2.0;
    around.instances = 0u;
    around.closest = around.centre;
    around.beside = around.centre;
    around.alike = 0u;
    around.instance = load_uint(params.gbuffer.ids, around.centre).r;
    around.depth = load(params.gbuffer.depth, around.centre).r;
    uint most = 0u, votes = 0u;
    for (int y = -1; y <= 1; y++) {
        for (int x = -1; x <= 1; x++) {
            ivec2 pixel = clamp(around.centre + ivec2(x, y), ivec2(0), last);
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
            if (instance == around.instance) {
                around.alike++;
            } else {
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

// Whether the history shows a surface, by depth and instance.
bool showed(ViewBuffer view, uvec2 surfaces, ivec2 pixel, float depth, uint id) {
    uint expected = 0u;
    if (id != 0u) {
        SceneBuffer scene = SceneBuffer(params.scene);
        Instance instance = InstanceBuffer(scene.at[0].instances).at[id - 1u];
        vec3 position = world_position(view, pixel, depth);
        expected = depth_code(depth_before(view, position_before(instance, position)));
    }
    uint least = surfaces.x & 0xffffu, most = surfaces.x >> 16;
    bool near = expected + DEPTH_TOLERANCE >= least && expected <= most + DEPTH_TOLERANCE;
    return near && (surfaces.y & instance_bit(id)) != 0u;
}

// Whether the history shows the surface of the centre, or what is behind and beside it, where that is thinner than a pixel: samples of earlier
// frames may have missed it.
bool was_seen(ViewBuffer view, Around around, uvec2 surfaces) {
    if (showed(view, surfaces, around.centre, around.depth, around.instance)) return true;
    if (around.alike > THIN || around.beside == around.centre) return false;
    float depth = load(params.gbuffer.depth, around.beside).r;
    return showed(view, surfaces, around.beside, depth, load_uint(params.gbuffer.ids, around.beside).r);
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
    Around around = look_around(view, at);
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

    // The history. Without motion there is no disocclusion, so features thinner than a pixel keep their history even if some frames miss
    // them.
    vec4 moments = vec4(0.0);
    vec3 history = vec3(0.0);
    float calm = 0.0;
    bool changes = false;
    if (params.valid != 0u && on_screen(before)) {
        ivec2 pixel_before = ivec2(before * size);
        uvec2 surfaces = load_uint(params.surfaces, pixel_before).xy;
        calm = still * float(surfaces.y >> STILLNESS_SHIFT) / MOST_STILLNESS;
        if (calm > 0.99 || was_seen(view, around, surfaces)) {
            moments = load(params.moments, pixel_before);
            history = still > 0.99 ? load(params.picture, pixel_before).rgb
                                   : catmull_rom(params.picture, params.sampler_id, before, size);
            if (is_taken(params.not_finite, vec4(history, dot(moments, vec4(1.0))))) {
                changes = (surfaces.y & CHANGES_BIT) != 0u;
            } else {
                moments = vec4(0.0);
                history = vec3(0.0);
            }
        }
    }

    float samples = moments.w, luma = around.mean.x;
    float changed = 0.0, fast = changes ? FAST.y : FAST.x;
    if (samples > 0.0 && around.seen) {
        float deviation = sqrt(moments.y + LEAST_VARIANCE * around.deviation.x * around.deviation.x);
        float step_off = abs(luma - moments.x), drift = abs(mix(moments.z, luma, fast) - moments.x);
        vec3 scale = vec3(deviation, max(luma, moments.x), 1.0);
        float off = max(step_off / dot(STEP, scale), drift / dot(DRIFT, scale));
        float steady = 1.0 - smoothstep(CHANGE.x, CHANGE.y, off);
        float kept = calm * steady;
        vec3 clipped = kept < 1.0 ? clip_to(around, history) : history;
        if (calm > 0.0) changed = 1.0 - steady;
        samples = mix(samples, min(samples, LEFT_AFTER_CHANGE), changed);
        history = mix(clipped, history, kept);
        changes = changed > 0.5 || (changes && samples < SETTLED);
        samples = min(samples, mix(MOST_MOVING, MOST_STILL, still));
    }
    float even = 1.0 - smoothstep(EVEN.x, EVEN.y, around.deviation.x / (around.mean.x + 1e-6));
    float weight = own > 0.0 ? max(own, even * (1.0 - min(samples / BRIEF, 1.0))) : 0.0;

    // Update of the mean. A short one is weighted by tone, against flicker of bright samples; that of static pixels is plain.
    float own_share = weight * mix(tone_weight(ycocg_of(now), params.exposure), 1.0, still);
    float old_share = samples * mix(tone_weight(ycocg_of(history), params.exposure), 1.0, still);
    float shares = own_share + old_share;
    float added = changes ? ADDED_WHILE_CHANGING * weight : weight;
    vec3 picture = shares > 0.0 ? (own_share * now + old_share * history) / shares : now;
    // The variance is that around the fast mean, which a change raises only as long as that mean does not know it.
    float share = 1.0 / (1.0 + samples), off = luma - moments.x, off_fast = luma - moments.z;
    vec4 next = vec4(moments.x + share * off, (1.0 - share) * (moments.y + share * off_fast * off_fast), 0.0, samples + added);
    next.z = mix(moments.z, luma, max(share, fast));
    // Moments restart where the pixel moves, has changed, or was disoccluded.
    vec4 fresh = vec4(luma, PRIOR * around.deviation.x * around.deviation.x, luma, samples + added);
    next = mix(fresh, next, samples > 0.0 ? still * (1.0 - changed) : 0.0);
    if (!around.seen) next = vec4(moments.xyz, samples);

    store(params.next_picture, pixel, vec4(picture, 1.0));
    store(params.next_moments, pixel, next);
    uint stillness = uint(still * MOST_STILLNESS + 0.5);
    uint depths = around.depth_least | (around.depth_most << 16);
    store_uint(params.next_surfaces, pixel, uvec4(depths, around.instances | (changes ? CHANGES_BIT : 0u) | (stillness << STILLNESS_SHIFT), 0u, 0u));
}
