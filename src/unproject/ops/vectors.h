// Vectors of eight floats, alone or with derivatives, and the functions that shading needs.
//
// A Dual carries derivatives along three directions (forward-mode differentiation). Polynomials are Cephes' (Moshier),
// good to about 2e-7; arguments are assumed finite.

#pragma once

#include <cmath>
#include <cstdint>
#include <cstring>

constexpr int LANES = 8;
typedef float V __attribute__((vector_size(32)));
typedef int32_t I __attribute__((vector_size(32)));
typedef uint32_t U __attribute__((vector_size(32)));

constexpr float PI = 3.14159265358979f;

inline V set(float x) { return V{x, x, x, x, x, x, x, x}; }
inline V select(I mask, V a, V b) { return mask ? a : b; }
inline V larger(V a, float b) { return select(a > b, a, set(b)); }
inline V lesser(V a, float b) { return select(a < b, a, set(b)); }

inline V root(V x) {
    V result;
    for (int k = 0; k < LANES; ++k) result[k] = std::sqrt(x[k]);
    return result;
}

inline V whole(V x) {  // floor
    V result;
    for (int k = 0; k < LANES; ++k) result[k] = std::floor(x[k]);
    return result;
}

inline V as_float(I x) { V y; std::memcpy(&y, &x, sizeof y); return y; }
inline I as_int(V x) { I y; std::memcpy(&y, &x, sizeof y); return y; }

inline V exponential(V x) {
    x = larger(lesser(x, 88.f), -87.f);
    V n = whole(x * 1.44269504f + 0.5f);
    x = x - n * 0.693359375f + n * 2.12194440e-4f;
    V y = ((((1.9875691500e-4f * x + 1.3981999507e-3f) * x + 8.3334519073e-3f) * x + 4.1665795894e-2f) * x +
           1.6666665459e-1f) * x + 5.0000001201e-1f;
    y = y * x * x + x + 1.f;
    return y * as_float((__builtin_convertvector(n, I) + 127) << 23);
}

inline V logarithm(V x) {  // of positive normal numbers
    I bits = as_int(x);
    V e = __builtin_convertvector((bits >> 23) - 126, V);
    V m = as_float((bits & 0x007fffff) | 0x3f000000);  // [0.5, 1)
    I low = m < 0.707106781f;
    e = select(low, e - 1.f, e);
    m = select(low, m + m, m) - 1.f;
    V z = m * m;
    V y = ((((((((7.0376836292e-2f * m - 1.1514610310e-1f) * m + 1.1676998740e-1f) * m - 1.2420140846e-1f) * m +
               1.4249322787e-1f) * m - 1.6668057665e-1f) * m + 2.0000714765e-1f) * m - 2.4999993993e-1f) * m +
           3.3333331174e-1f) * m * z;
    return m + (y - 0.5f * z - 2.12194440e-4f * e) + 0.693359375f * e;
}

inline void turn_cos_sin(V turns, V& cosine, V& sine) {  // of 2π turns, turns in [0, 1)
    V quarter = whole(turns * 4.f + 0.5f);
    V x = (turns * 4.f - quarter) * (PI / 2), z = x * x;
    I q = __builtin_convertvector(quarter, I) & 3;
    V s = ((-1.9515295891e-4f * z + 8.3321608736e-3f) * z - 1.6666654611e-1f) * z * x + x;
    V c = ((2.443315711809948e-5f * z - 1.388731625493765e-3f) * z + 4.166664568298827e-2f) * z * z - 0.5f * z + 1.f;
    I odd = (q & 1) != 0;
    V cs = select(odd, s, c), sn = select(odd, c, s);
    cosine = select((q == 1) | (q == 2), -cs, cs);
    sine = select(q >= 2, -sn, sn);
}

inline V arc(V y, V x) {  // atan2
    V ax = select(x < 0, -x, x), ay = select(y < 0, -y, y);
    I steep = ay > ax;
    V t = select(steep, ax, ay) / larger(select(steep, ay, ax), 1e-30f);
    I far = t > 0.4142135623730950f;
    V w = select(far, (t - 1.f) / (t + 1.f), t), z = w * w;
    V a = (((8.05374449538e-2f * z - 1.38776856032e-1f) * z + 1.99777106478e-1f) * z - 3.33329491539e-1f) * z * w + w;
    a = select(far, a + PI / 4, a);
    a = select(steep, PI / 2 - a, a);
    a = select(x < 0, PI - a, a);
    return select(y < 0, -a, a);
}

