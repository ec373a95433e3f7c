/* A chain by the classical Runge-Kutta method on accelerations, in double precision: four eliminations a step, then
   positions back onto the lengths and velocities onto their tangent. Scratch: 20 doubles a particle. */
#include <stddef.h>

typedef struct { double x, y, z; } vec;

static inline vec sub(vec a, vec b) { return (vec){a.x - b.x, a.y - b.y, a.z - b.z}; }
static inline vec add(vec a, double s, vec b) { return (vec){a.x + s * b.x, a.y + s * b.y, a.z + s * b.z}; }
static inline double dot(vec a, vec b) { return a.x * b.x + a.y * b.y + a.z * b.z; }

/* Solves (J W J^T) lam = right and gives W J^T lam: right is -|d'|^2 - d.(g' - g) (what = 0), -(|d|^2 - L^2) / 2 (1) or
   -d.d' (2). */
static void solve(int n, int what, vec g, const double *w, const double *rest, const vec *x, const vec *v,
                  vec *d, double *lower, double *y, vec *out) {
    vec before = {0, 0, 0};
    double inverse = 0, known = 0;
    for (int k = 0; k + 1 < n; ++k) {
        vec e = sub(x[k + 1], x[k]), rate = sub(v[k + 1], v[k]);
        double off = -w[k] * dot(before, e), size = dot(e, e), right;
        if (what == 0)
            right = -dot(rate, rate) - ((w[k + 1] > 0) - (w[k] > 0)) * dot(e, g);
        else
            right = what == 1 ? -0.5 * (size - rest[k] * rest[k]) : -dot(e, rate);
        double coupling = off * inverse;
        inverse = 1.0 / ((w[k] + w[k + 1]) * size - off * coupling);
        known = (right - off * known) * inverse;
        d[k] = before = e;
        lower[k] = coupling;
        y[k] = known;
    }
    vec ahead = {0, 0, 0};
    double lam = 0, coupling = 0;
    for (int k = n - 1; k >= 0; --k) {
        vec pull = {0, 0, 0};
        if (k) {
            lam = y[k - 1] - coupling * lam;
            coupling = lower[k - 1];
            pull = add(pull, lam, d[k - 1]);
        }
        out[k] = add((vec){0, 0, 0}, w[k], sub(pull, ahead));
        if (what == 0 && w[k] > 0)
            out[k] = add(out[k], 1.0, g);
        ahead = pull;
    }
}

void chain_rk4(int n, int steps, double h, const double *gravity, const double *w, const double *rest, vec *x, vec *v,
               double *scratch) {
    vec g = {gravity[0], gravity[1], gravity[2]};
    vec *d = (vec *)scratch, *a = d + n, *xs = a + n, *vs = xs + n, *sum_x = vs + n, *sum_v = sum_x + n;
    double *lower = (double *)(sum_v + n), *y = lower + n;
    const double part[4] = {0.5, 0.5, 1.0, 0.0}, weight[4] = {1.0 / 6, 1.0 / 3, 1.0 / 3, 1.0 / 6};
    for (int step = 0; step < steps; ++step) {
        for (int i = 0; i < n; ++i) {
            xs[i] = sum_x[i] = x[i];
            vs[i] = sum_v[i] = v[i];
        }
        for (int s = 0; s < 4; ++s) {
            solve(n, 0, g, w, rest, xs, vs, d, lower, y, a);
            for (int i = 0; i < n; ++i) {
                sum_x[i] = add(sum_x[i], weight[s] * h, vs[i]);
                sum_v[i] = add(sum_v[i], weight[s] * h, a[i]);
                xs[i] = add(x[i], part[s] * h, vs[i]);
                vs[i] = add(v[i], part[s] * h, a[i]);
            }
        }
        solve(n, 1, g, w, rest, sum_x, sum_v, d, lower, y, a);
        for (int i = 0; i < n; ++i)
            x[i] = add(sum_x[i], 1.0, a[i]);
        solve(n, 2, g, w, rest, x, sum_v, d, lower, y, a);
        for (int i = 0; i < n; ++i)
            v[i] = add(sum_v[i], 1.0, a[i]);
    }
}
