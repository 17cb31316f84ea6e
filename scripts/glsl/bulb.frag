#version 300 es
// A ray marcher as they are written by hand: the power-8 Mandelbulb with 20 iterations, bailout 10. Spherical angles,
// running derivative, estimate r ln r / 2dr, stop at one pixel's width.
precision highp float;
uniform vec2 size;
out vec4 colour;

const vec3 EYE = vec3(1.2, -2.4, 1.2);
const float FAR = 50.0;

float distance_to_bulb(vec3 p) {
    vec3 z = p;
    float dr = 1.0;
    float r = 0.0;
    for (int i = 0; i < 20; i++) {
        r = length(z);
        if (r > 10.0) break;
        float theta = asin(z.z / r) * 8.0;
        float phi = atan(z.y, z.x) * 8.0;
        dr = pow(r, 7.0) * 8.0 * dr + 1.0;
        z = pow(r, 8.0) * vec3(cos(theta) * cos(phi), cos(theta) * sin(phi), sin(theta)) + p;
    }
    return 0.5 * log(r) * r / dr;
}

#define DISTANCE distance_to_bulb
