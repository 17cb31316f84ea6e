// The Mandelbox of scale 2 with its scalar derivative: fold at a box, fold at a sphere, scale, add c.

fn estimate(c: vec3<f32>) -> Found {
    var z = c;
    var dr = 1.0;
    var n = 0u;
    var inside = true;
    while n < 10u {
        n++;
        z = clamp(z, vec3<f32>(-1.0), vec3<f32>(1.0)) * 2.0 - z;
        let k = 2.0 / clamp(dot(z, z), 0.25, 1.0);
        z = z * k + c;
        dr = dr * k + 1.0;
        if dot(z, z) > 3600.0 {
            inside = false;
            break;
        }
    }
    if inside {
        return Found(0.0, true, n);
    }
    return Found(max(length(z) - 10.392305, 0.0) / dr, false, n);
}
