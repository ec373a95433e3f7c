/* The Jacobi sweep of benchmarks/step.py as plain C: the same loads, the same scatter, one thread. */
#include <math.h>

void sweep(int edges, int particles, int iterations, const int *edge, const float *rest, const float *x, const float *w,
           const int *share, float relaxation, float *u, float *correction) {
    for (int iteration = 0; iteration < iterations; iteration++) {
        for (int k = 0; k < edges; k++) {
            int i = edge[2 * k], j = edge[2 * k + 1];
            float weight = share[i] * w[i] + share[j] * w[j];
            if (weight <= 0.0f) continue;
            float d[3], n[3] = {1.0f, 0.0f, 0.0f};
            for (int a = 0; a < 3; a++) d[a] = (x[3 * i + a] - x[3 * j + a]) + (u[3 * i + a] - u[3 * j + a]);
            float length = sqrtf(d[0] * d[0] + d[1] * d[1] + d[2] * d[2]);
            if (length > 0.0f)
                for (int a = 0; a < 3; a++) n[a] = d[a] / length;
            float lam = -relaxation * (length - rest[k]) / weight;
            for (int a = 0; a < 3; a++) {
                correction[3 * i + a] += w[i] * lam * n[a];
                correction[3 * j + a] -= w[j] * lam * n[a];
            }
        }
        for (int a = 0; a < 3 * particles; a++) {
            u[a] += correction[a];
            correction[a] = 0.0f;
        }
    }
}

/* The same sweep as fast as plain C makes it here: arrays of components instead of vectors, what does not change from
   sweep to sweep taken out of them, and no scatter, so that gcc vectorises all of it. Each particle gathers from its
   `width` constraints: slot [width][particles], `edges` where it has fewer, sign [width][particles].
   start: x_i - x_j, [3][edges]; scale: relaxation over the denominator; push: room, [3][edges + 1]; u: [3][particles]. */
void sweep_gather(int edges, int particles, int iterations, int width, const int *restrict first,
                  const int *restrict second, const float *restrict rest, const float *restrict start,
                  const float *restrict scale, const float *restrict w, const int *restrict slot,
                  const float *restrict sign, float *restrict u, float *restrict push) {
    const float *sx = start, *sy = start + edges, *sz = start + 2 * edges;
    float *ux = u, *uy = u + particles, *uz = u + 2 * particles;
    float *px = push, *py = push + edges + 1, *pz = push + 2 * (edges + 1);
    px[edges] = py[edges] = pz[edges] = 0.0f;
    for (int iteration = 0; iteration < iterations; iteration++) {
#pragma GCC ivdep
        for (int k = 0; k < edges; k++) {
            int i = first[k], j = second[k];
            float dx = sx[k] + (ux[i] - ux[j]), dy = sy[k] + (uy[i] - uy[j]), dz = sz[k] + (uz[i] - uz[j]);
            float length = sqrtf(dx * dx + dy * dy + dz * dz);
            float lam = length > 0.0f ? -scale[k] * (length - rest[k]) / length : 0.0f;
            px[k] = lam * dx;
            py[k] = lam * dy;
            pz[k] = lam * dz;
        }
        for (int d = 0; d < width; d++) {
            const int *at = slot + d * particles;
            const float *s = sign + d * particles;
#pragma GCC ivdep
            for (int i = 0; i < particles; i++) {
                float factor = s[i] * w[i];
                ux[i] += factor * px[at[i]];
                uy[i] += factor * py[at[i]];
                uz[i] += factor * pz[at[i]];
            }
        }
    }
}
