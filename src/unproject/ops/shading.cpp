// Radiance of maps under ambient or natural light, and the gradient of its sum with given weights.
//
// shading.py has the formulas and the plain reference, with the same names and order. Eight pixels are computed at a
// time and samples are not stored. The gradient computes the samples again, as Duals with derivatives by the roughness
// and along two tangents of the normal; the albedos enter linearly.

#include <algorithm>

#include "vectors.h"

struct Job {
    const float *maps, *camera, *table, *turn, *pool, *along, *diffuse, *gradient;
    const int64_t *which, *seed;
    float* out;
    int64_t pixels, rows, columns, lobes, lights, stratum;
    int32_t natural, independent, albedo, fixed;
    float f0;
};

namespace {

constexpr float TINY = 1e-6f, LEAST = 1e-12f, LEAST_ROUGHNESS = 1e-3f, BRIGHT = 0.04f, LEAST_SINE = 1e-4f;

template <class T>
struct Pixel {
    T frame[3][3], o[3], m, inverse_m2, seen, base;  // seen: G1(ωo) / cosθo
    V k_d[3], k_s, f0, f90, diffuse, length, base_by_k_s, f90_by_k_s, spoilt;
};

template <class T>
inline T dot(const T* a, const T* b) { return a[0] * b[0] + a[1] * b[1] + a[2] * b[2]; }

template <class T>
inline T fifth(const T& cos) {  // (1 - cosθ)⁵
    T x = lesser(larger(1.f - cos, 0.f), 1.f), x2 = x * x;
    return x2 * x2 * x;
}

template <class T>
inline T smith_over_cos(T cos, const T& m) {
    cos = larger(cos, TINY);
    T slope = m * root(larger(1.f - cos * cos, TINY * TINY));
    T a = cos * over(slope);
    T fit = (3.535f + 2.181f * a) * over(slope * (1.f + a * (2.276f + 2.577f * a)));
    return select(value(a) < 1.6f, fit, over(cos));
}

template <class T>
inline void tangents(const T& x, const T& y, const T& z, T frame[3][3]) {
    T a = -over(1.f + z), b = x * y * a;
    T rows[3][3] = {{1.f + x * x * a, b, -x}, {b, 1.f + y * y * a, -y}, {x, y, z}};
    std::copy(&rows[0][0], &rows[0][0] + 9, &frame[0][0]);
}

inline V load(const float* from, const int64_t* index) {
    V x;
    for (int k = 0; k < LANES; ++k) x[k] = from[index[k]];
    return x;
}

template <class T>
struct Normal;

template <>
struct Normal<V> {
    static void make(const V n[3], V m, Pixel<V>& p) {
        p.m = larger(m, LEAST_ROUGHNESS);
        tangents(n[0], n[1], n[2], p.frame);
    }
};

template <>
struct Normal<Dual> {  // derivative 0: by the roughness; 1 and 2: along the tangents of the normal
    static void make(const V n[3], V m, Pixel<Dual>& p) {
        V frame[3][3];
        tangents(n[0], n[1], n[2], frame);
        p.m = {larger(m, LEAST_ROUGHNESS), {select(m >= LEAST_ROUGHNESS, set(1), set(0)), set(0), set(0)}};
        Dual x = {n[0], {set(0), frame[0][0], frame[1][0]}}, y = {n[1], {set(0), frame[0][1], frame[1][1]}},
             z = {n[2], {set(0), frame[0][2], frame[1][2]}};
        tangents(x, y, z, p.frame);
    }
};

template <class T>
Pixel<T> make_pixel(const Job& job, int64_t batch, const int64_t* index) {
    Pixel<T> p;
    const float* maps = job.maps + batch * 8 * job.pixels;
    const float* camera = job.camera + batch * 3 * job.pixels;
    V n[3];
    for (int c = 0; c < 3; ++c) {
        p.k_d[c] = load(maps + c * job.pixels, index);
        n[c] = load(maps + (5 + c) * job.pixels, index);
    }
    p.k_s = load(maps + 3 * job.pixels, index);
    p.length = root(larger(dot(n, n), LEAST));
    for (int c = 0; c < 3; ++c) n[c] = n[c] / p.length;
    const V m = load(maps + 4 * job.pixels, index);
    Normal<T>::make(n, m, p);
    T toward[3];
    for (int c = 0; c < 3; ++c) toward[c] = from<T>(load(camera + c * job.pixels, index));
    for (int c = 0; c < 3; ++c) p.o[c] = dot(p.frame[c], toward);
    // 0, or NaN: clamps would hide NaN, and diverged training must be noticed.
    p.spoilt = 0.f * (m + n[0] + n[1] + n[2] + value(p.o[2]));
    p.inverse_m2 = over(p.m * p.m);
    p.seen = smith_over_cos(p.o[2], p.m);
    p.diffuse = select(value(p.o[2]) > TINY, load(job.diffuse + batch * job.pixels, index), set(float(job.lobes)));
    p.base = from<T>(set(1));
    p.base_by_k_s = p.f90_by_k_s = set(0);
    p.f0 = set(job.f0), p.f90 = set(1);
    if (job.albedo) {
        p.f0 = p.k_s, p.f90 = lesser(p.k_s / BRIGHT, 1);
        p.f90_by_k_s = select(p.k_s <= BRIGHT, set(1 / BRIGHT), set(0));
        T x = fifth(select(value(p.o[2]) < 0, -p.o[2], p.o[2]));
        p.base = 1.f - (from<T>(p.f0) + x * (p.f90 - p.f0));
        p.base_by_k_s = select(value(p.base) >= 0, -(1.f + value(x) * (p.f90_by_k_s - 1.f)), set(0));
        p.base = select(value(p.base) >= 0, p.base, from<T>(set(0)));
    }
    return p;
}

// Radiance and density in a direction in the material's frame; with derivatives if the direction has them.
struct Seen {
    alignas(32) float all[4 * LANES], by_column[4 * LANES], by_row[4 * LANES];

