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
