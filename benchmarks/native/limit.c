/* The limit: inverse dynamics of the shipped OmniLeg, written by hand for the vector unit.

   The mathematics is that of leg_dynamics/closed_form/_omnileg_composite.py, with what is zero in the shipped file left
   out and gravity along z; numbers.h, generated from the leg, holds its composite parameters as constants. One block is
   as many rows as a vector has lanes: three loads and six shuffles turn rows of three into one vector a coordinate.
   Nothing is validated. Angles up to 1e5 rad. */

#include <math.h>
#include <stdint.h>
#include <string.h>
#if defined(__x86_64__)
#include <immintrin.h>
#elif defined(__aarch64__)
#include <arm_neon.h>
#endif

#include "numbers.h"

#if defined(__AVX512F__) && defined(__AVX512DQ__)
#define LANES 8
#elif defined(__AVX2__)
#define LANES 4
#else
#define LANES 2
#endif

typedef double vec __attribute__((vector_size(8 * LANES), may_alias));
typedef double loose __attribute__((vector_size(8 * LANES), may_alias, aligned(8)));
typedef int64_t ivec __attribute__((vector_size(8 * LANES), may_alias));

#define INLINE static inline __attribute__((always_inline))

typedef struct { vec sin, cos; } sincos;
typedef struct { vec x, y, z; } vec3;

INLINE vec all(double x) { return x - (vec){}; }

/* 1 / sqrt(x). With 512 bits two Newton steps from the 14-bit estimate are faster than the divider, to 1 ulp. */
#if LANES == 8
INLINE vec inverse_root(vec x) {
    vec y = (vec)_mm512_rsqrt14_pd((__m512d)x), half = 0.5 * x;
    y = y + y * (0.5 - (half * y) * y);
    return y + y * (0.5 - (half * y) * y);
}
#elif LANES == 4
INLINE vec inverse_root(vec x) { return (vec)_mm256_sqrt_pd((__m256d)(1.0 / x)); }
#elif defined(__x86_64__)
INLINE vec inverse_root(vec x) { return (vec)_mm_sqrt_pd((__m128d)(1.0 / x)); }
#elif defined(__aarch64__)
INLINE vec inverse_root(vec x) { return (vec)vsqrtq_f64((float64x2_t)(1.0 / x)); }
#else
INLINE vec inverse_root(vec x) { return (vec){1.0 / sqrt(x[0]), 1.0 / sqrt(x[1])}; }
#endif

/* Rows of three to columns and back. */
#if LANES == 8
INLINE vec3 columns(const double *rows) {
    vec a = *(const loose *)rows, b = *(const loose *)(rows + 8), c = *(const loose *)(rows + 16);
    return (vec3){
        __builtin_shuffle(__builtin_shuffle(a, b, (ivec){0, 3, 6, 9, 12, 15, 0, 0}), c, (ivec){0, 1, 2, 3, 4, 5, 10, 13}),
        __builtin_shuffle(__builtin_shuffle(a, b, (ivec){1, 4, 7, 10, 13, 0, 0, 0}), c, (ivec){0, 1, 2, 3, 4, 8, 11, 14}),
        __builtin_shuffle(__builtin_shuffle(a, b, (ivec){2, 5, 8, 11, 14, 0, 0, 0}), c, (ivec){0, 1, 2, 3, 4, 9, 12, 15}),
    };
}
INLINE void rows(double *to, vec x, vec y, vec z) {
    *(loose *)to = __builtin_shuffle(
        __builtin_shuffle(x, y, (ivec){0, 8, 0, 1, 9, 0, 2, 10}), z, (ivec){0, 1, 8, 3, 4, 9, 6, 7});
    *(loose *)(to + 8) = __builtin_shuffle(
        __builtin_shuffle(x, y, (ivec){0, 3, 11, 0, 4, 12, 0, 5}), z, (ivec){10, 1, 2, 11, 4, 5, 12, 7});
    *(loose *)(to + 16) = __builtin_shuffle(
        __builtin_shuffle(x, y, (ivec){13, 0, 6, 14, 0, 7, 15, 0}), z, (ivec){0, 13, 2, 3, 14, 5, 6, 15});
}
#elif LANES == 4
INLINE vec3 columns(const double *rows) {
    vec a = *(const loose *)rows, b = *(const loose *)(rows + 4), c = *(const loose *)(rows + 8);
    vec low = __builtin_shuffle(a, b, (ivec){0, 1, 6, 7}); /* x0 y0 x2 y2 */
    vec mid = __builtin_shuffle(a, c, (ivec){2, 3, 4, 5}); /* z0 x1 z2 x3 */
    vec top = __builtin_shuffle(b, c, (ivec){0, 1, 6, 7}); /* y1 z1 y3 z3 */
    return (vec3){
        __builtin_shuffle(low, mid, (ivec){0, 5, 2, 7}),
        __builtin_shuffle(low, top, (ivec){1, 4, 3, 6}),
        __builtin_shuffle(mid, top, (ivec){0, 5, 2, 7}),
    };
}
INLINE void rows(double *to, vec x, vec y, vec z) {
    vec low = __builtin_shuffle(x, y, (ivec){0, 4, 2, 6}); /* x0 y0 x2 y2 */
    vec mid = __builtin_shuffle(z, x, (ivec){0, 5, 2, 7}); /* z0 x1 z2 x3 */
    vec top = __builtin_shuffle(y, z, (ivec){1, 5, 3, 7}); /* y1 z1 y3 z3 */
    *(loose *)to = __builtin_shuffle(low, mid, (ivec){0, 1, 4, 5});
    *(loose *)(to + 4) = __builtin_shuffle(top, low, (ivec){0, 1, 6, 7});
    *(loose *)(to + 8) = __builtin_shuffle(mid, top, (ivec){2, 3, 6, 7});
}
#else
INLINE vec3 columns(const double *rows) {
    return (vec3){(vec){rows[0], rows[3]}, (vec){rows[1], rows[4]}, (vec){rows[2], rows[5]}};
}
INLINE void rows(double *to, vec x, vec y, vec z) {
    to[0] = x[0], to[1] = y[0], to[2] = z[0], to[3] = x[1], to[4] = y[1], to[5] = z[1];
}
#endif

