// A march as one writes it by hand: one dispatch, a loop with branches. `estimate` is in another file.

override pixel_radius: f32;
override max_steps: u32 = 1000u;

struct Found {
    de: f32,
    inside: bool,
    n: u32,
}

@group(0) @binding(0) var<storage, read> rays: array<f32>;
@group(0) @binding(1) var<storage, read_write> hits: array<f32>;

@compute @workgroup_size(64)
fn march(@builtin(global_invocation_id) id: vec3<u32>) {
    let i = id.x;
    let n = arrayLength(&rays) / 8u;
    if i >= n {
        return;
    }
    let origin = vec3<f32>(rays[i], rays[n + i], rays[2u * n + i]);
    let direction = vec3<f32>(rays[3u * n + i], rays[4u * n + i], rays[5u * n + i]);
    let near = rays[6u * n + i];
    let far = rays[7u * n + i];

    var t = near;
    var front = near;
    var outside = -1.0;
    var inside = -1.0;
    var last = -1.0;
    var status = 2.0;
    var steps = 0u;
    var iterations = 0u;
    if near < far {
        status = 3.0;
        while steps < max_steps {
            let found = estimate(origin + direction * t);
            steps++;
            iterations += found.n;
            let eps = t * pixel_radius;
            if found.inside {
                inside = t;
            } else {
                outside = t;
            }
            if inside >= 0.0 {
                // Between a point outside and one inside: bisect.
                last = max(found.de, 0.0);
                let middle = 0.5 * (inside + outside);
                if outside < 0.0 || inside - outside <= eps * 0.125 || middle <= outside || inside <= middle {
                    t = max(inside, near);
                    status = 1.0;
                    break;
                }
                t = middle;
                continue;
            }
            let de = select(0.0, found.de, found.de >= 0.0);
            if !(de < eps && last < eps && last >= 0.0) {
                front = t;
            }
            last = de;
            var next = t + max(de, eps * 0.25);
            if next <= t {
                next = t + (t * 2.3841858e-7 + 1e-7);
            }
            if next >= far {
                t = far;
                status = 2.0;
                break;
            }
            t = next;
        }
    }
    hits[i] = t;
    hits[n + i] = front;
    hits[2u * n + i] = outside;
    hits[3u * n + i] = inside;
    hits[4u * n + i] = last;
    hits[5u * n + i] = status;
    hits[6u * n + i] = f32(steps);
    hits[7u * n + i] = f32(iterations);
    hits[8u * n + i] = 0.0;
}
