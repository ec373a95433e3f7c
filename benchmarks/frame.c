/* A frame of benchmarks/frames.py as plain C, one thread: a rope locked at its first particle, with lines 5 and 7, one
   sweep of Gauss-Seidel or some of Jacobi, lines 12-15, and the damping of section 3.5 of Mueller et al. 2007 where there is any. */
#include <math.h>

typedef struct { float x, y, z; } vec;

static inline vec add(vec a, vec b) { return (vec){a.x + b.x, a.y + b.y, a.z + b.z}; }
static inline vec sub(vec a, vec b) { return (vec){a.x - b.x, a.y - b.y, a.z - b.z}; }
static inline vec mul(float s, vec a) { return (vec){s * a.x, s * a.y, s * a.z}; }
static inline float dot(vec a, vec b) { return a.x * b.x + a.y * b.y + a.z * b.z; }
static inline vec cross(vec a, vec b) {
    return (vec){a.y * b.z - a.z * b.y, a.z * b.x - a.x * b.z, a.x * b.y - a.y * b.x};
}

static void damp(int n, const vec *x, vec *v, const float *w, float fraction) {
    float mass = 0.0f, xx = 0.0f, yy = 0.0f, zz = 0.0f, xy = 0.0f, xz = 0.0f, yz = 0.0f;
    vec centre = {0}, velocity = {0}, momentum = {0}, omega = {0};
    for (int i = 0; i < n; i++)
        if (w[i] > 0.0f) {
            float m = 1.0f / w[i];
            mass += m;
            centre = add(centre, mul(m, sub(x[i], x[0])));
            velocity = add(velocity, mul(m, v[i]));
        }
    centre = mul(1.0f / mass, centre);
    velocity = mul(1.0f / mass, velocity);
    for (int i = 0; i < n; i++)
        if (w[i] > 0.0f) {
            float m = 1.0f / w[i];
            vec r = sub(sub(x[i], x[0]), centre);
            momentum = add(momentum, mul(m, cross(r, sub(v[i], velocity))));
            xx += m * (r.y * r.y + r.z * r.z);
            yy += m * (r.x * r.x + r.z * r.z);
            zz += m * (r.x * r.x + r.y * r.y);
            xy -= m * r.x * r.y;
            xz -= m * r.x * r.z;
            yz -= m * r.y * r.z;
        }
    float mean = (xx + yy + zz) / 3.0f;
    if (mean > 0.0f) {
        float s = 1.0f / mean;
        vec l = mul(s, momentum), a = {s * xx, s * xy, s * xz}, b = {s * xy, s * yy, s * yz}, c = {s * xz, s * yz, s * zz};
        vec p = cross(b, c), q = cross(c, a), r = cross(a, b);
        float determinant = dot(a, p), minors = p.x + q.y + r.z;
        if (determinant > 16.0f * 1.1920929e-7f * 1.5f * minors)
            omega = mul(1.0f / determinant, (vec){dot(p, l), dot(q, l), dot(r, l)});
        else {
            vec line = p.x > q.y && p.x > r.z ? p : q.y > r.z ? q : r;
            line = mul(1.0f / sqrtf(dot(line, line)), line);
            omega = mul(1.0f / 1.5f, sub(l, mul(dot(line, l), line)));
        }
    }
    for (int i = 0; i < n; i++)
        if (w[i] > 0.0f) {
            vec rigid = add(velocity, cross(omega, sub(sub(x[i], x[0]), centre)));
            v[i] = add(v[i], mul(fraction, sub(rigid, v[i])));
        }
}

static inline void project(vec *u, const vec *x, const float *w, float rest, int i, int j) {
    float weight = w[i] + w[j];
    if (weight <= 0.0f) return;
    vec d = add(sub(x[i], x[j]), sub(u[i], u[j]));
    float length = sqrtf(dot(d, d));
    if (length <= 0.0f) return;
    vec push = mul(-(length - rest) / (weight * length), d);
    u[i] = add(u[i], mul(w[i], push));
    u[j] = sub(u[j], mul(w[j], push));
}

static inline void jacobi(vec *correction, const vec *x, const vec *u, const float *w, const int *share, float rest,
                          int i, int j) {
    float weight = share[i] * w[i] + share[j] * w[j];
    if (weight <= 0.0f) return;
    vec d = add(sub(x[i], x[j]), sub(u[i], u[j]));
    float length = sqrtf(dot(d, d));
    if (length <= 0.0f) return;
    vec push = mul(-(length - rest) / (weight * length), d);
    correction[i] = add(correction[i], mul(w[i], push));
    correction[j] = sub(correction[j], mul(w[j], push));
}

/* edge: [edges][2], in the order in which they are projected. iterations: of Jacobi with split masses (share: how many
   constraints each particle has); 0: one sweep of Gauss-Seidel. locked: the particle held at the origin, or -1. */
void frame(int n, int edges, int steps, int iterations, const int *edge, const float *rest, const float *w,
           const int *share, float dt, float gravity, float fraction, int locked, vec *x, vec *v, vec *u,
           vec *correction) {
    for (int step = 0; step < steps; step++) {
        for (int i = 0; i < n; i++)
            if (w[i] > 0.0f) v[i].y += dt * gravity;
        if (fraction > 0.0f) damp(n, x, v, w, fraction);
        for (int i = 0; i < n; i++) u[i] = mul(dt, v[i]);
        int held = locked >= 0 && w[locked] > 0.0f;
        if (iterations == 0) {
            for (int k = 0; k < edges; k++) project(u, x, w, rest[k], edge[2 * k], edge[2 * k + 1]);
            if (held) u[locked] = mul(-1.0f, x[locked]);
        }
        for (int iteration = 0; iteration < iterations; iteration++) {
            for (int k = 0; k < edges; k++) jacobi(correction, x, u, w, share, rest[k], edge[2 * k], edge[2 * k + 1]);
            if (held)
                correction[locked] = sub(correction[locked], mul(1.0f / share[locked], add(x[locked], u[locked])));
            for (int i = 0; i < n; i++) {
                u[i] = add(u[i], correction[i]);
                correction[i] = (vec){0.0f, 0.0f, 0.0f};
            }
        }
        for (int i = 0; i < n; i++) {
            v[i] = mul(1.0f / dt, u[i]);
            x[i] = add(x[i], u[i]);
        }
    }
}