/* Quarter turns off, then the minimax polynomials of fdlibm on [-pi/4, pi/4]; no branch. */
INLINE sincos turn(vec x) {
    const double shifter = 0x1.8p52;
    vec shifted = x * 0x1.45f306dc9c883p-1 + shifter, quarters = shifted - shifter;
    ivec k = (ivec)shifted;
    vec r = x - quarters * 0x1.921fb54442d18p0;
    r = r - quarters * 0x1.1a62633145c07p-54;
    vec z = r * r;
    vec s = 1.58969099521155010221e-10 * z - 2.50507602534068634195e-08;
    s = s * z + 2.75573137070700676789e-06;
    s = s * z - 1.98412698298579493134e-04;
    s = s * z + 8.33333333332248946124e-03;
    s = s * z - 1.66666666666666324348e-01;
    s = r + (r * z) * s;
    vec c = -1.13596475577881948265e-11 * z + 2.08757232129817482790e-09;
    c = c * z - 2.75573143513906633035e-07;
    c = c * z + 2.48015872894767294178e-05;
    c = c * z - 1.38888888888741095749e-03;
    c = c * z + 4.16666666666666019037e-02;
    c = c * z - 0.5;
    c = c * z + 1.0;
    const ivec sign = (ivec)all(-0.0);
#if LANES == 8
    __mmask8 odd = _mm512_test_epi64_mask((__m512i)k, _mm512_set1_epi64(1));
    vec a = (vec)_mm512_mask_blend_pd(odd, (__m512d)s, (__m512d)c);
    vec b = (vec)_mm512_mask_blend_pd(odd, (__m512d)c, (__m512d)s);
#else
    ivec odd = -(k & 1);
    vec a = (vec)(((ivec)s & ~odd) | ((ivec)c & odd)), b = (vec)(((ivec)c & ~odd) | ((ivec)s & odd));
#endif
    return (sincos){(vec)((ivec)a ^ ((k << 62) & sign)), (vec)((ivec)b ^ (((k + 1) << 62) & sign))};
}