    template <bool slopes>
    void gather(const Job& job, int64_t which, V column, V row) {
        const float width = float(job.columns);
        V left = whole(column), upper = lesser(whole(row), float(job.rows - 2));
        V across = column - left, down = row - upper;
        left = left - width * whole(left / width);
        const float* table = job.table + which * job.rows * job.columns * 4;
        for (int k = 0; k < LANES; ++k) {
            const float at = left[k];  // a NaN direction must not read out of bounds
            int64_t i = at > 0 ? std::min(int64_t(at), job.columns - 1) : 0, right = i + 1 == job.columns ? 0 : i + 1;
            const float* line = table + int64_t(upper[k]) * job.columns * 4;
            const float *a = line + i * 4, *b = line + right * 4, *c = a + job.columns * 4, *d = b + job.columns * 4;
            for (int j = 0; j < 4; ++j) {
                float top = a[j] + (b[j] - a[j]) * across[k], low = c[j] + (d[j] - c[j]) * across[k];
                all[j * LANES + k] = top + (low - top) * down[k];
                if (slopes) {
                    by_column[j * LANES + k] = (b[j] - a[j]) + ((d[j] - c[j]) - (b[j] - a[j])) * down[k];
                    by_row[j * LANES + k] = low - top;
                }
            }
        }
    }

    static V take(const float* from, int j) { V x; std::memcpy(&x, from + j * LANES, sizeof x); return x; }
    V read(int j, V, V) const { return take(all, j); }
    Dual read(int j, const Dual& column, const Dual& row) const {
        V u = take(by_column, j), v = take(by_row, j);
        return {take(all, j), {u * column.d[0] + v * row.d[0], u * column.d[1] + v * row.d[1], u * column.d[2] + v * row.d[2]}};
    }
};

template <class T>
void look_up(const Job& job, int64_t which, float turn, const T* direction, T light[4]) {
    T around = direction[0] * direction[0] + direction[1] * direction[1];
    I away = value(around) > 1e-14f;
    T sine = root(larger(around, 1e-14f));
    T azimuth = arc(select(away, direction[1], from<T>(set(0))), select(away, direction[0], from<T>(set(1))));
    T column = (azimuth - turn) * (float(job.columns) / (2 * PI)) - 0.5f;
    T row = arc(sine, direction[2]) * (float(job.rows) / PI) - 0.5f;
    row = lesser(larger(row, 0.f), float(job.rows - 1));
    Seen seen;
    seen.gather<sizeof(T) != sizeof(V)>(job, which, value(column), value(row));
    for (int j = 0; j < 4; ++j) light[j] = seen.read(j, column, row);
    light[3] = light[3] * over(larger(sine, LEAST_SINE));
}

// Microfacet terms of two directions: D, its density of reflected directions, (1 - ωo·h)⁵.
template <class T>
struct Facets {
    T d, density, fresnel;
    I facing;

