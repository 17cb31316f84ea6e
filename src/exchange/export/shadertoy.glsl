
// ---- The picture ----

const vec3 camera_position = $POSITION;
const vec3 camera_target = $TARGET;
const vec3 camera_up = $UP;
// Height of the picture at distance 1.
const float picture_height = $HEIGHT;
// Everything lies within this distance of the origin.
const float bounding_radius = $RADIUS;
const vec3 sun_direction = $SUN_DIRECTION;
const vec3 sun_colour = $SUN;
const vec3 sky_colour = $SKY;
const vec3 surface_colour = $COLOUR;

// Where the ray enters and leaves the bounding sphere; x > y where it misses.
vec2 bounding_range(vec3 origin, vec3 direction) {
    float b = dot(origin, direction);
    float h = b * b - dot(origin, origin) + bounding_radius * bounding_radius;
    return h < 0.0 ? vec2(1.0, 0.0) : vec2(max(-b - sqrt(h), 0.0), -b + sqrt(h));
}

// The ray parameter of the first point whose estimate is below the hit threshold; -1 where there is none.
float march(vec3 origin, vec3 direction, float pixel) {
    vec2 range = bounding_range(origin, direction);
    float t = range.x;
    for (int i = 0; i < 300 && t < range.y; i++) {
        float de = distance_estimate(origin + t * direction);
        if (de < pixel * max(t, 1e-3)) {
            return t;
        }
        t += de;
    }
    return -1.0;
}

// Differences along the corners of a tetrahedron.
vec3 normal_at(vec3 p, float h) {
    vec3 sum = vec3(0.0);
    for (int i = 0; i < 4; i++) {
        vec3 corner = 2.0 * vec3(((i + 3) >> 1) & 1, (i >> 1) & 1, i & 1) - 1.0;
        sum += corner * distance_estimate(p + h * corner);
    }
    return length(sum) > 0.0 ? normalize(sum) : vec3(0.0, 0.0, 1.0);
}

void mainImage(out vec4 fragColor, in vec2 fragCoord) {
    vec3 forward = normalize(camera_target - camera_position);
    vec3 right = normalize(cross(forward, camera_up));
    vec3 up = cross(right, forward);
    vec2 at = (fragCoord - 0.5 * iResolution.xy) / iResolution.y * picture_height;
    vec3 direction = normalize(forward + at.x * right + at.y * up);
    float pixel = 0.5 * picture_height / iResolution.y;
    vec3 colour = mix($BOTTOM, $TOP, fragCoord.y / iResolution.y);
    float t = march(camera_position, direction, pixel);
    if (t >= 0.0) {
        float h = pixel * max(t, 1e-3);
        vec3 p = camera_position + t * direction;
        vec3 normal = normal_at(p, h);
        float lit = max(dot(normal, sun_direction), 0.0);
        if (lit > 0.0 && march(p + 4.0 * h * normal, sun_direction, pixel) >= 0.0) {
            lit = 0.0;
        }
        vec3 light = sun_colour * lit + sky_colour * (0.5 + 0.5 * dot(normal, camera_up));
        colour = surface_colour * light;
    }
    fragColor = vec4(pow(colour / (1.0 + colour), vec3(1.0 / 2.2)), 1.0);
}
