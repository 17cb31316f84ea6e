#info A box
#include "DE-Raytracer.frag"
#group Box
// Scale of the box.
uniform float Scale; slider[-3,3,5]
uniform float MinRad2;  slider[0,0.25,2]
uniform int Iterations; slider[0,13,50]
uniform vec3 Tint; slider[(0,0,0),(1,0.5,0),(1,1,1)]
float DE(vec3 p) {
    vec3 w = p;
    float stretch = 1.0;
    for (int n = 0; n < Iterations && dot(w, w) < 1e4; n++) {
        w = 2.0 * clamp(w, -1.0, 1.0) - w;
        float near = dot(w, w), grow = near < MinRad2 ? 1.0 / MinRad2 : (near < 1.0 ? 1.0 / near : 1.0);
        w = w * grow * Scale + p;
        stretch = stretch * grow * abs(Scale) + 1.0;
    }
    return length(w) / stretch;
}
#preset Default
FOV = 0.5
Eye = 1,-2,3
Target = 0,0,0
Up = 0,0,1
Scale = 2
#endpreset
#preset Inside
Scale = -1.5
Iterations = 7
#endpreset