    Facets(const Pixel<T>& p, const T i[3]) {
        T h[3] = {i[0] + p.o[0], i[1] + p.o[1], i[2] + p.o[2]};
        T inverse = over(root(larger(dot(h, h), TINY * TINY)));
        for (auto& x : h) x = x * inverse;
        T o_h = dot(p.o, h);
        T tan2 = lesser((h[0] * h[0] + h[1] * h[1]) * over(larger(h[2] * h[2], TINY * TINY)), 1e8f);
        T spread = 1.f + tan2;
        d = exponential(-tan2 * p.inverse_m2) * spread * spread * p.inverse_m2 * (1 / PI);
        facing = (value(i[2]) > 0) & (value(p.o[2]) > TINY);
        density = d * larger(h[2], 0.f) * over(larger(o_h, TINY) * 4.f);
        density = select(facing, density, from<T>(set(0)));
        fresnel = fifth(o_h);
    }
};

template <class T>
T weight(const Job& job, const Pixel<T>& p, const T i[3], const Facets<T>& facets, const T& light_density) {
    T density = larger(i[2], 0.f) * (p.diffuse * (1 / PI)) + facets.density * (float(job.lobes) - p.diffuse) +
                light_density * float(job.lights);
    return over(larger(density, LEAST));
}

// A lobe's direction in the frame of the normal.
template <class T>
void sample_lobe(const Pixel<T>& p, V u, V v, I diffuse, T i[3]) {
    V cosine, sine;
    turn_cos_sin(v, cosine, sine);
    V depth = -logarithm(1.f - larger(lesser(u, 1 - TINY), TINY));
    T c = over(root(1.f + p.m * p.m * depth)), s = p.m * root(depth) * c;
    T h[3] = {s * cosine, s * sine, c};
    T twice = dot(p.o, h) * 2.f;
    V flat = root(u), direction[3] = {flat * cosine, flat * sine, root(1.f - u)};
    for (int k = 0; k < 3; ++k) i[k] = select(diffuse, from<T>(direction[k]), twice * h[k] - p.o[k]);
}

template <class T>
void to_world(const Pixel<T>& p, const T i[3], T world[3]) {
    for (int k = 0; k < 3; ++k) world[k] = i[0] * p.frame[0][k] + i[1] * p.frame[1][k] + i[2] * p.frame[2][k];
}

// The sums of a block of pixels: radiance, or the gradient of its sum with weights g.
struct Sums {
    V radiance[3], by_k_d[3], by_k_s, slopes[SLOPES], g[3];
};

// base and lobe: f cosθi = k_d base + lobe, the lobe also by k_s.
template <class T>
void reflected(const Job& job, const Pixel<T>& p, const T i[3], const Facets<T>& facets, T& base, T& lobe, V& lobe_by_k_s) {
    base = p.base * larger(i[2], 0.f) * (1 / PI);
    T common = facets.d * smith_over_cos(i[2], p.m) * p.seen * larger(i[2], 0.f) * 0.25f;
    common = select(facets.facing, common, from<T>(set(0)));
    T fresnel = from<T>(p.f0) + facets.fresnel * (p.f90 - p.f0);
    if (job.albedo) {
        lobe = common * fresnel;
        lobe_by_k_s = value(common) * (1.f + value(facets.fresnel) * (p.f90_by_k_s - 1.f));
    } else {
        lobe = common * fresnel * p.k_s;
        lobe_by_k_s = value(common * fresnel);
    }
}

inline void add(const Job& job, const Pixel<V>& p, const V i[3], const Facets<V>& facets, const V light[3], V w, Sums& sums) {
    V base, lobe, by_k_s;
    reflected(job, p, i, facets, base, lobe, by_k_s);
    for (int c = 0; c < 3; ++c) sums.radiance[c] += (p.k_d[c] * base + lobe) * light[c] * w;
}

inline void add(const Job& job, const Pixel<Dual>& p, const Dual i[3], const Facets<Dual>& facets, const Dual light[3],
                const Dual& w, Sums& sums) {
    Dual base, lobe, all = light[0] * sums.g[0], coloured = light[0] * (sums.g[0] * p.k_d[0]);
    V by_k_s;
    reflected(job, p, i, facets, base, lobe, by_k_s);
    for (int c = 1; c < 3; ++c) {
        all = all + light[c] * sums.g[c];
        coloured = coloured + light[c] * (sums.g[c] * p.k_d[c]);
    }
    Dual y = (coloured * base + all * lobe) * w;
    for (int k = 0; k < SLOPES; ++k) sums.slopes[k] += y.d[k];
    for (int c = 0; c < 3; ++c) sums.by_k_d[c] += sums.g[c] * light[c].v * base.v * w.v;
    V falling = p.base_by_k_s * larger(i[2].v, 0.f) * (1 / PI);
    sums.by_k_s += (coloured.v * falling + all.v * by_k_s) * w.v;
}

// One sample of S-valued pixels `source`, weighted as part of the T-valued `p`: equal unless samples are fixed.
template <class S, class T>
void weigh(const Job& job, const Pixel<S>& source, const Pixel<T>& p, const S i[3], const S world[3], const S light[4], Sums& sums) {
    Facets<S> facets(source, i);
    S w = weight(job, source, i, facets, light[3]);
    if constexpr (sizeof(S) == sizeof(T)) {
        add(job, p, i, facets, light, w, sums);
    } else {
        T fixed[3], local[3], radiance[3];
        for (int k = 0; k < 3; ++k) fixed[k] = from<T>(world[k]), radiance[k] = from<T>(light[k]);
        for (int k = 0; k < 3; ++k) local[k] = dot(p.frame[k], fixed);
        add(job, p, local, Facets<T>(p, local), radiance, from<T>(w), sums);
    }
}

template <class S, class T>
void integrate(const Job& job, int64_t batch, const int64_t* index, const Pixel<S>& source, const Pixel<T>& p, Sums& sums) {
    const uint32_t seed = uint32_t(job.seed[batch]);
    U pixel;
    for (int k = 0; k < LANES; ++k) pixel[k] = uint32_t(index[k]) * 4u;
    const U shift[3] = {scramble(pixel ^ seed), scramble((pixel + 1u) ^ seed), scramble((pixel + 2u) ^ seed)};
    S i[3], world[3], light[4];
    for (int64_t s = 0; s < job.lobes; ++s) {
        V at[2];
        for (int k = 0; k < 2; ++k) {
            V x = unit(job.independent ? scramble(shift[k] + uint32_t(s) * 0x9e3779b9u) : shift[k]);
            at[k] = job.independent ? x : x + job.along[2 * s + k];
            at[k] = at[k] - whole(at[k]);
        }
        sample_lobe(source, at[0], at[1], set(float(s)) < source.diffuse, i);
        to_world(source, i, world);
        if (job.natural) look_up(job, job.which[batch], job.turn[batch], world, light);
        else for (int k = 0; k < 4; ++k) light[k] = from<S>(set(k < 3));
        weigh(job, source, p, i, world, light, sums);
    }
    const int64_t entries = job.lights * job.stratum;
    for (int64_t s = 0; s < job.lights; ++s) {
        const float* pool = job.pool + batch * entries * 8;
        alignas(32) float drawn[8][LANES];
        const U hashed = scramble(shift[2] + uint32_t(s) * 0x9e3779b9u);
        for (int k = 0; k < LANES; ++k) {
            int64_t entry = job.independent ? hashed[k] % entries : s * job.stratum + shift[2][k] % job.stratum;
            for (int j = 0; j < 7; ++j) drawn[j][k] = pool[entry * 8 + j];
        }
        V row[7];
        std::memcpy(row, drawn, sizeof row);
        for (int k = 0; k < 3; ++k) world[k] = from<S>(row[k]);
        for (int k = 0; k < 4; ++k) light[k] = from<S>(row[3 + k]);
        for (int k = 0; k < 3; ++k) i[k] = dot(source.frame[k], world);
        weigh(job, source, p, i, world, light, sums);
    }
}

void store(float* to, const int64_t* index, int count, V x) {
    for (int k = 0; k < count; ++k) to[index[k]] = x[k];
}

template <bool back>
void run(const Job& job, int64_t batch, int64_t first) {
    int64_t index[LANES];
    const int count = int(std::min<int64_t>(LANES, job.pixels - first));
    for (int k = 0; k < LANES; ++k) index[k] = first + std::min(k, count - 1);
    Sums sums;
    std::memset(&sums, 0, sizeof sums);
    const Pixel<V> plain = make_pixel<V>(job, batch, index);
    if constexpr (!back) {
        integrate(job, batch, index, plain, plain, sums);
        for (int c = 0; c < 3; ++c) store(job.out + (batch * 3 + c) * job.pixels, index, count, sums.radiance[c] + plain.spoilt);
    } else {
        const Pixel<Dual> p = make_pixel<Dual>(job, batch, index);
        for (int c = 0; c < 3; ++c) sums.g[c] = load(job.gradient + (batch * 3 + c) * job.pixels, index);
        if (job.fixed) integrate(job, batch, index, plain, p, sums);
        else integrate(job, batch, index, p, p, sums);
        float* out = job.out + batch * 8 * job.pixels;
        for (int c = 0; c < 3; ++c) {
            store(out + c * job.pixels, index, count, sums.by_k_d[c]);
            V along = (sums.slopes[1] * plain.frame[0][c] + sums.slopes[2] * plain.frame[1][c]) / plain.length;
            store(out + (5 + c) * job.pixels, index, count, along);
        }
        store(out + 3 * job.pixels, index, count, sums.by_k_s);
        store(out + 4 * job.pixels, index, count, sums.slopes[0] + plain.spoilt);
    }
}

}  // namespace

// Blocks of eight pixels from `begin` to `end`, counted through the batch.
extern "C" int shade(const Job* job, int64_t begin, int64_t end) {
    const int64_t blocks = (job->pixels + LANES - 1) / LANES;
    for (int64_t k = begin; k < end; ++k)
        job->gradient ? run<true>(*job, k / blocks, k % blocks * LANES) : run<false>(*job, k / blocks, k % blocks * LANES);
    return 0;  // it allocates nothing
}