INLINE vec3 block(vec3 q, vec3 v, vec3 acc) {
    sincos A = turn(q.x), B = turn(q.y), C = turn(q.z);
    vec sa = A.sin, ca = A.cos, sb = B.sin, cb = B.cos, sg = C.sin, cg = C.cos;

    /* where the thigh and the Cardan shaft are */
    vec lever = ca * sb, s = inverse_root(cb * cb + lever * lever), s2 = s * s;
    vec cbs = cb * s, j = s * (sa * sb);
    vec sin_theta = cbs * sa, cos_theta = s * ca, theta_alpha = cb * s2;
    vec rx = s * lever, rz = cos_theta * cb, yx = sin_theta * sb, yz = sin_theta * cb;
    vec P = sg * cb, Q = cg * cos_theta - sg * yx;
    vec w = 1.0 / (P * P + Q * Q);
    vec x = cg * rx - sg * sin_theta, u = sg * rx + cg * sin_theta;

    /* how it moves */
    vec V = v.y * cos_theta, spin = v.y * sin_theta, push = v.x * rx;
    vec theta = theta_alpha * v.x - j * V;
    vec half_lag = push * (V - j * theta);
    vec X = cos_theta * acc.y - 2.0 * (spin * theta);
    vec Y = theta_alpha * acc.x - j * X - 2.0 * half_lag;
    vec fall = sb * X + yz * Y + rz * (theta * theta + V * V);
    vec cos_fall = sg * acc.z + cg * (v.z * v.z);

    /* the Cardan shaft and its crosses */
    vec S = P * V + Q * theta, nu = Q * V - P * theta;
    vec along = v.z * rz, xi = v.z * x, zag = rz * acc.z;
    vec tilt = S + xi, a1 = w * (nu - along * u), ua = u * a1, n = along - ua;
    vec a2 = w * (Q * X - P * Y - u * zag - along * S - tilt * (n - ua));
    vec n2 = zag - v.z * (sb * V + yz * theta) - u * a2 - a1 * tilt;
    vec moment_a = CARDAN_A * a2 + CARDAN_C * (along * xi * w), moment_n = CARDAN_SPIN * n2;
    vec turning = CARDAN_SPIN * n;
    vec about_p = w * (moment_a - u * moment_n - turning * S), about_q = w * (turning * nu);
    vec gamma_4 = (rz * w) * (moment_n - u * moment_a + CARDAN_C * (zag - 2.0 * (xi * a1)));

    /* torques: about theta, along V, then about the motors */
    vec weight = LOAD + KNEE_LIFT * cos_fall, out_x = SPIN_2 * (v.x * push);
    vec about = TRANSVERSE * Y - SPIN_1 * (V * spin) + sin_theta * (sb * out_x + cb * weight) + (Q * about_q - P * about_p);
    vec sweep = (TRANSVERSE - SPIN_1) * X + (sb * weight - cb * out_x) + (Q * about_p + P * about_q);
    vec drag = SHANK * cos_fall + KNEE_LIFT * fall + SHANK_WEIGHT;
    return (vec3){
        (INERTIA_ALPHA + SPIN_2 * (rx * rx)) * acc.x + theta_alpha * about + (2.0 * SPIN_2) * (cb * half_lag),
        (INERTIA_BETA + SPIN_1) * acc.y + cos_theta * (sweep - j * about),
        INERTIA_GAMMA * acc.z + sg * drag + gamma_4,
    };
}

INLINE void some(int64_t count, const double *q, const double *v, const double *a, double *out) {
    double in[3][3 * LANES] = {{0}}, result[3 * LANES];
    memcpy(in[0], q, 24 * count), memcpy(in[1], v, 24 * count), memcpy(in[2], a, 24 * count);
    vec3 tau = block(columns(in[0]), columns(in[1]), columns(in[2]));
    rows(result, tau.x, tau.y, tau.z);
    memcpy(out, result, 24 * count);
}

int lanes(void) { return LANES; }

/* q, v, a and out are (n, 3), row by row; out must be none of the others. */
void torque(int64_t n, const double *restrict q, const double *restrict v, const double *restrict a, double *restrict out) {
    int64_t i = 0;
    /* Two blocks at a time, interleaved by the scheduler (-fschedule-insns), hide each other's latency. */
#pragma GCC unroll 2
    for (; i + LANES <= n; i += LANES) {
        vec3 tau = block(columns(q + 3 * i), columns(v + 3 * i), columns(a + 3 * i));
        rows(out + 3 * i, tau.x, tau.y, tau.z);
    }
    if (i < n) some(n - i, q + 3 * i, v + 3 * i, a + 3 * i, out + 3 * i);
}

/* The same, one call a row: what one sample costs inside C. All lanes compute the same row. */
INLINE vec3 spread(const double *row) { return (vec3){all(row[0]), all(row[1]), all(row[2])}; }
__attribute__((noinline)) static void one(const double *q, const double *v, const double *a, double *out) {
    vec3 tau = block(spread(q), spread(v), spread(a));
    out[0] = tau.x[0], out[1] = tau.y[0], out[2] = tau.z[0];
}
void torque_by_row(int64_t n, const double *q, const double *v, const double *a, double *out) {
    for (int64_t i = 0; i < n; i++) one(q + 3 * i, v + 3 * i, a + 3 * i, out + 3 * i);
}
