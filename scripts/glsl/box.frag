#version 300 es
// A ray marcher as they are written by hand: the Mandelbox of scale 2 with 20 iterations, bailout 100. Running derivative,
// estimate r / dr, stop at one pixel's width.
precision highp float;
uniform vec2 size;
out vec4 colour;

const vec3 EYE = vec3(9.6, -18.0, 9.4);
const float FAR = 50.0;

float distance_to_box(vec3 p) {
    vec3 z = p;
    float dr = 1.0;
    for (int i = 0; i < 20; i++) {
        z = clamp(z, -1.0, 1.0) * 2.0 - z;
        float r2 = dot(z, z);
        float scale = r2 < 0.25 ? 4.0 : r2 < 1.0 ? 1.0 / r2 : 1.0;
        z = z * (scale * 2.0) + p;
        dr = dr * (scale * 2.0) + 1.0;
        if (dot(z, z) > 10000.0) break;
    }
    return length(z) / dr;
}

#define DISTANCE distance_to_box
