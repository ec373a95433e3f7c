/* The Newton iterations of kernels/newton.py as plain C, for rigid links along paths and the gradient at the end of the
   step, one thread. A link is eliminated with the particle behind it, without a proximal compliance. The matrices are
   symmetric, and six numbers of each are kept. Compiled for double or, with -DREAL=float, for float. */
#include <tgmath.h>

#ifndef REAL
#define REAL double
#endif

typedef struct { REAL x, y, z; } Vec;
typedef struct { REAL xx, xy, xz, yy, yz, zz; } Sym;

typedef struct {
    Sym inverse;       /* of the particle's block, its link behind eliminated */
    Vec solution;
    Vec gain;
    REAL known;
    Vec gradient;      /* of the link ahead */
    REAL kappa;
} Place;

static inline Vec add(Vec a, Vec b) { return (Vec){a.x + b.x, a.y + b.y, a.z + b.z}; }
static inline Vec sub(Vec a, Vec b) { return (Vec){a.x - b.x, a.y - b.y, a.z - b.z}; }
static inline Vec scaled(REAL s, Vec a) { return (Vec){s * a.x, s * a.y, s * a.z}; }
static inline REAL dot(Vec a, Vec b) { return a.x * b.x + a.y * b.y + a.z * b.z; }

static inline Vec times(const Sym *s, Vec a) {
    return (Vec){s->xx * a.x + s->xy * a.y + s->xz * a.z, s->xy * a.x + s->yy * a.y + s->yz * a.z,
                 s->xz * a.x + s->yz * a.y + s->zz * a.z};
}

static inline Sym inverted(const Sym *s) {
    REAL xx = s->yy * s->zz - s->yz * s->yz, xy = s->xz * s->yz - s->xy * s->zz, xz = s->xy * s->yz - s->xz * s->yy;
    REAL r = (REAL)1.0 / (s->xx * xx + s->xy * xy + s->xz * xz);
    return (Sym){r * xx, r * xy, r * xz, r * (s->xx * s->zz - s->xz * s->xz), r * (s->xy * s->xz - s->xx * s->yz),
                 r * (s->xx * s->yy - s->xy * s->xy)};
}

/* k (1 - g g^T) (a): across the link. */
static inline Vec across(REAL k, Vec g, Vec a) { return scaled(k, sub(a, scaled(dot(g, a), g))); }

/* The particles of path p are first[p] .. first[p + 1] - 1; lam[s] is of the link from s to s + 1. */
void eliminate(int paths, int iterations, const int *first, const REAL *rest, const Vec *x, const REAL *w,
               const Vec *base, Place *place, REAL *lam, Vec *u) {
    for (int p = 0; p < paths; p++) {
        int begin = first[p], end = first[p + 1];
        for (int iteration = 0; iteration < iterations; iteration++) {
            Sym P = {0};
            Vec m = {0}, g = {0}, force = {0};
            REAL k = (REAL)0.0, c = (REAL)0.0;
            for (int s = begin; s < end; s++) {
                /* The particle behind and the link behind, as this particle sees them. */
                Vec h = times(&P, g);
                REAL e = dot(g, h), kk = k * k, rhs = c - dot(g, m);
                REAL behind = kk * e + k;
                Vec q = sub(g, across(k, g, h)), b = sub(across(k, g, m), force);
                Sym A = {k - kk * (P.xx - (REAL)2.0 * g.x * h.x) - behind * g.x * g.x,
                         -kk * (P.xy - g.x * h.y - h.x * g.y) - behind * g.x * g.y,
                         -kk * (P.xz - g.x * h.z - h.x * g.z) - behind * g.x * g.z,
                         k - kk * (P.yy - (REAL)2.0 * g.y * h.y) - behind * g.y * g.y,
                         -kk * (P.yz - g.y * h.z - h.y * g.z) - behind * g.y * g.z,
                         k - kk * (P.zz - (REAL)2.0 * g.z * h.z) - behind * g.z * g.z};

                g = force = (Vec){0};
                k = c = (REAL)0.0;
                if (s + 1 < end) {
                    Vec d = add(sub(x[s], x[s + 1]), sub(u[s], u[s + 1]));
                    REAL length = sqrt(dot(d, d));
                    g = length > (REAL)0.0 ? scaled((REAL)1.0 / length, d) : (Vec){(REAL)1.0, (REAL)0.0, (REAL)0.0};
                    c = rest[s] - length;
                    if (length > (REAL)0.0) k = -lam[s] / length;
                    if (k < (REAL)0.0) k = fmax(k, -(REAL)0.2 / fmax(w[s], w[s + 1]));
                    force = scaled(lam[s], g);
                }

                Place at = {.gradient = g, .kappa = k};
                if (w[s] > (REAL)0.0) {
                    REAL mass = (REAL)1.0 / w[s], diagonal = mass + k;
                    A.xx += diagonal - k * g.x * g.x;
                    A.xy -= k * g.x * g.y;
                    A.xz -= k * g.x * g.z;
                    A.yy += diagonal - k * g.y * g.y;
                    A.yz -= k * g.y * g.z;
                    A.zz += diagonal - k * g.z * g.z;
                    b = add(b, sub(force, scaled(mass, sub(u[s], base[s]))));
                    P = inverted(&A);
                    m = times(&P, b);
                    Vec t = times(&P, q);
                    REAL pivot = e + dot(q, t);
                    if (pivot > (REAL)0.0) {
                        at.gain = scaled((REAL)1.0 / pivot, t);
                        at.known = rhs / pivot + dot(at.gain, b);
                        m = sub(m, scaled(at.known, t));
                        P.xx -= t.x * at.gain.x;
                        P.xy -= t.x * at.gain.y;
                        P.xz -= t.x * at.gain.z;
                        P.yy -= t.y * at.gain.y;
                        P.yz -= t.y * at.gain.z;
                        P.zz -= t.z * at.gain.z;
                    }
                } else {
                    P = (Sym){0};
                    m = (Vec){0};
                    if (e > (REAL)0.0) at.known = rhs / e;
                }
                at.inverse = P;
                at.solution = m;
                place[s] = at;
            }

            Vec du = {0};
            REAL dlam = (REAL)0.0;
            for (int s = end - 1; s >= begin; s--) {
                const Place *at = &place[s];
                Vec pull = add(across(at->kappa, at->gradient, du), scaled(dlam, at->gradient));
                du = add(at->solution, times(&at->inverse, pull));
                dlam = at->known + dot(at->gain, pull);
                u[s] = add(u[s], du);
                if (s > begin) lam[s - 1] += dlam;
            }
        }
    }
}
