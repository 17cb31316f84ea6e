// The second half of each marcher: rays of a pinhole camera, steps of the estimate's length until it is below the width of
// a pixel, a normal from six more estimates, one light and no shadow.
vec3 normal_at(vec3 p, float h) {
    vec2 e = vec2(h, 0.0);
    return normalize(vec3(
        DISTANCE(p + e.xyy) - DISTANCE(p - e.xyy),
        DISTANCE(p + e.yxy) - DISTANCE(p - e.yxy),
        DISTANCE(p + e.yyx) - DISTANCE(p - e.yyx)));
}

void main() {
    vec3 forward = normalize(-EYE);
    vec3 right = normalize(cross(forward, vec3(0.0, 0.0, 1.0)));
    vec3 up = cross(right, forward);
    vec2 at = gl_FragCoord.xy / size - 0.5;
    vec3 direction = normalize(right * at.x * (size.x / size.y) + forward + up * at.y);
    float t = 0.0;
    bool hit = false;
    for (int i = 0; i < 1000; i++) {
        float de = DISTANCE(EYE + direction * t);
        if (de < t / size.y) {
            hit = true;
            break;
        }
        t += de;
        if (t > FAR) break;
    }
    if (!hit) {
        colour = vec4(0.125, 0.1875, 0.3125, 1.0);
        return;
    }
    vec3 n = normal_at(EYE + direction * t, t / size.y);
    vec3 light = normalize(right * -0.5 + up * 0.7071 - forward * 0.5);
    colour = vec4(vec3(0.8 * (0.1 + max(0.0, dot(n, light)))), 1.0);
}