constexpr int SLOPES = 3;

struct Dual {
    V v, d[SLOPES];
};

inline V value(V x) { return x; }
inline V value(const Dual& x) { return x.v; }

// f(x) of value y and derivative dy/dx.
inline Dual chain(const Dual& x, V y, V slope) { return {y, {slope * x.d[0], slope * x.d[1], slope * x.d[2]}}; }
inline Dual constant(V x) { return {x, {set(0), set(0), set(0)}}; }

template <class T> T from(V x);
template <> inline V from<V>(V x) { return x; }
template <> inline Dual from<Dual>(V x) { return constant(x); }

inline Dual operator+(const Dual& a, const Dual& b) {
    return {a.v + b.v, {a.d[0] + b.d[0], a.d[1] + b.d[1], a.d[2] + b.d[2]}};
}
inline Dual operator-(const Dual& a, const Dual& b) {
    return {a.v - b.v, {a.d[0] - b.d[0], a.d[1] - b.d[1], a.d[2] - b.d[2]}};
}
inline Dual operator*(const Dual& a, const Dual& b) {
    return {a.v * b.v, {a.d[0] * b.v + a.v * b.d[0], a.d[1] * b.v + a.v * b.d[1], a.d[2] * b.v + a.v * b.d[2]}};
}
inline Dual operator*(const Dual& a, V b) { return {a.v * b, {a.d[0] * b, a.d[1] * b, a.d[2] * b}}; }
inline Dual operator*(V a, const Dual& b) { return b * a; }
inline Dual operator*(const Dual& a, float b) { return a * set(b); }
inline Dual operator*(float a, const Dual& b) { return b * set(a); }
inline Dual operator+(const Dual& a, V b) { return {a.v + b, {a.d[0], a.d[1], a.d[2]}}; }
inline Dual operator+(const Dual& a, float b) { return a + set(b); }
inline Dual operator+(float a, const Dual& b) { return b + set(a); }
inline Dual operator-(const Dual& a) { return a * -1.f; }
inline Dual operator-(const Dual& a, float b) { return a + set(-b); }
inline Dual operator-(float a, const Dual& b) { return -b + set(a); }
inline Dual over(const Dual& x) {
    V y = 1.f / x.v;
    return chain(x, y, -y * y);
}
inline V over(V x) { return 1.f / x; }
inline Dual root(const Dual& x) {
    V y = root(x.v);
    return chain(x, y, 0.5f / larger(y, 1e-18f));
}
inline Dual exponential(const Dual& x) {
    V y = exponential(x.v);
    return chain(x, y, y);
}
inline Dual select(I mask, const Dual& a, const Dual& b) {
    return {select(mask, a.v, b.v), {select(mask, a.d[0], b.d[0]), select(mask, a.d[1], b.d[1]), select(mask, a.d[2], b.d[2])}};
}
inline Dual larger(const Dual& a, float b) { return select(a.v > b, a, constant(set(b))); }
inline Dual lesser(const Dual& a, float b) { return select(a.v < b, a, constant(set(b))); }
inline Dual arc(const Dual& y, const Dual& x) {
    V w = 1.f / larger(x.v * x.v + y.v * y.v, 1e-14f), by_y = x.v * w, by_x = y.v * w;
    return {arc(y.v, x.v), {by_y * y.d[0] - by_x * x.d[0], by_y * y.d[1] - by_x * x.d[1], by_y * y.d[2] - by_x * x.d[2]}};
}

// A 32-bit hash and numbers in [0, 1) of it: low_discrepancy.py.
inline U scramble(U x) {
    x = (x ^ (x >> 16)) * 0x7feb352du;
    x = (x ^ (x >> 15)) * 0x846ca68bu;
    return x ^ (x >> 16);
}
inline V unit(U x) { return __builtin_convertvector(__builtin_convertvector(x >> 8, I), V) * 5.9604644775390625e-8f; }
