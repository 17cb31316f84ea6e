// The power-8 Mandelbulb with its scalar derivative: both angles by complex squares, without trigonometry.

fn square(a: vec2<f32>) -> vec2<f32> {
    return vec2<f32>(a.x * a.x - a.y * a.y, 2.0 * a.x * a.y);
}

fn estimate(c: vec3<f32>) -> Found {
    var z = c;
    var dr = 1.0;
    var n = 0u;
    var inside = true;
    while n < 6u {
        n++;
        let r2 = dot(z, z);
        dr = 8.0 * dr * r2 * r2 * r2 * sqrt(r2) + 1.0;
        let q = dot(z.xy, z.xy);
        var turn = vec2<f32>(1.0, 0.0);
        var rho = 0.0;
        if q > 1e-30 {
            let per_rho = inverseSqrt(q);
            turn = z.xy * per_rho;
            rho = q * per_rho;
        }
        let tilt8 = square(square(square(vec2<f32>(z.z, rho))));
        let turn8 = square(square(square(turn)));
        z = vec3<f32>(tilt8.y * turn8, tilt8.x) + c;
        if dot(z, z) > 100.0 {
            inside = false;
            break;
        }
    }
    if inside {
        return Found(0.0, true, n);
    }
    let r = length(z);
    return Found(max(0.5 * log(r) * r / dr, 0.0), false, n);
}
