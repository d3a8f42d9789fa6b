#ifndef LIB_SURFEL_PLANE_GLSL
#define LIB_SURFEL_PLANE_GLSL
// Local linear regression of the light that surfels share over their places on a surface.

// Added to the squares of places, the latter over the number of surfels: what few of them say of a slope counts less.
const vec2 RIDGE = vec2(0.02, 0.25);

// Weighted sums over surfels, a surfel itself among them, from which a plane follows through the light that they share, over their places on the surface.
struct Plane {
    float weights;
    vec2 place;         // over the reach
    vec3 squares;       // of places: xx, yy, xy
    float light;        // luminance
    vec2 place_light;
    float squared_weights;
    float least;        // luminance that one of them shares
    float most;
};

const Plane NO_PLANE = Plane(0.0, vec2(0.0), vec3(0.0), 0.0, vec2(0.0), 0.0, 3.4e38, 0.0);

void add_to_plane(inout Plane sum, vec2 place, float light, float weight) {
    sum.weights += weight;
    sum.place += weight * place;
    sum.squares += weight * vec3(place * place, place.x * place.y);
    sum.light += weight * light;
    sum.place_light += weight * light * place;
    sum.squared_weights += weight * weight;
    sum.least = min(sum.least, light);
    sum.most = max(sum.most, light);
}

// Light of the plane at the surfel, over the mean: they differ where most of the others are on one side, as along an edge. It stays between the least and the
// most that one of them shares, so that surfels which take light from each other can't raise it from frame to frame.
float at_surfel(Plane sum) {
    if (!(sum.light > 0.0)) return 1.0;
    float scale = 1.0 / sum.weights;
    vec2 place = scale * sum.place;
    float light = scale * sum.light;
    vec3 squares = scale * sum.squares - vec3(place * place, place.x * place.y);
    squares.xy += RIDGE.x + RIDGE.y * sum.squared_weights * scale * scale;
    vec2 covariance = scale * sum.place_light - light * place;
    vec2 slope = vec2(squares.y * covariance.x - squares.z * covariance.y, squares.x * covariance.y - squares.z * covariance.x) / (squares.x * squares.y - squares.z * squares.z);
    return clamp(light - dot(slope, place), sum.least, sum.most) / light;
}

#endif
