/* The yardstick: Runge-Kutta steps of many chains by hand, in C with vector types.

   The algorithm of npend_gym/physics/kernels (sincos, dynamics, rk4), without torque and damping:
   one vector holds the same quantity of WIDTH chains, everything a step needs stays in the cache.
   gcc -O3 -march=native -ffp-contract=off -shared -fPIC; contraction would change the results. */

#include <stdint.h>

#ifndef WIDTH
#define WIDTH 8
#endif
#define MAX_RODS 1000

typedef double pack __attribute__((vector_size(8 * WIDTH), aligned(8)));
typedef int64_t mask __attribute__((vector_size(8 * WIDTH), aligned(8)));

static inline pack spread(double x) { return x - (pack){}; }
static inline pack where(mask m, pack a, pack b) {
    return (pack)((m & (mask)a) | (~m & (mask)b));
}

static inline void sincos_pack(pack x, pack *s, pack *c) {
    const double ROUND = 6755399441055744.0;
    pack shifted = x * 6.36619772367581382433e-01 + ROUND;
    pack q = shifted - ROUND;
    pack first = x - q * 1.57079632673412561417e+00;
    pack w = q * 6.07710050630396597660e-11;
    pack r = first - w;
    w = q * 2.02226624879595063154e-21 - ((first - r) - w);
    pack y = r - w;
    pack y_low = (r - y) - w;
    pack z = y * y;
    pack p = 8.33333333332248946124e-03
        + z * (-1.98412698298579493134e-04
        + z * (2.75573137070700676789e-06
        + z * (-2.50507602534068634195e-08 + z * 1.58969099521155010221e-10)));
    pack sin_y = y - ((z * (0.5 * y_low - (z * y) * p) - y_low)
        - (z * y) * -1.66666666666666324348e-01);
    p = z * (4.16666666666666019037e-02
        + z * (-1.38888888888741095749e-03
        + z * (2.48015872894767294178e-05
        + z * (-2.75573143513906633035e-07
        + z * (2.08757232129817482790e-09 + z * -1.13596475577881948265e-11)))));
    pack hz = 0.5 * z;
    pack top = 1.0 - hz;
    pack cos_y = top + (((1.0 - top) - hz) + (z * p - y * y_low));
    pack half = 0.5 * q;
    mask swap = (half + ROUND) - ROUND != half;
    pack quarter = 0.5 * where(swap, half - 0.5, half);
    mask turn = (quarter + ROUND) - ROUND != quarter;
    pack sin_x = where(swap, cos_y, sin_y), cos_x = where(swap, sin_y, cos_y);
    *s = where(turn, -sin_x, sin_x);
    *c = where(turn ^ swap, -cos_x, cos_x);
}

/* v: inverse masses at joints 0..n; l, inverse lengths il: n; gravity g */
static void accelerations(
    int n, const pack *theta, const pack *omega, const pack *v, const pack *l, const pack *il,
    pack g, pack *alpha
) {
    static pack s[MAX_RODS + 2], c[MAX_RODS + 2], t[MAX_RODS + 2], link[MAX_RODS + 2];
    sincos_pack(theta[0], &s[0], &c[0]);
    for (int i = 1; i < n; i++) sincos_pack(theta[i] - theta[i - 1], &s[i], &c[i]);
    c[n] = s[n] = spread(0.0);
    t[0] = t[n + 1] = spread(0.0); /* tension of rod i is t[i + 1] */
    int middle = n / 2;
    pack q_top = spread(0.0), z_top = q_top, q_tip = q_top, z_tip = q_top;
    for (int i = 0; i < middle; i++) {
        pack o = c[i] * v[i], rhs = l[i] * (omega[i] * omega[i]);
        if (i == 0) rhs += g * c[0];
        q_top = 1.0 / ((v[i] + v[i + 1]) - (o * o) * q_top);
        z_top = (rhs + o * z_top) * q_top;
        t[i + 1] = z_top;
        link[i] = (c[i + 1] * v[i + 1]) * q_top;
        int j = n - 1 - i;
        if (j > middle) {
            o = c[j + 1] * v[j + 1];
            q_tip = 1.0 / ((v[j] + v[j + 1]) - (o * o) * q_tip);
            z_tip = (l[j] * (omega[j] * omega[j]) + o * z_tip) * q_tip;
            t[j + 1] = z_tip;
            link[j] = (c[j] * v[j]) * q_tip;
        }
    }
    pack o = c[middle] * v[middle], below = c[middle + 1] * v[middle + 1];
    pack rhs = l[middle] * (omega[middle] * omega[middle]);
    if (middle == 0) rhs += g * c[0];
    pack pivot = ((v[middle] + v[middle + 1]) - (o * o) * q_top) - (below * below) * q_tip;
    pack up = ((rhs + o * z_top) + below * z_tip) / pivot, down = up;
    t[middle + 1] = up;
    for (int i = 1; i <= middle; i++) {
        up = t[middle - i + 1] + link[middle - i] * up;
        t[middle - i + 1] = up;
        if (middle + i < n) {
            down = t[middle + i + 1] + link[middle + i] * down;
            t[middle + i + 1] = down;
        }
    }
    for (int i = 0; i < n; i++)
        alpha[i] = (v[i + 1] * (t[i + 2] * s[i + 1]) - v[i] * (t[i] * s[i])) * il[i];
    alpha[0] -= (g * s[0]) * il[0];
}

/* Take `steps` steps of h seconds with each of `groups` groups of WIDTH chains: arrays are
   [group][rod][lane], as in the package. */
void rk4(
    int groups, int n, int steps, double h, double gravity, double *thetas, double *omegas,
    const double *vs, const double *ls, const double *ils
) {
    static pack a1[MAX_RODS], a2[MAX_RODS], a3[MAX_RODS], a4[MAX_RODS];
    static pack w2[MAX_RODS], w3[MAX_RODS], w4[MAX_RODS], x[MAX_RODS];
    pack g = spread(gravity);
    double sixth = h / 6.0;
    for (int group = 0; group < groups; group++) {
        pack *theta = (pack *)thetas + group * n, *omega = (pack *)omegas + group * n;
        const pack *v = (const pack *)vs + group * (n + 1);
        const pack *l = (const pack *)ls + group * n, *il = (const pack *)ils + group * n;
        for (int step = 0; step < steps; step++) {
            accelerations(n, theta, omega, v, l, il, g, a1);
            for (int i = 0; i < n; i++) {
                x[i] = theta[i] + 0.5 * h * omega[i];
                w2[i] = omega[i] + 0.5 * h * a1[i];
            }
            accelerations(n, x, w2, v, l, il, g, a2);
            for (int i = 0; i < n; i++) {
                x[i] = theta[i] + 0.5 * h * w2[i];
                w3[i] = omega[i] + 0.5 * h * a2[i];
            }
            accelerations(n, x, w3, v, l, il, g, a3);
            for (int i = 0; i < n; i++) {
                x[i] = theta[i] + h * w3[i];
                w4[i] = omega[i] + h * a3[i];
            }
            accelerations(n, x, w4, v, l, il, g, a4);
            for (int i = 0; i < n; i++) {
                theta[i] += sixth * ((omega[i] + w4[i]) + 2.0 * (w2[i] + w3[i]));
                omega[i] += sixth * ((a1[i] + a4[i]) + 2.0 * (a2[i] + a3[i]));
            }
        }
    }
}
